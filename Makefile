# fleetcal: `make demo` shows it, `make test` proves it.

SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help

CARGO ?= cargo
BUILT := $(or $(CARGO_TARGET_DIR),target)
BIN := $(BUILT)/release/fleetcal
PYTHON := $(abspath $(BUILT))/python/bin/python
ZENOHD := $(abspath $(BUILT))/zenohd/bin/zenohd
# Steps of this run, with what each took: `.ci/run` has further ones behind those of `make test`.
export FLEETCAL_STEPS ?= $(abspath $(BUILT))/steps.jsonl
STEP = python3 tests/steps.py run
export NPM_CONFIG_FUND = false
export NPM_CONFIG_AUDIT = false
export NPM_CONFIG_UPDATE_NOTIFIER = false

.PHONY: help
help: ## Lists the targets
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | awk -F ':.*## ' '{printf "  make %-18s %s\n", $$1, $$2}'

.PHONY: demo
demo: announce dashboard rust ## Builds and starts service, router and six simulated robots: http://127.0.0.1:8080
	@# With the features of all crates, as `make build` has them; their other binaries are left out.
	$(CARGO) build --release --locked --workspace --bin fleetcal
	@.ci/dependencies keep $(BUILT)
	$(BIN) demo

.PHONY: announce
announce:
	@[ -x $(BIN) ] || echo "Builds the dashboard and the service from about 700 crates: some 12 minutes on two cores, once. Then six simulated robots drive: http://127.0.0.1:8080"

.PHONY: build
build: dashboard rust ## Builds the dashboard and the binary
	$(CARGO) build --release --locked --workspace
	@.ci/dependencies keep $(BUILT)

.PHONY: dashboard
dashboard: web/dist/index.html ## Builds the dashboard's pages

# Types made from the API's description are in no page: checking makes them anew.
web/dist/index.html: web/node_modules/.package-lock.json docs/glossary.md $(shell find web/src web/public web/index.html web/vite.config.ts -type f -not -name schema.d.ts 2>/dev/null)
	cd web && npm run build --silent
	@touch $@

web/node_modules/.package-lock.json: web/package.json web/package-lock.json | node
	cd web && npm ci --no-progress --prefer-offline
	@touch $@

.PHONY: node
node:
	@node -e 'const [major, minor] = process.versions.node.split(".").map(Number); process.exit((major === 20 && minor >= 19) || (major === 22 && minor >= 13) || major >= 24 ? 0 : 1)' 2>/dev/null \
	  || { echo "Node.js 20.19, 22.13 or 24 and newer is missing: install it with npm, then run make again." >&2; exit 1; }

.PHONY: rust
rust:
	@command -v $(CARGO) >/dev/null \
	  || { echo "Rust is missing: install rustup, which reads rust-toolchain.toml, then run make again." >&2; exit 1; }
	@command -v cc >/dev/null \
	  || { echo "A C compiler is missing (SQLite is built from source): install gcc, then run make again." >&2; exit 1; }
	@.ci/dependencies restore $(BUILT)

.PHONY: chromium
chromium:
	@command -v chromium >/dev/null || command -v chromium-browser >/dev/null || { \
	  if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
	    apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq chromium >/dev/null; \
	  else \
	    echo "Chromium is missing: install the package chromium, then run make again." >&2; exit 1; \
	  fi; }

.PHONY: strace
strace:
	@command -v strace >/dev/null || { \
	  if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
	    apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq strace >/dev/null; \
	  else \
	    echo "strace is missing, which the power-loss test needs: install the package strace, then run make again." >&2; exit 1; \
	  fi; }

.PHONY: python
python: $(BUILT)/python/ready

$(BUILT)/python/ready: tests/requirements.txt
	@python3 -c 'import ensurepip, venv' 2>/dev/null || { \
	  if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
	    apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq python3-venv >/dev/null; \
	  else \
	    echo "Python 3 with venv is missing, which the Python example's test needs: install the package python3-venv, then run make again." >&2; exit 1; \
	  fi; }
	@python3 -m venv --clear $(BUILT)/python
	@$(PYTHON) -m pip install --quiet --disable-pip-version-check -r $< \
	  || { echo "The packages of $< could not be installed: PyPI has to be reachable once for the Python example's test." >&2; exit 1; }
	@touch $@

