//! Tells cargo what the store embeds: the migrations.

fn main() {
    println!("cargo::rerun-if-changed=../../migrations");
}
