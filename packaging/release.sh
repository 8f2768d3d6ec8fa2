#!/usr/bin/env bash
# Makes what a release publishes, in target/packages: a static binary in an archive, a Debian package,
# a container image, third-party notices, an SBOM and checksums. `make release` runs it.
set -euo pipefail
cd "$(dirname "$0")/.."

built="${CARGO_TARGET_DIR:-target}"
target=x86_64-unknown-linux-musl
version="$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -1)"
name="fleetcal-$version-$target"
out="$built/packages"
stage="$built/packages.stage"
binary="$built/$target/release/fleetcal"

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

cargo_tool() {
  command -v "$1" >/dev/null || cargo install --locked "$@"
}

tools() {
  system_package musl-gcc musl-tools
  system_package buildah buildah
  [ -f /etc/ssl/certs/ca-certificates.crt ] || fail "/etc/ssl/certs/ca-certificates.crt is missing: install the package ca-certificates."
  command -v rustup >/dev/null || fail "rustup is missing: install it for the target $target."
  rustup target add "$target"
  cargo_tool cargo-about --features cli
  cargo_tool cargo-deb
  cargo_tool cargo-cyclonedx
}

build() {
  cargo build --release --locked --package fleetcal --bin fleetcal --target "$target"
  if readelf --program-headers "$binary" | grep -q INTERP; then
    fail "$binary is not static: it asks for a dynamic loader."
  fi
}

# Everything that the archive, the Debian package and the image contain, in one folder.
gather() {
  rm -rf "$stage" "$out"
  mkdir -p "$stage/man" "$stage/completions" "$out"
  cp "$binary" LICENSE CHANGELOG.md fleetcal.example.toml "$stage/"
  cp packaging/fleetcal.service packaging/fleetcal.toml "$stage/"
  "$binary" man "$stage/man"
  gzip -9 -n -f "$stage"/man/*.1
  "$binary" completions bash >"$stage/completions/fleetcal"
  "$binary" completions zsh >"$stage/completions/_fleetcal"
  "$binary" completions fish >"$stage/completions/fleetcal.fish"
  cargo about generate --locked --config packaging/about.toml --manifest-path service/Cargo.toml \
    packaging/notices.hbs >"$stage/THIRD-PARTY-NOTICES.md"
  # The dashboard's packages, as its bundler names them.
  cat web/dist/licenses.md >>"$stage/THIRD-PARTY-NOTICES.md"
}

archive() {
  tar --create --gzip --sort=name --owner=0 --group=0 --numeric-owner \
    --mtime="@$(git log -1 --format=%ct)" --transform "s,^\.,$name," \
    --file "$out/$name.tar.gz" --directory "$stage" .
}

debian() {
  cargo deb --package fleetcal --no-build --no-strip --target "$target" \
    --output "$out/fleetcal_${version}-1_amd64.deb"
  # A later revision of the same, for the test of an upgrade; it is not published.
  cargo deb --package fleetcal --no-build --no-strip --target "$target" --deb-revision 2 \
    --output "$stage/fleetcal_${version}-2_amd64.deb"
}

container() {
  local context
  context="$(mktemp -d)"
  cp "$stage/fleetcal" "$stage/THIRD-PARTY-NOTICES.md" LICENSE packaging/Containerfile "$context/"
  cp -L /etc/ssl/certs/ca-certificates.crt "$context/"
  mkdir -m 700 "$context/data"
  buildah --storage-driver vfs build --isolation chroot --tag "fleetcal:$version" "$context"
  buildah --storage-driver vfs push "fleetcal:$version" "oci-archive:$out/fleetcal-$version.oci.tar:fleetcal:$version"
  rm -rf "$context"
}

bill_of_materials() {
  cargo cyclonedx --manifest-path service/Cargo.toml --format json --target "$target" \
    --override-filename fleetcal.cdx
  mv service/fleetcal.cdx.json "$out/fleetcal-$version.cdx.json"
  # It writes one beside each member of the workspace.
  git ls-files --others --exclude-standard -- '*.cdx.json' | xargs --no-run-if-empty rm
}

tools
build
gather
archive
debian
bill_of_materials
container
(cd "$out" && sha256sum -- * >SHA256SUMS && cat SHA256SUMS)