# The crate graph is among the Rust tests. Each step is a target of its own, timed.
TEST_STEPS = packages dashboard format build-for-tests doc clippy check-web test-rust test-web-units test-browser
.PHONY: test
test: ## Runs all checks and tests, and prints what each step took
	@command -v python3 >/dev/null || { echo "Python 3 is missing: install python3, then run make again." >&2; exit 1; }
	@mkdir -p "$$(dirname $(FLEETCAL_STEPS))" && rm -f $(FLEETCAL_STEPS)
	@failed=0; for step in $(TEST_STEPS); do \
	  $(STEP) $$step $(MAKE) --no-print-directory $$step || { failed=1; break; }; \
	done; python3 tests/steps.py table; exit $$failed

.PHONY: packages
packages: node rust chromium strace python web/node_modules/.package-lock.json ## Packages that the tests use, where they are missing

.PHONY: quick
quick: dashboard rust ## The inner loop: format, clippy and unit tests of what a change touches and of what is above it
	.ci/quick $(CARGO)

.PHONY: check
check: lint ## Format, lints, types, documentation and the crate graph
	@# Shows the crates and what each may use; fails on a circle.
	$(CARGO) test --release --locked -p fleetcal-architecture -- --nocapture --test-threads 1

.PHONY: lint
lint: format doc clippy check-web ## Format, lints, types and documentation

.PHONY: format
format: rust
	$(CARGO) fmt --check

.PHONY: clippy
clippy: dashboard rust
	$(CARGO) clippy --release --locked --workspace --all-targets -- -D warnings
	@# Tests that need a server are no target of the others.
	$(CARGO) clippy --release --locked --workspace --test postgres -- -D warnings
	@.ci/dependencies keep $(BUILT)

.PHONY: check-web
check-web: dashboard
	cd web && npm run check --silent

.PHONY: build-for-tests
build-for-tests: dashboard rust
	@# Binary and tests in one go: apart, their features differ and Zenoh is compiled twice.
	$(CARGO) build --release --locked --workspace --bins --tests
	@.ci/dependencies keep $(BUILT)

# Places for tests, as .config/nextest.toml gives them out: many tests wait for processes and for real time.
PLACES = $$(( $$(nproc) * 3 ))
# What needs recordings is `make test-recordings`: the rest passes with no folder beside it.
.PHONY: test-rust
test-rust: build-for-tests strace python ## Rust tests, end-to-end ones included
	if $(CARGO) nextest --version >/dev/null 2>&1; then \
	  env -u FLEETCAL_DATA FLEETCAL_BIN=$(abspath $(BIN)) FLEETCAL_PYTHON=$(PYTHON) \
	    $(CARGO) nextest run --release --locked --workspace --bins --tests --test-threads $(PLACES) -E 'not test(/^recordings::/) and (not binary(cluster) or test(/^(checker|figures|progress)::/))'; \
	else \
	  env -u FLEETCAL_DATA FLEETCAL_BIN=$(abspath $(BIN)) FLEETCAL_PYTHON=$(PYTHON) \
	    $(CARGO) test --release --locked --workspace -- --test-threads 2 \
	    --skip recordings:: --skip instances_share_the_robots --skip who_does_not_fit_does_not_start --skip rounds:: \
	    --skip two_instances_cost --skip instances_are_upgraded --skip a_cell_has_as_many \
	    --skip a_machine_that_is_gone --skip requests_pass_haproxy; \
	fi

.PHONY: test-recordings
test-recordings: build-for-tests ## Tests on recordings of real robots, in the folder FLEETCAL_DATA
	@[ -n "$${FLEETCAL_DATA:-}" ] && [ -d "$$FLEETCAL_DATA" ] \
	  || { echo "FLEETCAL_DATA: got '$${FLEETCAL_DATA:-}', expected the folder with the recordings." >&2; exit 1; }
	FLEETCAL_DATA="$$(cd "$$FLEETCAL_DATA" && pwd)" FLEETCAL_BIN=$(abspath $(BIN)) \
	  $(CARGO) test --release --locked --workspace --test end_to_end -- recordings:: --test-threads 1

.PHONY: test-postgres-contract
test-postgres-contract: build-for-tests ## What PostgreSQL has to do, as SQLite does (installs it where it is missing, as root)
	tests/postgres/with_server_test.sh
	tests/postgres/with_server.sh $(CARGO) test --release --locked --workspace \
	  --test store --test postgres -- --test-threads 2

