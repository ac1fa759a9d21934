//! Hint at commas that are missing between the values of an option.

use clap::{Arg, Command, CommandFactory as _};

use super::Arguments;

/// Returns a hint if one of the arguments is an option with comma-separated values, and two numbers
/// follow it. Call it only after the arguments were refused.
pub fn hint(arguments: impl Iterator<Item = String>) -> Option<String> {
    let arguments: Vec<String> = arguments.collect();
    let program = Arguments::command();
    let mut command = &program;
    for argument in &arguments {
        command = command.find_subcommand(argument).unwrap_or(command);
    }
    let options = lists(command);
    arguments.windows(3).find_map(|window| {
        let [option, first, second] = window else {
            return None;
        };
        let name = option.strip_prefix("--")?;
        let is_list = options.iter().any(|known| known == name);
        let is_number = |text: &String| text.parse::<f64>().is_ok();
        let first = first.trim_end_matches(',').to_owned();
        (is_list && is_number(&first) && is_number(second))
            .then(|| format!("--{name} takes its values with commas: --{name} {first},{second}"))
    })
}

/// Returns the names of the options whose values are separated by commas.
fn lists(command: &Command) -> Vec<String> {
    let is_list = |argument: &&Arg| {
        let has_comma = argument.get_value_delimiter() == Some(',');
        let shown = argument.get_value_names().unwrap_or_default();
        has_comma || shown.iter().any(|name| name.contains(','))
    };
    let lists = command.get_arguments().filter(is_list);
    let names = lists.filter_map(|argument| argument.get_long().map(str::to_owned));
    names.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(words: &str) -> Option<String> {
        hint(words.split_whitespace().map(str::to_owned))
    }

    #[test]
    fn missing_comma_is_named_with_way_out() {
        let said = of("trinocular verify rig.toml --points 25 50").expect("a hint");
        assert!(said.ends_with("--points 25,50"), "{said}");
        let said = of("trinocular init --steps-per-mm 80, 80 400").expect("a hint");
        assert!(said.ends_with("--steps-per-mm 80,80"), "{said}");
        assert_eq!(of("trinocular verify rig.toml --points 25,50"), None);
        assert_eq!(of("trinocular verify r.toml --depth-range 600 x 3"), None);
        assert_eq!(of("trinocular verify"), None);
    }
}
