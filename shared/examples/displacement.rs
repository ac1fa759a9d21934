//! Displacement of a target from your own matched points, without images and without a station.
//!
//! ```sh
//! cargo run -p trinocular-core --example displacement
//! ```

use trinocular_core::estimate::{Refusal, closed_form, midpoint};
use trinocular_core::rig::{Camera, Rig};
use trinocular_core::sums::View;
use trinocular_core::sums::centred::CentredSums;
use trinocular_core::sums::pair::PairSums;

/// Pixels of each point at the keyframe and now, in the left, middle and right camera. These were
/// made from a target that moved by (2, -1, 5) mm, and rounded to a tenth of a pixel.
#[rustfmt::skip]
const MATCHES_PX: [[[[f64; 2]; 2]; 3]; 8] = [
    [
        [[190.1, 83.9], [191.1, 83.5]],
        [[148.0, 83.9], [149.2, 83.5]],
        [[107.0, 83.9], [108.5, 83.5]],
    ],
    [
        [[247.8, 96.6], [248.5, 96.1]],
        [[206.9, 96.6], [207.8, 96.1]],
        [[167.0, 96.6], [168.2, 96.1]],
    ],
    [
        [[197.4, 144.9], [198.4, 144.2]],
        [[153.8, 144.9], [155.0, 144.2]],
        [[111.4, 144.9], [112.9, 144.2]],
    ],
    [
        [[148.4, 169.5], [149.6, 168.7]],
        [[107.6, 169.5], [109.0, 168.7]],
        [[68.0, 169.5], [69.6, 168.7]],
    ],
    [
        [[256.9, 174.1], [257.5, 173.3]],
        [[217.0, 174.1], [217.8, 173.3]],
        [[178.2, 174.1], [179.3, 173.3]],
    ],
    [
        [[187.4, 112.7], [188.5, 112.1]],
        [[144.8, 112.7], [146.1, 112.1]],
        [[103.3, 112.7], [104.9, 112.1]],
    ],
    [
        [[220.7, 153.1], [221.5, 152.4]],
        [[182.1, 153.1], [183.1, 152.4]],
        [[144.5, 153.1], [145.7, 152.4]],
    ],
    [
        [[279.1, 126.0], [279.6, 125.3]],
        [[237.4, 126.0], [238.2, 125.3]],
        [[196.9, 126.0], [197.9, 125.3]],
    ],
];

fn main() -> Result<(), Refusal> {
    let camera = |x_mm: f64| Camera::ideal([530.0, 530.0], [160.0, 120.0], [x_mm, 0.0]);
    let rig = Rig {
        image_size_px: [320, 240],
        cameras: [-70.0, 0.0, 68.0].map(camera).into_iter().collect(),
    };

    let mut centred = CentredSums::new(&rig)?;
    let mut pairs = PairSums::new(&rig)?;
    for point in MATCHES_PX {
        let views: [View; 3] = std::array::from_fn(|k| {
            let [start, end] = point[k];
            View::from_pixels(&rig.cameras[k], start, end)
        });
        centred.add(&views);
        pairs.add(views);
    }

    let estimate = midpoint::solve(&centred)?;
    let [x, y, z] = estimate.displacement_mm;
    let sigma = estimate.sigma_mm();
    println!("midpoint     {x:7.3} {y:7.3} {z:7.3} mm");
    println!(
        "sigma        {:7.3} {:7.3} {:7.3} mm",
        sigma[0], sigma[1], sigma[2]
    );
    let [x, y, z] = closed_form::solve(&pairs)?;
    println!("closed form  {x:7.3} {y:7.3} {z:7.3} mm");

    for (axis, want) in [2.0, -1.0, 5.0].into_iter().enumerate() {
        let off = estimate.displacement_mm[axis] - want;
        assert!(
            off.abs() < 4.0 * sigma[axis],
            "axis {axis} is off by {off} mm"
        );
    }
    Ok(())
}

#[test]
fn example_runs() {
    main().unwrap();
}
