//! Questions on a terminal, each with a default.

use std::fmt::Display;
use std::io::{BufRead, Write};

use crate::commands::failure::Failure;

/// Terminal for questions, or none.
pub struct Questions<'a> {
    terminal: Option<(&'a mut dyn BufRead, &'a mut dyn Write)>,
}

impl<'a> Questions<'a> {
    /// Reads answers from `answers` after questions to `asked`.
    pub fn on(answers: &'a mut dyn BufRead, asked: &'a mut dyn Write) -> Self {
        Self {
            terminal: Some((answers, asked)),
        }
    }

    /// Makes questions that are never asked: the defaults hold.
    pub const fn none() -> Self {
        Self { terminal: None }
    }

    /// Returns the given value, else the answer, else the default. Repeats the question, with the
    /// reason, if the answer cannot be read.
    ///
    /// # Errors
    /// If the answers end or cannot be read, or the default does not parse.
    pub fn value<T, E: Display>(
        &mut self,
        given: Option<T>,
        question: &str,
        default: &str,
        parse: impl Fn(&str) -> Result<T, E>,
    ) -> Result<T, Failure> {
        if let Some(given) = given {
            return Ok(given);
        }
        let Some((answers, asked)) = &mut self.terminal else {
            return parse(default).map_err(|error| Failure::Usage(error.to_string()));
        };
        loop {
            write!(asked, "{question} [{default}]: ")?;
            asked.flush()?;
            let mut line = String::new();
            let read = answers.read_line(&mut line).map_err(|cause| {
                Failure::Usage(format!(
                    "cannot read the answer: {cause}; nothing was written"
                ))
            })?;
            if read == 0 {
                let ended = "the answers ended; nothing was written (--defaults asks nothing)";
                return Err(Failure::Usage(ended.into()));
            }
            let answer = match line.trim() {
                "" => default,
                answer => answer,
            };
            match parse(answer) {
                Ok(value) => return Ok(value),
                Err(reason) => writeln!(asked, "  {reason}")?,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ask(answers: &str) -> (Option<u32>, String) {
        let (mut answers, mut asked) = (answers.as_bytes(), Vec::new());
        let mut questions = Questions::on(&mut answers, &mut asked);
        let value = questions.value(None, "How many", "3", str::parse);
        (value.ok(), String::from_utf8_lossy(&asked).into_owned())
    }

    #[test]
    fn enter_takes_the_default() {
        assert_eq!(ask("7\n").0, Some(7));
        assert_eq!(ask("\n"), (Some(3), "How many [3]: ".into()));
    }

    #[test]
    fn unreadable_answer_is_asked_again() {
        let (value, asked) = ask("many\n5\n");
        assert_eq!(value, Some(5));
        assert_eq!(asked.matches("How many").count(), 2, "{asked}");
        assert!(asked.contains("invalid digit"), "{asked}");
    }

    #[test]
    fn end_of_answers_is_an_error() {
        assert_eq!(ask("").0, None);
    }

    #[test]
    fn given_value_is_not_asked() {
        let mut asked = Vec::new();
        let mut answers: &[u8] = b"";
        let mut questions = Questions::on(&mut answers, &mut asked);
        let value = questions.value(Some(4), "How many", "3", str::parse::<u32>);
        assert_eq!(value.ok(), Some(4));
        assert!(asked.is_empty());
    }
}
