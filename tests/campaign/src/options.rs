//! The command line.

use crate::laws::Law;
use crate::sabotage::Sabotage;

/// Text of `--help`.
pub const HELP: &str = "\
Random lives of the station, judged by what its pins do.

Usage: campaign [OPTIONS]

  --kind station|loop  any commands, noise, switches and stalls; or following a target [station]
  --lives N            how many lives [1000]
  --seed S             seed of the first; each life has the next [0]
  --threads N          how many at a time [2]
  --replay SEED        live one life and print what happens
  --markdown           print both kinds' summaries as a page: tests/FAULTS-INJECTED.md
  --loop-lives N       with --markdown: how many of the loop kind [1000]
  --sabotage NAME     show the judge a station that breaks laws: steps, twice, homed, ...
  --counted LAW,...    laws that are counted only: breaking them leaves the exit code 0
  --progress N         say how far it is after every N lives [10000]

Exit code: 0 if every law holds, 1 if one is broken, 2 for a wrong option.
";

/// Kind of lives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Lives with any commands, noise, switches and stalls.
    Station,
    /// Lives that follow a target through a plant.
    Loop,
}

impl Kind {
    /// Returns the name of the kind on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Station => "station",
            Self::Loop => "loop",
        }
    }
}

/// Options of the command line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CampaignOptions {
    pub kind: Kind,
    pub lives: u64,
    pub seed: u64,
    pub threads: u64,
    pub replay: Option<u64>,
    pub markdown: bool,
    pub loop_lives: u64,
    pub progress: u64,
    pub sabotage: Sabotage,
    /// Names of laws that do not affect the exit code.
    pub counted: Vec<String>,
    pub help: bool,
}

impl CampaignOptions {
    /// Parses the arguments after the program's name.
    ///
    /// # Errors
    /// Returns the first mistake in the arguments.
    pub fn parse(arguments: impl Iterator<Item = String>) -> Result<Self, String> {
        let mut options = Self {
            kind: Kind::Station,
            lives: 1000,
            seed: 0,
            threads: 2,
            replay: None,
            markdown: false,
            loop_lives: 1000,
            progress: 10_000,
            sabotage: Sabotage::None,
            counted: Vec::new(),
            help: false,
        };
        let mut arguments = arguments;
        while let Some(name) = arguments.next() {
            let mut value = || arguments.next().ok_or(format!("{name} needs a value"));
            match name.as_str() {
                "-h" | "--help" => options.help = true,
                "--markdown" => options.markdown = true,
                "--kind" => {
                    options.kind = match value()?.as_str() {
                        "station" => Kind::Station,
                        "loop" => Kind::Loop,
                        other => return Err(format!("--kind is station or loop, not {other}")),
                    }
                }
                "--sabotage" => {
                    let name = value()?;
                    let all = Sabotage::ALL.into_iter();
                    let names: Vec<String> = all.clone().map(Sabotage::name).collect();
                    let found = all.zip(&names).find(|(_, known)| **known == name);
                    options.sabotage = found
                        .ok_or(format!(
                            "--sabotage is one of {}, not {name}",
                            names.join(", ")
                        ))?
                        .0;
                }
                "--counted" => options.counted = laws(&value()?)?,
                "--lives" => options.lives = number(&name, &value()?, 1)?,
                "--loop-lives" => options.loop_lives = number(&name, &value()?, 1)?,
                "--seed" => options.seed = number(&name, &value()?, 0)?,
                "--threads" => options.threads = number(&name, &value()?, 1)?,
                "--progress" => options.progress = number(&name, &value()?, 1)?,
                "--replay" => options.replay = Some(number(&name, &value()?, 0)?),
                other => return Err(format!("unknown option {other}")),
            }
        }
        Ok(options)
    }
}

/// Parses names of laws, separated by commas.
fn laws(text: &str) -> Result<Vec<String>, String> {
    let known = |name: &&str| {
        Law::STATION
            .iter()
            .chain(&Law::LOOP)
            .any(|law| law.name() == *name)
    };
    let names = text.split(',').map(|name| match known(&name) {
        true => Ok(name.to_owned()),
        false => Err(format!("--counted takes names of laws, not {name}")),
    });
    names.collect()
}

fn number(name: &str, text: &str, least: u64) -> Result<u64, String> {
    let number = text.parse().ok().filter(|number| *number >= least);
    number.ok_or(format!("{name} is a whole number from {least}, not {text}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(line: &str) -> Result<CampaignOptions, String> {
        CampaignOptions::parse(line.split_whitespace().map(String::from))
    }

    #[test]
    fn options_are_parsed() {
        let options = parse("--kind loop --lives 7 --seed 3 --threads 1 --markdown").expect("fine");
        assert_eq!(
            (options.kind, options.lives, options.seed),
            (Kind::Loop, 7, 3)
        );
        assert!(options.markdown && options.threads == 1);
        assert_eq!(parse("--replay 5").expect("fine").replay, Some(5));
    }

    #[test]
    fn wrong_options_are_named() {
        for line in [
            "--lives",
            "--lives x",
            "--lives 0",
            "--kind both",
            "--sabotage x",
            "--counted sick,x",
            "--fast",
        ] {
            let message = parse(line).expect_err(line);
            assert!(
                message.contains(line.split(' ').next().unwrap_or(line)),
                "{message}"
            );
        }
    }
}
