//! Makes arbitrary text safe inside HTML and SVG.

/// Returns `text` with the five characters of markup escaped, and with U+FFFD for characters that
/// no XML document may hold (control characters other than tab and line ends).
pub(super) fn escape(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '"' => safe.push_str("&quot;"),
            '\'' => safe.push_str("&#39;"),
            c => safe.push(printable(c)),
        }
    }
    safe
}

/// Returns `text` with U+FFFD for characters that no XML document may hold; markup is unchanged.
pub(super) fn printable_text(text: &str) -> String {
    text.chars().map(printable).collect()
}

fn printable(c: char) -> char {
    match c {
        '\t' | '\n' | '\r' => c,
        '\u{fffe}' | '\u{ffff}' => '\u{fffd}',
        c if !trinocular_rig::printable::is_printable(c) => '\u{fffd}',
        c => c,
    }
}

/// Checks for tests: every tag that opens closes in order, and every `&` starts an entity.
#[cfg(test)]
pub(crate) mod balance {
    /// Returns the first fault in `document`. Checks XML rules plus `<!doctype html>`, as far as
    /// the pages and figures of this module need them.
    pub fn fault(document: &str) -> Option<String> {
        let mut open: Vec<&str> = Vec::new();
        let mut rest = document;
        while let Some(start) = rest.find('<') {
            if let Some(fault) = bad_entity(&rest[..start]) {
                return Some(fault);
            }
            let end = match rest[start..].find('>') {
                Some(end) => start + end,
                None => return Some(format!("unclosed tag: {}", &rest[start..])),
            };
            let tag = &rest[start + 1..end];
            rest = &rest[end + 1..];
            if tag.contains('<') || !tag.matches('"').count().is_multiple_of(2) {
                return Some(format!("markup inside a tag: {tag}"));
            }
            if let Some(fault) = bad_entity(tag) {
                return Some(fault);
            }
            let name = tag.trim_start_matches('/').split([' ', '\n', '/']).next();
            let name = name.unwrap_or_default();
            if tag.starts_with('!') || tag.ends_with('/') {
                continue;
            }
            if !tag.starts_with('/') {
                open.push(name);
            } else if open.pop() != Some(name) {
                return Some(format!("</{name}> closes nothing"));
            }
        }
        open.pop().map(|name| format!("<{name}> never closes"))
    }

    fn bad_entity(text: &str) -> Option<String> {
        let known = ["&amp;", "&lt;", "&gt;", "&quot;", "&#39;", "&apos;"];
        text.match_indices('&')
            .find(|(at, _)| !known.iter().any(|entity| text[*at..].starts_with(entity)))
            .map(|(at, _)| format!("bare &: {}", &text[at..]))
    }

    #[test]
    fn faults_are_found() {
        assert_eq!(fault("<!doctype html><p a=\"1\">x &amp; y<br /></p>"), None);
        for bad in [
            "<p>",
            "</p>",
            "<p><b></p></b>",
            "<p>a & b</p>",
            "<p a=\"<\">x</p>",
            "<p",
        ] {
            assert!(fault(bad).is_some(), "{bad}");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn markup_and_controls_are_escaped() {
        assert_eq!(
            escape("<script>alert(\"a&b\")</script>'"),
            "&lt;script&gt;alert(&quot;a&amp;b&quot;)&lt;/script&gt;&#39;"
        );
        assert_eq!(escape("a\u{0}b\u{1b}[1m\tµ"), "a\u{fffd}b\u{fffd}[1m\tµ");
        assert_eq!(printable_text("<\u{7}>"), "<\u{fffd}>");
    }
}
