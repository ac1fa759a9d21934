#![doc = include_str!("../README.md")]
//!
//! # Modules
//!
//! | module | holds |
//! |---|---|
//! | [`rig_file`] | the rig file: reading, writing, a commented template, changes that keep comments |
//! | [`pivot`] | the point of a turning target whose displacement is measured |
//! | [`error`] | errors in files that the user gave, with file, line and field |
//! | [`input`] | reading of files with a limit to their size |
//! | [`output`] | files that are written whole or not at all |
//! | [`choice`] | refusals that name the nearest allowed word and all others |
//! | [`interruption`] | Ctrl-C and other signals |
//! | [`notice`](mod@notice), [`printable`] | messages on standard error, and foreign text in them |
//! | [`random`] | seeded random numbers |

// Output goes through `notice!` or a writer whose errors are handled: these macros panic instead.
#![cfg_attr(not(test), deny(clippy::print_stderr, clippy::print_stdout))]

pub mod choice;
pub mod error;
pub mod input;
pub mod interruption;
pub mod notice;
pub mod output;
pub mod pivot;
pub mod printable;
pub mod random;
pub mod rectangle;
pub mod rig_file;
