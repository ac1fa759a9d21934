//! A signal while files are written leaves all of them old or all of them new, and no other file.

use std::fs;
use std::process::Stdio;
use std::time::Instant;

use super::{Desk, run, trinocular};
use trinocular_tests::binary::signal;

const ARGUMENTS: [&str; 7] = [
    "--out",
    "rig/out.toml",
    "--opencv",
    "cv",
    "--ros",
    "ros",
    "--force",
];

/// Focal lengths that distinguish two rigs.
const FOCAL: [&str; 2] = ["533.16", "544.44"];

#[test]
fn signal_in_writing_mixes_no_files() {
    let desk = Desk::new();
    let folder = desk.folder.path();
    fs::create_dir(desk.path("rig")).expect("ours");
    desk.write("0.toml", desk.read("rig.toml"));
    desk.write("1.toml", desk.read("rig.toml").replace(FOCAL[0], FOCAL[1]));
    let convert = |rig: &'static str| [&["convert", rig], &ARGUMENTS[..]].concat();
    let start = Instant::now();
    assert_eq!(run(folder, &convert("0.toml")).code, Some(0));
    let whole = start.elapsed();
    let (mut ended, mut done) = (0, 0);
    for attempt in 0..60_u32 {
        let rig = ["1.toml", "0.toml"][attempt as usize % 2];
        let mut program = trinocular()
            .args(convert(rig))
            .current_dir(folder)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("it runs");
        // Send the signal at any moment of a run, and a little later.
        std::thread::sleep(whole * (attempt % 50) / 40);
        signal(&program, ["TERM", "INT", "QUIT"][attempt as usize % 3]);
        match program.wait().expect("it ends").success() {
            true => done += 1,
            false => ended += 1,
        }
        let mut news = Vec::new();
        for place in ["rig", "cv", "ros"] {
            for entry in fs::read_dir(desk.path(place)).expect("ours") {
                let path = entry.expect("ours").path();
                let text = fs::read_to_string(&path).expect("it is whole");
                let name = path.file_name().unwrap_or_default().to_string_lossy();
                assert!(!name.contains(".tmp"), "{name} is left over");
                if ["out.toml", "left.yml", "left.yaml"].contains(&&*name) {
                    news.push(text.contains(FOCAL[1]));
                }
            }
        }
        assert_eq!(news.len(), 3);
        assert!(
            news.iter().all(|new| *new == news[0]),
            "{attempt}: {news:?}"
        );
    }
    println!("{ended} runs were ended by the signal, {done} were done before");
}
