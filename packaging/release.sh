#!/usr/bin/env bash
# Makes what a release publishes, in target/packages: a static binary in an archive, a Debian package,
# a Python wheel, a container image, third-party notices, bills of materials and checksums. `make
# release` runs it.
set -euo pipefail
cd "$(dirname "$0")/.."

built="${CARGO_TARGET_DIR:-target}"
target=x86_64-unknown-linux-musl
version="$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -1)"
name="fleetcal-$version-$target"
out=target/packages
# Files of a release are dated by their commit.
SOURCE_DATE_EPOCH="$(git log -1 --format=%ct)"
export SOURCE_DATE_EPOCH
stage=target/packages.stage
binary="$built/$target/release/fleetcal"
export CC_x86_64_unknown_linux_musl=musl-gcc
# shellcheck source=packaging/cargo_tool.sh
. packaging/cargo_tool.sh

fail() {
  echo "$1" >&2
  exit 1
}

# A package of the system: installed by root on Debian, else named.
system_package() {
  command -v "$1" >/dev/null && return
  if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    apt-get update -qq
    DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$2" >/dev/null
  else
    fail "$1 is missing: install the package $2, then run make release again."
  fi
}

readable() {
  [ -f "$1" ] || fail "$1 is missing: install the package $2, then run make release again."
}

install_tools() {
  command -v rustup >/dev/null || fail "rustup is missing: install it, for the target $target."
  rustup target add "$target"
  system_package musl-gcc musl-tools
  system_package buildah buildah
  readable /etc/ssl/certs/ca-certificates.crt ca-certificates
  readable /usr/share/common-licenses/Apache-2.0 base-files
  readable /usr/share/doc/musl/copyright musl
  cargo_tool cargo-deb 3.8.0
  cargo_tool cargo-about 0.9.3 --features cli
}

build() {
  cargo build --release --locked --package fleetcal --bin fleetcal --target "$target"
  if readelf --program-headers --wide "$binary" | grep INTERP >/dev/null; then
    fail "$binary is not static: it asks for a dynamic loader."
  fi
}

# The folder of a crate's source.
crate_source() {
  local manifest
  manifest="$(cargo metadata --locked --format-version 1 |
    python3 -c 'import json, sys
print(next(p["manifest_path"] for p in json.load(sys.stdin)["packages"] if p["name"] == sys.argv[1]))' "$1")"
  dirname "$manifest"
}

# What the binary contains: crates, the dashboard's packages, musl and Rust's own library.
notices() {
  cargo about generate --locked --fail --target "$target" --config packaging/about.toml \
    --manifest-path service/Cargo.toml packaging/notices.hbs
  echo "# Packages of the dashboard"
  sed -e '1,/^The app bundles/d' web/dist/licenses.md
  printf '\n## The font Inter (OFL-1.1)\n\n'
  cat web/node_modules/@fontsource-variable/inter/LICENSE
  printf '\n# The allocator jemalloc\n\n```\n'
  cat "$(crate_source tikv-jemalloc-sys)/jemalloc/COPYING"
  printf '```\n\n# The C library musl\n\n```\n'
  cat /usr/share/doc/musl/copyright
  printf '```\n\n# The Rust standard library\n\nThe file rust-library.html beside this one.\n'
}

# Everything that the archive, the Debian package, the wheel and the image contain, in one folder.
gather() {
  rm -rf "$stage" "$out"
  mkdir -p "$stage/man" "$stage/completions" "$out"
  cp "$binary" LICENSE CHANGELOG.md fleetcal.example.toml "$stage/"
  cp packaging/fleetcal.service packaging/fleetcal.toml "$stage/"
  cp packaging/grafana/fleetcal.json "$stage/grafana-dashboard.json"
  cp /usr/share/common-licenses/Apache-2.0 "$stage/LICENSE-Apache-2.0.txt"
  cp "$(rustc --print sysroot)/share/doc/rust/COPYRIGHT-library.html" "$stage/rust-library.html"
  "$binary" man "$stage/man"
  gzip -9 -n -f "$stage"/man/*.1
  "$binary" completions bash >"$stage/completions/fleetcal"
  "$binary" completions zsh >"$stage/completions/_fleetcal"
  "$binary" completions fish >"$stage/completions/fleetcal.fish"
  notices >"$stage/THIRD-PARTY-NOTICES.md"
}

archive() {
  tar --create --use-compress-program 'gzip -9n' --sort=name --owner=0 --group=0 --numeric-owner \
    --mtime="@$(git log -1 --format=%ct)" --transform "s,^\.,$name," \
    --file "$out/$name.tar.gz" --directory "$stage" .
}

debian_package() {
  local revision="$1" to="$2"
  shift 2
  cargo deb --package fleetcal --no-build --no-strip --target "$target" --deb-revision "$revision" --output "$to" "$@"
}

container() {
  local context
  context="$(mktemp -d)"
  cp "$stage"/{fleetcal,THIRD-PARTY-NOTICES.md,rust-library.html,LICENSE,LICENSE-Apache-2.0.txt} "$context/"
  cp packaging/Containerfile "$context/"
  cp -L /etc/ssl/certs/ca-certificates.crt "$context/"
  mkdir -m 700 "$context/data" "$context/tmp"
  buildah --storage-driver vfs build --isolation chroot --timestamp "$(git log -1 --format=%ct)" \
    --tag "fleetcal:$version" "$context"
  buildah --storage-driver vfs push "fleetcal:$version" "oci-archive:$out/fleetcal-$version.oci.tar:fleetcal:$version"
  buildah --storage-driver vfs rmi "fleetcal:$version" >/dev/null
  rm -rf "$context"
}

install_tools
build
gather
archive
debian_package 1 "$out/fleetcal_$version-1_amd64.deb"
# A later revision of the same, for the test of an upgrade; it is not published.
debian_package 2 "$stage/fleetcal_$version-2_amd64.deb" --fast
# Static: it asks for no C library, of whatever kind and age.
packaging/wheel.sh "$stage" "$out" manylinux2014_x86_64 musllinux_1_1_x86_64
packaging/sbom.sh "$out"
container
cd "$out"
sha256sum -- fleetcal* >SHA256SUMS
cat SHA256SUMS
