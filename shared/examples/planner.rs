//! Motion planner and step generator on another board: a move of two axes as port words.
//!
//! A board needs a port with a set/reset register and a timer that writes one word per period, by
//! DMA or in an interrupt. Here a loop takes the place of both and counts the STEP edges.
//!
//! ```sh
//! cargo run -p trinocular-core --example planner
//! ```

use std::error::Error;
use trinocular_core::motion::{AxisConfig, Limits, Planner};
use trinocular_core::steps::{Generator, PortMap, Position, WordRate};

fn main() -> Result<(), Box<dyn Error>> {
    // 80 steps/mm, 100 mm/s, 1 m/s², 50 m/s³, travel ±150 mm.
    let axis = AxisConfig {
        steps_per_m: 80_000,
        max_speed_um_s: 100_000,
        max_acceleration_um_s2: 1_000_000,
        max_jerk_um_s3: 50_000_000,
        travel_um: [-150_000, 150_000],
        invert: false,
    };
    let rate = WordRate::from_hz(200_000)?;
    let map = PortMap {
        step: [0, 1, 2],
        dir: [3, 4, 5],
        invert: [false; 3],
    };
    let mut planner = Planner::new(Limits::new(&[axis; 3], rate)?, [Position::centre(0); 3]);
    let mut generator = Generator::new(map)?;

    // X to 20 mm and Z to -5 mm, on a straight line.
    planner.move_in_step([Some(1600), None, Some(-400)].map(|steps| steps.map(Position::centre)));

    let mut words = vec![0; 2 * usize::from(rate.slots_per_segment())];
    let (mut port, mut rises, mut segments) = (0u32, [0; 3], 0);
    loop {
        let segment = planner.plan_segment();
        if planner.has_arrived() {
            break;
        }
        generator.load(&segment)?;
        let filled = generator.fill(&mut words);
        for word in &words[..filled] {
            // On a board: the timer writes `word` to the port's set/reset register.
            let after = port & !(word >> 16) | word & 0xffff;
            for (axis, rises) in rises.iter_mut().enumerate() {
                *rises += (after & !port) >> map.step[axis] & 1;
            }
            port = after;
        }
        segments += 1;
    }
    println!("{rises:?} STEP edges in {} ms", f64::from(segments) * 0.25);
    println!("positions {:?}", generator.emitted());

    assert_eq!(rises, [1600, 0, 400]);
    assert_eq!(generator.emitted(), [1600, 0, -400]);
    Ok(())
}

#[test]
fn example_runs() {
    main().unwrap();
}
