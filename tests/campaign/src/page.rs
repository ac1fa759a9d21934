//! Texts of tests/FAULTS-INJECTED.md.

use crate::options::{CampaignOptions, Kind};

/// Beginning of the page.
pub const HEAD: &str = "\
# Faults injected

Random lives of the station, and the laws that none of them may break. A judge that shares no code
with the station reads the port words as a logic analyser does: levels, pulse widths, counted steps,
and speed, acceleration and jerk by differences. What it expects follows from the packets that were
sent, the switches, and the station's reports. Only the messages' types are common to both.

A life is its seed: `campaign --kind KIND --replay SEED` lives it again and prints what happens.
The judge itself is tested: if it is shown a station that breaks the laws, it reports every law as
broken (`every_law_notices_its_violation`).
";

/// Returns the heading of a kind.
pub const fn title(kind: Kind) -> &'static str {
    match kind {
        Kind::Station => "Lives of any commands, noise, switches and stalls",
        Kind::Loop => "Lives that follow a target",
    }
}

/// Returns the description of the lives of a kind.
pub const fn about(kind: Kind) -> &'static str {
    match kind {
        Kind::Station => {
            "\
Commands in any order and at any spacing: configurations from usual to nonsense, zero, jogs,
setpoints, searches for home, sound and hostile frames, motors, stops, resets, bursts of more than a
control tick takes. Silence of the host; noise, broken, doubled and old packets; emergency stop,
driver fault and limit switches with bounce; a shell that stalls. Word rates from 64 kHz to 1 MHz;
clocks that begin just before 2^31 and 2^32 us and ms, 2^47 and 2^48 us. At the end: reset,
configuration, zero and a move that must end exactly."
        }
        Kind::Loop => {
            "\
The stage that the pins move is what simulated cameras see: ideal displacements with noise. Every
second life is healthy: 5 to 1,000 frames per second, even or irregular, occlusions, targets that
speed up while they are hidden. In the others the mount has a wrong sign, is turned by 60 to 180
degrees or has swapped axes, distances are seen 2 to 4 times too large, stamps are off by -70 to +60
ms, or a motor stalls."
        }
    }
}

/// Returns the end of the page: the command, build and machine that made it.
pub fn foot(options: &CampaignOptions) -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = info.lines().find(|line| line.starts_with("model name"));
    let model = model.and_then(|line| line.split(": ").nth(1));
    let machine = model.unwrap_or("a machine that does not say its name");
    let threads = options.threads;
    format!(
        "\n## How it was made\n\n\
         Printed by `campaign --markdown --lives {} --loop-lives {} --seed {} \
         --threads {threads}`,\n\
         built with `--release`: optimised, with `debug-assertions` and `overflow-checks`.\n\
         Machine: {machine}, {threads} threads.\n",
        options.lives, options.loop_lives, options.seed,
    )
}

#[cfg(test)]
mod tests {
    use crate::laws::Law;
    use std::collections::BTreeSet;

    #[test]
    fn published_laws_are_the_laws() {
        let page = include_str!("../../FAULTS-INJECTED.md");
        let rows = page.lines().filter(|line| line.starts_with("| `"));
        let published: BTreeSet<(String, String)> = rows
            .map(|row| {
                let mut cells = row.split('|').map(str::trim).skip(1);
                let mut cell = || cells.next().unwrap_or_default().to_string();
                (cell(), cell())
            })
            .collect();
        let laws = Law::STATION.into_iter().chain(Law::LOOP);
        let ours: BTreeSet<_> = laws
            .map(|law| (format!("`{}`", law.name()), law.text().to_string()))
            .collect();
        assert_eq!(published, ours);
    }
}
