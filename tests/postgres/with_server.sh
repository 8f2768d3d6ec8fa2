#!/usr/bin/env bash
# Runs a command beside a throw-away PostgreSQL, which the command finds in FLEETCAL_TEST_POSTGRES
# and may fill with databases: tests/postgres/with_server.sh [--durable] COMMAND [ARGUMENT]...
# The server is on loopback, belongs to this run alone, and goes with it. With --durable it writes to
# the disk as one that is used does, for measurements, with the settings that docs/postgresql.md
# advises; without it nothing outlives a power cut, which tests do not need: those of durability start
# servers of their own.
set -euo pipefail

settings="-c fsync=off -c full_page_writes=off"
if [ "${1:-}" = --durable ]; then
  settings="-c checkpoint_timeout=15min -c max_wal_size=4GB -c wal_compression=on"
  shift
fi
if [ "$#" -eq 0 ]; then
  echo "usage: $0 [--durable] COMMAND [ARGUMENT]..." >&2
  exit 2
fi

# The newest server there is, if it is new enough: in the PATH, or where packages put it. On Debian it
# is not in the PATH.
find_bin() {
  local initdb version newest=14 found=""
  for initdb in "$(command -v initdb)" /usr/lib/postgresql/*/bin/initdb /usr/pgsql-*/bin/initdb \
    /usr/local/pgsql/bin/initdb; do
    [ -x "$initdb" ] || continue
    # Such as "initdb (PostgreSQL) 15.18 (Debian 15.18-0+deb12u1)".
    version="$("$initdb" --version)"
    version="${version#*) }"
    version="${version%%[!0-9]*}"
    if [ "${version:-0}" -gt "$newest" ]; then
      newest="$version"
      found="$(dirname "$initdb")"
    fi
  done
  echo "$found"
}

bin="$(find_bin)"
if [ -z "$bin" ] && [ "$(id -u)" -eq 0 ] && command -v apt-get >/dev/null; then
  # Without the cluster that Debian makes for everybody: this run makes its own.
  if [ ! -e /etc/postgresql-common/createcluster.conf ]; then
    mkdir -p /etc/postgresql-common
    echo "create_main_cluster = false" >/etc/postgresql-common/createcluster.conf
  fi
  apt-get update -qq >/dev/null
  DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends postgresql >/dev/null
  bin="$(find_bin)"
fi
if [ -z "$bin" ]; then
  echo "PostgreSQL 15 or newer is missing, which these tests need: install the package postgresql, then run make again." >&2
  exit 1
fi

# PostgreSQL refuses to run as root.
as_owner=()
if [ "$(id -u)" -eq 0 ]; then
  as_owner=(runuser -u postgres --)
fi
folder="$(mktemp -d "${TMPDIR:-/tmp}/fleetcal-postgres.XXXXXX")"

stop() {
  # A second Ctrl-C would leave the server behind.
  trap '' INT TERM HUP
  "${as_owner[@]}" "$bin/pg_ctl" -D "$folder/data" -m immediate -w stop >/dev/null 2>&1 || true
  rm -rf "$folder"
}
trap stop EXIT
trap 'exit 130' INT
trap 'exit 143' TERM
trap 'exit 129' HUP

chmod 755 "$folder"
if [ "${#as_owner[@]}" -gt 0 ]; then
  chown postgres "$folder"
fi
cd "$folder"
"${as_owner[@]}" "$bin/initdb" -D "$folder/data" -U fleetcal --auth=trust -E UTF8 --locale=C \
  --no-sync >/dev/null
port="$(python3 -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])')"
if ! "${as_owner[@]}" "$bin/pg_ctl" -D "$folder/data" -l "$folder/log" -w start -o \
  "-p $port -k '$folder' -c listen_addresses=127.0.0.1 -c max_connections=300 \
   $settings" >/dev/null; then
  cat "$folder/log" >&2
  exit 1
fi
cd "$OLDPWD"
FLEETCAL_TEST_POSTGRES="postgres://fleetcal@127.0.0.1:$port/postgres" "$@"
