#!/usr/bin/env bash
# A cluster on this machine until Ctrl-C: two instances, two Zenoh routers and simulated robots, on the
# PostgreSQL that FLEETCAL_TEST_POSTGRES names (tests/postgres/with_server.sh starts one).
# FLEETCAL_BIN is the binary, FLEETCAL_ROUTER the router, or ZENOHD a zenohd; ROBOTS=24 says how many
# drive.
set -euo pipefail

robots="${ROBOTS:-24}"
folder="$(mktemp -d "${TMPDIR:-/tmp}/fleetcal-cluster.XXXXXX")"
pids=()

stop() {
  trap '' INT TERM HUP
  if [ "${#pids[@]}" -gt 0 ]; then
    kill "${pids[@]}" 2>/dev/null || true
    wait "${pids[@]}" 2>/dev/null || true
  fi
  rm -rf "$folder"
}
trap stop EXIT
trap 'exit 0' INT TERM
trap 'exit 129' HUP

# Runs a command in the background, with what it says in a file.
start() {
  local log="$folder/$1.log"
  shift
  "$@" >"$log" 2>&1 &
  pids+=($!)
}

router() {
  local own="tcp/127.0.0.1:$1" other="tcp/127.0.0.1:$2"
  if [ -n "${ZENOHD:-}" ]; then
    start "router_$1" "$ZENOHD" --listen "$own" --connect "$other" --no-multicast-scouting
  else
    start "router_$1" "$FLEETCAL_ROUTER" "$own" "$other"
  fi
}

# Waits until a page answers.
wait_for() {
  local tries
  for tries in $(seq 300); do
    if curl --silent --fail --output /dev/null "$1"; then return; fi
    sleep 0.2
  done
  echo "$1 does not answer:" >&2
  tail -n 20 "$folder"/*.log >&2
  exit 1
}

router 7451 7452
router 7452 7451

"$FLEETCAL_BIN" simulate --robots "$robots" --configuration >"$folder/robots.toml"
for name in a b; do
  {
    echo "[cluster]"
    echo "plaintext_peers = true"
    echo 'peers = { a = "http://127.0.0.1:8081", b = "http://127.0.0.1:8082" }'
    echo "signing_key = \"$folder/signing.key\""
    cat "$folder/robots.toml"
  } >"$folder/$name.toml"
done
port=8081
router_port=7451
for name in a b; do
  cat >"$folder/$name.json5" <<CLIENT
{ mode: "client", connect: { endpoints: ["tcp/127.0.0.1:$router_port"] },
  scouting: { multicast: { enabled: false } } }
CLIENT
  start "$name" "$FLEETCAL_BIN" serve --config "$folder/$name.toml" --data "$folder/$name" \
    --database "$FLEETCAL_TEST_POSTGRES" --instance "$name" --http "127.0.0.1:$port" \
    -c "$folder/$name.json5"
  wait_for "http://127.0.0.1:$port/readyz"
  port=$((port + 1))
  router_port=$((router_port + 1))
done
echo "cluster on this machine" | "$FLEETCAL_BIN" user create --database "$FLEETCAL_TEST_POSTGRES" \
  --name admin --role admin >/dev/null
start robots "$FLEETCAL_BIN" simulate --robots "$robots" \
  -e tcp/127.0.0.1:7451 -e tcp/127.0.0.1:7452

cat <<PAGES
$robots simulated robots drive, two instances share them:
  http://127.0.0.1:8081  (instance a)
  http://127.0.0.1:8082  (instance b)
Sign in as admin, password "cluster on this machine". The health page shows who has which robots.
What the processes say is in $folder. Ctrl-C ends all of them.
PAGES
wait "${pids[@]}"
