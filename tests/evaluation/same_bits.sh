#!/usr/bin/env bash
# What the estimator of this checkout publishes against what another commit's does, bit for bit.
#
#   tests/evaluation/same_bits.sh OLD [DRIVES]
#
# Both sides write the lines of `examples/same_bits` over the same drives, each by its own simulator. OLD is
# a commit, or a program built from it; a commit is built in a worktree with a target folder of its own,
# which both stay below the target folder for the next time. Lines that this checkout alone has are new
# fields and allowed; a line of OLD's that is missing or different fails, as does one event more.
set -euo pipefail
cd "$(dirname "$0")/../.."
old="$1"
drives="${2:-}"
cargo="${CARGO:-cargo}"
built="$(realpath -m "${CARGO_TARGET_DIR:-target}")"
work="$built/same-bits"
mkdir -p "$work"

build() {
  .ci/dependencies restore "$1"
  # With the features of all crates, as `make build` has them.
  CARGO_TARGET_DIR="$1" "$cargo" build --release --locked --quiet --workspace --example same_bits
}
program=release/examples/same_bits
if [ -f "$old" ]; then
  old_program="$old"
else
  git cat-file -e "$old:tests/evaluation/examples/same_bits/main.rs" 2>/dev/null \
    || { echo "OLD: got $old, expected a program, or a commit that has tests/evaluation/examples/same_bits" >&2; exit 2; }
  [ -e "$work/old/.git" ] || { git worktree prune && git worktree add --force --detach --quiet "$work/old" "$old"; }
  git -C "$work/old" checkout --detach --quiet "$(git rev-parse "$old^{commit}")"
  (cd "$work/old" && build "$work/target")
  old_program="$work/target/$program"
fi
build "$built"

for side in before after; do rm -rf "${work:?}/$side"; done
"$old_program" "$work/before" $drives
"$built/$program" "$work/after" $drives

differ=0
for before in "$work"/before/*.txt; do
  drive="$(basename "$before" .txt)"
  after="$work/after/$drive.txt"
  if [ ! -f "$after" ]; then
    echo "$drive: not driven any more"
    differ=$((differ + 1))
  elif ! cmp --silent "$before" "$after"; then
    changes="$(diff --unified=0 "$before" "$after" | tail -n +3 | grep '^[-+]' || true)"
    lost="$(grep -c '^-' <<<"$changes" || true)"
    [ "$lost" = 0 ] && continue
    differ=$((differ + 1))
    echo "$drive: $lost of $(wc -l <"$before") lines are not what they were. The first:"
    grep --max-count 1 '^-' <<<"$changes"
    grep --max-count 1 '^+' <<<"$changes" || true
  fi
done
count="$(find "$work/before" -name '*.txt' | wc -l)"
lines="$(cat "$work"/before/*.txt | wc -l)"
[ "$count" -gt 0 ] || { echo "no drive was driven" >&2; exit 1; }
echo "$((count - differ)) of $count drives give the same bits ($lines lines)"
[ "$differ" = 0 ]
