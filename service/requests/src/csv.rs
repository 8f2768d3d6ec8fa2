//! Tables that clients send: CSV after RFC 4180, with commas or semicolons.

use std::fmt;

/// Reason for which a table cannot be read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CsvRefused {
    /// Line of the fault, from 1.
    pub line: usize,
    /// Fault, in words.
    pub fault: &'static str,
}

impl fmt::Display for CsvRefused {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "line {}: {}", self.line, self.fault)
    }
}

/// Row of a table.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CsvRow {
    /// Line at which it begins, from 1.
    pub line: usize,
    /// Fields without their quotes; unquoted ones without surrounding blanks.
    pub fields: Vec<String>,
}

/// Reads a table; empty lines are left out. Fields are separated by semicolons if the first line
/// has some and no comma.
///
/// # Errors
/// A quoted field does not end, or goes on behind its end.
pub fn rows(text: &str) -> Result<Vec<CsvRow>, CsvRefused> {
    let text = text.trim_start_matches('\u{feff}');
    let first = text.lines().next().unwrap_or("");
    let separator = if first.contains(';') && !first.contains(',') {
        ';'
    } else {
        ','
    };
    let mut rest = text;
    let mut line = 1;
    let mut rows = Vec::new();
    while !rest.is_empty() {
        let begin = line;
        let mut fields = Vec::new();
        loop {
            let (field, behind, lines) = field(rest, separator, line)?;
            fields.push(field);
            line += lines;
            rest = behind;
            match rest.strip_prefix(separator) {
                Some(next) => rest = next,
                None => break,
            }
        }
        rest = rest.strip_prefix('\r').unwrap_or(rest);
        rest = rest.strip_prefix('\n').unwrap_or(rest);
        line += 1;
        if fields.iter().any(|field| !field.is_empty()) {
            rows.push(CsvRow {
                line: begin,
                fields,
            });
        }
    }
    Ok(rows)
}

/// Field at the begin of `text`, the text behind it, and the line breaks within it.
fn field(text: &str, separator: char, line: usize) -> Result<(String, &str, usize), CsvRefused> {
    let ends = [separator, '\r', '\n'];
    let Some(mut rest) = text.trim_start_matches(' ').strip_prefix('"') else {
        let end = text.find(ends).unwrap_or(text.len());
        let (field, behind) = text.split_at(end);
        return Ok((field.trim().to_owned(), behind, 0));
    };
    let mut content = String::new();
    loop {
        let fault = "a quoted field has no end";
        let end = rest.find('"').ok_or(CsvRefused { line, fault })?;
        content.push_str(&rest[..end]);
        rest = &rest[end + 1..];
        match rest.strip_prefix('"') {
            Some(behind) => {
                content.push('"');
                rest = behind;
            }
            None => break,
        }
    }
    rest = rest.trim_start_matches(' ');
    if !rest.is_empty() && !rest.starts_with(ends) {
        let fault = "a quoted field goes on behind its end";
        return Err(CsvRefused { line, fault });
    }
    let lines = content.matches('\n').count();
    Ok((content, rest, lines))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Vec<(usize, Vec<String>)> {
        let rows = rows(text).unwrap().into_iter();
        rows.map(|row| (row.line, row.fields)).collect()
    }

    fn row(line: usize, fields: &[&str]) -> (usize, Vec<String>) {
        (line, fields.iter().map(|&field| field.to_owned()).collect())
    }

    #[test]
    fn rows_have_their_lines_and_fields() {
        assert_eq!(
            read("\u{feff}id, a\r\n\r\n\"x, \"\"y\"\"\nz\",2\nw,"),
            [
                row(1, &["id", "a"]),
                row(3, &["x, \"y\"\nz", "2"]),
                row(5, &["w", ""]),
            ]
        );
        assert_eq!(
            read("id;a\nx;1,5\n"),
            [row(1, &["id", "a"]), row(2, &["x", "1,5"])]
        );
        assert_eq!(read(""), []);
    }

    #[test]
    fn a_broken_quote_is_named_with_its_line() {
        let told = |text| rows(text).unwrap_err().to_string();
        assert_eq!(told("id\n\"x"), "line 2: a quoted field has no end");
        assert_eq!(
            told("id\nx\n\"y\"z"),
            "line 3: a quoted field goes on behind its end"
        );
    }
}
