//! Imports among the dashboard's files.

use std::collections::BTreeMap;

use super::rust_sources::Edges;

/// Returns the imports among files, given by their paths below `web/src`.
pub fn imports(files: &BTreeMap<String, String>) -> Edges {
    let mut edges = Edges::new();
    for (from, text) in files {
        for named in named(text) {
            if let Some(to) = resolve(files, from, named).filter(|to| *to != from) {
                edges.insert((from.clone(), to.clone()));
            }
        }
    }
    edges
}

/// Returns the quoted texts behind `from`, `import` or `import(`.
fn named(text: &str) -> impl Iterator<Item = &str> {
    ["from", "import", "import("]
        .into_iter()
        .flat_map(move |word| {
            text.match_indices(word).filter_map(move |(at, _)| {
                let rest = text[at + word.len()..].trim_start();
                let quote = rest.chars().next().filter(|c| matches!(c, '\'' | '"'))?;
                rest[1..].split(quote).next()
            })
        })
}

/// Resolves the relative path of an import to its file.
fn resolve<'a>(files: &'a BTreeMap<String, String>, from: &str, named: &str) -> Option<&'a String> {
    let mut path: Vec<&str> = from.split('/').collect();
    path.pop();
    if !named.starts_with('.') {
        return None;
    }
    for part in named.split('/') {
        match part {
            "." => {}
            ".." => drop(path.pop()),
            name => path.push(name),
        }
    }
    let stem = path.join("/");
    ["", ".ts", ".svelte", ".svelte.ts", "/index.ts"]
        .into_iter()
        .find_map(|ending| files.get_key_value(&format!("{stem}{ending}")))
        .map(|(name, _)| name)
}
