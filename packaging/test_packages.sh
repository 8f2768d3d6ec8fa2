#!/usr/bin/env bash
# Installs, starts, upgrades, removes and purges the Debian package of target/packages in a Debian of
# its own, and runs the container image, the archive and the wheel. `make test-packages`, as root.
#
# systemd does not run in a chroot. In its place the line ExecStart of the installed unit is run as the
# unit's User, with its StateDirectory made as systemd makes it; `systemd-analyze verify` reads the unit.
set -euo pipefail
cd "$(dirname "$0")/.."

packages="$PWD/target/packages"
stage="$PWD/target/packages.stage"
clean_debian="$PWD/target/packages.debian"
version="$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -1)"
target=x86_64-unknown-linux-musl
api=http://127.0.0.1:8080
calibrated_within_s=300
ready_within_s=60

fail() {
  echo "FAILED: $1" >&2
  exit 1
}

# Ports, processes and mounts of its own, so that a service that runs here is not met.
if [ "${FLEETCAL_INSIDE:-}" != 1 ]; then
  [ "$(id -u)" = 0 ] || fail "run this as root: it makes a Debian in a chroot"
  [ -f "$packages/SHA256SUMS" ] || fail "target/packages is empty: run make release first"
  for package in mmdebstrap podman iproute2 curl; do
    dpkg -s "$package" >/dev/null 2>&1 || DEBIAN_FRONTEND=noninteractive \
      apt-get install -y -qq --no-install-recommends "$package" >/dev/null
  done
  if [ ! -x "$clean_debian/usr/bin/apt-get" ]; then
    mmdebstrap --variant=minbase --include=ca-certificates,adduser,systemd,man-db bookworm "$clean_debian"
  fi
  export FLEETCAL_INSIDE=1
  exec unshare --net --mount --pid --fork --mount-proc --kill-child "$0" "$@"
fi

ip link set lo up
# crun refuses a system that has both generations of control groups.
mount -t cgroup2 none /sys/fs/cgroup
work="$(mktemp -d)"
debian="$work/debian"
cleanup() {
  if mountpoint -q "$debian/proc"; then
    umount "$debian/proc"
  fi
  rm -rf "$work"
}
trap cleanup EXIT
cp -a "$clean_debian" "$debian"
mount -t proc proc "$debian/proc"
cp "$packages/fleetcal_$version-1_amd64.deb" "$stage/fleetcal_$version-2_amd64.deb" "$debian/srv/"

# Words before a command that runs it in that Debian.
inside=(chroot "$debian" /usr/bin/env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root DEBIAN_FRONTEND=noninteractive)

apt() {
  "${inside[@]}" apt-get "$1" -y -qq "$2" >"$work/apt.log" 2>&1 ||
    { cat "$work/apt.log" >&2; fail "apt-get $1 $2"; }
}

install_deb() {
  apt install "/srv/fleetcal_$version-$1_amd64.deb"
}

setting() {
  sed -n "s/^$1=//p" "$debian$unit"
}

# `until_true SECONDS REASON COMMAND`: waits until the command succeeds.
until_true() {
  local limit_s="$1" reason="$2" began_s=$SECONDS
  shift 2
  until "$@"; do
    [ $((SECONDS - began_s)) -lt "$limit_s" ] || logged "$reason within $limit_s s"
    sleep 0.5
  done
}

ready() {
  curl -fs "$api/readyz" >/dev/null
}

