//! Words for people in documents.

use fleetcal_model::{Consistency, ModelFit, Unit};
use fleetcal_proto::estimate::ChangeDocument;

/// Writes a change or fault in one line.
pub fn event(event: &ChangeDocument) -> String {
    let kind = word(&event.kind);
    let cause = word(&event.cause);
    let changes: Vec<String> = event
        .change
        .iter()
        .map(|(name, by)| match name.unit() {
            Unit::Radian => format!("{} {:+.3}°", word(name), by.to_degrees()),
            Unit::Metre => format!("{} {:+.1} mm", word(name), by * 1e3),
            Unit::Second => format!("{} {:+.1} ms", word(name), by * 1e3),
            Unit::One => format!("{} {by:+.5}", word(name)),
        })
        .collect();
    format!(
        "{kind} ({cause}) at {:.1} s, since {:.1} s: {}",
        event.time_s,
        event.onset_s,
        changes.join(", ")
    )
}

/// Writes whether the model explains the data, in the dashboard's words.
pub fn fit(consistency: &Consistency) -> String {
    let times = consistency.errors_over_expected();
    let times = format!("{times:.1} times as large as expected");
    match consistency.fit {
        None => "Too few updates yet to say whether the model explains the data.".to_owned(),
        Some(ModelFit::Explained) => {
            format!("The model explains the data: its errors are {times}.")
        }
        Some(ModelFit::Rough) => format!(
            "The errors are {times}: the robot moves or measures more roughly than configured, and the \
             standard deviations are wider for it."
        ),
        Some(ModelFit::Unexplained) => format!(
            "The model does not explain the data: its errors are {times}. Look at wheelbase, vehicle \
             model, signs and stamps."
        ),
    }
}

/// Returns the word that documents use, with spaces.
pub fn word(value: &impl serde::Serialize) -> String {
    match serde_json::to_value(value) {
        Ok(serde_json::Value::String(word)) => word.replace('_', " "),
        _ => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use serde::Deserialize;

    use super::*;

    /// Sentences of the dashboard and of documents, which the tests of both read.
    const SENTENCES: &str = include_str!("../../../web/src/robot/fit-sentences.json");

    #[derive(Deserialize)]
    struct Case {
        consistency: Consistency,
        sentence: String,
    }

    #[test]
    fn the_fit_is_said_in_the_words_of_the_dashboard() {
        let cases: Vec<Case> = serde_json::from_str(SENTENCES).unwrap();
        assert_eq!(cases.len(), 4);
        for case in cases {
            assert_eq!(fit(&case.consistency), case.sentence);
        }
    }
}
