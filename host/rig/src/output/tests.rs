//! An existing file is replaced whole or kept; pipes and devices are written in place.

use super::*;
use std::fs;

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<String> = entries
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

fn write(path: &Path, replace: Replace, text: &str) -> Result<(), InputError> {
    Output::open(path, replace)?.write(text)
}

#[test]
fn new_text_replaces_old() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("report.html");
    write(&path, Replace::Nothing, "old").unwrap();
    write(&path, Replace::Anything, "new").unwrap();
    assert_eq!(fs::read_to_string(&path).unwrap(), "new");
    assert_eq!(names(folder.path()), ["report.html"]);
}

#[test]
fn foreign_file_needs_force() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a");
    fs::write(&path, "mine").unwrap();
    for (replace, reason) in [
        (Replace::Nothing, "exists"),
        (
            Replace::Own(OwnFile::Report),
            "is no report of this program",
        ),
        (
            Replace::Own(OwnFile::Recording),
            "is no recording of this program",
        ),
    ] {
        let error = Output::open(&path, replace).unwrap_err();
        assert!(
            error.reason.contains(reason) && error.reason.contains("--force"),
            "{error}"
        );
        assert_eq!(fs::read_to_string(&path).unwrap(), "mine");
        assert!(Output::open(&path, replace.or_forced(true)).is_ok());
    }
}

#[test]
fn own_output_is_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a");
    let page = "<html><footer>Trinocular 0.1.0</footer></html>\n".to_owned();
    let recording = "\u{89}MCAP0\r\n"
        .chars()
        .map(|c| c as u8)
        .collect::<Vec<_>>();
    let recording = [&recording[..], b"\x01....ros2....trinocular 0.1.0...."].concat();
    let files = [
        (OwnFile::Report, page.into_bytes()),
        (OwnFile::Figure, marked("<svg></svg>\n").into_bytes()),
        (OwnFile::Recording, recording),
    ];
    for (kind, _) in &files {
        for (found, bytes) in &files {
            fs::write(&path, bytes).unwrap();
            let outcome = write(&path, Replace::Own(*kind), "new");
            // A page in the place of a recording would be a loss, too.
            assert_eq!(outcome.is_ok(), kind == found, "{kind:?} over {found:?}");
            let left = fs::read(&path).unwrap();
            assert_eq!(left == b"new", kind == found, "{kind:?} over {found:?}");
        }
        fs::write(&path, "").unwrap();
        write(&path, Replace::Own(*kind), "new").unwrap();
    }
}

#[test]
fn unwritable_place_fails_at_open() {
    let folder = tempfile::tempdir().unwrap();
    let error = Output::open(&folder.path().join("none/a"), Replace::Anything).unwrap_err();
    assert!(error.reason.contains("no such folder"), "{error}");
    let error = Output::open(folder.path(), Replace::Anything).unwrap_err();
    assert!(error.reason.contains("is a folder"), "{error}");
    assert!(Output::open(Path::new("/"), Replace::Anything).is_err());
    assert!(Output::open(Path::new(""), Replace::Anything).is_err());
    assert!(names(folder.path()).is_empty());
}

#[test]
fn opening_changes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let (old, new) = (folder.path().join("old"), folder.path().join("new"));
    fs::write(&old, "old").unwrap();
    let opened = [&old, &new].map(|path| Output::open(path, Replace::Anything).unwrap());
    assert_eq!(names(folder.path()), ["old"]);
    assert_eq!(fs::read_to_string(&old).unwrap(), "old");
    assert!(opened[0].replaces_file() && !opened[1].replaces_file());
}

#[test]
fn longest_file_name_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("n".repeat(255));
    write(&path, Replace::Nothing, "text").unwrap();
    assert_eq!(fs::read_to_string(&path).unwrap(), "text");
}

#[test]
fn one_failure_changes_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    fs::write(path("old"), "old").unwrap();
    let open = |name| Output::open(&path(name), Replace::Anything).unwrap();
    let outputs = ["old", "new", "lost"].map(|name| (open(name), "text".to_owned()));
    // A folder appears in the place of the last output; no file replaces a folder.
    fs::create_dir_all(path("lost/inside")).unwrap();
    let error = write_all(outputs.into()).unwrap_err();
    assert_eq!(error.file, path("lost"));
    assert_eq!(names(folder.path()), ["lost", "old"]);
    assert_eq!(fs::read_to_string(path("old")).unwrap(), "old");
}