# All but what looks into SQLite's files, or copies them.
.PHONY: test-postgres
test-postgres: build-for-tests python ## Unit tests and end-to-end tests with all services on PostgreSQL: 10 minutes
	env -u FLEETCAL_DATA FLEETCAL_BIN=$(abspath $(BIN)) FLEETCAL_PYTHON=$(PYTHON) \
	  tests/postgres/with_server.sh $(CARGO) test --release --locked --workspace --no-fail-fast \
	  --lib --test store --test postgres -- --test-threads 2 --skip only_its_owner_reads_the_database
	env -u FLEETCAL_DATA FLEETCAL_BIN=$(abspath $(BIN)) FLEETCAL_PYTHON=$(PYTHON) \
	  tests/postgres/with_server.sh $(CARGO) test --release --locked --workspace --no-fail-fast --test end_to_end -- \
	  --test-threads 2 service:: http:: agent:: zenoh:: plain_robots:: --skip a_backup_of_a_running_service_can_be_served \
	  --skip a_database_whose_log_is_gone --skip a_signing_key_without_its_database \
	  --skip only_its_owner_reads_the_database

# Each test has the machine to itself.
CLUSTER_TEST = FLEETCAL_BIN=$(abspath $(BIN)) tests/postgres/with_server.sh \
  $(CARGO) test --release --locked --workspace --test cluster -- --nocapture --test-threads 1

.PHONY: cluster-smoke
cluster-smoke: build-for-tests ## Two instances on PostgreSQL and two routers: joined, frozen, killed, stopped; a lost machine (as root alone, in a network namespace); a cell of 4,096 robots (installs PostgreSQL where it is missing, as root)
	$(CLUSTER_TEST) smoke:: lost_machine:: cell::

.PHONY: cluster-upgrade
cluster-upgrade: build-for-tests ## Builds a next version and changes instances to it and back, under robots that drive: 15 minutes
	next="$$(CARGO=$(CARGO) tests/cluster/next_version.sh $(abspath $(BUILT))/next $(abspath $(BUILT)))"; \
	  FLEETCAL_NEXT="$$next" $(CLUSTER_TEST) upgrade::

# Rounds of a cluster that is hurt, after each of which all that was decided, written and heard is
# checked; and faults beside the product that the check has to find.
CLUSTER_ROUNDS = checker:: figures:: progress:: rounds:: --skip rounds::failover

.PHONY: cluster-test
cluster-test: build-for-tests ## A few rounds of each kind on a cluster: killed, frozen, cut off, raced, without its database, while webhooks are told and calibrations verified; and one behind HAProxy (installs it where it is missing, as root): 14 minutes
	FLEETCAL_HAPROXY="$$(tests/cluster/haproxy.sh)" && export FLEETCAL_HAPROXY && \
	$(CLUSTER_TEST) $(CLUSTER_ROUNDS) balancer::

