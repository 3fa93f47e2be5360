//! Text and tables as HTML. Every string from outside goes through [`escape`].

use serde_json::Value;

/// Escapes text for HTML content and attributes.
pub(super) fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            // HTML forbids control characters, but names in glTF may contain them.
            c if c.is_control() && !matches!(c, '\n' | '\t') => out.push('\u{FFFD}'),
            c => out.push(c),
        }
    }
    out
}

/// A cell with text to be escaped, aligned left or right.
pub(super) enum Cell {
    Text(String),
    Number(String),
}

/// A table with a head; empty if there are no rows.
pub(super) fn table(head: &[&str], rows: &[Vec<Cell>]) -> String {
    let Some(first) = rows.first() else {
        return String::new();
    };
    let class = |cell: &Cell| match cell {
        Cell::Text(_) => "",
        Cell::Number(_) => " class=\"n\"",
    };
    let mut out = String::from("<div class=\"scroll\"><table>\n");
    if !head.is_empty() {
        out.push_str("<tr>");
        for (name, cell) in head.iter().zip(first) {
            out.push_str(&format!("<th{}>{}</th>", class(cell), escape(name)));
        }
        out.push_str("</tr>\n");
    }
    for row in rows {
        out.push_str("<tr>");
        for cell in row {
            let (Cell::Text(text) | Cell::Number(text)) = cell;
            out.push_str(&format!("<td{}>{}</td>", class(cell), escape(text)));
        }
        out.push_str("</tr>\n");
    }
    out + "</table></div>\n"
}

/// A paragraph in a subdued colour.
pub(super) fn note(text: &str) -> String {
    format!("<p class=\"dim\">{}</p>\n", escape(text))
}

/// The number at a JSON pointer.
pub(super) fn number(value: &Value, pointer: &str) -> Option<f64> {
    value.pointer(pointer)?.as_f64().filter(|x| x.is_finite())
}

/// The list at a JSON pointer; empty where there is none.
pub(super) fn list<'v>(value: &'v Value, pointer: &str) -> &'v [Value] {
    value
        .pointer(pointer)
        .and_then(Value::as_array)
        .map_or(&[], Vec::as_slice)
}

/// The text of a field; empty if it is missing.
pub(super) fn text<'v>(value: &'v Value, field: &str) -> &'v str {
    value.get(field).and_then(Value::as_str).unwrap_or_default()
}

/// A fraction as a percentage with three significant digits.
pub(super) fn percent(x: f64) -> String {
    format!("{} %", short(100.0 * x))
}

/// Three significant digits, in plain notation if that is short.
pub(super) fn short(x: f64) -> String {
    if x == 0.0 {
        return "0".into();
    }
    let size = x.abs().log10().floor();
    if !(-4.0..7.0).contains(&size) {
        return format!("{x:.2e}");
    }
    let digits = (2.0 - size).max(0.0) as usize;
    format!("{x:.digits$}")
}

/// A count with spaces between thousands.
pub(super) fn count(x: f64) -> String {
    let digits = format!("{x:.0}");
    let mut out = String::new();
    for (i, c) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i) % 3 == 0 {
            // A non-breaking space.
            out.push('\u{A0}');
        }
        out.push(c);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_in_a_text_is_markup() {
        assert_eq!(
            escape("<b a=\"1\" c='2'>&\u{0}"),
            "&lt;b a=&quot;1&quot; c=&#39;2&#39;&gt;&amp;\u{FFFD}"
        );
        let t = table(&["<h>"], &[vec![Cell::Text("<script>".into())]]);
        assert!(t.contains("&lt;script&gt;") && t.contains("&lt;h&gt;") && !t.contains("<script"));
    }

    #[test]
    fn figures() {
        assert_eq!(short(0.0), "0");
        assert_eq!(
            (short(1234.5), short(12.345), short(0.012345), short(-0.5)),
            (
                "1234".into(),
                "12.3".into(),
                "0.0123".into(),
                "-0.500".into()
            )
        );
        assert_eq!(
            (short(1e-9), short(2.5e8)),
            ("1.00e-9".into(), "2.50e8".into())
        );
        assert_eq!(
            (count(1234567.0), count(12.0)),
            ("1\u{A0}234\u{A0}567".into(), "12".into())
        );
    }
}
