# Compiles a tool once into target/packages.tools, without the long optimisation at link time, and puts
# that folder into PATH. For scripts to source: cargo_tool CRATE VERSION [OPTION]...
tools=target/packages.tools
export PATH="$PWD/$tools/bin:$PATH"

cargo_tool() {
  local crate="$1" version="$2"
  shift 2
  CARGO_PROFILE_RELEASE_LTO=off CARGO_PROFILE_RELEASE_CODEGEN_UNITS=16 \
    cargo install --locked --quiet --root "$tools" --target-dir "$tools/build" "$@" "$crate@$version"
}
