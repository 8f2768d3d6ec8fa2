//! Tables as files: CSV after RFC 4180.

use axum::http::header;
use axum::response::{IntoResponse, Response};

/// One line of fields.
pub fn line<'a>(fields: impl IntoIterator<Item = &'a str>) -> String {
    let fields: Vec<String> = fields.into_iter().map(quoted).collect();
    fields.join(",") + "\r\n"
}

/// An answer that a browser saves under `name`.
pub fn file(kind: &'static str, name: &str, text: String) -> Response {
    let disposition = format!("attachment; filename=\"{name}\"");
    let headers = [
        (header::CONTENT_TYPE, kind.to_owned()),
        (header::CONTENT_DISPOSITION, disposition),
    ];
    (headers, text).into_response()
}

/// The media type.
pub const CSV: &str = "text/csv; charset=utf-8";

/// A field in quotes where it needs them. What a spreadsheet would take for a formula stays text;
/// a number is none.
fn quoted(field: &str) -> String {
    let begins_so = field.starts_with(['=', '+', '-', '@', '\t', '\r']);
    let formula = begins_so && field.parse::<f64>().is_err();
    let text = if formula {
        format!("'{field}")
    } else {
        field.to_owned()
    };
    if text.contains([',', '"', '\n', '\r']) {
        return format!("\"{}\"", text.replace('"', "\"\""));
    }
    text
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
        assert_eq!(line(["a", "", "b c"]), "a,,b c\r\n");
    }
}
