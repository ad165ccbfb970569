//! Where a field stands in a file, for errors: JSON as it is written, and YAML's fields at its top.

/// The line (from 1) of the field that `steps` lead to, names and indices from the top; of the deepest one that is there, if not all
/// are. The text must be well-formed.
pub(crate) fn line(text: &str, steps: &[String]) -> usize {
    let bytes = text.as_bytes();
    let at = if text.trim_start().starts_with('{') { in_json(bytes, steps) } else { at_top(text, steps) };
    1 + bytes[..at.min(bytes.len())].iter().filter(|byte| **byte == b'\n').count()
}

/// The byte at which the deepest field begins.
fn in_json(text: &[u8], steps: &[String]) -> usize {
    let mut at = after(text, 0, |byte| byte.is_ascii_whitespace());
    for step in steps {
        let found = match text.get(at) {
            Some(b'{') => member(text, at, step),
            Some(b'[') => step.parse().ok().and_then(|index| element(text, at, index)),
            _ => None,
        };
        let Some(found) = found else { break };
        at = found;
    }
    at
}

/// Where the value of a key of the object at `at` begins.
fn member(text: &[u8], at: usize, key: &str) -> Option<usize> {
    let mut at = after(text, at + 1, is_between);
    while text.get(at) == Some(&b'"') {
        let end = value_end(text, at);
        let value = after(text, end, |byte| byte.is_ascii_whitespace() || byte == b':');
        if serde_json::from_slice::<String>(&text[at..end]).is_ok_and(|found| found == key) {
            return Some(value);
        }
        at = after(text, value_end(text, value), is_between);
    }
    None
}

/// Where an element of the list at `at` begins.
fn element(text: &[u8], at: usize, index: usize) -> Option<usize> {
    let mut at = after(text, at + 1, is_between);
    for _ in 0..index {
        at = after(text, value_end(text, at), is_between);
    }
    text.get(at).is_some_and(|byte| *byte != b']').then_some(at)
}

fn is_between(byte: u8) -> bool {
    byte.is_ascii_whitespace() || byte == b','
}

/// The first byte from `at` on for which `skipped` does not hold.
fn after(text: &[u8], at: usize, skipped: impl Fn(u8) -> bool) -> usize {
    at + text.iter().skip(at).take_while(|byte| skipped(**byte)).count()
}

/// The byte behind the value that begins at `at`.
fn value_end(text: &[u8], mut at: usize) -> usize {
    let mut depth = 0usize;
    while let Some(byte) = text.get(at) {
        match byte {
            b'"' => {
                at += 1;
                while text.get(at).is_some_and(|byte| *byte != b'"') {
                    at += if text[at] == b'\\' { 2 } else { 1 };
                }
            }
            b'{' | b'[' => depth += 1,
            b'}' | b']' => depth = depth.saturating_sub(1),
            _ => {
                let end = |byte: u8| !is_between(byte) && !matches!(byte, b'"' | b'{' | b'[' | b'}' | b']' | b':');
                at = after(text, at, end).max(at + 1) - 1;
            }
        }
        at += 1;
        if depth == 0 {
            break;
        }
    }
    at.min(text.len())
}

/// The byte at which the line of YAML that begins with the first step's name begins.
fn at_top(text: &str, steps: &[String]) -> usize {
    let is_it = |line: &str| {
        let key = line.split(':').next().unwrap_or_default().trim().trim_matches(['"', '\'']);
        steps.first().is_some_and(|step| step == key)
    };
    let mut lines = text.split_inclusive('\n').scan(0, |at, line| {
        let start = *at;
        *at += line.len();
        Some((start, line))
    });
    lines.find(|(_, line)| is_it(line)).map_or(0, |(start, _)| start)
}

#[cfg(test)]
mod tests {
    use super::line;

    #[test]
    fn lines_of_fields() {
        let text = "\n{\"a\\\"}\": [1, \"]\\\\\", {\"x\": -1e-3}],\n \"photos\": [\n  {\"K\": {\n   \"fx\": 1},\n   \"R\": [[1, 0],\n    [2, 3]]},\n  {}]}\n";
        let at = |path: &str| line(text, &path.split('.').map(str::to_owned).collect::<Vec<_>>());
        for (path, expected) in [
            ("a\"}.2.x", 2),
            ("photos", 3),
            ("photos.0", 4),
            ("photos.0.K.fx", 5),
            ("photos.0.K.fy", 4),
            ("photos.0.R.1.1", 7),
            ("photos.1", 8),
            ("photos.1.K", 8),
            ("photos.2", 3),
            ("b", 2),
        ] {
            assert_eq!(at(path), expected, "{path}");
        }
        let yaml = "%YAML:1.0\n---\nimage_width: 3\ncamera_matrix: !!opencv-matrix\n   data: [1]\n";
        assert_eq!(line(yaml, &["camera_matrix".into(), "data".into()]), 4);
        assert_eq!(line("", &[]), 1);
        for end in 0..text.len() {
            line(&text[..end], &["photos".into(), "0".into(), "R".into(), "1".into()]);
        }
    }
}
