//! Strict reader of the `OpenMetrics` text format: it refuses text that a lenient one accepts.

#![expect(clippy::float_cmp, reason = "what is counted is a whole number")]

use std::collections::{BTreeMap, BTreeSet};

/// Line with a value.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Sample {
    pub(super) name: String,
    pub(super) labels: BTreeMap<String, String>,
    pub(super) value: f64,
}

/// Samples that have one name, meaning and type.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Family {
    pub(super) help: String,
    pub(super) kind: String,
    pub(super) samples: Vec<Sample>,
}

/// Reads a whole text.
///
/// # Errors
/// The problem of the text, with its line.
pub(super) fn parse(text: &str) -> Result<BTreeMap<String, Family>, String> {
    let body = text
        .strip_suffix("# EOF\n")
        .ok_or("it does not end in # EOF")?;
    let mut families: BTreeMap<String, Family> = BTreeMap::new();
    let mut current: Option<String> = None;
    for line in body.lines() {
        let wrong = |what: &str| Err(format!("{what}: {line}"));
        if let Some(rest) = line.strip_prefix("# HELP ") {
            let Some((name, help)) = rest.split_once(' ').filter(|(_, help)| !help.is_empty())
            else {
                return wrong("no help");
            };
            let family = Family {
                help: help.to_owned(),
                kind: String::new(),
                samples: Vec::new(),
            };
            if families.insert(name.to_owned(), family).is_some() {
                return wrong("a family for the second time");
            }
            current = Some(name.to_owned());
        } else if let Some(rest) = line.strip_prefix("# TYPE ") {
            let (name, kind) = rest.split_once(' ').ok_or("no type")?;
            let family = families.get_mut(name).filter(|family| {
                current.as_deref() == Some(name)
                    && family.kind.is_empty()
                    && family.samples.is_empty()
            });
            let Some(family) = family else {
                return wrong("a type out of its place");
            };
            if !matches!(kind, "counter" | "gauge" | "histogram" | "info") {
                return wrong("an unknown type");
            }
            kind.clone_into(&mut family.kind);
        } else if line.starts_with('#') {
            return wrong("an unknown comment");
        } else {
            let sample = sample(line)?;
            let name = current.clone().unwrap_or_default();
            let family = families.get_mut(&name);
            let Some(family) = family.filter(|family| belongs(&sample, &name, &family.kind)) else {
                return wrong("a sample outside of its family");
            };
            family.samples.push(sample);
        }
    }
    for (name, family) in &families {
        check(name, family)?;
    }
    Ok(families)
}

/// True if a sample belongs to a family of this name and type.
fn belongs(sample: &Sample, family: &str, kind: &str) -> bool {
    let Some(suffix) = sample.name.strip_prefix(family) else {
        return false;
    };
    match kind {
        "counter" => suffix == "_total",
        "gauge" => suffix.is_empty(),
        "info" => suffix == "_info",
        "histogram" => matches!(suffix, "_sum" | "_count" | "_bucket"),
        _ => false,
    }
}

fn sample(line: &str) -> Result<Sample, String> {
    let wrong = |what: &str| format!("{what}: {line}");
    let end = line
        .find(['{', ' '])
        .ok_or_else(|| wrong("a line without a value"))?;
    let (name, rest) = line.split_at(end);
    check_name(name).map_err(|what| wrong(&what))?;
    let (labels, value) = match rest.strip_prefix('{') {
        Some(rest) => labels(rest).map_err(|what| wrong(&what))?,
        None => (BTreeMap::new(), rest),
    };
    let value = value.strip_prefix(' ').ok_or_else(|| wrong("no value"))?;
    let value = value
        .parse()
        .map_err(|_| wrong("a value that is no number"))?;
    Ok(Sample {
        name: name.to_owned(),
        labels,
        value,
    })
}

fn check_name(name: &str) -> Result<(), String> {
    let mut characters = name.chars();
    let first = characters
        .next()
        .is_some_and(|c| c.is_ascii_lowercase() || c == '_');
    let rest = characters.all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_');
    if first && rest {
        Ok(())
    } else {
        Err(format!("{name:?} is no name"))
    }
}

