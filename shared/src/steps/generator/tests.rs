use std::vec;
use std::vec::Vec;

use proptest::prelude::*;

use super::*;
use crate::steps::SegmentFault;

const MAP: PortMap = PortMap {
    step: [0, 7, 15],
    dir: [1, 8, 3],
    invert: [false, true, false],
};

fn generator() -> Generator {
    Generator::new(MAP).unwrap()
}

/// Content of the ring where nothing was written: it lowers STEP.
const IDLE: u32 = (1 << 0 | 1 << 7 | 1 << 15) << 16;

/// DIR pins.
const DIRS: u32 = 1 << 1 | 1 << 8 | 1 << 3;

/// Returns the pins after a word: a set bit wins over a reset bit.
fn after(pins: u32, word: u32) -> u32 {
    pins & !(word >> 16) | word & 0xffff
}

fn all_words(generator: &mut Generator) -> Vec<u32> {
    let mut words = vec![0xdead_beef; 2 * usize::from(generator.slots_left())];
    assert_eq!(generator.fill(&mut words), words.len());
    words
}

/// Literal model of the module documentation: exact positions in an i128, one floor per slot.
struct Model {
    position: [i128; AXES],
    backward: [Option<bool>; AXES],
}

impl Model {
    fn new() -> Self {
        Self {
            position: [1 << 31; AXES],
            backward: [None; AXES],
        }
    }

    fn words(&mut self, segment: &Segment) -> Vec<u32> {
        let slots = usize::from(segment.slots());
        let mut words = vec![0; 2 * slots];
        for (axis, motion) in segment.axes().iter().enumerate() {
            if motion.first == 0 && motion.change == 0 {
                continue;
            }
            let turns = self.backward[axis] != Some(motion.backward);
            self.backward[axis] = Some(motion.backward);
            if turns {
                let high = motion.backward == MAP.invert[axis];
                words[0] |= 1 << (MAP.dir[axis] + if high { 0 } else { 16 });
            }
            for k in 0..slots {
                let before = self.position[axis] >> 32;
                let increment = i128::from(motion.first) + i128::from(motion.change) * k as i128;
                self.position[axis] += if motion.backward {
                    -increment
                } else {
                    increment
                };
                if self.position[axis] >> 32 != before {
                    // The slot that writes DIR passes its step on.
                    let slot = if turns { k.max(1) } else { k };
                    words[2 * slot] |= 1 << MAP.step[axis];
                    words[2 * slot + 1] |= 1 << (MAP.step[axis] + 16);
                }
            }
        }
        words
    }
}

/// Generates valid segments with increments up to `fastest`; some start slowly enough to reverse.
fn segments(fastest: u32) -> impl Strategy<Value = Vec<Segment>> {
    let ends = prop_oneof![
        (0..1u32 << 24, 0..=fastest),
        (0..=fastest, 0..=fastest),
        Just((0, 0)),
        Just((fastest, fastest)),
    ];
    let axis = (ends, any::<bool>());
    let segment = (2..40u16, prop::array::uniform3(axis)).prop_map(|(slots, axes)| {
        let motions = axes.map(|((first, last), backward)| {
            let change = (i64::from(last) - i64::from(first)) / i64::from(slots - 1);
            let change = change.clamp(i64::from(i32::MIN), i64::from(i32::MAX)) as i32;
            AxisMotion {
                first,
                change,
                backward,
            }
        });
        Segment::new(slots, motions).unwrap()
    });
    prop::collection::vec(segment, 1..60)
}

