//! The `[[target]]` tables: targets in the cameras' view that are measured apart.

use std::fmt::Write as _;

use super::field::Field;
use crate::error::InputError;
use crate::printable::is_printable;
use crate::rectangle::is_within;

/// Largest number of targets.
pub const MOST_TARGETS: usize = 32;

/// Target in the cameras' view, which moves by itself.
///
/// ```
/// use std::path::Path;
/// use trinocular_rig::rig_file::RigFile;
///
/// let text = RigFile::paper().to_toml()
///     + "[[target]]\nname = \"deck\"\nroi = [40, 30, 120, 80]\n"
///     + "[[target]]\nname = \"pier\"\nroi = [200, 30, 90, 180]\nreference = true\n";
/// let targets = RigFile::parse(Path::new("rig.toml"), &text)?.targets;
/// assert_eq!((targets[1].name.as_str(), targets[1].is_reference), ("pier", true));
/// assert!(targets[0].drives);
/// # Ok::<(), trinocular_rig::error::InputError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Target {
    /// Name, different from that of every other target.
    pub name: String,
    /// Left, top, width and height of the rectangle in which its points are chosen at the keyframe,
    /// px.
    pub roi_px: [u32; 4],
    /// Index of the camera whose image has the rectangle.
    pub camera: usize,
    /// True for the target that the others are measured against; at most one.
    pub is_reference: bool,
    /// True for the target that the stage follows; exactly one.
    pub drives: bool,
}

/// Reads the tables. `names` are those of the cameras; the rectangle is in the image of
/// `nearest_middle` if its table names no camera.
pub(super) fn read(
    list: &Field<'_>,
    names: &[String],
    nearest_middle: usize,
    image_size_px: [u32; 2],
) -> Result<Vec<Target>, InputError> {
    let tables = list.elements()?;
    if tables.len() > MOST_TARGETS {
        let count = tables.len();
        return Err(list.fault(format!("{count} given, {MOST_TARGETS} are the most")));
    }
    let mut targets: Vec<Target> = Vec::new();
    let mut driving = None;
    for table in &tables {
        table.only(&["name", "roi", "camera", "reference", "drives"])?;
        table.require(&[
            ("name", "name = \"deck\""),
            ("roi", "roi = [40, 30, 120, 80]"),
        ])?;
        let name = table.required("name")?;
        let text = name.text()?.to_owned();
        if text.trim().is_empty() || targets.iter().any(|other| other.name == text) {
            return Err(name.fault("must be a name of its own"));
        }
        if !text.chars().all(is_printable) {
            return Err(name.fault("must have printable characters only"));
        }
        let roi = table.required("roi")?;
        let longest_px = image_size_px[0].max(image_size_px[1]);
        let roi_px: [u32; 4] = roi.each(|number| number.whole(0..=longest_px))?;
        check_roi(&roi, roi_px, image_size_px)?;
        let camera = match table.optional("camera")? {
            Some(field) => {
                let camera = field.text()?;
                let index = names.iter().position(|name| name == camera);
                let unknown = || field.fault(format!("the cameras are {}", names.join(", ")));
                index.ok_or_else(unknown)?
            }
            None => nearest_middle,
        };
        let flag = |key| match table.optional(key)? {
            Some(field) => Ok::<_, InputError>(Some((field.flag()?, field))),
            None => Ok(None),
        };
        let is_reference = match flag("reference")? {
            Some((true, field)) if targets.iter().any(|other| other.is_reference) => {
                return Err(field.fault("another target is the reference already"));
            }
            given => given.is_some_and(|(is_reference, _)| is_reference),
        };
        if let Some((true, field)) = flag("drives")? {
            if driving.is_some() {
                return Err(field.fault("another target drives the stage already"));
            }
            driving = Some(targets.len());
        }
        targets.push(Target {
            name: text,
            roi_px,
            camera,
            is_reference,
            drives: false,
        });
    }
    // The stage follows the first target that is no reference, if no table says otherwise.
    let first = targets.iter().position(|target| !target.is_reference);
    if let Some(target) = targets.get_mut(driving.or(first).unwrap_or(0)) {
        target.drives = true;
    }
    Ok(targets)
}

