//! Link arguments. They are here because cargo ignores a package's own `.cargo/config.toml` when it
//! runs in another folder.

use std::path::PathBuf;
use std::{env, fs, io};

fn main() -> io::Result<()> {
    let out = PathBuf::from(env::var_os("OUT_DIR").unwrap_or_default());
    fs::copy("memory.x", out.join("memory.x"))?;
    // cortex-m-rt asks for the names of the interrupt handlers. The vector table names its
    // functions itself.
    fs::write(out.join("device.x"), "")?;
    println!("cargo:rerun-if-changed=memory.x");
    println!("cargo:rustc-link-search={}", out.display());
    println!("cargo:rustc-link-arg-bins=-Tlink.x");
    println!("cargo:rustc-link-arg-bins=--nmagic");
    Ok(())
}
