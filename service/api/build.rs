//! Build script, which declares the API's embedded files to cargo: the dashboard's pages.

use std::path::Path;

fn main() {
    let pages = Path::new("../../web/dist");
    // The pages are built by npm; without them there is an empty folder, and the service says how
    // to build them.
    if let Err(error) = std::fs::create_dir_all(pages) {
        println!(
            "cargo::warning=the folder {} cannot be made: {error}",
            pages.display()
        );
    }
    println!("cargo::rerun-if-changed=../../web/dist");
}
