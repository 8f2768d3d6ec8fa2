//! The small evaluation holds all that the large one is held to.

use std::path::Path;

use fleetcal_evaluation::evaluate;
use fleetcal_evaluation::extent::Extent;

#[test]
fn every_figure_is_what_it_has_to_be() {
    let report = evaluate(&Extent::QUICK, &[], "test", "make test", |study| {
        println!("{study}");
    })
    .unwrap();
    report
        .write(Path::new(env!("CARGO_TARGET_TMPDIR")))
        .unwrap();
    let short = report.short_of();
    assert!(short.is_empty(), "falls short: {short:#?}");
}
