#!/usr/bin/env bash
# What odometry, filter and detection cost at one commit against another, in the same run.
#
#   estimator/benches/cost_ratio.sh [OLD [NEW [ROUNDS [RATIO_MAX]]]]
#
# Builds both commits' estimators in a temporary folder, runs the minute of `estimator_figures -- steps` of
# each by turns, and compares the fastest rounds: what else runs on the machine only makes a round slower.
# Fails where the ratio is above RATIO_MAX.
set -euo pipefail
cd "$(dirname "$0")/../.."
old="${1:-e58c1a8}"
new="${2:-HEAD}"
rounds="${3:-9}"
ratio_max="${4:-1.15}"

work="$(mktemp -d)"
clean_up() {
  git worktree remove --force "$work/old" 2>/dev/null || true
  git worktree remove --force "$work/new" 2>/dev/null || true
  rm -rf "$work"
}
trap clean_up EXIT

for side in old new; do
  git worktree add --detach --quiet "$work/$side" "${!side}"
  (cd "$work/$side" && CARGO_TARGET_DIR="$work/target-$side" cargo build --release --locked --quiet \
    -p fleetcal-estimator --example estimator_figures)
done

# Microseconds of one scan: the odometry, and all else.
one_round() {
  "$work/target-$1/release/examples/estimator_figures" steps | awk '
    /^LiDAR odometry/ { odometry = $3 }
    /^all but the odometry/ { sub(/ µs.*/, ""); rest = $NF }
    END { if (odometry == "" || rest == "") exit 1; print odometry, rest }'
}

for ((round = 0; round < rounds; round++)); do
  one_round old >>"$work/old.txt"
  one_round new >>"$work/new.txt"
done
least() {
  awk 'NR == 1 || $1 < odometry { odometry = $1 } NR == 1 || $2 < rest { rest = $2 }
    END { print odometry, rest, odometry + rest }' "$work/$1.txt"
}
read -r old_odometry old_rest old_all < <(least old)
read -r new_odometry new_rest new_all < <(least new)
awk -v old="$old" -v new="$new" -v o_odo="$old_odometry" -v o_rest="$old_rest" -v o_all="$old_all" \
  -v n_odo="$new_odometry" -v n_rest="$new_rest" -v n_all="$new_all" -v most="$ratio_max" 'BEGIN {
  printf "µs for each scan   odometry   filter and detection    both\n"
  printf "%-18s %8.1f   %20.1f  %6.1f\n", old, o_odo, o_rest, o_all
  printf "%-18s %8.1f   %20.1f  %6.1f\n", new, n_odo, n_rest, n_all
  printf "ratio              %8.2f   %20.2f  %6.2f (at most %s)\n", n_odo / o_odo, n_rest / o_rest, n_all / o_all, most
  exit n_all / o_all > most
}'
