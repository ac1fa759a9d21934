//! Reproduction of the paper: its tables and figures of numbers beside this program's results.
//!
//! * [`validation`]: section 3, random point sets (Tables 1 and 2, Cramér-Rao bound);
//! * [`moves`]: section 4.2, single moves seen by resting cameras (Table 5);
//! * [`tracking`]: section 4.3, five moves in closed loop (Table 6, Figs. 7 and 8);
//! * [`present`]: tables and figures of sections 4.2 and 4.3;
//! * [`tables`]: all of them at once.

pub mod moves;
pub mod present;
pub mod tables;
pub mod tracking;
pub mod validation;