fn check_roi(field: &Field<'_>, roi_px: [u32; 4], size_px: [u32; 2]) -> Result<(), InputError> {
    let [_, _, width, height] = roi_px;
    if width > 0 && height > 0 && is_within(roi_px, size_px) {
        return Ok(());
    }
    let [columns, rows] = size_px;
    Err(field.fault(format!(
        "must be [x, y, width, height] within the image of {columns} x {rows} px"
    )))
}

pub(super) fn write_toml(targets: &[Target], names: &[String], text: &mut String) {
    for target in targets {
        let camera = names.get(target.camera).map(String::as_str);
        let [name, camera] =
            [target.name.as_str(), camera.unwrap_or_default()].map(toml::Value::from);
        let _ = write!(
            text,
            "\n[[target]]\nname = {name}\nroi = {:?}\ncamera = {camera}\nreference = {}\ndrives = {}\n",
            target.roi_px, target.is_reference, target.drives
        );
    }
}

#[cfg(test)]
mod tests {
    use crate::rig_file::RigFile;
    use std::path::Path;

    const DECK: &str = "[[target]]\nname = \"deck\"\nroi = [40, 30, 120, 80]\n";

    fn parse(text: &str) -> Result<RigFile, crate::error::InputError> {
        RigFile::parse(Path::new("rig.toml"), &(RigFile::paper().to_toml() + text))
    }

    #[test]
    fn targets_survive_writing() {
        let text = format!(
            "{DECK}reference = true\n[[target]]\nname = \"pier\"\nroi = [0, 0, 320, 240]\n\
             camera = \"left\"\n"
        );
        let rig = parse(&text).expect("it is right");
        let places: Vec<_> = rig.targets.iter().map(|t| (t.camera, t.drives)).collect();
        assert_eq!(places, [(1, false), (0, true)]);
        let again = RigFile::parse(Path::new("rig.toml"), &rig.to_toml()).expect("it is right");
        assert_eq!(again.targets, rig.targets);
        let alone = parse(&format!("{DECK}reference = true\n")).expect("it is right");
        assert!(alone.targets[0].drives);
    }

    #[test]
    fn wrong_targets_are_named() {
        for (text, field, reason) in [
            (
                format!("{DECK}{DECK}"),
                "target[1].name",
                "a name of its own",
            ),
            (
                DECK.replace("deck", "de\\u001bck"),
                "target[0].name",
                "printable",
            ),
            (
                DECK.replace("deck", ""),
                "target[0].name",
                "a name of its own",
            ),
            (
                DECK.replace("120", "281"),
                "target[0].roi",
                "within the image",
            ),
            (DECK.replace("80", "0"), "target[0].roi", "within the image"),
            (
                DECK.replace("[40,", "[-1,"),
                "target[0].roi[0]",
                "out of range",
            ),
            (
                format!("{DECK}camera = \"top\"\n"),
                "target[0].camera",
                "left, middle, right",
            ),
            (
                format!("{DECK}reference = true\n{DECK}reference = true\n")
                    .replacen("deck", "a", 1),
                "target[1].reference",
                "already",
            ),
            (
                format!("{DECK}drives = true\n{DECK}drives = true\n").replacen("deck", "a", 1),
                "target[1].drives",
                "already",
            ),
            (
                format!("{DECK}mask = \"m.png\"\n"),
                "target[0].mask",
                "unknown",
            ),
            (DECK.replace("roi", "# roi"), "target[0].roi", "missing"),
        ] {
            let error = parse(&text).expect_err(&text).to_string();
            assert!(error.contains(field) && error.contains(reason), "{error}");
        }
    }
}
