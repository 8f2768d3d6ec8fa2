//! Tables as files: CSV after RFC 4180.

use axum::body::Body;
use axum::http::header;
use axum::response::{IntoResponse, Response};

/// Formats one line of fields.
pub fn line<'a>(fields: impl IntoIterator<Item = &'a str>) -> String {
    let fields: Vec<String> = fields.into_iter().map(quoted).collect();
    fields.join(",") + "\r\n"
}

/// Makes a response that a browser saves under `name`.
pub fn file(kind: &'static str, name: &str, body: Body) -> Response {
    let disposition = format!("attachment; filename=\"{name}\"");
    let headers = [
        (header::CONTENT_TYPE, kind.to_owned()),
        (header::CONTENT_DISPOSITION, disposition),
    ];
    (headers, body).into_response()
}

/// Media type of CSV.
pub const CSV: &str = "text/csv; charset=utf-8";

/// Characters after which a spreadsheet that is not set to commas begins a field or a line, in
/// quotes or not.
const OTHER_SEPARATORS: [char; 5] = [';', '\t', '|', '\n', '\r'];

/// Quotes a field if necessary. Text that a spreadsheet would interpret as a formula stays text,
/// whatever separates its fields.
fn quoted(field: &str) -> String {
    let parts = field.split_inclusive(OTHER_SEPARATORS);
    let text: String = parts.map(as_text).collect();
    if text.contains(OTHER_SEPARATORS) || text.contains([',', '"']) {
        return format!("\"{}\"", text.replace('"', "\"\""));
    }
    text
}

/// Escapes a part of a field that would begin a formula; a number does not.
fn as_text(part: &str) -> String {
    let content = part.trim_start_matches(['"', ' ']);
    let begins_so = content.starts_with(['=', '+', '-', '@', '\t', '\r']);
    let number = content.trim_end_matches(OTHER_SEPARATORS);
    if begins_so && number.parse::<f64>().is_err() {
        format!("'{part}")
    } else {
        part.to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_field_is_one_field_and_no_formula() {
        assert_eq!(quoted("plain"), "plain");
        assert_eq!(quoted("a,b"), "\"a,b\"");
        assert_eq!(quoted("say \"no\""), "\"say \"\"no\"\"\"");
        assert_eq!(quoted("=1+1"), "'=1+1");
        assert_eq!(quoted("-2, so"), "\"'-2, so\"");
        assert_eq!(quoted("-0.25"), "-0.25");
        assert_eq!(quoted("x;=1+1"), "\"x;'=1+1\"");
        assert_eq!(quoted("x\n\"=1+1\""), "\"x\n'\"\"=1+1\"\"\"");
        assert_eq!(quoted("0.1;-0.25;+3"), "\"0.1;-0.25;+3\"");
        assert_eq!(line(["a", "", "b c"]), "a,,b c\r\n");
    }
}
