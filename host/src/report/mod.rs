//! Reports: the results of a run as one self-contained HTML file, and the same tables on screen.
//!
//! A command fills plain values ([`Table`], [`LinePlot`], [`Scatter`], [`Path3d`]) and adds them to
//! a [`Page`]. The page is one file without external addresses, so that it can be mailed and
//! archived beside a recording. Its one script turns paths in space and copies texts; without it
//! the page shows the same.
//!
//! - A [`Table`] prints itself to a terminal ([`Table::to_text`]) and to the page from the same
//!   cells.
//! - A figure is one SVG document, written in tenths of a pixel; [`Figure::to_svg`] also serves a
//!   README.
//! - A value that is not a number leaves a gap; an empty series shows "no data".
//!
//! *Invariant:* nothing here measures or decides; a figure shows exactly the numbers it was given.
//!
//! ```
//! use trinocular::report::{Cell, LinePlot, Page, Style, Table};
//!
//! let table = Table::new("Two moves", ["move", "error, mm"])
//!     .row([Cell::text("first"), Cell::number(0.0123, 3)])
//!     .row([Cell::text("second"), Cell::number(-0.4, 3).bad()]);
//! assert_eq!(table.to_text().lines().nth(4), Some("first       0.012"));
//!
//! let plot = LinePlot::new("Error over time", "time, s", "error, mm")
//!     .series("X", Style::Line, [[0.0, 0.01], [1.0, 0.02]]);
//! let page = Page::new("A run", "on the twin").section("Moves", "").table(table).plot(plot);
//! assert!(page.to_html().ends_with("</html>\n"));
//! ```

mod axis;
mod band;
mod canvas;
mod chart;
mod mark;
mod markup;
mod page;
mod path3d;
mod picture;
mod plot;
mod scatter;
mod sheet;
mod stroke;
mod table;

#[cfg(test)]
pub(crate) use markup::balance;

pub use band::Band;
pub use mark::{Mark, MarkKind};
pub use page::Page;
pub use path3d::Path3d;
pub use picture::{Moment, View};
pub use plot::{LinePlot, Series};
pub use scatter::{Circle, Scatter};
pub use stroke::Style;
pub use table::{Cell, Emphasis, Table};

/// Any of the figures of a page.
#[derive(Clone, Debug, PartialEq)]
pub enum Figure {
    /// Values over an axis.
    Line(LinePlot),
    /// Positions in a plane, equal axes.
    Scatter(Scatter),
    /// Positions in space.
    Path3d(Path3d),
}

impl Figure {
    /// Returns the figure as one SVG document.
    pub fn to_svg(&self) -> String {
        match self {
            Self::Line(plot) => plot.to_svg(),
            Self::Scatter(plot) => plot.to_svg(),
            Self::Path3d(plot) => plot.to_svg(),
        }
    }

    /// Returns the figure for a page, whose script turns paths in space.
    fn to_page_svg(&self) -> String {
        match self {
            Self::Path3d(plot) => plot.to_turnable_svg(),
            figure => figure.to_svg(),
        }
    }
}

impl From<LinePlot> for Figure {
    fn from(plot: LinePlot) -> Self {
        Self::Line(plot)
    }
}

impl From<Scatter> for Figure {
    fn from(plot: Scatter) -> Self {
        Self::Scatter(plot)
    }
}

impl From<Path3d> for Figure {
    fn from(plot: Path3d) -> Self {
        Self::Path3d(plot)
    }
}
