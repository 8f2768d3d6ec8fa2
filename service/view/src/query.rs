//! Queries: what they consist of, which robots they select, and their text.

use std::fmt::{self, Write};

use strum::{EnumString, IntoStaticStr, VariantArray};

use crate::folded::{Folded, FoldedProperties};
use crate::properties::Properties;
use crate::word::Word;

/// Conditions that a robot has to meet, all of them.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Query(pub Vec<Term>);

/// One condition of a query, or its opposite.
#[derive(Debug, Clone, PartialEq)]
pub struct Term {
    /// True if the condition must not hold.
    pub is_negated: bool,
    /// The condition.
    pub condition: Condition,
}

/// Condition on a robot.
#[derive(Debug, Clone, PartialEq)]
pub enum Condition {
    /// Part of the robot's id, in upper or lower case.
    Text(Folded),
    /// Property that has one of some values.
    Has(Word, Vec<Folded>),
    /// Property that is not known: one of some.
    Lacks(Vec<String>),
    /// Deviation compared with a number of tolerances.
    Deviation(Comparison, f64),
    /// Time since the last message, compared with a number of units.
    Age(Comparison, u32, TimeUnit),
}

/// Property that is a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, EnumString, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "snake_case")]
pub enum Measure {
    /// Deviation of the estimate from the calibration in use, in tolerances.
    Deviation,
    /// Time since the last message.
    Age,
}

/// Comparison with a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, VariantArray)]
pub enum Comparison {
    /// Less than the number.
    Less,
    /// At most the number.
    AtMost,
    /// More than the number.
    More,
    /// At least the number.
    AtLeast,
}

/// Unit of a time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, VariantArray)]
pub enum TimeUnit {
    /// Seconds.
    Second,
    /// Minutes.
    Minute,
    /// Hours.
    Hour,
    /// Days.
    Day,
}

impl Comparison {
    /// The sign in queries.
    pub const fn sign(self) -> &'static str {
        match self {
            Self::Less => "<",
            Self::AtMost => "<=",
            Self::More => ">",
            Self::AtLeast => ">=",
        }
    }

    fn holds(self, value: f64, than: f64) -> bool {
        match self {
            Self::Less => value < than,
            Self::AtMost => value <= than,
            Self::More => value > than,
            Self::AtLeast => value >= than,
        }
    }
}

impl TimeUnit {
    /// The letter in queries.
    pub const fn letter(self) -> char {
        match self {
            Self::Second => 's',
            Self::Minute => 'm',
            Self::Hour => 'h',
            Self::Day => 'd',
        }
    }

    /// Duration of one, s.
    const fn seconds(self) -> f64 {
        match self {
            Self::Second => 1.0,
            Self::Minute => 60.0,
            Self::Hour => 3_600.0,
            Self::Day => 86_400.0,
        }
    }
}

impl Query {
    /// True if a robot meets every condition.
    pub fn selects(&self, robot: &Properties) -> bool {
        let folded = FoldedProperties::of(robot);
        let mut terms = self.0.iter();
        terms.all(|term| term.condition.holds(robot, &folded) != term.is_negated)
    }
}

impl Condition {
    fn holds(&self, robot: &Properties, folded: &FoldedProperties) -> bool {
        match self {
            Self::Text(text) => folded.id.contains(text.folded()),
            Self::Has(word, values) => values.iter().any(|value| folded.has(*word, value)),
            Self::Lacks(names) => names.iter().any(|name| robot.lacks(name)),
            Self::Deviation(comparison, than) => {
                let deviation = robot.deviation;
                deviation.is_some_and(|deviation| comparison.holds(deviation, *than))
            }
            // A robot that has sent nothing yet has been silent for longer than any time.
            Self::Age(comparison, count, unit) => {
                let age_s = robot.age_s.unwrap_or(f64::INFINITY);
                comparison.holds(age_s, f64::from(*count) * unit.seconds())
            }
        }
    }
}

impl fmt::Display for Query {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, term) in self.0.iter().enumerate() {
            if index > 0 {
                f.write_char(' ')?;
            }
            term.fmt(f)?;
        }
        Ok(())
    }
}

impl fmt::Display for Term {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_negated {
            f.write_char('-')?;
        }
        match &self.condition {
            Condition::Text(text) => {
                let text = text.as_str();
                let is_plain = !text.starts_with('-') && !text.contains([':', '<', '>']);
                write_value(f, text, is_plain)
            }
            Condition::Has(word, values) => {
                write_values(f, word.name(), values.iter().map(Folded::as_str))
            }
            Condition::Lacks(names) => write_values(f, "no", names.iter().map(String::as_str)),
            Condition::Deviation(comparison, than) => {
                write!(f, "deviation{}{than}", comparison.sign())
            }
            Condition::Age(comparison, count, unit) => {
                write!(f, "age{}{count}{}", comparison.sign(), unit.letter())
            }
        }
    }
}

fn write_values<'v>(
    f: &mut fmt::Formatter<'_>,
    name: &str,
    values: impl Iterator<Item = &'v str>,
) -> fmt::Result {
    f.write_str(name)?;
    for (index, value) in values.enumerate() {
        f.write_char(if index == 0 { ':' } else { ',' })?;
        write_value(f, value, true)?;
    }
    Ok(())
}

/// Writes a value, in quotes unless it can stand without them.
fn write_value(f: &mut fmt::Formatter<'_>, value: &str, is_plain: bool) -> fmt::Result {
    let needs = |c: char| c.is_whitespace() || matches!(c, ',' | '"');
    if is_plain && !value.is_empty() && !value.contains(needs) {
        return f.write_str(value);
    }
    let escaped = value.replace('\\', "\\\\").replace('"', "\\\"");
    write!(f, "\"{escaped}\"")
}

#[cfg(test)]
mod tests;