#[test]
fn empty_new_folders_are_removed() {
    let folder = tempfile::tempdir().unwrap();
    let inner = folder.path().join("a/b/c");
    for keeps in [false, true] {
        let mut folders = NewFolders::default();
        folders.make(&inner).unwrap();
        folders.make(&inner).unwrap();
        if keeps {
            fs::write(inner.join("file"), "").unwrap();
        }
        drop(folders);
        assert_eq!(inner.exists(), keeps);
    }
}

#[cfg(unix)]
mod unix {
    use super::*;
    use std::os::unix::fs::{FileTypeExt as _, PermissionsExt as _, symlink};
    use std::process::Command;

    #[test]
    fn mode_and_symbolic_link_stay() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        fs::write(path("file"), "old").unwrap();
        fs::set_permissions(path("file"), fs::Permissions::from_mode(0o640)).unwrap();
        symlink("file", path("link")).unwrap();
        symlink(path("link"), path("second")).unwrap();
        write(&path("second"), Replace::Anything, "new").unwrap();
        assert_eq!(fs::read_to_string(path("file")).unwrap(), "new");
        assert_eq!(
            fs::metadata(path("file")).unwrap().permissions().mode() & 0o777,
            0o640
        );
        assert!(fs::symlink_metadata(path("link")).unwrap().is_symlink());

        // A link to a file that does not exist yet.
        symlink("later", path("early")).unwrap();
        write(&path("early"), Replace::Nothing, "text").unwrap();
        assert_eq!(fs::read_to_string(path("later")).unwrap(), "text");
        symlink("circle", path("circle")).unwrap();
        assert!(Output::open(&path("circle"), Replace::Anything).is_err());
    }

    #[test]
    fn devices_are_written_in_place() {
        write(Path::new("/dev/null"), Replace::Nothing, "text").unwrap();
        assert!(
            fs::metadata("/dev/null")
                .unwrap()
                .file_type()
                .is_char_device()
        );

        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        assert!(
            Command::new("mkfifo")
                .arg(&pipe)
                .status()
                .unwrap()
                .success()
        );
        let reader = Command::new("cat")
            .arg(&pipe)
            .stdout(std::process::Stdio::piped())
            .spawn();
        let text = "text ".repeat(4_000);
        write(&pipe, Replace::Nothing, &text).unwrap();
        let read = reader.unwrap().wait_with_output().unwrap();
        assert_eq!(read.stdout, text.as_bytes());
        assert!(fs::metadata(&pipe).unwrap().file_type().is_fifo());
    }

    #[test]
    fn full_device_is_an_error() {
        if !Path::new("/dev/full").exists() {
            return;
        }
        let error = write(Path::new("/dev/full"), Replace::Nothing, "text").unwrap_err();
        assert!(error.reason.starts_with("cannot write: "), "{error}");
    }
}

/// The lock ends with the file, so that a crashed run leaves none.
#[test]
#[cfg(unix)]
fn file_of_a_running_stream_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let open = || Output::open(&path, Replace::Anything);
    let (first, second) = (open().unwrap(), open().unwrap());
    let file = first.stream().unwrap();
    // Both were opened before either began.
    let error = second.stream().unwrap_err();
    assert!(error.reason.contains("another run writes"), "{error}");
    let error = open().unwrap_err();
    assert!(error.reason.contains("another run writes"), "{error}");
    assert_eq!(names(folder.path()), ["run.mcap"]);
    drop(file);
    drop(open().unwrap().stream().unwrap());
}

#[test]
#[cfg(unix)]
fn runs_that_begin_together_do_not_share_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let began: Vec<bool> = std::thread::scope(|scope| {
        let run = || Output::open(&path, Replace::Anything).and_then(Output::stream);
        let runs: Vec<_> = (0..8).map(|_| scope.spawn(run)).collect();
        let files: Vec<_> = runs.into_iter().map(|run| run.join().unwrap()).collect();
        files.iter().map(Result::is_ok).collect()
    });
    assert_eq!(began.iter().filter(|is_ok| **is_ok).count(), 1, "{began:?}");
}