.PHONY: cluster-campaign
cluster-campaign: build-for-tests ## The rounds as often as a proof needs, failovers and upgrades included, for hours; goes on where it stopped (CLUSTER_PROGRESS, CLUSTER_ROUNDS_...)
	CLUSTER_PROGRESS="$${CLUSTER_PROGRESS:-$(abspath $(BUILT))/cluster-campaign-$${CLUSTER_INSTANCES:-2}}" \
	CLUSTER_ROUNDS_TAKEOVER="$${CLUSTER_ROUNDS_TAKEOVER:-50}" \
	CLUSTER_ROUNDS_TAKEOVER_BY_LEASE="$${CLUSTER_ROUNDS_TAKEOVER_BY_LEASE:-20}" \
	CLUSTER_ROUNDS_FREEZE="$${CLUSTER_ROUNDS_FREEZE:-100}" \
	CLUSTER_ROUNDS_PLANNED="$${CLUSTER_ROUNDS_PLANNED:-20}" \
	CLUSTER_ROUNDS_CUT_DATABASE="$${CLUSTER_ROUNDS_CUTS:-30}" \
	CLUSTER_ROUNDS_CUT_TO_DATABASE="$${CLUSTER_ROUNDS_CUTS:-30}" \
	CLUSTER_ROUNDS_CUT_OF_DATABASE="$${CLUSTER_ROUNDS_CUTS:-30}" \
	CLUSTER_ROUNDS_CUT_ROUTER="$${CLUSTER_ROUNDS_CUTS:-30}" \
	CLUSTER_ROUNDS_CUT_TO_ROUTER="$${CLUSTER_ROUNDS_CUTS:-30}" \
	CLUSTER_ROUNDS_CUT_OF_ROUTER="$${CLUSTER_ROUNDS_CUTS:-30}" \
	CLUSTER_ROUNDS_RACE="$${CLUSTER_RACES:-2000}" \
	CLUSTER_ROUNDS_SLOW_LINES="$${CLUSTER_ROUNDS_SLOW_LINES:-10}" \
	CLUSTER_ROUNDS_CERTAINTY="$${CLUSTER_ROUNDS_CERTAINTY:-3}" \
	CLUSTER_ROUNDS_POSTMASTER="$${CLUSTER_ROUNDS_POSTMASTER:-20}" \
	CLUSTER_ROUNDS_ROUTER_KILLED="$${CLUSTER_ROUNDS_ROUTER_KILLED:-20}" \
	CLUSTER_ROUNDS_VERIFICATION="$${CLUSTER_ROUNDS_VERIFICATION:-3}" \
	CLUSTER_ROUNDS_WEBHOOKS="$${CLUSTER_ROUNDS_WEBHOOKS:-20}" \
	$(CLUSTER_TEST) $(CLUSTER_ROUNDS)
	CLUSTER_PROGRESS="$${CLUSTER_PROGRESS:-$(abspath $(BUILT))/cluster-campaign-$${CLUSTER_INSTANCES:-2}}" $(MAKE) cluster-failover cluster-upgrade

.PHONY: cluster-failover
cluster-failover: build-for-tests ## Three servers under Patroni: primary moved, killed, frozen, its etcd gone, three times each, and an old Patroni whose fault has to be found (installs etcd and Patroni where they are missing, as root): 15 minutes
	FLEETCAL_PATRONI="$$(tests/cluster/patroni_tools.sh $(abspath $(BUILT)) 4.1.5)" && \
	FLEETCAL_OLD_PATRONI="$$(tests/cluster/patroni_tools.sh $(abspath $(BUILT)) 3.0.2)" && \
	export FLEETCAL_PATRONI FLEETCAL_OLD_PATRONI && \
	for kind in SWITCHOVER PRIMARY_KILLED PRIMARY_FROZEN POSTMASTER_OF_PATRONI ETCD_GONE; do \
	  export CLUSTER_ROUNDS_$$kind="$${CLUSTER_ROUNDS_FAILOVERS:-3}"; \
	done && \
	$(CLUSTER_TEST) rounds::failover

.PHONY: cluster-cost
cluster-cost: build-for-tests ## CPU a robot-second of one service and of two instances, in one run: 9 minutes
	$(CLUSTER_TEST) cost::

.PHONY: cluster-cell
cluster-cell: build-for-tests ## 4,096 robots, of which 60 drive, on two instances; a third joins and one dies: 1 minute
	$(CLUSTER_TEST) cell::

.PHONY: cluster-floods
cluster-floods: build-for-tests ## 8 hostile Zenoh sessions for FLEETCAL_ZENOH_FLOOD_S=15, each kind (or those of FLEETCAL_ZENOH_FLOODS) at one of two routers with the generated list, before two instances: 5 minutes, prints losses
	FLEETCAL_ZENOH_FLOOD_S="$${FLEETCAL_ZENOH_FLOOD_S:-15}" FLEETCAL_BIN=$(abspath $(BIN)) \
	  tests/postgres/with_server.sh $(CARGO) test --release --locked --workspace --test end_to_end -- \
	  --ignored --nocapture --test-threads 1 zenoh::mesh::

.PHONY: cluster
cluster: build-for-tests ## Starts a cluster on this machine: two instances, two routers, PostgreSQL and 24 simulated robots
	FLEETCAL_BIN=$(abspath $(BIN)) FLEETCAL_ROUTER=$(dir $(BIN))fleetcal-router \
	  tests/postgres/with_server.sh tests/cluster/run.sh

