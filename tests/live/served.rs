//! The program that serves its built-in twin, and a page of it with control.

use super::peer::Peer;
use std::io::{BufRead as _, BufReader};
use std::process::{Child, Stdio};
use trinocular_tests::binary::{signal, trinocular};

/// A program that serves its built-in twin.
pub struct Served {
    pub program: Child,
    pub page: Peer,
}

impl Served {
    /// Starts the program for at most some seconds, and opens its page.
    pub fn start(seconds: &str) -> Self {
        let mut command = trinocular();
        command.args(["serve", "--control", "--listen", "127.0.0.1:0"]);
        let mut program = command
            .args(["--seconds", seconds])
            .stderr(Stdio::piped())
            .stdout(Stdio::null())
            .spawn()
            .expect("the program runs");
        let mut lines = BufReader::new(program.stderr.take().expect("piped")).lines();
        let mut said = Vec::new();
        let link = lines
            .by_ref()
            .map_while(Result::ok)
            .inspect(|line| said.push(line.clone()))
            .find_map(|line| {
                let (_, link) = line.split_once("http://")?;
                let (address, token) = link.split_once("/#control=")?;
                Some((address.to_owned(), token.trim().to_owned()))
            });
        let link = link.unwrap_or_else(|| panic!("no control link in {said:#?}"));
        // An unread pipe would block the program.
        std::thread::spawn(move || lines.for_each(drop));
        let mut page = Peer::open(link.0.parse().expect("an address"));
        page.exchange(&link.1).expect("the link is new");
        Self { program, page }
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        signal(&self.program, "CONT");
        let _ = self.program.kill();
        let _ = self.program.wait();
    }
}