logged() {
  cat "$work"/*.log >&2
  fail "$1"
}

# What systemd does for the unit.
start() {
  "${inside[@]}" install -d -o "$user" -g "$user" -m "$(setting StateDirectoryMode)" "/var/lib/$(setting StateDirectory)"
  # The words of ExecStart have no quotes.
  # shellcheck disable=SC2046
  "${as_service[@]}" $(setting ExecStart) >"$work/service.log" 2>&1 &
  service=$!
  until_true $ready_within_s "the service is not ready" ready
}

stop() {
  kill -TERM "$service"
  local status=0
  wait "$service" || status=$?
  [ "$status" = 0 ] || logged "the service ended with status $status"
}

ask() {
  curl -fsS -H "Authorization: Bearer $token" "$@"
}

add_robot() {
  ask -X PUT -H 'If-None-Match: *' -H 'Content-Type: application/json' \
    -d '{"model": "bicycle", "wheelbase_m": 1.2}' "$api/api/v1/robots/tugger_01" >/dev/null
}

converged() {
  ask "$api/api/v1/robots/tugger_01/estimate" >"$work/estimate.json" 2>/dev/null &&
    [[ "$(cat "$work/estimate.json")" =~ \"steering_offset\":\{[^}]*\"status\":\"converged\" ]] &&
    [[ "$(cat "$work/estimate.json")" =~ \"lidar_yaw\":\{[^}]*\"status\":\"converged\" ]]
}

installed_service_calibrates() {
  local began_s=$SECONDS robot
  install_deb 1
  unit="$("${inside[@]}" dpkg -L fleetcal | grep '/fleetcal\.service$')"
  user="$(setting User)"
  as_service=("${inside[@]}" setpriv --reuid "$user" --regid "$(setting Group)" --clear-groups --no-new-privs)
  "${inside[@]}" systemd-analyze verify "$unit"
  start
  [ "$(stat -c %U "/proc/$service")" != root ] || fail "the service runs as root"
  token="$("${as_service[@]}" fleetcal token create --data /var/lib/fleetcal --role operator --name test)"
  add_robot
  "${inside[@]}" fleetcal simulate --connect tcp/127.0.0.1:7447 >"$work/robot.log" 2>&1 &
  robot=$!
  until_true $calibrated_within_s "no robot is calibrated" converged
  echo "from the package to a calibrated robot: $((SECONDS - began_s)) s"
  kill "$robot"
  wait "$robot" || true
  stop
}

package_is_whole() {
  local file
  for file in doc/fleetcal/THIRD-PARTY-NOTICES.md doc/fleetcal/LICENSE-Apache-2.0.txt doc/fleetcal/copyright \
    man/man1/fleetcal.1.gz man/man1/fleetcal-serve.1.gz bash-completion/completions/fleetcal \
    zsh/vendor-completions/_fleetcal fish/vendor_completions.d/fleetcal.fish; do
    [ -s "$debian/usr/share/$file" ] || fail "/usr/share/$file is missing"
  done
  "${inside[@]}" man --warnings fleetcal >/dev/null
  [ "$("${inside[@]}" fleetcal --version)" = "fleetcal $version" ] || fail "another version than $version"
  "${inside[@]}" fleetcal check-config /etc/fleetcal/fleetcal.toml >/dev/null
  echo "the package has its binary, manual pages, completions and licences"
}

upgrade_keeps_data() {
  echo '# a line of the administrator' >>"$debian/etc/fleetcal/fleetcal.toml"
  install_deb 2
  # dpkg-query expands this itself.
  # shellcheck disable=SC2016
  [ "$("${inside[@]}" dpkg-query --show --showformat '${Version}' fleetcal)" = "$version-2" ] || fail "not upgraded"
  grep 'a line of the administrator' "$debian/etc/fleetcal/fleetcal.toml" >/dev/null || fail "the upgrade lost the configuration"
  start
  [[ "$(ask "$api/api/v1/robots/tugger_01")" == *'"wheelbase_m":1.2'* ]] || fail "the upgrade lost a robot"
  stop
  echo "upgraded: configuration, robot and token are there"
}

removal_keeps_data_and_purge_does_not() {
  apt remove fleetcal
  [ ! -e "$debian/usr/bin/fleetcal" ] || fail "removing left the binary"
  [ -s "$debian/var/lib/fleetcal/fleetcal.db" ] || fail "removing took the database"
  apt purge fleetcal
  [ ! -e "$debian/var/lib/fleetcal" ] || fail "purging left the database"
  [ ! -e "$debian/etc/fleetcal" ] || fail "purging left the configuration"
  echo "removed with the data kept, purged with the data deleted"
}

archive_calibrates_a_recording() {
  local folder="$work/archive"
  mkdir "$folder"
  tar --extract --gzip --file "$packages/fleetcal-$version-$target.tar.gz" --directory "$folder" --strip-components 1
  (cd "$folder" && ./fleetcal simulate --record robot.mcap --duration 60 >/dev/null 2>&1 &&
    ./fleetcal calibrate robot.mcap --wheelbase 1.2 >/dev/null) || fail "the archive's binary calibrates no recording"
  echo "the archive's binary calibrates a recording"
}

# The machine's own Python: the wheel has the static binary alone.
wheel_checks_a_recording() {
  local environment="$work/environment"
  python3 -m venv "$environment"
  "$environment/bin/pip" install --quiet --disable-pip-version-check --no-index "$packages"/fleetcal-*.whl
  (cd "$environment" && bin/fleetcal simulate --record robot.mcap --duration 60 >/dev/null 2>&1 &&
    bin/fleetcal doctor robot.mcap --wheelbase 1.2 >/dev/null) || fail "the wheel's binary checks no recording"
  echo "the wheel's binary checks a recording"
}

image_serves() {
  local podman container status
  podman=(podman --storage-driver vfs --root "$work/images" --runroot "$work/run" --cgroup-manager cgroupfs)
  "${podman[@]}" load --quiet --input "$packages/fleetcal-$version.oci.tar" >/dev/null
  container="$("${podman[@]}" run --detach --cgroups disabled --network host "localhost/fleetcal:$version")"
  until_true $ready_within_s "the container is not ready" ready
  token="$("${podman[@]}" exec "$container" fleetcal token create --data /data --role operator --name test)"
  add_robot
  "${podman[@]}" stop --time 20 "$container" >/dev/null
  status="$("${podman[@]}" inspect --format '{{.State.ExitCode}}' "$container")"
  [ "$status" = 0 ] || fail "the container ended with status $status"
  "${podman[@]}" start "$container" >/dev/null
  until_true $ready_within_s "the container does not start again" ready
  [[ "$(ask "$api/api/v1/robots/tugger_01")" == *'"wheelbase_m":1.2'* ]] || fail "the container lost a robot"
  "${podman[@]}" rm --force --time 20 "$container" >/dev/null
  echo "the container serves, stops in order, and starts again with its data"
}

(cd "$packages" && sha256sum --check --quiet SHA256SUMS)
installed_service_calibrates
package_is_whole
upgrade_keeps_data
removal_keeps_data_and_purge_does_not
archive_calibrates_a_recording
wheel_checks_a_recording
image_serves
