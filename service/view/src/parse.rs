//! Parsing of queries.

use std::iter::Peekable;
use std::str::{CharIndices, FromStr};

use fleetcal_domain::limits;
use fleetcal_domain::robot::{ConnectionState, RobotState};
use fleetcal_domain::standing::Standing;
use fleetcal_model::VehicleModel;
use strum::VariantArray;
use thiserror::Error;

use crate::folded::Folded;
use crate::properties::OPTIONAL;
use crate::query::{Comparison, Condition, Measure, Query, Term, TimeUnit};
use crate::word::Word;

/// Reason for which a query was refused.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("got {token:?} at character {position}, expected {expected}")]
pub struct QueryRefused {
    /// Part of the query that was refused.
    pub token: String,
    /// Position of its first character, from 1.
    pub position: usize,
    /// Accepted texts at this place, in words.
    pub expected: String,
}

type Parsed<T> = Result<T, QueryRefused>;

impl FromStr for Query {
    type Err = QueryRefused;

    fn from_str(text: &str) -> Parsed<Self> {
        let chars = text.chars().count();
        if chars > limits::VIEW_QUERY_CHARS_MAX {
            return Err(QueryRefused {
                token: text.chars().take(20).collect(),
                position: 1,
                expected: format!(
                    "at most {} characters, these are {chars}",
                    limits::VIEW_QUERY_CHARS_MAX
                ),
            });
        }
        let mut parser = Parser {
            text,
            rest: text.char_indices().peekable(),
        };
        let mut terms = Vec::new();
        while parser.skip_spaces() {
            if terms.len() == limits::VIEW_QUERY_TERMS_MAX {
                let max = limits::VIEW_QUERY_TERMS_MAX;
                let from = parser.offset();
                return Err(parser.refused(from, format!("at most {max} conditions")));
            }
            terms.push(parser.term()?);
        }
        Ok(Self(terms))
    }
}

struct Parser<'a> {
    text: &'a str,
    rest: Peekable<CharIndices<'a>>,
}

impl Parser<'_> {
    fn peek(&mut self) -> Option<char> {
        self.rest.peek().map(|(_, next)| *next)
    }

    /// Offset of the next character, bytes.
    fn offset(&mut self) -> usize {
        self.rest
            .peek()
            .map_or(self.text.len(), |(offset, _)| *offset)
    }

    fn take(&mut self, wanted: char) -> bool {
        self.rest.next_if(|(_, next)| *next == wanted).is_some()
    }

    /// Takes the characters up to one that `ends` the word.
    fn word(&mut self, ends: impl Fn(char) -> bool) -> &str {
        let from = self.offset();
        while self.rest.next_if(|(_, next)| !ends(*next)).is_some() {}
        let to = self.offset();
        self.text.get(from..to).unwrap_or_default()
    }

    /// Takes spaces; true if something follows them.
    fn skip_spaces(&mut self) -> bool {
        self.word(|next| !next.is_whitespace());
        self.peek().is_some()
    }

    /// Refusal of the text from an offset up to here; of the rest of the word if that is nothing.
    fn refused(&mut self, from: usize, expected: impl Into<String>) -> QueryRefused {
        if self.offset() == from {
            self.word(char::is_whitespace);
        }
        let to = self.offset();
        let token = self.text.get(from..to).unwrap_or_default();
        let before = self.text.get(..from).unwrap_or_default();
        QueryRefused {
            token: token.to_owned(),
            position: before.chars().count() + 1,
            expected: expected.into(),
        }
    }

    fn term(&mut self) -> Parsed<Term> {
        let from = self.offset();
        let is_negated = self.take('-');
        if is_negated && self.peek().is_none_or(char::is_whitespace) {
            return Err(self.refused(from, "a condition after -"));
        }
        let condition = self.condition()?;
        if self.peek().is_some_and(|next| !next.is_whitespace()) {
            let from = self.offset();
            return Err(self.refused(from, "a space between two conditions"));
        }
        Ok(Term {
            is_negated,
            condition,
        })
    }

    fn condition(&mut self) -> Parsed<Condition> {
        let from = self.offset();
        if self.peek() == Some('"') {
            return self.quoted().map(|text| Condition::Text(text.into()));
        }
        let ends = |c: char| c.is_whitespace() || matches!(c, ':' | '<' | '>' | '"');
        let word = self.word(ends).to_owned();
        match self.peek() {
            Some(':' | '<' | '>') => self.qualified(&word, from),
            _ => Ok(Condition::Text(word.into())),
        }
    }

    /// Parses a condition on the property `name`, which begins at `from`.
    fn qualified(&mut self, name: &str, from: usize) -> Parsed<Condition> {
        let name = name.to_ascii_lowercase();
        if let Ok(measure) = name.parse::<Measure>() {
            return self.compared(measure);
        }
        let is_no = name == "no";
        let word = name.parse::<Word>();
        if !is_no && word.is_err() {
            return Err(self.refused(from, format!("one of {}, or a robot's name", names())));
        }
        let colon = self.offset();
        if !self.take(':') {
            self.word(|next| !matches!(next, '<' | '>' | '='));
            return Err(self.refused(colon, format!("a colon after {name}")));
        }
        let mut values = Vec::new();
        loop {
            let from = self.offset();
            let value = self.value()?;
            let value = match word {
                Ok(word) => checked(word, value),
                Err(_) => one_of(&value, OPTIONAL),
            };
            values.push(value.map_err(|expected| self.refused(from, expected))?);
            if !self.take(',') {
                break;
            }
        }
        Ok(match word {
            Ok(word) => Condition::Has(word, values.into_iter().map(Folded::from).collect()),
            Err(_) => Condition::Lacks(values),
        })
    }

    /// Parses a value, in quotes or up to a space or comma.
    fn value(&mut self) -> Parsed<String> {
        if self.peek() == Some('"') {
            return self.quoted();
        }
        let from = self.offset();
        let value = self.word(|c| c.is_whitespace() || matches!(c, ',' | '"'));
        if value.is_empty() {
            return Err(self.refused(from, "a value; in quotes if it has spaces or commas"));
        }
        Ok(value.to_owned())
    }

    fn quoted(&mut self) -> Parsed<String> {
        let from = self.offset();
        self.take('"');
        let mut value = String::new();
        while let Some((_, next)) = self.rest.next() {
            match next {
                '"' if value.is_empty() => {
                    return Err(self.refused(from, "at least one character in quotes"));
                }
                '"' => return Ok(value),
                '\\' => match self.rest.next() {
                    Some((_, escaped @ ('"' | '\\'))) => value.push(escaped),
                    _ => return Err(self.refused(from, "\\\" or \\\\ for a quote or backslash")),
                },
                other => value.push(other),
            }
        }
        Err(self.refused(from, "a quote at its end"))
    }

    /// Parses comparison and number, with or without a colon before them.
    fn compared(&mut self, measure: Measure) -> Parsed<Condition> {
        self.take(':');
        let from = self.offset();
        let comparison = match (self.take('<'), self.take('>')) {
            (true, false) if self.take('=') => Comparison::AtMost,
            (true, false) => Comparison::Less,
            (false, true) if self.take('=') => Comparison::AtLeast,
            (false, true) => Comparison::More,
            _ => {
                let name: &str = measure.into();
                return Err(self.refused(from, format!("<, <=, > or >= after {name}")));
            }
        };
        let from = self.offset();
        let number = self.word(char::is_whitespace).to_owned();
        match measure {
            Measure::Deviation => tolerances(&number)
                .map(|than| Condition::Deviation(comparison, than))
                .ok_or_else(|| self.refused(from, "a number of tolerances, such as 1 or 2.5")),
            Measure::Age => duration(&number)
                .map(|(count, unit)| Condition::Age(comparison, count, unit))
                .ok_or_else(|| self.refused(from, "a time, such as 30s, 10m, 8h or 7d")),
        }
    }
}

