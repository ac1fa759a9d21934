//! The page: headings, paragraphs, tables, figures and data in one HTML file.

use super::canvas;
use super::mark;
use super::markup::escape;
use super::picture::Moment;
use super::{Figure, Table};
use std::fmt::Write as _;
use trinocular_rig::error::InputError;
use trinocular_rig::output::Output;

/// A report under construction. Parts appear in the order in which they are added.
#[derive(Clone, Debug, PartialEq)]
pub struct Page {
    title: String,
    subtitle: String,
    parts: Vec<Part>,
}

#[derive(Clone, Debug, PartialEq)]
enum Part {
    Heading(Heading),
    Paragraph(String),
    Table(Table),
    Figures(Vec<Figure>),
    Facts(Vec<(String, String)>),
    Moments(Vec<Moment>),
    Text {
        summary: String,
        note: String,
        text: String,
    },
}

/// Heading of a section or of a part of one.
#[derive(Clone, Debug, PartialEq)]
struct Heading {
    text: String,
    id: String,
    is_part: bool,
}

/// Most sections of a page whose contents list the parts of each, too.
const MOST_DETAILED: usize = 6;

impl Page {
    /// Creates an empty page.
    pub fn new(title: impl Into<String>, subtitle: impl Into<String>) -> Self {
        Self {
            title: title.into(),
            subtitle: subtitle.into(),
            parts: Vec::new(),
        }
    }

    /// Adds a heading and, unless it is empty, a paragraph under it.
    pub fn section(self, heading: impl Into<String>, paragraph: impl Into<String>) -> Self {
        self.headed(heading.into(), paragraph.into(), false)
    }

    /// Adds a heading within a section and, unless it is empty, a paragraph under it.
    pub fn subsection(self, heading: impl Into<String>, paragraph: impl Into<String>) -> Self {
        self.headed(heading.into(), paragraph.into(), true)
    }

    fn headed(self, text: String, paragraph: String, is_part: bool) -> Self {
        let id = self.free_id(&text);
        let page = self.with(Part::Heading(Heading { text, id, is_part }));
        match paragraph.is_empty() {
            true => page,
            false => page.paragraph(paragraph),
        }
    }

    /// Returns an address within the page that no other heading has.
    fn free_id(&self, text: &str) -> String {
        let words = text.split(|c: char| !c.is_ascii_alphanumeric());
        let words: Vec<String> = words
            .filter(|word| !word.is_empty())
            .map(str::to_ascii_lowercase)
            .collect();
        let stem = match words.is_empty() {
            true => "section".to_owned(),
            false => words.join("-"),
        };
        let is_taken = |id: &str| self.headings().any(|heading| heading.id == id);
        let numbered = (2..).map(|n: u32| format!("{stem}-{n}"));
        let mut ids = std::iter::once(stem.clone()).chain(numbered);
        ids.find(|id| !is_taken(id)).unwrap_or(stem)
    }

    fn headings(&self) -> impl Iterator<Item = &Heading> {
        self.parts.iter().filter_map(|part| match part {
            Part::Heading(heading) => Some(heading),
            _ => None,
        })
    }

    /// Adds a paragraph.
    pub fn paragraph(self, text: impl Into<String>) -> Self {
        self.with(Part::Paragraph(text.into()))
    }

    /// Adds a table.
    pub fn table(self, table: Table) -> Self {
        self.with(Part::Table(table))
    }

    /// Adds a figure: a [`super::LinePlot`], [`super::Scatter`] or [`super::Path3d`].
    pub fn plot(self, figure: impl Into<Figure>) -> Self {
        self.with(Part::Figures(vec![figure.into()]))
    }

    /// Adds figures side by side, filling each row.
    pub fn plots(self, figures: impl IntoIterator<Item = Figure>) -> Self {
        self.with(Part::Figures(figures.into_iter().collect()))
    }

    /// Adds pictures of the cameras, moment by moment.
    pub fn moments(self, moments: impl IntoIterator<Item = Moment>) -> Self {
        self.with(Part::Moments(moments.into_iter().collect()))
    }

    /// Adds a text to copy, folded away: a table in CSV, or a file. The `note` stands above it.
    pub fn text(
        self,
        summary: impl Into<String>,
        note: impl Into<String>,
        text: impl Into<String>,
    ) -> Self {
        self.with(Part::Text {
            summary: summary.into(),
            note: note.into(),
            text: text.into(),
        })
    }

