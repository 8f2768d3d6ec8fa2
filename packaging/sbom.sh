#!/usr/bin/env bash
# Writes the bills of materials (CycloneDX) of the program and of its dashboard into the folder OUT:
# packaging/sbom.sh OUT. `make sbom` and packaging/release.sh run it.
set -euo pipefail
cd "$(dirname "$0")/.."
out="$1"
target=x86_64-unknown-linux-musl
version="$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -1)"

# Passes a bill on, dated by its commit. Crates of the workspace are named by the folder it is in: a path
# of the machine that built it.
bill() {
  DATE_S="$(git log -1 --format=%ct)" SOURCE_ROOT="$PWD" python3 -c '
import json, os, sys, time
bill = json.loads(sys.stdin.read().replace("file://" + os.environ["SOURCE_ROOT"], "file:///fleetcal"))
at = time.gmtime(int(os.environ["DATE_S"]))
bill["metadata"]["timestamp"] = time.strftime("%Y-%m-%dT%H:%M:%SZ", at)
json.dump(bill, sys.stdout, indent=2)'
}

# shellcheck source=packaging/cargo_tool.sh
. packaging/cargo_tool.sh
cargo_tool cargo-cyclonedx 0.5.9

mkdir -p "$out"
# cargo-cyclonedx writes one beside each member of the workspace.
name=fleetcal.packaging.cdx
trap 'find . -name "$name.json" -not -path "./target/*" -not -path "./web/node_modules/*" -delete' EXIT
cargo cyclonedx --manifest-path service/Cargo.toml --format json --target "$target" \
  --override-filename "$name"
bill <"service/$name.json" >"$out/fleetcal-$version.cdx.json"
# Tools of the build are in it, marked `cdx:npm:package:development`.
npm --prefix web sbom --package-lock-only --sbom-format cyclonedx | bill >"$out/fleetcal-dashboard-$version.cdx.json"
