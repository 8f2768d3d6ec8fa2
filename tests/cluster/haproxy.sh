#!/usr/bin/env bash
# Prints where HAProxy is, and installs it where it is missing, as root: tests/cluster/haproxy.sh
set -euo pipefail

# Debian has it where only root looks.
export PATH="$PATH:/usr/sbin"
if ! command -v haproxy >/dev/null; then
  if [ "$(id -u)" -ne 0 ] || ! command -v apt-get >/dev/null; then
    echo "HAProxy is missing, which these tests need: install the package haproxy, then run make again." >&2
    exit 1
  fi
  apt-get update -qq >/dev/null
  DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends haproxy >/dev/null
  # The package starts it with a configuration of its own, which nobody asked for.
  if [ -d /run/systemd/system ]; then systemctl disable --now haproxy >&2; fi
fi
command -v haproxy
