//! Report of `fleetcal calibrate --json`, held against the truth.

/// Asserts that each parameter is as near to the truth as required, and inside `sigmas` of its own
/// sigma and `uncertainty` of the truth's.
///
/// # Panics
/// When one is not.
pub fn assert_near(
    report: &serde_json::Value,
    cases: &[(&str, f64, f64)],
    sigmas: f64,
    uncertainty: [f64; 2],
) {
    for &(name, truth, tolerance) in cases {
        let parameter = &report["parameters"][name];
        let error = parameter["value"].as_f64().expect("a number") - truth;
        assert!(
            error.abs() <= tolerance,
            "{name} is off by {error}, expected {tolerance}"
        );
        let uncertainty = if parameter["unit"] == "rad" {
            uncertainty[0]
        } else {
            uncertainty[1]
        };
        let honest = sigmas * parameter["sigma"].as_f64().expect("a number") + uncertainty;
        assert!(
            error.abs() <= honest,
            "{name} is off by {error}, its sigma allows {honest}"
        );
    }
}
