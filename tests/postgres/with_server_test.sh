#!/usr/bin/env bash
# Tests tests/postgres/with_server.sh: that it finds a server, gives it to the command, passes the
# command's exit status on, and leaves nothing behind. `make test-postgres-contract` runs it first.
set -euo pipefail
cd "$(dirname "$0")"

folder="$(mktemp -d "${TMPDIR:-/tmp}/with-server-test.XXXXXX")"
trap 'rm -rf "$folder"' EXIT
# The server's own user has to pass.
chmod 755 "$folder"
export TMPDIR="$folder"

fail() {
  echo "with_server.sh: $1" >&2
  exit 1
}

# Runs a command, which has to end with a status and to leave nothing in the folder.
expect() {
  local expected="$1" status=0
  shift
  "$@" || status=$?
  [ "$status" -eq "$expected" ] || fail "got exit status $status of '$*', expected $expected"
  [ -z "$(ls -A "$folder")" ] || fail "'$*' left $(ls -A "$folder") behind"
}

# shellcheck disable=SC2016 # The command expands it.
answers='port="${FLEETCAL_TEST_POSTGRES##*:}"; exec 3<>"/dev/tcp/127.0.0.1/${port%/postgres}"'
expect 0 ./with_server.sh bash -c "$answers"
expect 7 ./with_server.sh bash -c 'exit 7'
expect 2 ./with_server.sh

# Debian has no `initdb` in the PATH.
expect 0 env PATH=/usr/sbin:/usr/bin:/sbin:/bin ./with_server.sh true

# A terminal's Ctrl-C and a CI's end reach script and command alike.
for signal in TERM HUP; do
  # shellcheck disable=SC2016 # The command expands it.
  setsid ./with_server.sh bash -c 'touch "$TMPDIR/ready"; exec sleep 60' &
  group=$!
  for _ in $(seq 300); do
    [ ! -e "$folder/ready" ] || break
    sleep 0.1
  done
  [ -e "$folder/ready" ] || fail "got no server within 30 s"
  rm "$folder/ready"
  kill -s "$signal" -- "-$group"
  expect "$((128 + $(kill -l "$signal")))" wait "$group"
done
