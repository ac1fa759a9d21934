//! The `[laser]` section: the ray of a laser that shall stay on one point of the target.

use std::fmt::Write as _;

use super::field::Field;
use crate::error::InputError;

/// Largest coordinate of a point of the ray, mm.
const LIMIT_MM: f64 = 1e5;

/// Ray of a laser, in the axes and from the origin of the rig file.
///
/// ```
/// use std::path::Path;
/// use trinocular_rig::rig_file::RigFile;
///
/// let text = RigFile::paper().to_toml()
///     + "[laser]\nfrom_mm = [0.0, 40.0, 0.0]\ndirection = [0.0, -0.05, 1.0]\n";
/// let laser = RigFile::parse(Path::new("rig.toml"), &text)?.laser.expect("a laser");
/// assert_eq!((laser.from_mm, laser.direction), ([0.0, 40.0, 0.0], [0.0, -0.05, 1.0]));
/// # Ok::<(), trinocular_rig::error::InputError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Laser {
    /// Point of the ray, mm.
    pub from_mm: [f64; 3],
    /// Direction of the ray, of any length; z is above 0, away from the cameras.
    pub direction: [f64; 3],
}

impl Laser {
    pub(super) fn read(section: &Field<'_>) -> Result<Self, InputError> {
        section.only(&["from_mm", "direction"])?;
        section.require(&[
            ("from_mm", "from_mm = [0.0, 40.0, 0.0]"),
            ("direction", "direction = [0.0, -0.05, 1.0]"),
        ])?;
        let from_mm = section
            .required("from_mm")?
            .each(|axis| axis.number(LIMIT_MM))?;
        let field = section.required("direction")?;
        let direction: [f64; 3] = field.each(|axis| axis.number(LIMIT_MM))?;
        if direction == [0.0; 3] {
            return Err(field.fault("has no length; along the cameras' axes it is [0, 0, 1]"));
        }
        if direction[2] <= 0.0 {
            let [.., z] = field.fields::<3>()?;
            return Err(z.fault(format!(
                "{} must be greater than 0: the ray goes away from the cameras",
                direction[2]
            )));
        }
        Ok(Self { from_mm, direction })
    }

    pub(super) fn write_toml(&self, text: &mut String) {
        let Self { from_mm, direction } = self;
        let _ = write!(
            text,
            "\n[laser]\nfrom_mm = {from_mm:?}\ndirection = {direction:?}\n"
        );
    }
}

#[cfg(test)]
mod tests {
    use crate::error::InputError;
    use crate::rig_file::RigFile;
    use std::path::Path;

    fn parse(section: &str) -> Result<RigFile, InputError> {
        RigFile::parse(
            Path::new("rig.toml"),
            &(RigFile::paper().to_toml() + section),
        )
    }

    #[test]
    fn laser_survives_writing() {
        let rig = parse("[laser]\nfrom_mm = [0, 40.5, -3]\ndirection = [1e-3, -0.05, 2]\n");
        let rig = rig.expect("a laser");
        let again = RigFile::parse(Path::new("rig.toml"), &rig.to_toml()).expect("a rig");
        assert!(again.laser.is_some());
        assert_eq!(again, rig);
    }

    #[test]
    fn impossible_lasers_are_named() {
        for (from_mm, direction, field, reason) in [
            ("[0, 0]", "[0, 0, 1]", "laser.from_mm", "3 elements"),
            ("[0, nan, 0]", "[0, 0, 1]", "laser.from_mm[1]", "finite"),
            (
                "[0, 0, 1e6]",
                "[0, 0, 1]",
                "laser.from_mm[2]",
                "out of range",
            ),
            ("[0, 0, 0]", "[0, 0, 0]", "laser.direction", "no length"),
            (
                "[0, 0, 0]",
                "[1, 0, 0]",
                "laser.direction[2]",
                "greater than 0",
            ),
            (
                "[0, 0, 0]",
                "[0, 0, -1]",
                "laser.direction[2]",
                "greater than 0",
            ),
            ("[0, 0, 0]", "[0, 0, inf]", "laser.direction[2]", "finite"),
        ] {
            let section = format!("[laser]\nfrom_mm = {from_mm}\ndirection = {direction}\n");
            let error = parse(&section).expect_err(&section);
            assert_eq!(error.field.as_deref(), Some(field), "{error}");
            assert!(
                error.reason.contains(reason) && error.line.is_some(),
                "{error}"
            );
        }
        let error = parse("[laser]\nfrom_mm = [0, 0, 0]\n").expect_err("no direction");
        assert_eq!(error.field.as_deref(), Some("laser.direction"));
        let error = parse("[laser]\nfrom = [0, 0, 0]\n").expect_err("an unknown field");
        assert_eq!(error.field.as_deref(), Some("laser.from"));
    }
}
