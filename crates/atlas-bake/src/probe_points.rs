//! Parses lists of points from JSON.

use gather::probes::MAX_PROBES;
use glam::DVec3;
use serde_json::Value;

/// A fault in a list of points.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{at}found {found}, expected {expected}")]
pub struct PointsError {
    /// Path of the element followed by `: `, or empty for the whole file.
    pub at: String,
    /// What was found.
    pub found: String,
    /// What was expected.
    pub expected: String,
}

/// Largest absolute coordinate, metres; the same limit as for scenes.
const MAX_COORDINATE: f64 = 1e12;

/// Longest text quoted in a message, characters.
const QUOTED: usize = 40;

/// Reads `{"points": [[x, y, z], …]}`, or just the list: positions in the glTF's world space,
/// metres. Other members of the object are ignored.
///
/// ```
/// let points = atlas_bake::parse_points(b"[[0, 1.5, 0], [2, 1.5, 0]]").expect("a list of points");
/// assert_eq!(points[1].x, 2.0);
/// let error = atlas_bake::parse_points(b"[[0, 1]]").unwrap_err();
/// assert_eq!(error.to_string(), "[0]: found a list of 2, expected three numbers, [x, y, z]");
/// ```
///
/// # Errors
/// [`PointsError`] with the first fault.
pub fn parse_points(json: &[u8]) -> Result<Vec<DVec3>, PointsError> {
    // Some editors write a byte order mark.
    let json = json.strip_prefix(b"\xef\xbb\xbf").unwrap_or(json);
    let fault = |at: &str, found: String, expected: &str| PointsError {
        at: if at.is_empty() {
            String::new()
        } else {
            format!("{at}: ")
        },
        found,
        expected: expected.into(),
    };
    let value: Value = serde_json::from_slice(json)
        .map_err(|e| fault("", format!("invalid JSON ({e})"), "JSON"))?;
    let (name, list) = match &value {
        Value::Array(list) => ("", list),
        Value::Object(o) => match o.get("points") {
            Some(Value::Array(list)) => ("points", list),
            Some(other) => return Err(fault("points", found(other), "a list of points")),
            None => return Err(fault("points", "nothing".into(), "a list of points")),
        },
        other => {
            let expected = "a list of points, or an object with the member points";
            return Err(fault("", found(other), expected));
        }
    };
    if list.is_empty() || list.len() > MAX_PROBES {
        let expected = format!("1 to {MAX_PROBES}");
        return Err(fault(name, format!("{} points", list.len()), &expected));
    }
    let mut points = Vec::with_capacity(list.len());
    for (i, point) in list.iter().enumerate() {
        let coordinates = match point {
            Value::Array(c) if c.len() == 3 => c,
            other => {
                let at = format!("{name}[{i}]");
                return Err(fault(&at, found(other), "three numbers, [x, y, z]"));
            }
        };
        let mut p = [0.0; 3];
        for (axis, c) in coordinates.iter().enumerate() {
            match c.as_f64().filter(|x| x.abs() <= MAX_COORDINATE) {
                Some(x) => p[axis] = x,
                None => {
                    let at = format!("{name}[{i}][{axis}]");
                    return Err(fault(&at, found(c), "a number from -1e12 to 1e12"));
                }
            }
        }
        points.push(DVec3::from_array(p));
    }
    Ok(points)
}

/// Describes a value in a message.
fn found(value: &Value) -> String {
    match value {
        Value::Object(_) => "an object".into(),
        Value::Array(a) => format!("a list of {}", a.len()),
        other => {
            let text = other.to_string();
            match text.char_indices().nth(QUOTED) {
                Some((end, _)) => format!("{}…", &text[..end]),
                None => text,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_come_bare_or_in_an_object() {
        let expected = vec![DVec3::new(1.0, -2.5, 3e2), DVec3::ZERO];
        for text in [
            "[[1, -2.5, 3e2], [0, 0, 0]]",
            "\u{feff}{\"about\": 1, \"points\": [[1, -2.5, 300.0], [0, -0, 0e5]]}",
        ] {
            assert_eq!(parse_points(text.as_bytes()), Ok(expected.clone()));
        }
    }

    #[test]
    fn messages_name_the_element() {
        for (text, message) in [
            (
                "",
                "found invalid JSON (EOF while parsing a value at line 1 column 0), expected JSON",
            ),
            (
                "3",
                "found 3, expected a list of points, or an object with the member points",
            ),
            ("{}", "points: found nothing, expected a list of points"),
            (
                "{\"points\": {}}",
                "points: found an object, expected a list of points",
            ),
            ("[]", "found 0 points, expected 1 to 262144"),
            (
                "{\"points\": []}",
                "points: found 0 points, expected 1 to 262144",
            ),
            (
                "[[0, 0, 0], [1, 2]]",
                "[1]: found a list of 2, expected three numbers, [x, y, z]",
            ),
            (
                "{\"points\": [1]}",
                "points[0]: found 1, expected three numbers, [x, y, z]",
            ),
            (
                "{\"points\": [[0, 0, \"a\"]]}",
                "points[0][2]: found \"a\", expected a number from -1e12 to 1e12",
            ),
            (
                "[[0, null, 0]]",
                "[0][1]: found null, expected a number from -1e12 to 1e12",
            ),
            (
                "[[2e12, 0, 0]]",
                "[0][0]: found 2000000000000.0, expected a number from -1e12 to 1e12",
            ),
        ] {
            let e = parse_points(text.as_bytes()).unwrap_err();
            assert_eq!(e.to_string(), message);
        }
        let long = format!("[[0, 0, \"{}\"]]", "ä".repeat(100));
        let e = parse_points(long.as_bytes()).unwrap_err().to_string();
        assert!(e.contains("ää…") && e.len() < 200, "{e}");
        assert!(parse_points(b"[[1e999, 0, 0]]").is_err());
        assert!(parse_points(b"[[0, 0, \xff]]").is_err());
        assert!(parse_points("[".repeat(100_000).as_bytes()).is_err());
    }
}
