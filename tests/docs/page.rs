//! A page of the documentation: its text, code blocks, headings and links.

use std::fs;
use std::path::{Path, PathBuf};

/// Returns the root of the repository.
pub fn root() -> PathBuf {
    let tests = Path::new(env!("CARGO_MANIFEST_DIR"));
    tests.parent().expect("tests/ is in a folder").to_owned()
}

/// A Markdown page.
pub struct Page {
    /// Path from the root of the repository, such as `docs/tracking.md`.
    pub name: String,
    /// Whole text.
    pub text: String,
}

/// A fenced code block.
pub struct Block<'a> {
    /// Language after the opening fence.
    pub language: &'a str,
    /// Line number of the first line of code, from 1.
    pub line: usize,
    /// Lines between the fences.
    pub lines: Vec<&'a str>,
}

impl Page {
    /// Reads the page of this name.
    pub fn read(name: &str) -> Self {
        let text = fs::read_to_string(root().join(name));
        Self {
            name: name.to_owned(),
            text: text.unwrap_or_else(|error| panic!("{name}: {error}")),
        }
    }

    /// Reads all pages for users.
    pub fn all() -> Vec<Self> {
        let entries = fs::read_dir(root().join("docs")).expect("the folder of the pages");
        let names = entries.map(|entry| entry.expect("an entry").file_name());
        let names = names.map(|name| name.into_string().expect("a plain name"));
        let mut pages: Vec<String> = names
            .filter(|name| name.ends_with(".md"))
            .map(|name| format!("docs/{name}"))
            .collect();
        pages.extend(["README.md", "RESULTS.md"].map(String::from));
        pages.sort();
        pages.iter().map(|name| Self::read(name)).collect()
    }

    /// Returns the fenced code blocks in the order of the page.
    pub fn blocks(&self) -> Vec<Block<'_>> {
        let mut blocks = Vec::new();
        let mut open: Option<Block<'_>> = None;
        for (index, line) in self.text.lines().enumerate() {
            match (line.strip_prefix("```"), &mut open) {
                (Some(_), Some(_)) => blocks.extend(open.take()),
                (Some(language), None) => {
                    open = Some(Block {
                        language,
                        line: index + 2,
                        lines: Vec::new(),
                    });
                }
                (None, Some(block)) => block.lines.push(line),
                (None, None) => {}
            }
        }
        assert!(open.is_none(), "{}: a code block is not closed", self.name);
        blocks
    }

    /// Returns the lines outside code blocks, with their numbers from 1.
    pub fn prose(&self) -> Vec<(usize, &str)> {
        let mut inside = false;
        let mut prose = Vec::new();
        for (index, line) in self.text.lines().enumerate() {
            if line.starts_with("```") {
                inside = !inside;
            } else if !inside {
                prose.push((index + 1, line));
            }
        }
        prose
    }

    /// Returns the text from the heading with this title to the next heading of its level or above.
    #[track_caller]
    pub fn section(&self, title: &str) -> Self {
        let level = |line: &str| line.bytes().take_while(|byte| *byte == b'#').count();
        let mut lines = self.prose().into_iter().filter(|(_, line)| level(line) > 0);
        let (start, heading) = lines
            .find(|(_, line)| line.trim_start_matches('#').trim() == title)
            .unwrap_or_else(|| panic!("{}: no heading `{title}`", self.name));
        let end = lines.find(|(_, line)| level(line) <= level(heading));
        let end = end.map_or(usize::MAX, |(number, _)| number - 1);
        let count = end.saturating_sub(start);
        let text: Vec<&str> = self.text.lines().skip(start).take(count).collect();
        Self {
            name: format!("{} ({title})", self.name),
            text: text.join("\n"),
        }
    }

    /// Returns the targets of Markdown links and images, with their line numbers.
    pub fn links(&self) -> Vec<(usize, &str)> {
        let mut links = Vec::new();
        for (number, line) in self.prose() {
            let mut rest = line;
            while let Some((_, after)) = rest.split_once("](") {
                let Some((target, after)) = after.split_once(')') else {
                    break;
                };
                links.push((number, target));
                rest = after;
            }
        }
        links
    }

    /// Returns the anchors that a link to this page may name, formed as GitHub forms them.
    pub fn anchors(&self) -> Vec<String> {
        let titles = self.prose().into_iter().map(|(_, line)| line);
        titles
            .filter(|line| line.starts_with('#'))
            .map(|line| anchor(line.trim_start_matches('#').trim()))
            .collect()
    }
}

/// Returns the anchor of a heading: lower case, hyphens for spaces, no other punctuation.
fn anchor(title: &str) -> String {
    let kept = title.to_lowercase();
    kept.chars()
        .filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'))
        .map(|c| if c == ' ' { '-' } else { c })
        .collect()
}