/// Names of all properties.
fn names() -> String {
    let words = Word::VARIANTS
        .iter()
        .map(|word| format!("{}:", word.name()));
    let others = ["no:", "deviation>", "age>"].map(str::to_owned);
    let names: Vec<String> = words.chain(others).collect();
    names.join(", ")
}

/// Parses a number of tolerances: digits with or without a decimal point.
fn tolerances(text: &str) -> Option<f64> {
    let is_decimal = text.chars().all(|c| c.is_ascii_digit() || c == '.');
    let number: f64 = text.parse().ok()?;
    (is_decimal && number.is_finite()).then_some(number)
}

fn duration(text: &str) -> Option<(u32, TimeUnit)> {
    let mut units = TimeUnit::VARIANTS.iter();
    let unit = units.find(|unit| text.ends_with(unit.letter()))?;
    let digits = text.strip_suffix(unit.letter())?;
    let is_number = digits.chars().all(|c| c.is_ascii_digit());
    is_number.then_some((digits.parse().ok()?, *unit))
}

/// Checks a value of a property that has only some; returns it as documents write it.
fn checked(word: Word, value: String) -> Result<String, String> {
    match word {
        Word::Id | Word::Site | Word::Type | Word::Tag => Ok(value),
        Word::Model => one_of(&value, VehicleModel::ALL.iter().map(|one| one.name())),
        Word::State => one_of(&value, RobotState::ALL.iter().map(|one| one.name())),
        Word::Standing => one_of(&value, Standing::ALL.iter().map(|one| one.as_str())),
        Word::Connection => one_of(&value, ConnectionState::ALL.iter().map(|one| one.name())),
    }
}

/// Finds the value that a text names, in upper or lower case, with `_`, `-` or spaces.
fn one_of(value: &str, accepted: impl IntoIterator<Item = &'static str>) -> Result<String, String> {
    let wanted = value.to_lowercase().replace(['-', ' '], "_");
    let accepted: Vec<&str> = accepted.into_iter().collect();
    if accepted.contains(&wanted.as_str()) {
        Ok(wanted)
    } else {
        Err(format!("one of {}", accepted.join(", ")))
    }
}
