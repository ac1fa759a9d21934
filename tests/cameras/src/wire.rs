//! V4L2's structures and requests as the kernel documents them (`linux/videodev2.h`), on 64-bit
//! computers.

use std::ffi::c_int;

/// The C library's error numbers.
pub type Errno = c_int;

/// Video capture: the only buffer type here.
pub const CAPTURE: u32 = 1;

/// Memory-mapped buffers: the only kind of memory here.
pub const MAPPED: u32 = 1;

/// Buffer flag: the data are damaged.
pub const SPOILT: u32 = 0x40;

/// Buffer flag: the stamp is on the monotonic clock.
pub const MONOTONIC: u32 = 0x2000;

/// Buffer flag: the stamp is of the start of the exposure.
pub const AT_START: u32 = 0x1_0000;

/// `struct v4l2_fmtdesc`.
#[repr(C)]
pub struct FormatDescription {
    pub index: u32,
    pub kind: u32,
    pub flags: u32,
    pub description: [u8; 32],
    pub fourcc: [u8; 4],
    pub rest: [u32; 4],
}

/// `struct v4l2_format` with a `struct v4l2_pix_format` in it.
#[repr(C)]
pub struct PixelFormat {
    pub kind: u32,
    /// Padding that aligns the union to 8 bytes.
    pub gap: u32,
    pub width: u32,
    pub height: u32,
    pub fourcc: [u8; 4],
    pub field: u32,
    pub bytes_per_line: u32,
    pub size: u32,
    /// Colour fields and padding.
    pub rest: [u32; 44],
}

/// `struct v4l2_requestbuffers`.
#[repr(C)]
pub struct RequestBuffers {
    pub count: u32,
    pub kind: u32,
    pub memory: u32,
    pub rest: [u32; 2],
}

/// `struct v4l2_buffer`.
#[repr(C)]
pub struct Buffer {
    pub index: u32,
    pub kind: u32,
    pub bytes_used: u32,
    pub flags: u32,
    pub field: u32,
    pub gap: u32,
    pub seconds: i64,
    pub micros: i64,
    pub timecode: [u32; 4],
    pub sequence: u32,
    pub memory: u32,
    pub offset: u64,
    pub length: u32,
    pub rest: [u32; 3],
}

/// Requests: number, size of the argument, name.
const REQUESTS: [(u64, usize, &str); 9] = [
    (2, size_of::<FormatDescription>(), "VIDIOC_ENUM_FMT"),
    (4, size_of::<PixelFormat>(), "VIDIOC_G_FMT"),
    (5, size_of::<PixelFormat>(), "VIDIOC_S_FMT"),
    (8, size_of::<RequestBuffers>(), "VIDIOC_REQBUFS"),
    (9, size_of::<Buffer>(), "VIDIOC_QUERYBUF"),
    (15, size_of::<Buffer>(), "VIDIOC_QBUF"),
    (17, size_of::<Buffer>(), "VIDIOC_DQBUF"),
    (18, size_of::<c_int>(), "VIDIOC_STREAMON"),
    (19, size_of::<c_int>(), "VIDIOC_STREAMOFF"),
];

/// Returns the name of a request whose argument has the size that is known here.
pub fn name(request: u64) -> Option<&'static str> {
    let (number, group, size) = (request & 0xFF, request >> 8 & 0xFF, request >> 16 & 0x3FFF);
    let same = |(n, s, _): &&(u64, usize, &str)| {
        group == u64::from(b'V') && (*n, *s as u64) == (number, size)
    };
    Some(REQUESTS.iter().find(same)?.2)
}
