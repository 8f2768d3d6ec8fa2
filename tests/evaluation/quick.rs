//! The small evaluation holds all that the large one is held to.

use std::path::Path;

use fleetcal_evaluation::Evaluation;
use fleetcal_evaluation::extent::Extent;
use fleetcal_evaluation::study::recording::Source;

#[test]
fn every_figure_is_what_it_has_to_be() {
    let evaluation = Evaluation {
        extent: Extent::QUICK,
        only: Vec::new(),
        // The recording has its own tests; here it would need the whole command.
        source: Source::default(),
        commit: "under test".to_owned(),
        command: "make test",
    };
    let report = evaluation.run(|study| println!("{study}")).unwrap();
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    report.write(folder).unwrap();
    let claims = report.sections.iter().map(|section| section.claims.len());
    assert!(claims.sum::<usize>() > 20);
    let short = report.short_of();
    assert!(short.is_empty(), "falls short: {short:#?}");
}