proptest! {
    #[test]
    fn words_follow_the_floor_law(segments in segments(u32::MAX), room in 0..50usize) {
        let mut generator = generator();
        let mut model = Model::new();
        for segment in &segments {
            match generator.load(segment) {
                Ok(()) => {
                    let mut words = Vec::new();
                    // Pieces of any size; an odd word at the end stays unused.
                    let mut piece = vec![0xdead_beef; room + 2];
                    while !generator.is_idle() {
                        let made = generator.fill(&mut piece);
                        prop_assert!(made > 0 && made.is_multiple_of(2));
                        words.extend_from_slice(&piece[..made]);
                    }
                    prop_assert_eq!(words, model.words(segment));
                }
                Err(fault) => {
                    let LoadFault::Turn { axis } = fault else { panic!("{fault}") };
                    prop_assert!(segment.axes()[axis].distance(2) > i64::from(u32::MAX));
                }
            }
            for axis in 0..AXES {
                let fine = generator.positions()[axis].fine();
                prop_assert_eq!(i128::from(fine), model.position[axis]);
                prop_assert_eq!(generator.emitted()[axis], fine >> 32);
            }
        }
    }

    #[test]
    fn ring_has_the_edges_of_fill(
        segments in prop_oneof![segments(u32::MAX), segments(1 << 29), segments(1 << 26)],
        silent in prop::collection::vec(prop::bool::weighted(0.1), 60),
    ) {
        let (mut filling, mut playing) = (generator(), generator());
        let (mut filled, mut played, mut unseen) = (0, 0, 0);
        for (segment, silent) in segments.iter().zip(silent) {
            prop_assert_eq!(playing.load(segment), filling.load(segment));
            let idle = (0..2 * segment.slots()).map(|_| AtomicU32::new(IDLE));
            let ring: Vec<AtomicU32> = idle.collect();
            let words = all_words(&mut filling);
            if silent {
                playing.skip();
                // `fill` shows what `play` does not: both must write DIR again.
                filled = words.iter().fold(filled, |pins, word| after(pins, *word));
                filling.forget_directions();
                playing.forget_directions();
                unseen = DIRS;
            } else {
                playing.play(&ring);
                for (word, place) in words.iter().zip(&ring) {
                    filled = after(filled, *word);
                    played = after(played, place.load(Relaxed));
                    // Until both wrote DIR, only one has it right.
                    unseen &= !(word | word >> 16);
                    prop_assert_eq!(filled & !unseen, played & !unseen);
                }
            }
            prop_assert_eq!(playing.positions(), filling.positions());
            prop_assert_eq!(playing.emitted(), filling.emitted());
            prop_assert!(playing.is_idle());
        }
    }

    // Below half a step per slot every segment may reverse.
    #[test]
    fn there_and_back_retraces_steps(segments in segments(i32::MAX as u32)) {
        let mut generator = generator();
        let start = generator.positions();
        for segment in &segments {
            generator.load(segment).unwrap();
            all_words(&mut generator);
        }
        for segment in segments.iter().rev() {
            let slots = segment.slots();
            // The same increments, last to first.
            let back = segment.axes().map(|motion| AxisMotion {
                first: (i64::from(motion.first)
                    + i64::from(motion.change) * i64::from(slots - 1)) as u32,
                change: -motion.change,
                backward: !motion.backward,
            });
            generator.load(&Segment::new(slots, back).unwrap()).unwrap();
            all_words(&mut generator);
        }
        prop_assert_eq!(generator.positions(), start);
        prop_assert_eq!(generator.emitted(), [0; AXES]);
    }

    #[test]
    fn nothing_panics(
        raw in prop::collection::vec(
            (
                any::<u16>(),
                prop::array::uniform3((any::<u32>(), any::<i32>(), any::<bool>())),
                0..300usize,
                any::<bool>(),
            ),
            1..20,
        ),
        pins: [u8; 6],
    ) {
        let map = PortMap {
            step: [pins[0], pins[1], pins[2]],
            dir: [pins[3], pins[4], pins[5]],
            invert: [true; 3],
        };
        let mut generator = Generator::new(map).unwrap_or(generator());
        for (slots, axes, room, halt) in raw {
            let motions = axes.map(|(first, change, backward)| AxisMotion {
                first,
                change,
                backward,
            });
            if let Ok(segment) = Segment::new(slots, motions) {
                let before = generator.positions();
                if generator.load(&segment).is_err() {
                    prop_assert_eq!(generator.positions(), before);
                }
            }
            let mut words = vec![7; room];
            let made = generator.fill(&mut words);
            prop_assert!(made <= room && words[made..].iter().all(|&word| word == 7));
            if halt {
                generator.halt();
                prop_assert_eq!(generator.fill(&mut words), 0);
            }
        }
    }
}

