//! Writes that take only a part of what they were given: nothing is refused, nothing is lost.

use std::fs;
use std::process::Command;

use fleetcal_tests::service::Service;

use crate::durability::injected::{Robots, settle};

/// Registered robots.
const ROBOTS: usize = 15;

#[test]
fn a_service_goes_on_where_a_write_was_cut_short() {
    let folder = tempfile::tempdir().unwrap();
    let [library, log] = ["short_writes.so", "cuts"].map(|name| folder.path().join(name));
    let source = concat!(env!("CARGO_MANIFEST_DIR"), "/durability/short_writes.c");
    let built = Command::new("cc")
        .args(["-shared", "-fPIC", "-O1", "-o"])
        .arg(&library)
        .arg(source)
        .status();
    assert!(built.unwrap().success(), "the C compiler that SQLite needs");
    for every in [1, 2, 3, 7] {
        fs::write(&log, "").unwrap();
        let every = every.to_string();
        let cut = [
            ("LD_PRELOAD", library.to_str().unwrap()),
            ("SHORT_WRITES_EVERY", every.as_str()),
            ("SHORT_WRITES_LOG", log.to_str().unwrap()),
        ];
        let mut service = Service::start_with_variables(&cut);
        let mut robots = Robots::default();
        for _ in 0..ROBOTS {
            assert!(robots.register(&service));
        }
        settle(&service);
        service.kill();
        service.restart();
        robots.check(&service);
        let cuts = fs::metadata(&log).unwrap().len();
        println!("each {every}. write cut: {cuts} cuts, {ROBOTS} writes acknowledged, 0 lost");
        assert!(cuts as usize > ROBOTS, "{cuts} cuts are too few to tell");
    }
}
