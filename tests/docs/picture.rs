//! The animation of the README, drawn from a run of the program: the images of a camera at rest and
//! of a camera on the stage, side by side.
//!
//! To draw it anew: `RENEW=1 cargo test -p trinocular-tests --test docs picture`.

use super::data::renew;
use super::page::root;
use super::table::numbers;
use std::fmt::Write as _;
use std::fs;
use trinocular_rig::random::Random;
use trinocular_tests::binary::{Outcome, trinocular};

const FILE: &str = "docs/following.svg";
/// Every eighth frame is drawn: the figure is smooth.
const EVERY: usize = 8;
const SECONDS: u32 = 16;
/// Units of the picture per mm at the target: a part of 100 mm fills the panel.
const SCALE: f64 = 3.0;
/// Panels: width, height, top.
const PANEL: [f64; 3] = [300.0, 225.0, 46.0];
/// Left edges of the two panels.
const LEFT: [f64; 2] = [12.0, 328.0];
/// Largest difference between a drawn and a committed coordinate, units.
const ROUNDING: f64 = 1.0;

/// Returns the positions per drawn frame, mm: the target's, and the target's less the cameras'.
fn run() -> [Vec<[f64; 2]>; 2] {
    let seconds = SECONDS.to_string();
    let mut command = trinocular();
    command.args([
        "track",
        "--sim",
        "--path",
        "lissajous",
        "--fps",
        "60",
        "--json",
    ]);
    let lines = Outcome::of(command.args(["--seconds", &seconds])).good_json();
    let read = |line: &serde_json::Value, key: &str, axis: usize| {
        line[key][axis].as_f64().expect("a position in every row")
    };
    let seen = |of: &dyn Fn(&serde_json::Value, usize) -> f64| {
        let rows = lines.iter().step_by(EVERY);
        let mut all = vec![[0.0; 2]];
        all.extend(rows.map(|line| [of(line, 0), of(line, 1)]));
        // The first frame, which a printout or still shows, has the target away from its origin.
        let eighth = all.len() / 8;
        all.rotate_left(eighth);
        all
    };
    let moved = |line: &serde_json::Value, axis| read(line, "target_mm", axis);
    let kept = |line: &serde_json::Value, axis| {
        read(line, "target_mm", axis) - read(line, "camera_mm", axis)
    };
    [seen(&moved), seen(&kept)]
}

/// Draws a poster of irregular shapes about the origin, as SVG.
fn poster() -> String {
    let mut random = Random::new(7, 0);
    let mut shapes = String::new();
    let half = [PANEL[0] / 2.0 + 75.0, PANEL[1] / 2.0 + 75.0];
    for number in 0..150 {
        let [x, y] = half.map(|half| random.between(-half, half));
        let size = 10.0 + 34.0 * random.unit().powi(2);
        let corners = 5 + random.below(4);
        let turned = random.between(0.0, std::f64::consts::TAU);
        let mut points = String::new();
        for corner in 0..corners {
            let angle = turned + std::f64::consts::TAU * corner as f64 / corners as f64;
            let radius = size * random.between(0.6, 1.0);
            let (dy, dx) = angle.sin_cos();
            let _ = write!(points, "{:.0},{:.0} ", x + radius * dx, y + radius * dy);
        }
        let _ = writeln!(
            shapes,
            "<polygon class=\"p{}\" points=\"{}\"/>",
            number % 5,
            points.trim()
        );
    }
    shapes
}

fn picture() -> String {
    let shapes = poster();
    let mut svg = String::from(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 640 284\" role=\"img\">\n\
         <title>Left: a target wanders through the image of a camera at rest. Right: it stays in \
         place in the image of the camera on the stage.</title>\n\
         <style>\n\
         text { font: 600 19px sans-serif; fill: #1f2933 }\n\
         .sheet { fill: #ffffff } .frame { fill: none; stroke: #52606d; stroke-width: 2 }\n\
         .p0 { fill: #b9c4cf } .p1 { fill: #7b8794 } .p2 { fill: #e4e7eb }\n\
         .p3 { fill: #4a5560 } .p4 { fill: #9aa5b1 }\n\
         .cross { stroke: #d55e00; stroke-width: 3 }\n\
         .mark { fill: #0072b2; stroke: #ffffff; stroke-width: 3 }\n\
         @media (prefers-color-scheme: dark) {\n\
         text { fill: #e6edf3 } .sheet { fill: #0d1117 } .frame { stroke: #8b949e } }\n\
         </style>\n\
         <rect class=\"sheet\" width=\"640\" height=\"284\"/>\n",
    );
    let [width, height, top] = PANEL;
    let titles = ["Camera at rest", "Camera on the stage"];
    for (index, (seen, left)) in run().iter().zip(LEFT).enumerate() {
        let values: Vec<String> = seen
            .iter()
            .map(|[x, y]| format!("{:.1} {:.1}", x * SCALE, y * SCALE))
            .collect();
        let [x, y] = [left + width / 2.0, top + height / 2.0];
        let _ = write!(
            svg,
            "<text x=\"{x}\" y=\"30\" text-anchor=\"middle\">{}</text>\n\
             <clipPath id=\"c{index}\"><rect x=\"{left}\" y=\"{top}\" width=\"{width}\" \
             height=\"{height}\"/></clipPath>\n\
             <g clip-path=\"url(#c{index})\"><g transform=\"translate({x} {y})\"><g>\n\
             <animateTransform attributeName=\"transform\" type=\"translate\" dur=\"{SECONDS}s\" \
             repeatCount=\"indefinite\" values=\"{}\"/>\n\
             {shapes}<circle class=\"mark\" r=\"11\"/></g></g></g>\n\
             <path class=\"cross\" d=\"M{} {y}h-22m-14 0h-22M{x} {}v-22m0 -14v-22\"/>\n\
             <rect class=\"frame\" x=\"{left}\" y=\"{top}\" width=\"{width}\" \
             height=\"{height}\"/>\n",
            titles[index],
            values.join(";"),
            x + 29.0,
            y + 29.0,
        );
    }
    svg + "</svg>\n"
}

#[test]
fn picture_is_what_a_run_draws() {
    let path = root().join(FILE);
    let drawn = picture();
    if renew() {
        fs::write(&path, &drawn).expect("the picture can be written");
    }
    let committed = fs::read_to_string(&path).expect("the picture is committed");
    let [ours, theirs] = [&drawn, &committed].map(|text| numbers(text));
    assert_eq!(ours.len(), theirs.len());
    let near = ours
        .iter()
        .zip(&theirs)
        .all(|(a, b)| (a - b).abs() <= ROUNDING);
    assert!(near, "{FILE} is not what the program draws");
}
