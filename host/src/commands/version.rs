//! Text of `trinocular --version`.

use trinocular_core::frame::{PROTOCOL, SCHEMA_HASH};

/// Returns the version, the commit that it was built from, the protocol that it speaks, and the
/// features that it was built with.
pub fn long() -> String {
    let commit = option_env!("TRINOCULAR_COMMIT").unwrap_or("unknown (built from a package)");
    let cameras = match cfg!(all(feature = "camera", target_os = "linux")) {
        true => "live cameras (V4L2)",
        false => "none; `--features camera` adds live cameras (V4L2, Linux)",
    };
    format!(
        "{}\ncommit    {commit}\nprotocol  {PROTOCOL}, schema {SCHEMA_HASH:08x}\n\
         features  {cameras}",
        env!("CARGO_PKG_VERSION")
    )
}
