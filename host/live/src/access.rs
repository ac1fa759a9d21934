//! Who may see and control a run: checks of host and origin, and the keys behind a control link.
//!
//! * The `Host` of every request must be this computer's own address. Otherwise a foreign name that
//!   resolves to it (DNS rebinding) could reach the page.
//! * The `Origin` of a websocket must be the page's own. Browsers always send it.
//! * Only a page that was opened by the control link controls the run. The link works once: the
//!   page exchanges its token for a key that lives as long as the browser's tab, and the program
//!   prints the next link. The token is the URL's fragment, which browsers send to no server.

use std::net::{IpAddr, SocketAddr};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Bytes of a token and of a key: they cannot be guessed.
const BYTES: usize = 16;

/// Pages that may control a run simultaneously; a further one replaces the oldest.
const KEYS: usize = 16;

/// Callback that prints the control link of a token.
type Announce = Box<dyn Fn(&str) + Send + Sync>;

/// Token of the control link and keys of the pages that were opened by it.
pub struct Access {
    state: Mutex<State>,
    announce: Announce,
}

struct State {
    token: String,
    keys: Vec<String>,
}

impl std::fmt::Debug for Access {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Access").finish_non_exhaustive()
    }
}

impl Access {
    /// Makes the first token, which [`Access::announce`] announces; every later one is announced
    /// when the link before it was used.
    ///
    /// # Errors
    /// If the system gives no random bytes.
    pub fn new(announce: impl Fn(&str) + Send + Sync + 'static) -> Result<Self, getrandom::Error> {
        let token = secret()?;
        let keys = Vec::new();
        Ok(Self {
            state: Mutex::new(State { token, keys }),
            announce: Box::new(announce),
        })
    }

