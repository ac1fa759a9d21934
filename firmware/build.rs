//! Link arguments. They are here and not in `.cargo/config.toml`, because cargo ignores that file
//! when it runs in another folder.

fn main() {
    let here = std::env::var("CARGO_MANIFEST_DIR").unwrap_or_default();
    // memory.x lies at the top level of the repository.
    println!("cargo:rustc-link-search={here}/..");
    println!("cargo:rerun-if-changed={here}/../memory.x");
    println!("cargo:rustc-link-arg-bins=--nmagic");
    println!("cargo:rustc-link-arg-bins=-Tlink.x");
    if std::env::var_os("CARGO_FEATURE_DEFMT").is_some() {
        println!("cargo:rustc-link-arg-bins=-Tdefmt.x");
    }
}