.PHONY: kill-rounds-postgres
kill-rounds-postgres: rust ## Kills the deciding process 150 times, and PostgreSQL under it 150 times: nothing acknowledged may be lost
	KILL_ROUNDS=150 tests/postgres/with_server.sh $(CARGO) test --release --locked --workspace \
	  --test end_to_end -- --nocapture durability::kill::
	CONTRACT_KILLS=150 tests/postgres/with_server.sh $(CARGO) test --release --locked --workspace \
	  --test postgres -- --nocapture postmaster::

.PHONY: hardening-postgres
hardening-postgres: rust ## 1,000 random sequences on both databases, 2,000 races of two stores, 200 cuts at COMMIT
	CONTRACT_SEQUENCES=1000 CONTRACT_RACES=2000 CONTRACT_CUTS=200 \
	  tests/postgres/with_server.sh $(CARGO) test --release --locked --workspace \
	  --test postgres -- --nocapture --test-threads 1 differential:: races:: commit::

.PHONY: store-load
store-load: rust ## What 1,000 robots' telemetry costs SQLite and PostgreSQL, dropping a day, copying: 25 minutes
	$(CARGO) build --release --locked --workspace \
	  --example store_load --example drop_day --example copy_load
	for example in store_load drop_day copy_load; do \
	  tests/postgres/with_server.sh --durable $(abspath $(BUILT))/release/examples/$$example || exit 1; \
	done

.PHONY: test-web
test-web: test-web-units test-browser ## The dashboard's unit tests, then the real binary in a browser

.PHONY: test-web-units
test-web-units: dashboard
	cd web && npm run test --silent

.PHONY: test-browser
test-browser: build-for-tests chromium python
	cd web && FLEETCAL_BIN=$(abspath $(BIN)) FLEETCAL_PYTHON=$(PYTHON) npm run e2e --silent

.PHONY: docs
docs: ## The documentation as a site in target/book (installs mdBook where it is missing)
	@command -v mdbook >/dev/null || $(CARGO) install --locked mdbook
	mdbook build

.PHONY: test-docs
test-docs: build ## Runs every shell block of the documentation that can run
	python3 tests/docs.py $(abspath $(BIN))

.PHONY: audit
audit: rust ## Dependencies: unmaintained ones with reasons, licences, bans, sources, known advisories (cargo-deny)
	@.ci/unmaintained
	@$(CARGO) deny --version >/dev/null 2>&1 || $(CARGO) install --locked cargo-deny
	$(CARGO) deny --all-features check bans licenses sources
	@# What cannot be fetched is said; what was fetched is obeyed.
	@if $(CARGO) deny --all-features fetch db; then \
	  $(CARGO) deny --all-features check --disable-fetch advisories; \
	else \
	  echo "advisories not checked: their database cannot be reached"; \
	fi

.PHONY: bench
bench: rust ## Benchmarks of the odometry's and the estimator's stages
	$(CARGO) bench --locked -p fleetcal-odometry -p fleetcal-estimator

.PHONY: build-loop
build-loop: rust ## The developer's loop on an idle machine: touches a file, builds the binary, prints the time
	tests/architecture/build_loop.sh

.PHONY: false-alarms
false-alarms: rust ## 3,000 simulated robot-hours without a change at the real threshold: under an hour
	$(CARGO) run --release --locked -p fleetcal-estimator --example false_alarms -- campaign 3000

.PHONY: starts-in-motion
starts-in-motion: rust ## 600 drives that are cut at 30 moments: claims, changes and convergence, two minutes
	$(CARGO) test --release --locked -p fleetcal-estimator --test calibration -- --nocapture --ignored cut_at_30

.PHONY: published-errors
published-errors: rust ## The mean NEES of what is published, 200 vehicles drawn from the priors, and with their sensors: three minutes
	$(CARGO) test --release --locked -p fleetcal-estimator --test calibration -- --nocapture --ignored of_200_vehicles

# Another commit to compare with: make cost-ratio OLD=main
OLD ?= e58c1a8
.PHONY: cost-ratio
cost-ratio: rust ## CPU time of odometry, filter and detection against the commit OLD, in the same run
	estimator/benches/cost_ratio.sh $(OLD) HEAD

.PHONY: same-bits
same-bits: OLD = main
same-bits: rust ## Every value, sigma, status and event against the commit or program OLD, bit for bit, on DRIVES=49 simulated drives and on recordings (FLEETCAL_DATA): a minute beside the builds
	CARGO=$(CARGO) tests/evaluation/same_bits.sh $(OLD) $(DRIVES)

