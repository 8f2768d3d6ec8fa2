#!/usr/bin/env bash
# The developer's loop: touches one file, then builds the binary, and says how long that took.
# Each line is the median of ROUNDS rounds (3): wall time and CPU time (user and system), s.
# TASKS says what is run ("build check").
#
#   tests/architecture/build_loop.sh            touches of the store, the estimator and the API
#   tests/architecture/build_loop.sh --clean    a clean build first, in a target folder of its own
#
# Run it on an idle machine. It works at commits with and without crates below `service/`, so that
# they can be compared: a file is looked for by the end of its path.
set -euo pipefail
cd "$(dirname "$0")/../.."
rounds="${ROUNDS:-3}"
tasks="${TASKS:-build check}"
TIMEFORMAT='%R %U %S'

# Prints wall and CPU seconds of a command.
timed() {
  { time "$@" >/dev/null 2>&1; } 2>&1 | awk '{ printf "%.1f %.1f\n", $1, $2 + $3 }'
}

# The middle line of those with two numbers, by the first.
median() { sort -n | awk '{ line[NR] = $0 } END { print line[int((NR + 1) / 2)] }'; }

loop() {
  local name="$1" ending="$2" file
  file="$(find service estimator -path "*$ending" -not -path '*/target/*' | head -n 1)"
  [ -n "$file" ] || { echo "no file ends in $ending" >&2; exit 1; }
  for task in $tasks; do
    local command=(cargo "$task" --release --locked -p fleetcal --bin fleetcal)
    "${command[@]}" >/dev/null 2>&1
    for _ in $(seq "$rounds"); do
      touch "$file"
      timed "${command[@]}"
    done | median | {
      read -r wall cpu
      printf '%-10s %-6s %7s s wall %7s s CPU   %s\n' "$name" "$task" "$wall" "$cpu" "$file"
    }
  done
}

if [ "${1:-}" = --clean ]; then
  CARGO_TARGET_DIR="$(mktemp -d)"
  export CARGO_TARGET_DIR
  trap 'rm -rf "$CARGO_TARGET_DIR"' EXIT
  timed cargo build --release --locked -p fleetcal --bin fleetcal |
    { read -r wall cpu; printf '%-10s %-6s %7s s wall %7s s CPU\n' clean build "$wall" "$cpu"; }
fi
loop store "$([ -d service/sqlite ] && echo sqlite/src/read.rs || echo sqlite/read.rs)"
loop estimator estimator/src/filter/mod.rs
loop api alerts/list.rs
