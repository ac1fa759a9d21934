# Sourced, not run: finds or installs a Rust compiler for the Cortex-M4F.
#
#   . tests/embedded-toolchain.sh
#   embedded_cargo build --release --manifest-path firmware/Cargo.toml
#
# embedded_cargo runs cargo with `--target thumbv7em-none-eabihf` and whatever else the compiler at hand needs. Two ways are tried:
#
#   rustup  the active toolchain, with the target's standard library added if it is not there;
#   debian  Debian's rustc-web and cargo-web, which compile `core` from rust-web-src on the way (the packages
#           match each other; rustup's servers may be out of reach where Debian's are not).
#
# EMBEDDED_TOOLCHAIN=rustup or =debian forces one; EMBEDDED_RUSTFLAGS are further flags. Messages go to stderr.

EMBEDDED_TARGET=thumbv7em-none-eabihf

# Chooses once per shell; sets embedded_kind. Fails with a message when neither way works.
embedded_toolchain() {
    [ -n "${embedded_kind:-}" ] && return 0
    local kind
    for kind in ${EMBEDDED_TOOLCHAIN:-rustup debian}; do
        if "_embedded_$kind"; then
            embedded_kind=$kind
            return 0
        fi
    done
    echo "no compiler for $EMBEDDED_TARGET: neither 'rustup target add $EMBEDDED_TARGET' nor" \
        "'apt-get install rustc-web cargo-web rust-web-src lld' worked" >&2
    return 1
}

# cargo SUBCOMMAND ARGUMENTS.. for the target.
#
# Functions that a crate marks #[inline] are inlined up to six times the usual size even where size counts; serde's and postcard's
# are so many that it costs 2 KB of flash. The threshold makes them ordinary ones.
embedded_cargo() {
    embedded_toolchain || return 1
    local subcommand=$1
    local -x CARGO_TARGET_THUMBV7EM_NONE_EABIHF_RUSTFLAGS="-C llvm-args=-inlinehint-threshold=50 ${EMBEDDED_RUSTFLAGS:-}"
    shift
    case $embedded_kind in
    rustup)
        cargo "$subcommand" --target "$EMBEDDED_TARGET" "$@"
        ;;
    debian)
        # The compiler is a stable one that is told to behave as a nightly, for build-std alone. Its artefacts do not mix with rustup's:
        # cargo keeps them apart by the compiler's version.
        env -u RUSTUP_TOOLCHAIN PATH="/usr/bin:$PATH" RUSTC=/usr/bin/rustc \
            RUSTC_BOOTSTRAP=1 CARGO_UNSTABLE_BUILD_STD=core \
            ${embedded_linker:+CARGO_TARGET_THUMBV7EM_NONE_EABIHF_LINKER="$embedded_linker"} \
            /usr/bin/cargo "$subcommand" --target "$EMBEDDED_TARGET" "$@"
        ;;
    esac
}

_embedded_rustup() {
    command -v cargo >/dev/null || return 1
    # A toolchain that has the target, whoever installed it, needs no rustup.
    local sysroot
    sysroot=$(rustc --print sysroot 2>/dev/null) || return 1
    compgen -G "$sysroot/lib/rustlib/$EMBEDDED_TARGET/lib/libcore-*" >/dev/null && return 0
    command -v rustup >/dev/null || return 1
    echo "adding $EMBEDDED_TARGET with rustup" >&2
    timeout 120 rustup target add "$EMBEDDED_TARGET" >&2
}

_embedded_debian() {
    local src=/usr/lib/rustlib/src/rust/library/core
    # Some releases put the compiler's library elsewhere; the compiler knows where.
    [ -x /usr/bin/rustc ] && src=$(/usr/bin/rustc --print sysroot)/lib/rustlib/src/rust/library/core
    if ! [ -x /usr/bin/rustc ] || ! [ -x /usr/bin/cargo ] || ! [ -d "$src" ]; then
        embedded_apt rustc-web cargo-web rust-web-src || return 1
        src=$(/usr/bin/rustc --print sysroot)/lib/rustlib/src/rust/library/core
        [ -d "$src" ] || return 1
    fi
    # The target's default linker is rust-lld, which Debian's compiler may come without.
    local lld
    embedded_linker=
    for lld in "$(/usr/bin/rustc --print sysroot)"/lib/rustlib/*/bin/rust-lld \
        "$(rustc --print sysroot 2>/dev/null)"/lib/rustlib/*/bin/rust-lld; do
        if [ -x "$lld" ]; then
            embedded_linker=$lld
            return 0
        fi
    done
    command -v ld.lld >/dev/null || embedded_apt lld || return 1
    embedded_linker=$(command -v ld.lld)
}

# apt-get install, as root or through sudo; quiet unless it fails.
embedded_apt() {
    command -v apt-get >/dev/null || return 1
    local root=
    if [ "$(id -u)" != 0 ]; then
        command -v sudo >/dev/null || return 1
        root="sudo -n"
    fi
    local log
    log=$(mktemp)
    echo "installing $* with apt-get" >&2
    if ! { DEBIAN_FRONTEND=noninteractive $root apt-get install -y --no-install-recommends "$@" ||
        { $root apt-get update && DEBIAN_FRONTEND=noninteractive $root apt-get install -y --no-install-recommends "$@"; }; } \
        >"$log" 2>&1; then
        tail -5 "$log" >&2
        rm -f "$log"
        return 1
    fi
    rm -f "$log"
}
