//! Network interfaces for several network cameras on one computer.
//!
//! Each address of the loopback network (127.0.0.0/8) can be used without setting it up, but a
//! program that asks for the interfaces learns only 127.0.0.1. With `TRINOCULAR_LOOPBACK` set to
//! addresses with commas between them, it learns an interface for each of them instead.

use std::ffi::CStr;
use std::net::Ipv4Addr;
use std::ptr;

/// Variable with the addresses.
const VARIABLE: &str = "TRINOCULAR_LOOPBACK";

/// Name of the interfaces.
const NAME: &CStr = c"lo";

/// Returns the addresses; `None` if the variable is not set.
pub fn addresses() -> Option<Vec<Ipv4Addr>> {
    let list = std::env::var(VARIABLE).ok()?;
    Some(list.split(',').filter_map(|at| at.parse().ok()).collect())
}

/// Returns the list of interfaces, which stays in memory until the program ends.
pub fn interfaces(addresses: &[Ipv4Addr]) -> *mut libc::ifaddrs {
    let mut next: *mut libc::ifaddrs = ptr::null_mut();
    for address in addresses.iter().rev() {
        let at = address_of(*address);
        next = Box::leak(Box::new(libc::ifaddrs {
            ifa_next: next,
            ifa_name: NAME.as_ptr().cast_mut(),
            ifa_flags: (libc::IFF_UP | libc::IFF_RUNNING | libc::IFF_LOOPBACK) as libc::c_uint,
            ifa_addr: at,
            ifa_netmask: address_of(Ipv4Addr::BROADCAST),
            // As the kernel says of the loopback interface.
            ifa_ifu: at,
            ifa_data: ptr::null_mut(),
        }));
    }
    next
}

fn address_of(address: Ipv4Addr) -> *mut libc::sockaddr {
    let address = libc::sockaddr_in {
        sin_family: libc::AF_INET as libc::sa_family_t,
        sin_port: 0,
        sin_addr: libc::in_addr {
            s_addr: u32::from(address).to_be(),
        },
        sin_zero: [0; 8],
    };
    ptr::from_mut(Box::leak(Box::new(address))).cast()
}
