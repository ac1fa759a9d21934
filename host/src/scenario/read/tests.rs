use super::*;

const SMALLEST: &str = "title = \"t\"\nseed = 1\n[cameras]\nkind = \"points\"\n\
                        frames_per_s = 60\nlatency_ms = 20\ndepth_mm = 850\n\
                        points = 100\nnoise_px = 0.0\n[[target]]\nmotion = \"still\"\n\
                        seconds = 2\n[expect]\n";

fn parse(text: &str) -> Result<Scenario, String> {
    Scenario::parse(Path::new("s.toml"), text).map_err(|error| error.to_string())
}

#[test]
fn absent_fields_take_defaults() {
    let scenario = parse(SMALLEST).expect("it is whole");
    assert_eq!(scenario.stage, default_stage());
    assert_eq!(scenario.measure.from_s, 0.0);
    assert_eq!(scenario.measure.until_s, 2.0);
    assert_eq!(scenario.expect, Expect::default());
    assert!(scenario.events.is_empty());
}

#[test]
fn every_event_and_motion_is_read() {
    let text = format!(
        "{SMALLEST}faults = [\"limit\"]\nstates = [\"idle\"]\nsteps = [1, -2, 3]\n\
         steps_within = [0, 0, 4]\n\
         [[expect.at]]\ntime_s = 1\nerror_mm = [1, 2, 3]\nstate = \"faulted\"\nstanding = true\n\
         [[target]]\nmotion = \"step\"\nby_mm = [1, 2, 3]\nseconds = 1\n\
         [[target]]\nmotion = \"line\"\nvelocity_mm_s = [1, 2, 3]\nseconds = 1\n\
         ramp_in_s = 0.5\nramp_out_s = 0.25\n\
         [[target]]\nmotion = \"lissajous\"\namplitude_mm = [1, 0, 0]\nratio = [1, 1, 1]\n\
         peak_mm_s = 5\nseconds = 1\n\
         [[event]]\nat_s = 0\nwhat = \"late\"\nframes = 3\nby_ms = 7\n\
         [[event]]\nat_s = 0\nwhat = \"limit\"\naxis = \"z\"\nend = \"positive\"\nseconds = 0.5\n\
         [[event]]\nat_s = 5\nwhat = \"zero\"\n"
    );
    let scenario = parse(&text).expect("it is whole");
    assert_eq!(scenario.legs.len(), 4);
    assert_eq!(scenario.legs[2].ramps_s, [0.5, 0.25]);
    let events: Vec<Happening> = scenario.events.iter().map(|event| event.what).collect();
    let limit = Happening::Limit {
        axis: 2,
        end: 1,
        seconds: 0.5,
    };
    let late = Happening::Late {
        frames: 3,
        by_ms: 7.0,
    };
    assert_eq!(events, [late, limit, Happening::Zero]);
    let expect = scenario.expect;
    assert_eq!(expect.faults, [Fault::Limit]);
    assert_eq!(expect.states, Some(vec![State::Idle]));
    assert_eq!(
        (expect.steps, expect.steps_within),
        (Some([1, -2, 3]), [0, 0, 4])
    );
    assert_eq!(expect.at[0].standing, Some(true));
}

/// Leaves out every line of the file in turn: the line was needed or has a default; nothing panics,
/// and errors name file and field.
#[test]
fn missing_line_is_named() {
    for index in 0..SMALLEST.lines().count() {
        let kept = SMALLEST.lines().enumerate().filter(|(i, _)| *i != index);
        let text: String = kept.map(|(_, line)| format!("{line}\n")).collect();
        let error = parse(&text).expect_err("every line is needed");
        assert!(error.starts_with("s.toml:"), "{error}");
        assert!(error.contains("field `"), "{error}");
    }
}

#[test]
fn impossible_values_are_refused() {
    for (from, to, part) in [
        ("seconds = 2", "seconds = 1e9", "out of range"),
        ("seconds = 2", "seconds = 2\nramp_in_s = 1", "unknown field"),
        ("points = 100", "points = 3", "8 to 4000"),
        ("frames_per_s = 60", "frames_per_s = 0", "1 to 200"),
        (
            "[expect]",
            "[expect]\nsteps_within = [1, 1, 1]",
            "no `steps`",
        ),
        ("[expect]", "[expect]\nsteps = [1.5, 1, 1]", "whole number"),
        ("[expect]", "[expect]\nrms_mm = [0, 1, 1]", "greater than 0"),
    ] {
        let text = SMALLEST.replacen(from, to, 1);
        let error = parse(&text).expect_err(part);
        assert!(error.contains(part), "{error}");
    }
    let text = SMALLEST.replacen("[[target]]\nmotion = \"still\"\nseconds = 2", "", 1);
    let error = parse(&format!("target = []\n{text}")).expect_err("no leg");
    assert!(error.contains("at least one leg"), "{error}");
}
