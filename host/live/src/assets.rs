//! Files of the page, embedded in the program.

/// A file of the page.
#[derive(Clone, Copy, Debug)]
pub struct Asset {
    /// Path in the URL.
    pub path: &'static str,
    /// Media type.
    pub kind: &'static str,
    /// Content.
    pub text: &'static str,
}

const HTML: &str = "text/html; charset=utf-8";
const CSS: &str = "text/css; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";

macro_rules! asset {
    ($path:literal, $kind:expr) => {
        Asset {
            path: concat!("/", $path),
            kind: $kind,
            text: include_str!(concat!("../page/", $path)),
        }
    };
}

/// All files but the page itself, which is at `/`.
pub const ASSETS: [Asset; 11] = [
    asset!("style.css", CSS),
    asset!("main.js", SCRIPT),
    asset!("link.js", SCRIPT),
    asset!("cameras.js", SCRIPT),
    asset!("plots.js", SCRIPT),
    asset!("path.js", SCRIPT),
    asset!("controls.js", SCRIPT),
    asset!("freshness.js", SCRIPT),
    asset!("vendor/uPlot.iife.min.js", SCRIPT),
    asset!("vendor/uPlot.min.css", CSS),
    asset!("icon.svg", "image/svg+xml"),
];

/// The page.
pub const PAGE: Asset = Asset {
    path: "/",
    kind: HTML,
    text: include_str!("../page/index.html"),
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn page_names_embedded_files_only() {
        for part in PAGE.text.split('"') {
            let is_file = part.ends_with(".js") || part.ends_with(".css") || part.ends_with(".svg");
            let path = format!("/{part}");
            assert!(
                !is_file || ASSETS.iter().any(|asset| asset.path == path),
                "{part}"
            );
        }
        for asset in ASSETS.iter().chain([&PAGE]) {
            let is_ours = !asset.path.starts_with("/vendor") && asset.kind != "image/svg+xml";
            assert!(
                !is_ours || !asset.text.contains("https://"),
                "{}",
                asset.path
            );
            assert!(
                !is_ours || !asset.text.contains("style=\""),
                "{}",
                asset.path
            );
        }
    }

    /// Returns the texts between `before` and the next quotation mark.
    fn quoted<'a>(text: &'a str, before: &str) -> Vec<&'a str> {
        let parts = text.split(before).skip(1);
        parts.filter_map(|part| part.split('"').next()).collect()
    }

    /// A script finds the first of two elements of the same name.
    #[test]
    fn elements_have_names_of_their_own() {
        let ids = quoted(PAGE.text, " id=\"");
        for id in &ids {
            let count = ids.iter().filter(|other| *other == id).count();
            assert_eq!(count, 1, "{id}");
        }
        let scripts = ASSETS
            .iter()
            .filter(|asset| asset.path.ends_with(".js") && !asset.path.starts_with("/vendor"));
        for script in scripts {
            for before in ["byId(\"", "setText(\"", " on(\"", "enable(\""] {
                for id in quoted(script.text, before) {
                    assert!(ids.contains(&id), "{}: {id}", script.path);
                }
            }
        }
    }
}
