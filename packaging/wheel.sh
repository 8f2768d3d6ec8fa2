#!/usr/bin/env bash
# Packs a binary as a Python wheel, which `pip install` puts into an environment as the command
# `fleetcal`: packaging/wheel.sh FOLDER OUT PLATFORM... FOLDER has the binary and what is to be in the
# wheel beside it as its licences; each PLATFORM is one of those that pip knows, such as linux_x86_64.
# PYTHON names a Python that has the package `wheel`.
set -euo pipefail
folder="$(realpath "$1")"
out="$(realpath "$2")"
shift 2
cd "$(dirname "$0")/.."
version="$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -1)"
stage="$(mktemp -d)"
trap 'rm -rf "$stage"' EXIT
info="$stage/fleetcal-$version.dist-info"
scripts="$stage/fleetcal-$version.data/scripts"
mkdir -p "$info/licenses" "$scripts"
install -m 755 "$folder/fleetcal" "$scripts/fleetcal"

{
  printf 'Metadata-Version: 2.4\nName: fleetcal\nVersion: %s\n' "$version"
  printf 'Summary: Calibrates fleets of wheeled robots: steering offset and LiDAR mount\n'
  printf 'License-Expression: Apache-2.0\n'
  for licence in LICENSE LICENSE-Apache-2.0.txt THIRD-PARTY-NOTICES.md rust-library.html; do
    if [ -f "$folder/$licence" ]; then
      install -m 644 "$folder/$licence" "$info/licenses/$licence"
      printf 'License-File: %s\n' "$licence"
    fi
  done
} >"$info/METADATA"

{
  printf 'Wheel-Version: 1.0\nGenerator: fleetcal\nRoot-Is-Purelib: false\n'
  printf 'Tag: py3-none-%s\n' "$@"
} >"$info/WHEEL"

"${PYTHON:-python3}" -m wheel pack --dest-dir "$out" "$stage"
