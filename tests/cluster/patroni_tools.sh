#!/usr/bin/env bash
# Prints the path of a Patroni of this version, in a folder, which gets it where it has none, and
# installs etcd where it is missing, as root: tests/cluster/patroni_tools.sh FOLDER VERSION
set -euo pipefail

folder="$1/patroni-$2"
version="$2"

# Installs packages, or says what is missing.
need() {
  if [ "$(id -u)" -ne 0 ] || ! command -v apt-get >/dev/null; then
    echo "$1 is missing, which these tests need: install the package $2, then run make again." >&2
    exit 1
  fi
  apt-get update -qq >/dev/null
  DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$2" >/dev/null
}

# The system's Python first: PostgreSQL's user runs it, who may not enter somebody's home.
python=/usr/bin/python3
[ -x "$python" ] || python="$(command -v python3)"
command -v etcd >/dev/null || need etcd etcd-server >&2
"$python" -c 'import ensurepip, venv' 2>/dev/null || need "Python 3 with venv" python3-venv >&2
if [ ! -x "$folder/bin/patroni" ]; then
  "$python" -m venv "$folder" >&2
  "$folder/bin/pip" install --quiet --disable-pip-version-check \
    "patroni[etcd3]==$version" 'psycopg[binary]' >&2
fi
chmod -R a+rX "$folder"
echo "$folder/bin/patroni"
