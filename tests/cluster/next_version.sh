#!/usr/bin/env bash
# Builds the next version of this program, as it is committed, and prints where its binary is:
# tests/cluster/next_version.sh FOLDER [TARGET]. The next version has a migration more, which only
# adds, and reads one more format of checkpoints. TARGET is a folder whose builds of dependencies are
# used.
set -euo pipefail

folder="$(mkdir -p "$1" && cd "$1" && pwd)"
target="${2:-}"
rm -rf "$folder/source"
mkdir -p "$folder/source"
git archive HEAD | tar -x -C "$folder/source"
if [ ! -d "$folder/target" ] && [ -n "$target" ]; then
  cp -a "$target/release" "$folder/release"
  mkdir "$folder/target"
  mv "$folder/release" "$folder/target/release"
fi
mkdir -p "$folder/source/web/dist"
cp -a web/dist/. "$folder/source/web/dist/"

cd "$folder/source"
cat >migrations/postgres/29990101000000_next.sql <<SQL
ALTER TABLE robot ADD COLUMN next TEXT;
INSERT INTO schema_compatible (version, oldest)
    SELECT 29990101000000, max(version) FROM schema_compatible;
SQL
packed=service/fleet/src/packed.rs
sed -i 's/^pub const FORMAT_READ_MAX: u8 = FORMAT;/pub const FORMAT_READ_MAX: u8 = 8;/
s/Some((&FORMAT, compressed))/Some((\&FORMAT | \&FORMAT_READ_MAX, compressed))/' "$packed"
sed -i 's/env!("CARGO_PKG_VERSION").to_owned()/concat!(env!("CARGO_PKG_VERSION"), "+next").to_owned()/' \
  service/src/cluster.rs
# What is edited has to be there.
grep -q 'FORMAT_READ_MAX: u8 = 8' "$packed"
grep -q '&FORMAT | &FORMAT_READ_MAX' "$packed"
grep -q '+next' service/src/cluster.rs
# With a test, for the features of the builds of dependencies.
CARGO_TARGET_DIR="$folder/target" "${CARGO:-cargo}" build --release --locked --workspace --bins --test cluster >&2
echo "$folder/target/release/fleetcal"
