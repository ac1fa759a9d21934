//! Fixed-point arithmetic on integers.
//!
//! Every function is total: it neither panics nor wraps, for any input, and results that do not fit
//! saturate. The one exception is [`product`], which trusts its caller.
//!
//! Other modules shift only where the bits themselves are meant (a step in a
//! [`Position`](crate::steps::Position), a pin in a port word) or where a comment beside the shift
//! gives the resulting format.

/// Converts `value` to fixed point: `value 2^bits`, rounded to the nearest `i32`.
///
/// Returns `None` if `value` is not finite or the result does not fit. The host calls this before
/// it sends; the station never does.
pub fn quantise(value: f64, bits: i32) -> Option<i32> {
    let scaled = libm::round(libm::ldexp(value, bits));
    let fits = scaled >= f64::from(i32::MIN) && scaled <= f64::from(i32::MAX);
    fits.then_some(scaled as i32)
}

/// Converts `value` to 32 bits, saturating.
pub fn narrow(value: i64) -> i32 {
    i32::try_from(value).unwrap_or(if value < 0 { i32::MIN } else { i32::MAX })
}

/// Computes `value / 2^bits`, rounded to nearest, halves up. Returns 0 for `bits` above 63.
pub fn shift_right_rounded(value: i64, bits: u32) -> i64 {
    match bits {
        0 => value,
        1..=63 => {
            // (value + half) >> bits without the overflow: floor plus the bit below it.
            let halves = value >> (bits - 1);
            (halves >> 1) + (halves & 1)
        }
        _ => 0,
    }
}

/// Computes `a b / 2^bits`, rounded to nearest. `bits` must be 1 to 62 for a useful result.
pub fn multiply_shift(a: i32, b: i32, bits: u32) -> i64 {
    shift_right_rounded(i64::from(a) * i64::from(b), bits)
}

/// Computes `a b` exactly: two 63-bit magnitudes make at most 126 bits.
///
/// Never inlined, because a checked 128-bit product takes about 300 bytes at every call site.
#[inline(never)]
pub fn wide(a: i64, b: i64) -> i128 {
    i128::from(a).wrapping_mul(i128::from(b))
}

/// Computes `a b`, saturating. Fast for factors of 32 bits.
///
/// Never inlined, because a checked 64-bit product takes about 80 bytes at every call site.
#[inline(never)]
pub fn times(a: i64, b: i64) -> i64 {
    if let (Ok(a), Ok(b)) = (i32::try_from(a), i32::try_from(b)) {
        return i64::from(a).wrapping_mul(i64::from(b)); // 63 bits
    }
    let product = wide(a, b);
    i64::try_from(product).unwrap_or(if product < 0 { i64::MIN } else { i64::MAX })
}

/// Computes `a b` for factors whose product is known to fit; only debug builds check it.
///
/// Takes three instructions on a Cortex-M4, where a check takes twenty.
#[inline(always)]
pub const fn product(a: i64, b: i64) -> i64 {
    debug_assert!(a.checked_mul(b).is_some());
    a.wrapping_mul(b)
}

/// Computes `a / divisor`, rounded down. A divisor below 1 counts as 1.
///
/// Numbers of 32 bits use the processor's own division, which is an order of magnitude faster than
/// one of 64 bits.
#[inline(never)]
pub fn quotient(a: i64, divisor: i64) -> i64 {
    let divisor = divisor.max(1);
    let floor = |quotient: i64, rest: bool| quotient.wrapping_sub(i64::from(rest));
    match (i32::try_from(a), i32::try_from(divisor)) {
        (Ok(a), Ok(divisor)) => {
            let quotient = a.wrapping_div(divisor);
            let rest = quotient.wrapping_mul(divisor) > a;
            floor(quotient.into(), rest)
        }
        _ => {
            let quotient = a.wrapping_div(divisor);
            floor(quotient, quotient.wrapping_mul(divisor) > a)
        }
    }
}

/// Computes the square root, rounded down. Returns 0 for negative numbers.
pub fn root(a: i64) -> i64 {
    square_root(u64::try_from(a).unwrap_or(0)).into()
}

/// Computes the integer square root, rounded down, exact for every input.
///
/// Values of 32 bits use [`square_root_32`]. Longer values use Zimmermann's Karatsuba square root
/// (INRIA report 3805, 1999): the root of the upper half, then as many bits again by one division.
#[inline(never)]
pub fn square_root(value: u64) -> u32 {
    if let Ok(small) = u32::try_from(value) {
        return square_root_32(small);
    }
    // Normalise to 63 or 64 bits, by an even shift so that the root shifts by half of it.
    let shift = value.leading_zeros() & !1;
    let normal = value << shift;
    let (high, low) = ((normal >> 32) as u32, normal as u32);
    let root = square_root_32(high); // 2^15 to 2^16
    let rest = high.wrapping_sub(root.wrapping_mul(root)); // at most 2 root
    // (rest 2^16 + the next 16 bits) / (2 root), halved to stay within 32 bits. The bit shifted out
    // goes to the new rest.
    let half = rest << 15 | low >> 17;
    let digits = half.checked_div(root).unwrap_or(0);
    let left = half.wrapping_sub(digits.wrapping_mul(root));
    let last = i64::from(left) << 17 | i64::from(low & 0x1_ffff);
    // The division by twice the root ignored the square of the digits: the result is never too
    // small, and at most one too large.
    let digits = i64::from(digits);
    let root = (i64::from(root) << 16) + digits - i64::from(last < product(digits, digits));
    (root >> (shift / 2)) as u32
}

