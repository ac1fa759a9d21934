//! Form of the pages: length, width, links, and the way from one page to the next.

use super::page::{Page, root};

/// Longest line of a code block, in columns: narrower than GitHub's page.
const CODE_COLUMNS: usize = 80;
/// Longest README, in words.
const README_WORDS: usize = 500;

#[test]
fn readme_has_at_most_500_words() {
    let words = Page::read("README.md").text.split_whitespace().count();
    assert!(words <= README_WORDS, "{words} words");
}

#[test]
fn code_blocks_fit_80_columns() {
    let mut wide = Vec::new();
    for page in Page::all() {
        for block in page.blocks() {
            for (index, line) in block.lines.iter().enumerate() {
                let columns = line.chars().count();
                if columns > CODE_COLUMNS {
                    wide.push(format!("{}:{}: {columns}", page.name, block.line + index));
                }
            }
        }
    }
    assert!(wide.is_empty(), "{}", wide.join("\n"));
}

#[test]
fn links_lead_to_files_and_headings() {
    let mut broken = Vec::new();
    for page in Page::all() {
        let folder = root().join(&page.name);
        let folder = folder.parent().expect("a page is in a folder");
        for (line, target) in page.links() {
            if target.contains("://") {
                continue;
            }
            let (path, anchor) = target.split_once('#').unwrap_or((target, ""));
            let file = match path {
                "" => root().join(&page.name),
                path => folder.join(path),
            };
            let found = match anchor {
                "" => file.exists(),
                anchor => std::fs::read_to_string(&file).is_ok_and(|text| {
                    let name = target.to_owned();
                    Page { name, text }
                        .anchors()
                        .iter()
                        .any(|known| known == anchor)
                }),
            };
            if !found {
                broken.push(format!("{}:{line}: {target}", page.name));
            }
        }
    }
    assert!(broken.is_empty(), "{}", broken.join("\n"));
}

#[test]
fn pages_end_with_what_to_do_next() {
    for page in Page::all() {
        if !page.name.starts_with("docs/") || page.name == "docs/README.md" {
            continue;
        }
        let mut headings = page.prose().into_iter().map(|(_, line)| line);
        let last = headings.rfind(|line| line.starts_with("## "));
        assert_eq!(last, Some("## Next"), "{}", page.name);
        let next = page.section("Next");
        assert!(!next.links().is_empty(), "{} has no link", next.name);
    }
}

#[test]
fn index_lists_every_page() {
    let index = Page::read("docs/README.md");
    for page in Page::all() {
        let Some(name) = page.name.strip_prefix("docs/") else {
            continue;
        };
        let listed = index.links().iter().any(|(_, target)| *target == name);
        assert!(
            listed || name == "README.md",
            "docs/README.md: no link to {name}"
        );
    }
}