/// Labels after `{`, and the text after `}`.
fn labels(mut rest: &str) -> Result<(BTreeMap<String, String>, &str), String> {
    let mut labels = BTreeMap::new();
    loop {
        let (key, behind) = rest.split_once("=\"").ok_or("no label")?;
        check_name(key)?;
        let mut value = String::new();
        let mut characters = behind.char_indices();
        let end = loop {
            match characters.next().ok_or("a label without an end")? {
                (at, '"') => break at + 1,
                (_, '\\') => match characters.next().ok_or("a label without an end")? {
                    (_, escaped @ ('"' | '\\')) => value.push(escaped),
                    (_, 'n') => value.push('\n'),
                    (_, other) => return Err(format!("\\{other} escapes nothing")),
                },
                (_, character) => value.push(character),
            }
        };
        if labels.insert(key.to_owned(), value).is_some() {
            return Err(format!("{key} twice"));
        }
        rest = behind.get(end..).unwrap_or("");
        if let Some(after) = rest.strip_prefix('}') {
            return Ok((labels, after));
        }
        rest = rest.strip_prefix(',').ok_or("no comma between labels")?;
    }
}

/// Checks that no series is repeated, that counters are counts, and that histograms are complete.
fn check(name: &str, family: &Family) -> Result<(), String> {
    if family.kind.is_empty() {
        return Err(format!("{name} has no type"));
    }
    let mut seen = BTreeSet::new();
    for sample in &family.samples {
        if !seen.insert((&sample.name, &sample.labels)) {
            return Err(format!("a series twice: {sample:?}"));
        }
        if family.kind != "gauge" && (sample.value.is_nan() || sample.value < 0.0) {
            return Err(format!("less than nothing: {sample:?}"));
        }
    }
    if family.kind == "histogram" {
        check_histogram(name, family)?;
    }
    Ok(())
}

fn check_histogram(name: &str, family: &Family) -> Result<(), String> {
    let is = |sample: &Sample, suffix: &str| sample.name == format!("{name}{suffix}");
    for count in family.samples.iter().filter(|one| is(one, "_count")) {
        let buckets = family.samples.iter().filter(|one| {
            let mut labels = one.labels.clone();
            labels.remove("le").is_some() && is(one, "_bucket") && labels == count.labels
        });
        let (mut bound, mut below) = (f64::NEG_INFINITY, 0.0);
        for bucket in buckets {
            let le = &bucket.labels["le"];
            let le: f64 = le.parse().map_err(|_| format!("le is {le}"))?;
            if le <= bound || bucket.value < below {
                return Err(format!("buckets of {name} do not rise: {bucket:?}"));
            }
            (bound, below) = (le, bucket.value);
        }
        let has_sum = family
            .samples
            .iter()
            .any(|one| is(one, "_sum") && one.labels == count.labels);
        if bound != f64::INFINITY || below != count.value || !has_sum {
            return Err(format!("{name} is no whole histogram: {count:?}"));
        }
    }
    Ok(())
}

#[test]
fn what_is_wrong_is_refused() {
    let good = "# HELP a_seconds A.\n# TYPE a_seconds gauge\na_seconds{b=\"c\\\"\"} 1.5\n# EOF\n";
    let families = parse(good).unwrap();
    assert_eq!(families["a_seconds"].samples[0].labels["b"], "c\"");
    let counter = "# HELP a A.\n# TYPE a counter\n";
    let histogram = "# HELP a A.\n# TYPE a histogram\n";
    for bad in [
        "a 1\n# EOF\n".to_owned(),
        good.replace("# EOF\n", ""),
        good.replace("# HELP a_seconds A.\n", ""),
        good.replace("# TYPE a_seconds gauge\n", ""),
        good.replace("a_seconds{", "b_seconds{"),
        good.replace("1.5", "much"),
        good.replace("gauge", "number"),
        good.replace("# EOF", "a_seconds{b=\"c\\\"\"} 2\n# EOF"),
        good.replace(
            "# EOF",
            "# HELP a_seconds A.\n# TYPE a_seconds gauge\n# EOF",
        ),
        format!("{counter}a 1\n# EOF\n"),
        format!("{counter}a_total -1\n# EOF\n"),
        format!("{histogram}a_sum 1\na_count 2\na_bucket{{le=\"1\"}} 2\n# EOF\n"),
        format!("{histogram}a_sum 1\na_count 2\na_bucket{{le=\"+Inf\"}} 1\n# EOF\n"),
        format!("{histogram}a_count 2\na_bucket{{le=\"+Inf\"}} 2\n# EOF\n"),
        format!(
            "{histogram}a_sum 1\na_count 1\na_bucket{{le=\"1\"}} 2\na_bucket{{le=\"+Inf\"}} 1\n# EOF\n"
        ),
    ] {
        assert!(parse(&bad).is_err(), "{bad}");
    }
}
