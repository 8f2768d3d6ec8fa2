#!/usr/bin/env bash
# Installs, starts, upgrades, removes and purges the Debian package of target/packages in a Debian of
# its own, and runs the container image and the archive. `make test-packages`, as root.
#
# systemd does not run in a chroot. In its place the line ExecStart of the installed unit is run as the
# unit's User, with its StateDirectory made as systemd makes it; `systemd-analyze verify` reads the unit.
set -euo pipefail
cd "$(dirname "$0")/.."

built="$(realpath "${CARGO_TARGET_DIR:-target}")"
version="$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -1)"
unit=/lib/systemd/system/fleetcal.service
api=http://127.0.0.1:8080
limit_s=300

fail() {
  echo "FAILED: $1" >&2
  exit 1
}

# Ports and processes of its own, so that a service that runs here is not met.
if [ "${FLEETCAL_INSIDE:-}" != 1 ]; then
  [ "$(id -u)" = 0 ] || fail "run this as root: it makes a Debian in a chroot"
  for package in mmdebstrap podman iproute2; do
    dpkg -s "$package" >/dev/null 2>&1 || DEBIAN_FRONTEND=noninteractive \
      apt-get install -y -qq --no-install-recommends "$package" >/dev/null
  done
  debian="$built/packages.debian"
  if [ ! -x "$debian/usr/bin/apt-get" ]; then
    mmdebstrap --variant=minbase --include=ca-certificates,adduser,systemd,curl bookworm "$debian"
  fi
  export FLEETCAL_INSIDE=1
  exec unshare --net --mount --pid --fork --mount-proc "$0" "$@"
fi

ip link set lo up
debian="$(mktemp -d)"
cleanup() {
  mountpoint -q "$debian/proc" && umount "$debian/proc"
  rm -rf "$debian"
}
trap cleanup EXIT
cp -a "$built/packages.debian/." "$debian/"
mount -t proc proc "$debian/proc"
cp "$built/packages/fleetcal_${version}-1_amd64.deb" "$built/packages.stage/fleetcal_${version}-2_amd64.deb" "$debian/root/"

inside() {
  chroot "$debian" /usr/bin/env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root DEBIAN_FRONTEND=noninteractive "$@"
}

setting() {
  sed -n "s/^$1=//p" "$debian$unit"
}

as_service() {
  inside setpriv --reuid "$(setting User)" --regid "$(setting Group)" --clear-groups --no-new-privs "$@"
}

# What systemd does for the unit.
start() {
  local state user
  state="/var/lib/$(setting StateDirectory)"
  user="$(setting User)"
  inside install -d -o "$user" -g "$user" -m "$(setting StateDirectoryMode)" "$state"
  # The words of ExecStart have no quotes.
  # shellcheck disable=SC2046
  as_service $(setting ExecStart) >"$debian/root/service.log" 2>&1 &
  service=$!
  for _ in $(seq 300); do
    curl -fs "$api/readyz" >/dev/null && return
    sleep 0.1
  done
  cat "$debian/root/service.log" >&2
  fail "the service is not ready"
}

stop() {
  kill -TERM "$service"
  wait "$service" || fail "the service ended with status $?"
}

ask() {
  curl -fsS -H "Authorization: Bearer $token" "$@"
}

install_deb() {
  inside apt-get install -y -qq "/root/fleetcal_${version}-$1_amd64.deb" >/dev/null
}

calibrated() {
  ask "$api/api/v1/robots/tugger_01/estimate" | grep -q '"steering_offset":{[^}]*"converged"'
}

began=$(date +%s)
install_deb 1
inside systemd-analyze verify "$unit"
inside getent passwd fleetcal >/dev/null || fail "no user of its own"
inside dpkg -L fleetcal | grep -q THIRD-PARTY-NOTICES.md || fail "no third-party notices"
start
[ "$(stat -c %U "/proc/$(pgrep -n -x fleetcal)")" != root ] || fail "the service runs as root"
token="$(as_service fleetcal token create --data /var/lib/fleetcal --role operator --name test)"
ask -X PUT -H 'If-None-Match: *' -H 'Content-Type: application/json' \
  -d '{"model": "bicycle", "wheelbase_m": 1.2}' "$api/api/v1/robots/tugger_01" >/dev/null
inside fleetcal simulate --connect tcp/127.0.0.1:7447 >/dev/null 2>&1 &
robot=$!
until calibrated; do
  [ $(($(date +%s) - began)) -lt $limit_s ] || fail "no calibrated robot within $limit_s s"
  sleep 1
done
echo "from the package to a calibrated robot: $(($(date +%s) - began)) s"
kill "$robot"
stop

install_deb 2
inside dpkg -s fleetcal | grep -q "^Version: ${version}-2" || fail "not upgraded"
start
ask "$api/api/v1/robots/tugger_01" | grep -q '"wheelbase_m":1.2' || fail "the upgrade lost a robot"
stop
echo "upgraded: the robot and its token are there"

inside apt-get remove -y -qq fleetcal >/dev/null
[ ! -e "$debian/usr/bin/fleetcal" ] || fail "removing left the binary"
inside test -e /var/lib/fleetcal/fleetcal.db || fail "removing took the database"
inside apt-get purge -y -qq fleetcal >/dev/null
[ ! -e "$debian/var/lib/fleetcal" ] || fail "purging left the database"
[ ! -e "$debian/etc/fleetcal" ] || fail "purging left the configuration"
echo "removed and purged"

folder="$debian/root/archive"
mkdir "$folder"
tar --extract --gzip --file "$built/packages/fleetcal-$version-x86_64-unknown-linux-musl.tar.gz" --directory "$folder" --strip-components 1
(cd "$folder" && ./fleetcal simulate --record robot.mcap --duration 60 >/dev/null && ./fleetcal calibrate robot.mcap --wheelbase 1.2 >/dev/null)
echo "the archive's binary calibrates a recording"

podman=(podman --storage-driver vfs --root "$debian/root/images" --runroot "$debian/root/run" --cgroup-manager cgroupfs)
"${podman[@]}" load --quiet --input "$built/packages/fleetcal-$version.oci.tar" >/dev/null
container="$("${podman[@]}" run --detach --cgroups disabled --network host "localhost/fleetcal:$version")"
for _ in $(seq 300); do
  curl -fs "$api/readyz" >/dev/null && break
  sleep 0.1
done
curl -fs "$api/readyz" >/dev/null || { "${podman[@]}" logs "$container" >&2; fail "the container is not ready"; }
"${podman[@]}" exec "$container" fleetcal token create --data /data --role viewer --name test >/dev/null
"${podman[@]}" stop --time 10 "$container" >/dev/null
status="$("${podman[@]}" inspect --format '{{.State.ExitCode}}' "$container")"
[ "$status" = 0 ] || fail "the container ended with status $status"
"${podman[@]}" rm "$container" >/dev/null
echo "the container serves and stops in order"
