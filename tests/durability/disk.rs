//! A disk whose power may go: what was synced is there, of the rest any part of it.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use rand::Rng;
use rand::rngs::StdRng;

use crate::durability::trace::Event;

/// A change of a file that may not have reached the disk.
#[derive(Debug, Clone)]
enum Change {
    Write { offset: usize, bytes: Vec<u8> },
    Truncate(usize),
}

/// Content of a file, by whatever name.
#[derive(Debug, Clone, Default)]
struct Content {
    durable: Vec<u8>,
    /// Numbers of the events and their changes.
    pending: Vec<(usize, Change)>,
}

/// A change of the folder's entries.
#[derive(Debug, Clone)]
enum Entry {
    Is(String, usize),
    Gone(String),
}

/// Model of the disk.
#[derive(Debug, Default)]
pub struct Disk {
    contents: Vec<Content>,
    /// Entries in the view of programs.
    names: BTreeMap<String, usize>,
    /// Entries after a power loss at the earliest.
    durable_names: BTreeMap<String, usize>,
    pending_entries: Vec<(usize, Entry)>,
}

impl Disk {
    /// Applies event `number`.
    pub fn take(&mut self, number: usize, event: &Event) {
        match event {
            Event::Create { file } => {
                self.contents.push(Content::default());
                self.enter(number, file, self.contents.len() - 1);
            }
            Event::Write {
                file,
                offset,
                bytes,
            } => {
                let (offset, bytes) = (*offset, bytes.clone());
                self.change(number, file, Change::Write { offset, bytes });
            }
            Event::Truncate { file, length } => {
                self.change(number, file, Change::Truncate(*length));
            }
            Event::Sync { file, begun } => {
                let content = &mut self.contents[self.names[file]];
                let synced = content.pending.extract_if(.., |(at, _)| *at < *begun);
                for (_, change) in synced {
                    apply(&mut content.durable, &change);
                }
            }
            Event::SyncFolder { begun } => {
                let synced = self.pending_entries.extract_if(.., |(at, _)| *at < *begun);
                for (_, entry) in synced {
                    set(&mut self.durable_names, &entry);
                }
            }
            Event::Unlink { file } => {
                self.names.remove(file);
                self.pending_entries
                    .push((number, Entry::Gone(file.clone())));
            }
            Event::Rename { from, to } => {
                let content = self.names.remove(from).unwrap();
                self.pending_entries
                    .push((number, Entry::Gone(from.clone())));
                self.enter(number, to, content);
            }
            Event::Print(_) => {}
        }
    }

    fn enter(&mut self, number: usize, file: &str, content: usize) {
        self.names.insert(file.to_owned(), content);
        self.pending_entries
            .push((number, Entry::Is(file.to_owned(), content)));
    }

    fn change(&mut self, number: usize, file: &str, change: Change) {
        self.contents[self.names[file]]
            .pending
            .push((number, change));
    }

    /// Writes a possible content after a power loss now: of the folder's unsynced entries the first
    /// ones, of each unsynced write any of its sectors.
    pub fn lose_power(&self, random: &mut StdRng, folder: &Path) {
        let mut names = self.durable_names.clone();
        let kept = random.random_range(0..=self.pending_entries.len());
        for (_, entry) in self.pending_entries.iter().take(kept) {
            set(&mut names, entry);
        }
        let sector = if random.random() { 512 } else { 4_096 };
        let chance = [0.0, 0.1, 0.5, 0.9, 1.0][random.random_range(0..5)];
        for (name, content) in names {
            let content = &self.contents[content];
            let mut bytes = content.durable.clone();
            for (_, change) in &content.pending {
                tear(&mut bytes, change, sector, chance, random);
            }
            fs::write(folder.join(name), bytes).unwrap();
        }
    }
}

fn set(names: &mut BTreeMap<String, usize>, entry: &Entry) {
    match entry {
        Entry::Is(file, content) => names.insert(file.clone(), *content),
        Entry::Gone(file) => names.remove(file),
    };
}

fn apply(bytes: &mut Vec<u8>, change: &Change) {
    match change {
        Change::Write { offset, bytes: new } => put(bytes, *offset, new),
        Change::Truncate(length) => bytes.resize(*length, 0),
    }
}

fn put(bytes: &mut Vec<u8>, offset: usize, new: &[u8]) {
    let end = offset + new.len();
    if bytes.len() < end {
        bytes.resize(end, 0);
    }
    bytes[offset..end].copy_from_slice(new);
}

/// Applies the part of a change that happens to have reached the disk.
fn tear(bytes: &mut Vec<u8>, change: &Change, sector: usize, chance: f64, random: &mut StdRng) {
    match change {
        Change::Truncate(length) => {
            if random.random_bool(chance) {
                bytes.resize(*length, 0);
            }
        }
        Change::Write { offset, bytes: new } => {
            let mut at = 0;
            while at < new.len() {
                // Up to the next boundary of a sector of the disk.
                let length = (sector - (offset + at) % sector).min(new.len() - at);
                if random.random_bool(chance) {
                    put(bytes, offset + at, &new[at..at + length]);
                }
                at += length;
            }
        }
    }
}
