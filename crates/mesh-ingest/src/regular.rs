//! Opens files whose names come from elsewhere.

use std::fs::{self, File, Metadata};
use std::io::{self, ErrorKind, Read};
use std::path::Path;

/// Opens a regular file for reading. Pipes, devices and folders are refused without opening them:
/// opening a pipe blocks until someone writes to it, and a device may never end. Links are
/// followed.
/// A file that is replaced by a pipe in between does not block.
///
/// # Errors
/// The system's, and `Other` if it is not a regular file.
pub fn open_regular(path: &Path) -> io::Result<File> {
    let refuse = |meta: &Metadata| match meta.is_file() {
        true => Ok(()),
        false => Err(io::Error::other(format!(
            "found {}, expected a regular file",
            kind(meta)
        ))),
    };
    refuse(&fs::metadata(path)?)?;
    let file = open_without_waiting(path)?;
    refuse(&file.metadata()?)?;
    Ok(file)
}

/// Opens without waiting for whoever writes into a pipe. Reading regular files is not affected.
fn open_without_waiting(path: &Path) -> io::Result<File> {
    let mut options = File::options();
    options.read(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::custom_flags(&mut options, libc::O_NONBLOCK);
    options.open(path)
}

/// Checks that there is a regular file of at most `most` bytes.
///
/// # Errors
/// As [`open_regular`]; `FileTooLarge` if it is longer.
pub fn check_regular(path: &Path, most: u64) -> io::Result<()> {
    open_within(path, most).map(drop)
}

/// Reads a regular file of at most `most` bytes.
///
/// # Errors
/// As [`check_regular`], before anything is read.
pub fn read_regular(path: &Path, most: u64) -> io::Result<Vec<u8>> {
    let (file, length) = open_within(path, most)?;
    let mut bytes = Vec::with_capacity(length as usize);
    // A file that grows while it is read must not exceed the limit.
    file.take(most).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// An open file and its length.
fn open_within(path: &Path, most: u64) -> io::Result<(File, u64)> {
    let file = open_regular(path)?;
    let length = file.metadata()?.len();
    if length > most {
        let message = format!("found {length} bytes, expected at most {most}");
        return Err(io::Error::new(ErrorKind::FileTooLarge, message));
    }
    Ok((file, length))
}

fn kind(meta: &Metadata) -> &'static str {
    if meta.is_dir() {
        return "a folder";
    }
    #[cfg(unix)]
    {
        use std::os::unix::fs::FileTypeExt;
        let kind = meta.file_type();
        if kind.is_fifo() {
            return "a pipe";
        }
        if kind.is_char_device() || kind.is_block_device() {
            return "a device";
        }
        if kind.is_socket() {
            return "a socket";
        }
    }
    "something else"
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    /// As after the check, if the file was replaced by then.
    #[test]
    fn opening_a_pipe_does_not_wait() {
        let folder = tempfile::tempdir().expect("a folder");
        let pipe = folder.path().join("pipe");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status();
        assert!(made.expect("mkfifo runs").success());
        let file = open_without_waiting(&pipe).expect("no writer is needed");
        assert_eq!(kind(&file.metadata().expect("open")), "a pipe");
    }
}