/// Full speed needs every slot: one step lost in 2³² slots is the price of a 32-bit increment.
#[test]
fn full_speed_steps_in_every_slot() {
    let mut generator = generator();
    let start = AxisMotion {
        first: 1 << 20,
        change: 1 << 24,
        backward: false,
    };
    let full = AxisMotion {
        first: u32::MAX,
        change: 0,
        backward: false,
    };
    generator
        .load(&Segment::new(100, [start; 3]).unwrap())
        .unwrap();
    all_words(&mut generator);
    let before = generator.emitted();
    generator
        .load(&Segment::new(10_000, [full; 3]).unwrap())
        .unwrap();
    let words = all_words(&mut generator);
    let raise = 1 << 0 | 1 << 7 | 1 << 15;
    assert!(words.chunks(2).all(|pair| pair == [raise, raise << 16]));
    assert_eq!(generator.emitted(), before.map(|steps| steps + 10_000));
}

#[test]
fn too_fast_reversals_are_refused() {
    let slow = |first, change, backward| AxisMotion {
        first,
        change,
        backward,
    };
    let only_y = |motion| [AxisMotion::REST, motion, AxisMotion::REST];
    let mut generator = generator();
    // Both first increments together make 2³² - 1, which is just allowed; one more is not.
    let allowed = Segment::new(2, only_y(slow(1 << 31, -1, true))).unwrap();
    let refused = Segment::new(2, only_y(slow(1 << 31, 0, true))).unwrap();
    assert_eq!(generator.load(&refused), Err(LoadFault::Turn { axis: 1 }));
    assert_eq!(generator.load(&allowed), Ok(()));
    assert_eq!(generator.load(&allowed), Err(LoadFault::Busy));
    // Y is inverted: DIR high is backwards. The step waits for the second slot.
    assert_eq!(all_words(&mut generator), [1 << 8, 0, 1 << 7, 1 << 23]);
    // The direction is on the pin now, so the same segment no longer reverses the axis.
    assert_eq!(generator.load(&refused), Ok(()));
    all_words(&mut generator);
    let short = Segment::new(1, only_y(slow(1, 0, false))).unwrap();
    assert_eq!(generator.load(&short), Err(LoadFault::Turn { axis: 1 }));
}

#[test]
fn halt_keeps_the_position() {
    let mut generator = generator();
    let fast = AxisMotion {
        first: 1 << 30,
        change: 0,
        backward: false,
    };
    generator
        .load(&Segment::new(100, [fast; 3]).unwrap())
        .unwrap();
    let mut words = [0; 2 * 11];
    generator.fill(&mut words);
    generator.halt();
    let rises = words.iter().filter(|&&word| word & 1 != 0).count();
    assert_eq!(generator.emitted(), [rises as i64; 3]);
    // Eleven increments of a quarter step; the second slot compensates for the first.
    assert_eq!(
        generator.positions(),
        [Position::from_fine((1 << 31) + 11 * (1 << 30)); 3]
    );
    assert!(generator.is_idle());
}

#[test]
fn pins_are_checked() {
    let with = |step, dir| {
        Generator::new(PortMap {
            step,
            dir,
            invert: [false; 3],
        })
        .map(|_| ())
    };
    assert_eq!(with([0, 1, 16], [3, 4, 5]), Err(PortFault::NoSuchPin(16)));
    assert_eq!(with([0, 1, 2], [3, 4, 1]), Err(PortFault::PinTwice(1)));
    assert_eq!(
        Segment::new(0, [AxisMotion::REST; 3]),
        Err(SegmentFault::NoSlots)
    );
}