    /// Adds names and their values: settings, versions, totals.
    pub fn facts<N: AsRef<str>, V: AsRef<str>>(self, facts: &[(N, V)]) -> Self {
        let owned = facts.iter();
        self.with(Part::Facts(
            owned
                .map(|(name, value)| (name.as_ref().to_owned(), value.as_ref().to_owned()))
                .collect(),
        ))
    }

    fn with(mut self, part: Part) -> Self {
        self.parts.push(part);
        self
    }

    /// Returns the page as HTML.
    pub fn to_html(&self) -> String {
        let title = escape(&self.title);
        let shades = canvas::shades(&mark::SHADES);
        let mut html = format!(
            "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\" />\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\" />\n\
             <title>{title}</title>\n<style>\n{shades}{STYLE}</style>\n</head>\n<body>\n<main>\n\
             <header><h1>{title}</h1>"
        );
        if !self.subtitle.is_empty() {
            let _ = write!(html, "<p>{}</p>", escape(&self.subtitle));
        }
        html.push_str("</header>\n");
        self.write_contents(&mut html);
        for part in &self.parts {
            write_part(&mut html, part);
        }
        // The footer stays last: it is the mark by which the program knows its own pages.
        let _ = write!(
            html,
            "<script>\n{SCRIPT}</script>\n<footer>Trinocular {}</footer>\n</main>\n</body>\n\
             </html>\n",
            env!("CARGO_PKG_VERSION")
        );
        html
    }

    /// Writes the table of contents of a page with at least two sections.
    fn write_contents(&self, html: &mut String) {
        let sections = self.headings().filter(|heading| !heading.is_part).count();
        if sections < 2 {
            return;
        }
        let is_listed = |heading: &&Heading| !heading.is_part || sections <= MOST_DETAILED;
        let listed: Vec<&Heading> = self.headings().filter(is_listed).collect();
        html.push_str("<nav aria-label=\"Contents\"><ol>\n");
        for (index, heading) in listed.iter().enumerate() {
            let (text, id) = (escape(&heading.text), &heading.id);
            let _ = write!(html, "<li><a href=\"#{id}\">{text}</a>");
            let is_part = |i: usize| listed.get(i).is_some_and(|heading| heading.is_part);
            html.push_str(match (heading.is_part, is_part(index + 1)) {
                (false, true) => "\n<ol>\n",
                (true, false) => "</li></ol>\n</li>\n",
                _ => "</li>\n",
            });
        }
        html.push_str("</ol></nav>\n");
    }

    /// Writes the page: the whole of it or, on any error, nothing.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write(&self, output: Output) -> Result<(), InputError> {
        output.write(self.to_html())
    }
}

fn write_part(html: &mut String, part: &Part) {
    match part {
        Part::Heading(Heading { text, id, is_part }) => {
            let level = if *is_part { "h3" } else { "h2" };
            let _ = writeln!(html, "<{level} id=\"{id}\">{}</{level}>", escape(text));
        }
        Part::Paragraph(text) => {
            let _ = writeln!(html, "<p>{}</p>", escape(text));
        }
        Part::Table(table) => html.push_str(&table.to_html()),
        Part::Figures(figures) => {
            html.push_str("<div class=\"figures\">\n");
            for figure in figures {
                let _ = writeln!(html, "<figure>{}</figure>", figure.to_page_svg());
            }
            html.push_str("</div>\n");
        }
        Part::Moments(moments) => {
            moments
                .iter()
                .for_each(|moment| html.push_str(&moment.to_html()));
        }
        Part::Text {
            summary,
            note,
            text,
        } => {
            let (summary, note, text) = (escape(summary), escape(note), escape(text));
            // A line end right after the tag is not part of the text.
            let _ = writeln!(
                html,
                "<details><summary>{summary}</summary>\n<p>{note}</p>\n\
                 <button type=\"button\" class=\"copy\" hidden=\"hidden\">Copy</button>\n\
                 <pre>\n{text}</pre></details>"
            );
        }
        Part::Facts(facts) => {
            html.push_str("<dl>\n");
            for (name, value) in facts {
                let _ = writeln!(
                    html,
                    "<div><dt>{}</dt><dd>{}</dd></div>",
                    escape(name),
                    escape(value)
                );
            }
            html.push_str("</dl>\n");
        }
    }
}