/// Upper bounds of `sqrt(k 2^27) / 2^8` for `k` from 9 to 32.
const ROOTS: [u16; 24] = [
    136, 144, 151, 157, 164, 170, 176, 182, 187, 192, 198, 203, 208, 213, 218, 222, 227, 231, 236,
    240, 244, 248, 252, 256,
];

/// Computes the integer square root of 32 bits, rounded down, exact for every input.
///
/// Newton's method from above: the first guess is at most 6 % too large, so two steps leave the
/// root exact or one too large.
#[inline(never)]
pub fn square_root_32(value: u32) -> u32 {
    if value == 0 {
        return 0;
    }
    // Normalise to 31 or 32 bits, by an even shift so that the root shifts by half of it.
    let shift = value.leading_zeros() & !1;
    let normal = value << shift;
    let bound = ROOTS
        .get(((normal >> 27) as usize).wrapping_sub(8))
        .copied();
    let step = |root: u32| root.wrapping_add(normal.checked_div(root).unwrap_or(0)) >> 1;
    let root = step(step(u32::from(bound.unwrap_or(256)) << 8));
    let root = root.wrapping_sub(u32::from(normal.checked_div(root).unwrap_or(0) < root));
    root >> (shift / 2)
}

/// Computes `a 2^32 / divisor`, rounded down, saturating; a divisor of 0 saturates, too. `divisor`
/// must be below 2^63.
///
/// Works bit by bit, for values that are computed once: a 128-bit division would cost more memory
/// than it saves time.
#[inline(never)]
pub fn ratio(a: u64, divisor: u64) -> u64 {
    let (Some(whole), Some(mut rest)) = (a.checked_div(divisor), a.checked_rem(divisor)) else {
        return u64::MAX;
    };
    if whole >> 32 != 0 {
        return u64::MAX;
    }
    let mut quotient = whole;
    for _ in 0..32 {
        rest <<= 1;
        quotient <<= 1;
        if rest >= divisor {
            rest -= divisor;
            quotient |= 1;
        }
    }
    quotient
}

/// Reciprocal of a positive number, as a 32-bit mantissa and an exponent.
///
/// For `d` normalised to a mantissa `m` in `[2^31, 2^32)`, `mantissa` is `2^63 / m` and `1/d =
/// mantissa 2^(zeros - 95)`. The relative error is at most 2^-29.6, of which 2^-31 comes from
/// dropping the low bits of `d` (test `reciprocal_error_bound`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reciprocal {
    mantissa: u32,
    zeros: u32,
}

impl Reciprocal {
    /// Computes the reciprocal of `divisor`, or returns `None` if `divisor` is not positive.
    #[inline(always)]
    pub fn of(divisor: i64) -> Option<Self> {
        let divisor = u64::try_from(divisor).ok().filter(|d| *d > 0)?;
        let zeros = divisor.leading_zeros();
        let mantissa = ((divisor << zeros) >> 32) as u32;
        Some(Self {
            mantissa: invert_mantissa(mantissa),
            zeros,
        })
    }

    /// Computes `numerator / divisor 2^bits`, rounded towards minus infinity within the
    /// reciprocal's error, saturating.
    #[inline(always)]
    pub fn times(self, numerator: i64, bits: i32) -> i64 {
        // The upper half fits an i32, so that one product of the processor suffices.
        let high = i64::from((numerator >> 32) as i32) * i64::from(self.mantissa);
        let low = u64::from(numerator as u32) * u64::from(self.mantissa);
        let product = high.saturating_add((low >> 32) as i64); // numerator mantissa 2^-32
        // numerator / divisor = product 2^(zeros - 63)
        match (self.zeros as i32).saturating_sub(63).saturating_add(bits) {
            right @ ..=0 => shift_right_rounded(product, right.unsigned_abs()),
            left => {
                let limit = i64::MAX >> left.min(62);
                if left > 62 || product > limit || product < -limit {
                    if product < 0 { i64::MIN } else { i64::MAX }
                } else {
                    product << left
                }
            }
        }
    }
}