    /// Announces the token of the present control link.
    pub fn announce(&self) {
        let token = self.state().token.clone();
        (self.announce)(&token);
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Exchanges the token of the control link for a key. Returns `None` for a wrong or used one.
    pub fn exchange(&self, token: &str) -> Option<String> {
        let mut state = self.state();
        if !is_equal(&state.token, token) {
            return None;
        }
        let (next, key) = (secret().ok()?, secret().ok()?);
        if state.keys.len() == KEYS {
            state.keys.remove(0);
        }
        state.keys.push(key.clone());
        state.token.clone_from(&next);
        drop(state);
        (self.announce)(&next);
        Some(key)
    }

    /// Returns true for the key of a page that may control the run.
    pub fn knows(&self, key: &str) -> bool {
        // All keys are compared, so that the time does not depend on the one that fits.
        let state = self.state();
        let fits = state.keys.iter().map(|known| is_equal(known, key));
        fits.fold(false, |any, fit| any | fit)
    }
}

/// Returns a random text of hexadecimal digits.
fn secret() -> Result<String, getrandom::Error> {
    let mut bytes = [0; BYTES];
    getrandom::fill(&mut bytes)?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// Compares two texts in a time that does not depend on the first difference.
fn is_equal(known: &str, given: &str) -> bool {
    if known.len() != given.len() {
        return false;
    }
    let pairs = known.bytes().zip(given.bytes());
    std::hint::black_box(pairs.fold(0, |all, (a, b)| all | (a ^ b))) == 0
}

/// Returns true if a request with this `Host` was meant for the server at `address`.
pub fn is_own_host(host: Option<&str>, address: SocketAddr) -> bool {
    let Some(name) = host.map(without_port) else {
        return false;
    };
    let name = name.trim_start_matches('[').trim_end_matches(']');
    if name.eq_ignore_ascii_case("localhost") {
        return true;
    }
    // A foreign name can resolve to this computer; an address cannot.
    match name.parse::<IpAddr>() {
        Ok(ip) if address.ip().is_unspecified() => !ip.is_unspecified(),
        Ok(ip) => ip.is_loopback() || ip == address.ip(),
        Err(_) => false,
    }
}

/// Returns true if a page with this `Origin` came from the server that `host` names, or if the
/// request has no origin, because no browser sent it.
pub fn is_own_origin(origin: Option<&str>, host: Option<&str>) -> bool {
    match (origin, host) {
        (None, _) => true,
        (Some(origin), Some(host)) => {
            let own = origin.strip_prefix("http://");
            own.is_some_and(|own| own.eq_ignore_ascii_case(host))
        }
        (Some(_), None) => false,
    }
}

/// Removes the port of a host, if it has one.
fn without_port(host: &str) -> &str {
    match host.rsplit_once(':') {
        Some((name, port)) if port.bytes().all(|byte| byte.is_ascii_digit()) => name,
        _ => host,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;

    fn access() -> (Access, Arc<Mutex<Vec<String>>>) {
        let announced = Arc::new(Mutex::new(Vec::new()));
        let theirs = Arc::clone(&announced);
        let access = Access::new(move |token| theirs.lock().unwrap().push(token.to_owned()));
        let access = access.unwrap();
        access.announce();
        (access, announced)
    }

    #[test]
    fn token_works_once() {
        let (access, announced) = access();
        let first = announced.lock().unwrap()[0].clone();
        let key = access.exchange(&first).expect("the link is new");
        assert!(access.knows(&key));
        assert_eq!(access.exchange(&first), None);
        let next = announced.lock().unwrap()[1].clone();
        assert!(access.exchange(&next).is_some() && access.knows(&key));
    }

    #[test]
    fn wrong_keys_are_unknown() {
        let (access, announced) = access();
        let token = announced.lock().unwrap()[0].clone();
        for wrong in [
            "",
            "0",
            &token[1..],
            &format!("{token}0"),
            &token.to_uppercase(),
        ] {
            // A token without letters equals its upper case.
            assert!(
                wrong == token || access.exchange(wrong).is_none(),
                "{wrong}"
            );
            assert!(!access.knows(wrong));
        }
        assert!(!access.knows(&token), "a token is not a key");
    }

    #[test]
    fn keys_are_bounded() {
        let (access, announced) = access();
        let latest = || announced.lock().unwrap().last().unwrap().clone();
        let keys: Vec<String> = (0..KEYS + 1)
            .map(|_| access.exchange(&latest()).unwrap())
            .collect();
        assert!(!access.knows(&keys[0]) && access.knows(&keys[1]));
    }

    #[test]
    fn host_must_be_this_computer() {
        let loopback: SocketAddr = "127.0.0.1:7411".parse().unwrap();
        for own in [
            "127.0.0.1:7411",
            "localhost:7411",
            "localhost:9000",
            "[::1]:7411",
            "LOCALHOST",
        ] {
            assert!(is_own_host(Some(own), loopback), "{own}");
        }
        for other in [
            "example.org",
            "192.168.1.7:7411",
            "localhost.example.org:7411",
            "",
            ":7411",
        ] {
            assert!(!is_own_host(Some(other), loopback), "{other}");
        }
        assert!(!is_own_host(None, loopback));
        let everywhere: SocketAddr = "0.0.0.0:7411".parse().unwrap();
        assert!(is_own_host(Some("192.168.1.7:7411"), everywhere));
        assert!(!is_own_host(Some("lab.example.org:7411"), everywhere));
    }

    #[test]
    fn origin_must_be_the_page() {
        let host = Some("127.0.0.1:7411");
        assert!(is_own_origin(Some("http://127.0.0.1:7411"), host));
        assert!(is_own_origin(None, host));
        for other in [
            "http://127.0.0.1:80",
            "https://127.0.0.1:7411",
            "http://example.org",
            "http://localhost:7411",
            "null",
            "",
        ] {
            assert!(!is_own_origin(Some(other), host), "{other}");
        }
        assert!(!is_own_origin(Some("http://127.0.0.1:7411"), None));
    }
}
