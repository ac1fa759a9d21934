//! Names of ROS 2.

/// Two cameras have one name in ROS 2.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("cameras {first:?} and {second:?} are both {name:?} in ROS 2; rename one in the rig file")]
pub struct SameName {
    /// Name of one camera.
    pub first: String,
    /// Name of the other.
    pub second: String,
    /// Name of both.
    pub name: String,
}

/// Returns a part of a topic's name: letters, digits and underscores of ASCII, no digit first.
///
/// ```
/// assert_eq!(trinocular_ros::name::part("left-1"), "left_1");
/// assert_eq!(trinocular_ros::name::part("0"), "_0");
/// ```
pub fn part(name: &str) -> String {
    let known = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
    let part: String = name.chars().map(known).collect();
    match part.starts_with(|c: char| c.is_ascii_digit()) || part.is_empty() {
        true => format!("_{part}"),
        false => part,
    }
}

/// Returns the parts of all cameras' names.
///
/// # Errors
/// [`SameName`] if two are equal.
pub fn parts(cameras: &[String]) -> Result<Vec<String>, SameName> {
    let parts: Vec<_> = cameras.iter().map(|name| part(name)).collect();
    for (second, name) in parts.iter().enumerate() {
        if let Some(first) = parts[..second].iter().position(|earlier| earlier == name) {
            return Err(SameName {
                first: cameras[first].clone(),
                second: cameras[second].clone(),
                name: name.clone(),
            });
        }
    }
    Ok(parts)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_names_are_refused_with_both_cameras() {
        let names = ["a-b", "c", "a.b"].map(String::from);
        let refusal = parts(&names).unwrap_err();
        assert!(
            refusal.to_string().contains(r#""a-b" and "a.b""#),
            "{refusal}"
        );
        assert_eq!(parts(&names[..2]).unwrap(), ["a_b", "c"]);
    }
}