.PHONY: evaluation
evaluation: rust ## The paper's evaluation and more: writes docs/evaluation.md, half an hour on two cores
	$(CARGO) build --release --locked -p fleetcal --bin fleetcal
	$(CARGO) build --release --locked -p fleetcal-evaluation
	FLEETCAL_BIN=$(abspath $(BIN)) $(dir $(BIN))fleetcal-evaluation --out docs --commit "$$(git describe --always --dirty --exclude '*')"

.PHONY: evaluation-quick
evaluation-quick: rust ## The same with a few seeds, under three minutes: writes target/evaluation
	$(CARGO) run --release --locked -p fleetcal-evaluation -- --quick --out target/evaluation

# Robots of each imperfection and route: unchanged ones, and ones of each change and speed.
SEEDS ?= 200
CHANGE_SEEDS ?= 50
.PHONY: imperfect-robots
imperfect-robots: rust ## Claims and alarms of imperfect robots, 600 of each imperfection: hours; goes on where it stopped
	$(CARGO) build --release --locked -p fleetcal-evaluation --bin imperfect_robots
	mkdir -p target/imperfect_robots
	$(dir $(BIN))imperfect_robots --report target/imperfect_robots/report.md --seeds $(SEEDS) --change-seeds $(CHANGE_SEEDS) \
	  --results target/imperfect_robots/$$(git describe --always --dirty --exclude '*').jsonl

.PHONY: results
results: rust ## The pages of docs/results from the newest figures of each campaign
	$(CARGO) run --release --locked -p fleetcal-evaluation --bin results

.PHONY: results-imperfect-robots
results-imperfect-robots: rust ## Figures of typical imperfections by poses, RESULT_SEEDS=20 robots a cell: half an hour
	$(CARGO) build --release --locked -p fleetcal-evaluation --bin imperfect_robots --bin results
	$(dir $(BIN))imperfect_robots --strength typical --sensor poses --seeds $${RESULT_SEEDS:-20} --change-seeds $${RESULT_CHANGE_SEEDS:-5} \
	  --figures docs/results/data/imperfect_robots.jsonl --commit $$(git describe --always --dirty --exclude '*') --date $$(date +%F)
	$(dir $(BIN))results

.PHONY: results-joining-checks
results-joining-checks: rust ## Wrong inputs and what is named of them, and of 735 robots whose inputs are right: some minutes
	$(CARGO) build --release --locked -p fleetcal-evaluation --bin joining_checks --bin results
	$(dir $(BIN))joining_checks --figures docs/results/data/joining_checks.jsonl \
	  --commit $$(git describe --always --dirty --exclude '*') --date $$(date +%F)
	$(dir $(BIN))results

.PHONY: load
load: build ## LOAD_ROBOTS=50 robots for LOAD_SECONDS=20, LOAD_SESSIONS=each or one, LOAD_SAMPLES=several or single a message: CPU time per robot-second and by thread, latency, memory. With LOAD_HELD=0.25 the service has a quarter of the CPU time it needs for the second third (root)
	FLEETCAL_BIN=$(abspath $(BIN)) $(CARGO) test --release --locked -p fleetcal-tests --test end_to_end -- --nocapture load::

LOAD_DATA = $(abspath docs/results/data/load.jsonl)
.PHONY: results-load
results-load: build ## Figures of LOAD_ROBOTS=50 robots with a session each and with one, on an idle machine: two minutes
	printf '{"campaign":"load","title":"Load of the service","commit":"%s","date":"%s","command":"make results-load LOAD_ROBOTS=%s"}\n' \
	  "$$(git describe --always --dirty --exclude '*')" "$$(date +%F)" "$${LOAD_ROBOTS:-50}" > $(LOAD_DATA)
	for samples in several single; do for sessions in each one; do \
	  LOAD_FIGURES=$(LOAD_DATA) LOAD_SAMPLES=$$samples LOAD_SESSIONS=$$sessions FLEETCAL_BIN=$(abspath $(BIN)) \
	    $(CARGO) test --release --locked -p fleetcal-tests --test end_to_end -- --nocapture load:: || exit 1; \
	done; done
	$(CARGO) run --release --locked -p fleetcal-evaluation --bin results

