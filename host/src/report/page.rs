//! The page: headings, paragraphs, tables and figures in one HTML file.

use super::markup::escape;
use super::{Error, Figure, Table};
use std::fmt::Write as _;
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
    Section { heading: String, paragraph: String },
    Paragraph(String),
    Table(Table),
    Figures(Vec<Figure>),
    Facts(Vec<(String, String)>),
}

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
        self.with(Part::Section {
            heading: heading.into(),
            paragraph: paragraph.into(),
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
    pub fn to_html(&self) -> Result<String, Error> {
        let title = escape(&self.title);
        let mut html = format!(
            "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\" />\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\" />\n\
             <title>{title}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n<main>\n\
             <header><h1>{title}</h1>"
        );
        if !self.subtitle.is_empty() {
            let _ = write!(html, "<p>{}</p>", escape(&self.subtitle));
        }
        html.push_str("</header>\n");
        for part in &self.parts {
            write_part(&mut html, part)?;
        }
        let _ = write!(
            html,
            "<footer>Trinocular {}</footer>\n</main>\n</body>\n</html>\n",
            env!("CARGO_PKG_VERSION")
        );
        Ok(html)
    }

    /// Writes the page: the whole of it or, on any error, nothing.
    ///
    /// # Errors
    /// If a figure cannot be drawn or the file cannot be written.
    pub fn write(&self, output: Output) -> Result<(), Error> {
        output.write(&self.to_html()?)?;
        Ok(())
    }
}

fn write_part(html: &mut String, part: &Part) -> Result<(), Error> {
    match part {
        Part::Section { heading, paragraph } => {
            let _ = writeln!(html, "<h2>{}</h2>", escape(heading));
            if !paragraph.is_empty() {
                let _ = writeln!(html, "<p>{}</p>", escape(paragraph));
            }
        }
        Part::Paragraph(text) => {
            let _ = writeln!(html, "<p>{}</p>", escape(text));
        }
        Part::Table(table) => html.push_str(&table.to_html()),
        Part::Figures(figures) => {
            html.push_str("<div class=\"figures\">\n");
            for figure in figures {
                let _ = writeln!(html, "<figure>{}</figure>", figure.to_svg()?);
            }
            html.push_str("</div>\n");
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
    Ok(())
}

/// Style sheet of the page. It holds no `<` and no `&`, so that the page is also well-formed XML.
const STYLE: &str = "\
:root{color-scheme:light;--ink:#1f2933;--soft:#52606d;--line:#e4e7eb;--back:#f5f7fa;\
--accent:#0072b2}
*{box-sizing:border-box}
body{margin:0;background:var(--back);color:var(--ink);font:16px/1.55 system-ui,-apple-system,\
'Segoe UI',Roboto,'Helvetica Neue',Arial,sans-serif}
main{max-width:1120px;margin:0 auto;padding:40px 32px 24px;background:#fff;min-height:100vh}
header{border-bottom:3px solid var(--accent);padding-bottom:12px;margin-bottom:8px}
h1{font-size:1.9rem;line-height:1.2;margin:0}
header p{margin:6px 0 0;color:var(--soft)}
h2{font-size:1.3rem;line-height:1.3;margin:40px 0 8px}
p{max-width:72ch;margin:8px 0 16px}
.table{overflow-x:auto;margin:16px 0 24px}
table{border-collapse:collapse;font-size:.86rem;font-variant-numeric:tabular-nums}
caption{text-align:left;font-weight:600;padding:0 0 8px}
th,td{padding:5px 12px 5px 6px;text-align:left;white-space:nowrap;\
border-bottom:1px solid var(--line)}
th{color:var(--soft);font-weight:600;white-space:normal;border-bottom:2px solid #cbd2d9;\
vertical-align:bottom}
tbody tr:hover{background:var(--back)}
.n{text-align:right}
td.n{white-space:pre}
.strong{font-weight:700}
.good{color:#00664b}
.bad{color:#a63f00;font-weight:700}
.muted{color:#6b7785}
.figures{display:flex;flex-wrap:wrap;gap:16px 24px;margin:16px 0 24px}
figure{margin:0;max-width:100%}
svg{display:block;max-width:100%;height:auto}
svg text{font-family:system-ui,-apple-system,'Segoe UI',Roboto,'Helvetica Neue',Arial,sans-serif}
dl{display:grid;grid-template-columns:repeat(auto-fill,minmax(220px,1fr));gap:12px 24px;\
margin:16px 0 24px;padding:16px 20px;background:var(--back);border-radius:8px}
dt{font-size:.8rem;color:var(--soft)}
dd{margin:0;font-weight:600;font-variant-numeric:tabular-nums;overflow-wrap:anywhere}
footer{margin-top:48px;padding-top:12px;border-top:1px solid var(--line);font-size:.8rem;\
color:var(--soft)}
@media print{body,main{background:#fff;padding:0}figure,tr,dl{break-inside:avoid}h2{\
break-after:avoid}}
";

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
        assert_eq!(balance::fault(&page().to_html().unwrap()), None);
    }

    #[test]
    fn page_is_self_contained() {
        let html = page()
            .to_html()
            .unwrap()
            .replace("http://www.w3.org/2000/svg", "");
        for outside in [
            "http", "src=", "href=", "url(", "@import", "<script", "<link", "<img",
        ] {
            assert!(!html.contains(outside), "{outside}");
        }
    }

    #[test]
    fn parts_keep_their_order() {
        let html = page().to_html().unwrap();
        let at = |text: &str| {
            html.find(text)
                .unwrap_or_else(|| panic!("{text} is missing"))
        };
        let order = [
            "<h2>Moves &lt;1&gt;",
            "x &lt; y",
            "<dl>",
            "<table>",
            "aria-label=\"p\"",
            "aria-label=\"r\"",
        ];
        assert!(order.map(at).is_sorted());
    }

    #[test]
    fn page_is_deterministic() {
        assert_eq!(page().to_html().unwrap(), page().to_html().unwrap());
    }
}
