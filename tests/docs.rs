//! The pages for users: their commands run as typed, their references match the parsers, their
//! figures are those that the program prints, and the example data can be reproduced.
//!
//! Pages are `README.md`, `RESULTS.md` and everything in `docs/`.

#[path = "docs/commands.rs"]
mod commands;
#[path = "docs/data.rs"]
mod data;
#[path = "docs/form.rs"]
mod form;
#[path = "docs/json_reference.rs"]
mod json_reference;
#[path = "docs/page.rs"]
mod page;
#[path = "docs/picture.rs"]
mod picture;
#[path = "docs/range.rs"]
mod range;
#[path = "docs/results.rs"]
mod results;
#[path = "docs/rig_reference.rs"]
mod rig_reference;
#[path = "docs/scenario_reference.rs"]
mod scenario_reference;
#[path = "docs/table.rs"]
mod table;
#[path = "docs/turning.rs"]
mod turning;