.PHONY: results-peers
results-peers: rust ## The LiDAR odometry beside small_gicp, kiss-icp and genz-icp on the same scans (PyPI): two minutes
	odometry/benches/peers/compare.py --venv $(BUILT)/peers-venv --figures docs/results/data/lidar_odometry_peers.jsonl \
	  --commit "$$(git describe --always --dirty --exclude '*')" --date "$$(date +%F)"
	$(CARGO) run --release --locked -p fleetcal-evaluation --bin results

# What a campaign has done stands in its file here; `rm` begins it again.
HARDENING := $(abspath $(BUILT))/hardening
COMMIT = $$(git describe --always --dirty --exclude '*')

.PHONY: hardening-http
hardening-http: build-for-tests ## 2,600 silent, slow and never-reading HTTP connections for ten minutes: prints N and percentiles
	@mkdir -p $(HARDENING) && touch $(HARDENING)/http.seeds
	@if grep -qx "flood 600 $(COMMIT)" $(HARDENING)/http.seeds; then \
	  echo "the flood of HTTP was withstood at this commit already: $(HARDENING)/http.seeds"; \
	else \
	  FLEETCAL_HTTP_FLOOD_S=600 FLEETCAL_BIN=$(abspath $(BIN)) \
	    $(CARGO) test --release --locked --workspace --test end_to_end -- --nocapture http::flood:: && \
	  echo "flood 600 $(COMMIT)" >> $(HARDENING)/http.seeds; \
	fi

# The campaigns go on where they stopped: the seeds that have passed stand in the folder SEEDS_PASSED.
SEEDS_PASSED = $(abspath $(BUILT))/hardening
HARDENING_N ?= 200
STOPPED_S ?= 60
.PHONY: hardening
hardening: hardening-store hardening-http hardening-zenoh hardening-process kill-rounds hardening-growth ## Every fault of docs/reliability.md: hours; goes on where it stopped

.PHONY: hardening-zenoh
hardening-zenoh: build-for-tests ## 8 hostile Zenoh sessions for FLEETCAL_ZENOH_FLOOD_S=60, each kind (or those of FLEETCAL_ZENOH_FLOODS) against either access list: half an hour, prints losses
	FLEETCAL_ZENOH_FLOOD_S="$${FLEETCAL_ZENOH_FLOOD_S:-60}" FLEETCAL_BIN=$(abspath $(BIN)) $(CARGO) test --release --locked --workspace --test end_to_end -- --include-ignored --nocapture --test-threads 1 zenoh::floods::

.PHONY: hardening-growth
hardening-growth: build-for-tests ## GROWTH_MINUTES=60 of each flood and of none: prints what database and log grow by, nine hours
	FLEETCAL_BIN=$(abspath $(BIN)) $(CARGO) test --release --locked --workspace --test end_to_end -- --ignored --nocapture zenoh::growth::

.PHONY: hardening-process
hardening-process: build-for-tests ## HARDENING_N=200 kills inside migrations and SIGTERMs under load; stopped for a minute; 64 file descriptors; 256 MiB (root)
	HARDENING_N=$(HARDENING_N) HARDENING_STOPPED_S=$(STOPPED_S) HARDENING_SEEDS=$(SEEDS_PASSED) FLEETCAL_BIN=$(abspath $(BIN)) \
	  nice $(CARGO) test --release --locked --workspace --test end_to_end -- --nocapture --test-threads 1 durability::lifecycle:: && \
	FLEETCAL_BIN=$(abspath $(BIN)) $(CARGO) test --release --locked --workspace --test end_to_end -- --ignored --nocapture durability::memory::

.PHONY: soak
soak: build-for-tests ## 50 robots for SOAK_MINUTES=120 with a flood of each kind in turn: prints memory, files and threads
	SOAK_MINUTES=$(or $(SOAK_MINUTES),120) FLEETCAL_BIN=$(abspath $(BIN)) $(CARGO) test --release --locked --workspace --test end_to_end -- --ignored --nocapture zenoh::soak::

.PHONY: encoders
encoders: rust ## 10,000 random messages of each type by rosbags and pycdr2 (PyPI): same bytes back
	@python3 -c 'import venv, ensurepip' 2>/dev/null \
	  || { echo "Python 3 with venv is missing: install python3-venv, then run make again." >&2; exit 1; }
	python3 -m venv $(BUILT)/encoders
	$(BUILT)/encoders/bin/pip install --quiet --requirement tests/encoders/requirements.txt
	$(BUILT)/encoders/bin/python tests/encoders/encoders.py $(BUILT)/encoders/messages.bin 10000
	$(CARGO) run --release --locked -p fleetcal-proto --example encoded -- $(BUILT)/encoders/messages.bin

