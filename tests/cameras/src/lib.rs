//! Stand-in for the kernel's side of V4L2 on a computer without cameras, and for network interfaces
//! (see [`loopback`]).
//!
//! The library is preloaded into a program (`LD_PRELOAD`) and answers `open`, `close`, `poll` and
//! `ioctl` for the devices `/dev/video90` to `/dev/video99`. All other calls go to the C library
//! behind it. The memory of a device is an anonymous file, which the program maps without further
//! support.
//!
//! The plan and images of a device are in the folder that `TRINOCULAR_CAMERAS` names; see [`plan`].
//! Each device writes its log there.
//!
//! The library is for 64-bit Linux, whose V4L2 structures are in [`wire`].
#![allow(unsafe_code)]

mod camera;
mod loopback;
mod plan;
mod wire;

use std::collections::BTreeMap;
use std::ffi::{CStr, c_char, c_int, c_long, c_short, c_uint, c_void};
use std::fs::File;
use std::os::fd::{AsRawFd, FromRawFd, IntoRawFd, OwnedFd};
use std::sync::atomic::{AtomicBool, Ordering::SeqCst};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use camera::Camera;
use wire::{Buffer, Errno, FormatDescription, PixelFormat, RequestBuffers};

/// Number of file descriptors that can be cameras; higher ones never are.
const FDS: usize = 1024;

/// Marks the descriptors that are cameras. It has no lock because the C library's functions are
/// called from every thread.
static IS_CAMERA: [AtomicBool; FDS] = [const { AtomicBool::new(false) }; FDS];

static CAMERAS: Mutex<BTreeMap<c_int, Camera>> = Mutex::new(BTreeMap::new());

/// Interval at which a waiting caller polls the device.
const NAP: Duration = Duration::from_micros(200);

fn cameras() -> MutexGuard<'static, BTreeMap<c_int, Camera>> {
    CAMERAS.lock().unwrap_or_else(PoisonError::into_inner)
}

fn flag(fd: c_int) -> Option<&'static AtomicBool> {
    IS_CAMERA.get(usize::try_from(fd).ok()?)
}

fn is_camera(fd: c_int) -> bool {
    flag(fd).is_some_and(|flag| flag.load(SeqCst))
}

fn failed(errno: Errno) -> c_int {
    // SAFETY: the C library gives every thread its own.
    unsafe { *libc::__errno_location() = errno };
    -1
}

/// Returns the C library's function of this name, which this library hides.
///
/// # Safety
/// `F` must be a pointer to a function of its type.
unsafe fn hidden<F: Copy>(name: &CStr) -> F {
    // SAFETY: `name` ends with a zero; the caller guarantees the type, and every name used exists.
    unsafe {
        let address = libc::dlsym(libc::RTLD_NEXT, name.as_ptr());
        assert!(!address.is_null());
        std::mem::transmute_copy(&address)
    }
}

/// Returns the time on the drivers' clock, µs.
fn now_us() -> u64 {
    // SAFETY: a `timespec` may be all zeros, and the call may write to it.
    let now = unsafe {
        let mut now: libc::timespec = std::mem::zeroed();
        libc::clock_gettime(libc::CLOCK_MONOTONIC, &mut now);
        now
    };
    now.tv_sec as u64 * 1_000_000 + now.tv_nsec as u64 / 1000
}

/// Replaces the C library's `open`.
///
/// # Safety
/// The requirements are those of the C library's function.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn open(path: *const c_char, flags: c_int, mode: c_uint) -> c_int {
    // SAFETY: the caller's path ends with a zero.
    let name = unsafe { CStr::from_ptr(path) }.to_str().unwrap_or_default();
    if !name.starts_with("/dev/video9") {
        // SAFETY: the same arguments.
        return unsafe { libc::openat(libc::AT_FDCWD, path, flags, mode) };
    }
    // SAFETY: a new descriptor that no other code closes.
    let memory = unsafe {
        let fd = libc::memfd_create(c"camera".as_ptr(), libc::MFD_CLOEXEC);
        if fd < 0 {
            return fd;
        }
        OwnedFd::from_raw_fd(fd)
    };
    let opened = (memory.try_clone()).map(|copy| Camera::open(name, File::from(copy)));
    let Ok(Some(camera)) = opened else {
        return failed(libc::ENOENT);
    };
    let Some(flag) = flag(memory.as_raw_fd()) else {
        return failed(libc::EMFILE);
    };
    let fd = memory.into_raw_fd();
    cameras().insert(fd, camera);
    flag.store(true, SeqCst);
    fd
}

/// Replaces the C library's `close`.
///
/// # Safety
/// The requirements are those of the C library's function.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn close(fd: c_int) -> c_int {
    if is_camera(fd) {
        if let Some(flag) = flag(fd) {
            flag.store(false, SeqCst);
        }
        // The device's files are closed after the lock is released.
        let camera = cameras().remove(&fd);
        drop(camera);
    }
    // SAFETY: `close` has this type.
    unsafe { hidden::<unsafe extern "C" fn(c_int) -> c_int>(c"close")(fd) }
}

