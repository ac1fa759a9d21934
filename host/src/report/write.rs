//! Files that are either there in full or not at all.

use super::Error;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

/// Writes `text` to a new file beside `path`, then renames it over `path`: a reader sees the old file or
/// the new one, never half of one. On any error nothing is left behind.
pub fn write_atomically(path: &Path, text: &str) -> Result<(), Error> {
    write_and_rename(path, text).map_err(|source| Error::Write {
        path: path.to_owned(),
        source,
    })
}

fn write_and_rename(path: &Path, text: &str) -> io::Result<()> {
    let (mut file, temporary) = create_beside(path)?;
    let written = file
        .write_all(text.as_bytes())
        .and_then(|()| file.sync_all())
        .and_then(|()| fs::rename(&temporary, path));
    if written.is_err() {
        // The first error is the one worth telling; a file that cannot be removed is not.
        let _ = fs::remove_file(&temporary);
    }
    written
}

/// A file that did not exist before, in the folder of `path` so that the rename stays on one file system.
fn create_beside(path: &Path) -> io::Result<(File, PathBuf)> {
    let name = path
        .file_name()
        .ok_or_else(|| io::Error::new(io::ErrorKind::InvalidInput, "names no file"))?;
    for attempt in 0..100_u32 {
        let mut temporary = std::ffi::OsString::from(".");
        temporary.push(name);
        temporary.push(format!(".{}-{attempt}.tmp", std::process::id()));
        let temporary = path.with_file_name(temporary);
        match OpenOptions::new()
            .write(true)
            .create_new(true)
            .open(&temporary)
        {
            Ok(file) => return Ok((file, temporary)),
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            Err(error) => return Err(error),
        }
    }
    Err(io::Error::new(
        io::ErrorKind::AlreadyExists,
        "a hundred temporary files of this name are in the way",
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).unwrap();
        entries
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect()
    }

    #[test]
    fn the_new_text_replaces_the_old_and_nothing_else_stays() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("report.html");
        write_atomically(&path, "old").unwrap();
        write_atomically(&path, "new").unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "new");
        assert_eq!(names(folder.path()), ["report.html"]);
    }

    #[test]
    fn a_failed_rename_leaves_no_temporary_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("report.html");
        fs::create_dir(&path).unwrap();
        fs::write(path.join("inside"), "x").unwrap();
        let error = write_atomically(&path, "new").unwrap_err();
        assert!(error.to_string().contains("report.html"), "{error}");
        assert_eq!(names(folder.path()), ["report.html"]);
    }

    #[test]
    fn a_missing_folder_and_a_missing_name_are_errors() {
        let folder = tempfile::tempdir().unwrap();
        assert!(write_atomically(&folder.path().join("none/report.html"), "x").is_err());
        assert!(write_atomically(Path::new("/"), "x").is_err());
        assert!(names(folder.path()).is_empty());
    }

    #[test]
    fn a_left_over_of_a_killed_run_is_stepped_around() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let stale = folder
            .path()
            .join(format!(".a.{}-0.tmp", std::process::id()));
        fs::write(&stale, "stale").unwrap();
        write_atomically(&path, "new").unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "new");
        assert_eq!(fs::read_to_string(&stale).unwrap(), "stale");
    }
}