# Each target of tests/fuzz gets FUZZ_S seconds; a later run goes on with the seeds after those.
FUZZ_S ?= 7200
.PHONY: fuzz
fuzz: rust ## FUZZ_S=7200 seconds of damaged inputs for each reader (or those of FUZZ_TARGETS): goes on where it stopped
	nice $(CARGO) run --release --locked -p fleetcal-fuzz -- $(FUZZ_S) $(HARDENING)/fuzz $(FUZZ_TARGETS)

API_EXAMPLES ?= 100
.PHONY: hardening-api
hardening-api: build-for-tests ## API_EXAMPLES=100 generated requests (schemathesis, PyPI) for each operation and kind, as each role: no 5xx, nothing undocumented
	@python3 -c 'import venv, ensurepip' 2>/dev/null \
	  || { echo "Python 3 with venv is missing: install python3-venv, then run make again." >&2; exit 1; }
	python3 -m venv $(BUILT)/hardening-api
	$(BUILT)/hardening-api/bin/pip install --quiet --requirement tests/hardening_api/requirements.txt
	nice $(BUILT)/hardening-api/bin/python tests/hardening_api/hardening_api.py $(abspath $(BIN)) $(API_EXAMPLES)

.PHONY: zenohd
zenohd: build ## Builds Zenoh's own router from its crate and tests the service behind it
	$(CARGO) install zenohd --version 1.10.2 --locked --root $(BUILT)/zenohd \
	  --no-default-features --features zenoh/transport_tcp,zenoh/transport_tls,zenoh/transport_quic,zenoh/auth_usrpwd
	FLEETCAL_BIN=$(abspath $(BIN)) FLEETCAL_ZENOHD=$(ZENOHD) $(CARGO) test --release --locked --workspace --test end_to_end -- --nocapture --test-threads 1 zenoh::router:: zenoh::breaks::

.PHONY: kill-rounds
kill-rounds: rust ## Kills the deciding process 3,000 times: nothing acknowledged may be lost
	KILL_ROUNDS=3000 $(CARGO) test --release --locked -p fleetcal-tests --test end_to_end -- --nocapture durability::kill::

.PHONY: hardening-store
hardening-store: build-for-tests strace ## Each N-th write and sync of the database fails: hours; goes on where it stopped
	@mkdir -p $(HARDENING)
	FLEETCAL_BIN=$(abspath $(BIN)) FAULTS_PROGRESS=$(HARDENING)/store.seeds \
	  $(CARGO) test --release --locked --workspace --test end_to_end -- --nocapture --ignored durability::campaign::
	POWER_IMAGES=2000 $(CARGO) test --release --locked --workspace --test end_to_end -- --nocapture durability::power::
	FLEETCAL_BIN=$(abspath $(BIN)) HANGS_FOR_S=30 \
	  $(CARGO) test --release --locked --workspace --test end_to_end -- --nocapture durability::hanging::
	FLEETCAL_BIN=$(abspath $(BIN)) \
	  $(CARGO) test --release --locked --workspace --test end_to_end -- --nocapture --ignored durability::stuck::

.PHONY: doc
doc: rust ## The crates' documentation
	RUSTDOCFLAGS="-D warnings" $(CARGO) doc --release --locked --workspace --no-deps

.PHONY: screenshots
screenshots: build chromium ## Takes the pictures in docs/ from the running demo
	cd web && FLEETCAL_BIN=$(abspath $(BIN)) npm run screenshots

.PHONY: release
release: dashboard rust python ## Static binary, Debian package, Python wheel, container image, notices, SBOM and checksums in target/packages
	PYTHON=$(PYTHON) packaging/release.sh

.PHONY: sbom
sbom: node rust ## Bills of materials (CycloneDX) of the program and its dashboard, in target/sbom (compiles cargo-cyclonedx once)
	packaging/sbom.sh target/sbom

.PHONY: test-packages
test-packages: ## Installs, upgrades and removes what `make release` made, and runs its container (root, Debian)
	packaging/test_packages.sh

.PHONY: clean
clean: ## Removes what was built
	rm -rf target web/dist web/node_modules web/test-results