/// Replaces the C library's `poll`.
///
/// # Safety
/// The requirements are those of the C library's function.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn poll(
    fds: *mut libc::pollfd,
    count: libc::nfds_t,
    timeout: c_int,
) -> c_int {
    type Poll = unsafe extern "C" fn(*mut libc::pollfd, libc::nfds_t, c_int) -> c_int;
    // SAFETY: the pointer is to one descriptor, or null with none.
    let asked = match (count, unsafe { fds.as_mut() }) {
        (1, Some(asked)) if is_camera(asked.fd) => asked,
        // SAFETY: `poll` has this type; the same arguments.
        _ => return unsafe { hidden::<Poll>(c"poll")(fds, count, timeout) },
    };
    asked.revents = 0;
    let end_us = u64::try_from(timeout).map(|ms| now_us() + 1000 * ms);
    loop {
        let now_us = now_us();
        if let Some(camera) = cameras().get_mut(&asked.fd) {
            asked.revents =
                camera.poll(now_us) as c_short & (asked.events | libc::POLLERR | libc::POLLHUP);
        }
        if asked.revents != 0 {
            return 1;
        }
        if end_us.is_ok_and(|end_us| now_us >= end_us) {
            return 0;
        }
        std::thread::sleep(NAP);
    }
}

/// Replaces the C library's `syscall`; the program does not call `ioctl` itself.
///
/// # Safety
/// The requirements are those of the C library's function.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn syscall(
    number: c_long,
    a: c_long,
    b: c_long,
    c: c_long,
    d: c_long,
    e: c_long,
    f: c_long,
) -> c_long {
    type Syscall =
        unsafe extern "C" fn(c_long, c_long, c_long, c_long, c_long, c_long, c_long) -> c_long;
    let fd = a as c_int;
    if number != libc::SYS_ioctl || !is_camera(fd) {
        // SAFETY: the call takes as many of the arguments as it has, and ignores the others.
        return unsafe { hidden::<Syscall>(c"syscall")(number, a, b, c, d, e, f) };
    }
    let now_us = now_us();
    let mut cameras = cameras();
    let Some(camera) = cameras.get_mut(&fd) else {
        return c_long::from(failed(libc::EBADF));
    };
    // SAFETY: the request states the length of the caller's argument.
    match unsafe { command(camera, b as u64, c as *mut c_void, now_us) } {
        Ok(()) => 0,
        Err(errno) => c_long::from(failed(errno)),
    }
}

/// Replaces the C library's `getifaddrs`.
///
/// # Safety
/// The requirements are those of the C library's function.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn getifaddrs(list: *mut *mut libc::ifaddrs) -> c_int {
    type GetIfAddrs = unsafe extern "C" fn(*mut *mut libc::ifaddrs) -> c_int;
    let Some(addresses) = loopback::addresses() else {
        // SAFETY: `getifaddrs` has this type.
        return unsafe { hidden::<GetIfAddrs>(c"getifaddrs")(list) };
    };
    // SAFETY: the caller's pointer is valid.
    unsafe { *list = loopback::interfaces(&addresses) };
    0
}

/// Replaces the C library's `freeifaddrs`.
///
/// # Safety
/// The requirements are those of the C library's function.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn freeifaddrs(list: *mut libc::ifaddrs) {
    type FreeIfAddrs = unsafe extern "C" fn(*mut libc::ifaddrs);
    if loopback::addresses().is_none() {
        // SAFETY: `freeifaddrs` has this type, and the list is the C library's.
        unsafe { hidden::<FreeIfAddrs>(c"freeifaddrs")(list) };
    }
}

/// Handles a V4L2 request.
///
/// # Safety
/// `argument` must point to the structure that `request` names.
unsafe fn command(
    camera: &mut Camera,
    request: u64,
    argument: *mut c_void,
    now_us: u64,
) -> Result<(), Errno> {
    // SAFETY: for each, the request holds the size of the structure, which `wire` compares.
    unsafe {
        match wire::name(request) {
            Some("VIDIOC_ENUM_FMT") => camera.describe(&mut *argument.cast::<FormatDescription>()),
            Some("VIDIOC_G_FMT") => camera.format(&mut *argument.cast::<PixelFormat>()),
            Some("VIDIOC_S_FMT") => camera.set_format(&mut *argument.cast::<PixelFormat>()),
            Some("VIDIOC_REQBUFS") => camera.allocate(&mut *argument.cast::<RequestBuffers>()),
            Some("VIDIOC_QUERYBUF") => camera.query(&mut *argument.cast::<Buffer>()),
            Some("VIDIOC_QBUF") => camera.queue(&mut *argument.cast::<Buffer>(), now_us),
            Some("VIDIOC_DQBUF") => camera.dequeue(&mut *argument.cast::<Buffer>(), now_us),
            Some("VIDIOC_STREAMON") => camera.start(now_us),
            Some("VIDIOC_STREAMOFF") => camera.stop(),
            _ => Err(libc::ENOTTY),
        }
    }
}
