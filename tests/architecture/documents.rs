//! Documents that people read: the links among them, the book's table of contents, and words that
//! nobody should have to decode.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};

use pulldown_cmark::{Event, HeadingLevel, Options, Parser, Tag, TagEnd};

/// Words and phrases to avoid, with the term instead.
pub const NOT_USED: &[(&str, &str)] = &[
    ("anew", "again, from scratch"),
    ("whoever", "a person who, clients that"),
    ("site-wide stop", "deployment freeze, paused deployments"),
    ("doubt", "uncertainty"),
    ("doubts", "uncertainties"),
    ("brought along", "factory calibration"),
    ("what is approved", "the approved calibration"),
    ("surely", "significantly"),
    ("on trial", "in verification"),
    ("seen from above", "top view"),
    ("stands under", "is in"),
    ("counts meanwhile", "applies meanwhile"),
    ("drive stream", "wheel odometry"),
    ("fresh estimate", "verification estimate"),
    ("waits for approval", "awaits approval"),
    ("clerk", "lifecycle"),
    ("sentry", "alert evaluator"),
    ("courier", "webhook dispatcher"),
    ("parcel", "outbox message"),
    ("shed", "dropped"),
    ("sweep", "scan"),
    ("sweeps", "scans"),
];

/// Files that may use words of [`NOT_USED`] with this beginning, with the reason. An empty path is
/// all Rust sources.
pub const MAY_USE: &[(&str, &str, &str)] = &[
    ("tests/architecture/documents.rs", "", "lists the words"),
    ("docs/upgrading.md", "", "names what was renamed"),
    ("CHANGELOG.md", "", "names what was renamed"),
    (
        "proto/src/progress.rs",
        "shed",
        "the name on the wire, by which senders pace themselves",
    ),
    ("", "whoever", "only documents avoid it so far"),
];

/// Returns the abbreviated commit ids of a text: seven to ten hexadecimal digits, letters and
/// figures, outside links.
pub fn commits(text: &str) -> Vec<&str> {
    let is_id = |word: &&str| {
        (7..=10).contains(&word.len())
            && word
                .bytes()
                .all(|byte| matches!(byte, b'0'..=b'9' | b'a'..=b'f'))
            && word.bytes().any(|byte| byte.is_ascii_digit())
            && word.bytes().any(|byte| byte.is_ascii_lowercase())
    };
    let words = text.split_whitespace().filter(|word| !word.contains("://"));
    let parts = words.flat_map(|word| word.split(|letter: char| !letter.is_ascii_alphanumeric()));
    parts.filter(is_id).collect()
}

/// Largest number of words of a document, or of all in a folder, generated ones included.
pub const WORDS_MAX: &[(&str, usize)] = &[
    ("README.md", 600),
    ("ARCHITECTURE.md", 1_800),
    ("estimator/README.md", 2_000),
    ("docs", 40_000),
];

/// Returns the number of words of a text: what white space separates and holds a letter. Figures
/// and rules of tables are none.
pub fn words(text: &str) -> usize {
    let has_letter = |word: &&str| word.chars().any(char::is_alphabetic);
    text.split_whitespace().filter(has_letter).count()
}

/// Links of a document, and the anchors of its headings.
#[derive(Debug, Default)]
pub struct Document {
    pub links: Vec<String>,
    pub anchors: BTreeSet<String>,
    /// Rust sources that it names as code.
    pub sources: Vec<String>,
}

impl Document {
    /// Reads Markdown.
    pub fn parse(text: &str) -> Self {
        let mut document = Self::default();
        let mut heading: Option<(HeadingLevel, String)> = None;
        for event in Parser::new_ext(text, Options::ENABLE_TABLES) {
            match event {
                Event::Start(Tag::Heading { level, .. }) => heading = Some((level, String::new())),
                Event::End(TagEnd::Heading(_)) => {
                    if let Some((_, title)) = heading.take() {
                        document.anchors.insert(anchor(&title));
                    }
                }
                Event::Text(ref part) | Event::Code(ref part) => {
                    if let Event::Code(code) = &event
                        && code.ends_with(".rs")
                    {
                        document.sources.push(code.to_string());
                    }
                    if let Some((_, title)) = &mut heading {
                        title.push_str(part);
                    }
                }
                Event::Start(Tag::Link { dest_url, .. } | Tag::Image { dest_url, .. }) => {
                    document.links.push(dest_url.into_string());
                }
                _ => {}
            }
        }
        document
    }
}