/// Computes `2^63 / m` for a mantissa `m` in `[2^31, 2^32)`, with a relative error of at most
/// 2^-29.6. The result lies in `[2^31, 2^32)`.
///
/// A 16-bit quotient from the hardware divider is refined by one Newton step `r (2 - m r)` in 32 x
/// 32 -> 64 bit products. This costs about 20 instructions on a Cortex-M4; a 64 by 32 bit division
/// costs about 270. The quotient's relative error is below 2^-14.9; the step squares it to 2^-29.8
/// and errs below the true value. A mantissa outside the range, which [`Reciprocal::of`] never
/// makes, is clamped to it.
pub fn invert_mantissa(mantissa: u32) -> u32 {
    let mantissa = mantissa.max(1 << 31);
    let guess = u32::MAX / (mantissa >> 16); // 2^48 / m, at most 17 bits
    // m guess / 2^16 is 2^32 (1 - e), and guess (1 + e) is the refined quotient.
    let product = (u64::from(mantissa) * u64::from(guess)) >> 16;
    // Below 2^18 in size.
    let error = (product as u32).wrapping_neg().cast_signed();
    let refined =
        (i64::from(guess) << 15) + ((i64::from(guess.cast_signed()) * i64::from(error)) >> 17);
    refined.clamp(1 << 31, i64::from(u32::MAX)) as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn reciprocal_error_bound() {
        let mut worst = 0.0f64;
        for step in 0..2_000_000u64 {
            let mantissa = ((1u64 << 31) + step * 1073 + step % 7).min(u64::from(u32::MAX)) as u32;
            let exact = (1u128 << 63) as f64 / f64::from(mantissa);
            let error = (f64::from(invert_mantissa(mantissa)) - exact).abs() / exact;
            worst = worst.max(error);
        }
        std::println!("worst relative error 2^{:.2}", worst.log2());
        assert!(worst < (-29.6f64).exp2());
    }

    proptest! {
        #[test]
        fn quotient_matches_wide_division(n in any::<i64>(), d in 1i64.., bits in -40i32..40) {
            let got = Reciprocal::of(d).unwrap().times(n, bits);
            let exact = n as f64 / d as f64 * f64::from(bits).exp2();
            if exact.abs() < 9e18 {
                // One unit of the last place, plus the truncated low word, plus the relative bound.
                let low_word = f64::from(bits + d.leading_zeros() as i32 - 63).exp2();
                let bound = 1.0 + low_word + exact.abs() * (-29.5f64).exp2();
                prop_assert!((got as f64 - exact).abs() <= bound, "{got} {exact}");
            } else {
                prop_assert!(got.abs_diff(0) > 1 << 62);
            }
        }

        #[test]
        fn wide_products_are_exact(a: i64, b: i64) {
            prop_assert_eq!(Some(wide(a, b)), i128::from(a).checked_mul(i128::from(b)));
        }

        #[test]
        fn times_saturates(a: i64, b: i64, small: i32) {
            prop_assert_eq!(times(a, b), a.saturating_mul(b));
            prop_assert_eq!(times(a, small.into()), a.saturating_mul(small.into()));
        }

        #[test]
        fn ratio_matches_wide_division(a: u64, bits in 0u32..63, low: u64) {
            let divisor = (1 << bits) | (low & ((1 << bits) - 1));
            let exact = (u128::from(a) << 32) / u128::from(divisor);
            prop_assert_eq!(ratio(a, divisor), u64::try_from(exact).unwrap_or(u64::MAX));
        }

        #[test]
        fn integer_arithmetic_is_exact(
            a: i64, b: i64, shifts in (0u32..64, 0u32..64),
        ) {
            let (a, b) = (a >> shifts.0, b >> shifts.1);
            let exact = i128::from(a) * i128::from(b);
            prop_assert_eq!(i128::from(times(a, b)), exact.clamp(i64::MIN.into(), i64::MAX.into()));
            prop_assert_eq!(quotient(a, b), a.div_euclid(b.max(1)));
            prop_assert_eq!(root(a), if a < 0 { 0 } else { a.isqrt() });
            prop_assert_eq!(u64::from(square_root(a.cast_unsigned())), a.cast_unsigned().isqrt());
        }

        #[test]
        fn roots_are_exact_beside_squares(root: u32, beside in -1i64..=1) {
            let square = (u64::from(root) * u64::from(root)).wrapping_add_signed(beside);
            prop_assert_eq!(u64::from(square_root(square)), square.isqrt());
            let root = root & 0xffff;
            let square = (root * root).wrapping_add_signed(beside as i32);
            prop_assert_eq!(square_root_32(square), square.isqrt());
        }

        #[test]
        fn shift_rounds_to_nearest(v in any::<i64>(), bits in 0u32..70) {
            let exact = (i128::from(v) + if bits == 0 { 0 } else { 1i128 << (bits - 1) }) >> bits;
            prop_assert_eq!(i128::from(shift_right_rounded(v, bits)), exact);
        }

        #[test]
        fn divisors_up_to_zero_are_refused(d in i64::MIN..=0) {
            prop_assert_eq!(Reciprocal::of(d), None);
        }
    }

    #[test]
    fn quantise_refuses_misfits() {
        assert_eq!(quantise(1.0, 30), Some(1 << 30));
        assert_eq!(quantise(2.0, 30), None);
        assert_eq!(quantise(-2.0, 30), Some(i32::MIN));
        assert_eq!(quantise(f64::NAN, 0), None);
        assert_eq!(quantise(f64::INFINITY, 0), None);
    }
}