/// Style sheet of the page. It holds no `<` and no `&`, so that the page is also well-formed XML.
const STYLE: &str = include_str!("page.css");

/// Script of the page, without `<` and `&` as the style sheet. Without scripts, paths stand still
/// and texts are selected by hand.
const SCRIPT: &str = include_str!("page.js");

#[cfg(test)]
mod tests {
    use super::super::markup::balance;
    use super::super::{Cell, LinePlot, Path3d, Scatter, Style};
    use super::*;

    fn page() -> Page {
        Page::new("A <run> & \"more\"", "sub & title")
            .section("Moves <1>", "x < y & z")
            .paragraph("")
            .facts(&[("f < 530 px", "h1 & h2"), ("", "")])
            .table(Table::new("<t>", ["a & b"]).row([Cell::number(1.0, 2).strong()]))
            .plot(LinePlot::new("p", "x", "y").series("s", Style::Steps, [[0.0, 1.0], [1.0, 0.0]]))
            .plots([
                Scatter::new("q", "x", "y")
                    .circle([0.0; 2], 1.0, "1 mm")
                    .into(),
                Path3d::new("r", ["X", "Y", "Z"]).into(),
            ])
    }

    #[test]
    fn page_is_well_formed() {
        assert_eq!(balance::fault(&page().to_html()), None);
    }

    #[test]
    fn page_is_self_contained() {
        let html = page()
            .to_html()
            .replace("http://www.w3.org/2000/svg", "")
            .replace("href=\"#", "")
            .replace("href=\"data:image/jpeg;base64,", "");
        for outside in [
            "http", "src=", "href=", "url(", "@import", "import(", "fetch(", "<link", "<img",
        ] {
            assert!(!html.contains(outside), "{outside}");
        }
    }

    #[test]
    fn parts_keep_their_order() {
        let html = page().to_html();
        let at = |text: &str| {
            html.find(text)
                .unwrap_or_else(|| panic!("{text} is missing"))
        };
        let order = [
            "<h2 id=\"moves-1\">Moves &lt;1&gt;",
            "x &lt; y",
            "<dl>",
            "<table>",
            "aria-label=\"p\"",
            "aria-label=\"r\"",
        ];
        assert!(order.map(at).is_sorted());
    }

    #[test]
    fn contents_lead_to_every_section() {
        let page = page()
            .subsection("Moves <1>", "")
            .subsection("\u{b5}", "")
            .section("Last", "");
        let html = page.to_html();
        assert_eq!(balance::fault(&html), None);
        let links: Vec<&str> = html
            .split("href=\"#")
            .skip(1)
            .filter_map(|rest| rest.split('"').next())
            .collect();
        assert_eq!(links, ["moves-1", "moves-1-2", "section", "last"]);
        for id in links {
            assert_eq!(html.matches(&format!(" id=\"{id}\"")).count(), 1, "{id}");
        }
    }

    #[test]
    fn text_is_kept_for_copies() {
        let page = page().text("Data & more", "note", "\na,b\n\"<1>\",2\n");
        let html = page.to_html();
        assert_eq!(balance::fault(&html), None);
        assert!(
            html.contains("<pre>\n\na,b\n&quot;&lt;1&gt;&quot;,2\n</pre>"),
            "{html}"
        );
    }

    #[test]
    fn every_colour_has_a_dark_form() {
        let html = page().to_html();
        assert!(html.contains("(prefers-color-scheme:dark)"));
        let drawn = html.split("</style>").nth(1).unwrap();
        let colours = ["fill", "stroke"].map(|part| {
            let attribute = format!(" {part}=\"#");
            let values = drawn.split(&attribute).skip(1).map(|rest| &rest[..6]);
            values
                .map(|value| format!("svg [{part}=\"#{value}\"]"))
                .collect::<Vec<_>>()
        });
        for rule in colours.concat() {
            assert!(html.contains(&rule), "{rule}");
        }
    }

    #[test]
    fn page_is_deterministic() {
        assert_eq!(page().to_html(), page().to_html());
    }
}