/// Returns a heading's anchor, as the hosts of repositories and mdBook make it.
fn anchor(title: &str) -> String {
    title
        .trim()
        .to_lowercase()
        .chars()
        .filter(|c| c.is_alphanumeric() || matches!(c, '-' | '_' | ' '))
        .map(|c| if c == ' ' { '-' } else { c })
        .collect()
}

/// Returns the broken links: `from -> to`. Documents and other files have their paths from the
/// root.
pub fn broken(
    documents: &BTreeMap<PathBuf, Document>,
    exists: impl Fn(&Path) -> bool,
) -> Vec<String> {
    let mut broken = Vec::new();
    for (from, document) in documents {
        for link in &document.links {
            if link.contains("://") || link.starts_with("mailto:") {
                continue;
            }
            let (path, fragment) = link.split_once('#').unwrap_or((link, ""));
            let to = if path.is_empty() {
                from.clone()
            } else {
                normal(&from.parent().unwrap_or(Path::new("")).join(path))
            };
            let anchored = fragment.is_empty()
                || documents
                    .get(&to)
                    .is_some_and(|target| target.anchors.contains(fragment));
            if !exists(&to) || !anchored {
                broken.push(format!("{} -> {link}", from.display()));
            }
        }
    }
    broken
}

/// Removes `..` from a path.
fn normal(path: &Path) -> PathBuf {
    let mut parts = PathBuf::new();
    for part in path.components() {
        match part {
            Component::ParentDir => drop(parts.pop()),
            Component::CurDir => {}
            other => parts.push(other),
        }
    }
    parts
}

/// True if a file may use a word, by [`MAY_USE`].
fn may_use(file: &str, word: &str) -> bool {
    MAY_USE.iter().any(|(path, exempt, _)| {
        let is_there = match *path {
            "" => Path::new(file)
                .extension()
                .is_some_and(|ending| ending == "rs"),
            path => file == path,
        };
        is_there && word.starts_with(exempt)
    })
}

/// Finds the words of [`NOT_USED`] in the text of a file: `line: word, use …`.
pub fn not_used(file: &str, text: &str) -> Vec<String> {
    let mut found = Vec::new();
    for (number, line) in text.lines().enumerate() {
        if refuses_otherwise(line) && !may_use(file, "expected") {
            found.push(format!("{}: write `field: got X, expected W`", number + 1));
        }
        let line = line.to_lowercase();
        for (word, instead) in NOT_USED {
            if has(&line, word) && !may_use(file, word) {
                found.push(format!("{}: {word:?}, use {instead}", number + 1));
            }
        }
    }
    found
}

/// True if a line of code refuses a value with `field is {value}, expected …`.
fn refuses_otherwise(line: &str) -> bool {
    line.match_indices(", expected").any(|(at, _)| {
        let before = &line[..at];
        let value = before.rsplit_once(" is {").map(|(_, value)| value);
        value.is_some_and(|value| value.find('}') == Some(value.len() - 1))
    })
}

/// True if a line has a phrase, not as a part of longer words.
fn has(line: &str, phrase: &str) -> bool {
    line.match_indices(phrase).any(|(at, _)| {
        let beside = |c: Option<char>| c.is_none_or(|c| !c.is_alphanumeric() && c != '_');
        beside(line[..at].chars().next_back()) && beside(line[at + phrase.len()..].chars().next())
    })
}

#[test]
fn a_planted_broken_link_and_word_are_found() {
    let page = |text| Document::parse(text);
    let documents = BTreeMap::from([
        (
            "README.md".into(),
            page("# A b\n[x](docs/a.md#what-is-it) ![i](no.png) [y](#a-b)"),
        ),
        (
            "docs/a.md".into(),
            page("## What *is* it?\n[up](../README.md#nowhere)"),
        ),
    ]);
    let exists = |path: &Path| documents.contains_key(path);
    assert_eq!(
        broken(&documents, exists),
        ["README.md -> no.png", "docs/a.md -> ../README.md#nowhere"]
    );
    assert_eq!(not_used("a.md", "Begin anew.\nrenewal").len(), 1);
    assert_eq!(not_used("a.rs", "/// The clerk.\nlet clerks = 1;").len(), 1);
    assert!(not_used("a.rs", "// whoever").is_empty());
    assert_eq!(not_used("estimator/src/lib.rs", "// a sweep").len(), 1);
    assert_eq!(
        not_used("a.rs", "#[error(\"{field} is {value}, expected 1\")]").len(),
        1
    );
    assert!(not_used("a.rs", "#[error(\"{field}: got {value}, expected 1\")]").is_empty());
}
