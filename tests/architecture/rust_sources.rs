//! Uses among the files of a crate, read from its sources.
//!
//! A file uses another when its code names something that is defined there; re-exports are followed
//! to the definition. Left out are code under `#[cfg(test)]`; a module's re-exports of what is
//! below it, which make it an index and not a user; and what a file uses of the `mod.rs` of a
//! folder in which it stands, because a folder's type is defined there and extended in its files.

use std::collections::{BTreeMap, BTreeSet};

use proc_macro2::{TokenStream, TokenTree};
use syn::spanned::Spanned;
use syn::visit::{self, Visit};
use syn::{Attribute, Item, UseTree};

/// Most re-exports that are followed one after another.
const HOPS_MAX: usize = 16;

/// A path of modules below the crate, `["fleet", "view"]`.
type ModulePath = Vec<String>;

/// A `use`: the names of its path, the last one being what is imported.
struct Import {
    path: Vec<String>,
    /// True if it only re-exports something that is defined below its module.
    is_index: bool,
}

#[derive(Default)]
struct Module {
    file: String,
    items: BTreeSet<String>,
    imports: BTreeMap<String, Import>,
    globs: Vec<Vec<String>>,
    /// Paths in its code, as written.
    named: BTreeSet<Vec<String>>,
}

/// Modules of one crate.
pub struct Crate {
    modules: BTreeMap<ModulePath, Module>,
    /// Number of lines of each file without those under `#[cfg(test)]`.
    pub lines: BTreeMap<String, usize>,
}

/// Uses: pairs of a user and the used.
pub type Edges = BTreeSet<(String, String)>;

impl Crate {
    /// Reads a crate from the texts of its files, by their paths below `src`.
    pub fn read(files: &BTreeMap<String, String>) -> Self {
        let mut read = Self {
            modules: BTreeMap::new(),
            lines: BTreeMap::new(),
        };
        read.file(files, "lib.rs", Vec::new());
        read
    }

    fn file(&mut self, files: &BTreeMap<String, String>, name: &str, at: ModulePath) {
        let text = &files[name];
        let parsed = syn::parse_file(text).unwrap_or_else(|error| panic!("{name}: {error}"));
        self.lines.insert(name.to_owned(), text.lines().count());
        self.module(files, name, at, &parsed.items);
    }

    fn module(
        &mut self,
        files: &BTreeMap<String, String>,
        file: &str,
        at: ModulePath,
        items: &[Item],
    ) {
        let mut module = Module {
            file: file.to_owned(),
            ..Module::default()
        };
        for item in items {
            if is_test(attributes(item)) {
                let span = item.span();
                let lines = span.end().line + 1 - span.start().line;
                *self.lines.get_mut(file).unwrap() -= lines;
                continue;
            }
            module.items.extend(defined(item));
            match item {
                Item::Mod(child) => {
                    let mut below = at.clone();
                    below.push(child.ident.to_string());
                    if let Some((_, items)) = &child.content {
                        self.module(files, file, below, items);
                    } else {
                        let stem = below.join("/");
                        let folder = format!("{stem}/mod.rs");
                        let name = if files.contains_key(&folder) {
                            folder
                        } else {
                            format!("{stem}.rs")
                        };
                        self.file(files, &name, below);
                    }
                }
                Item::Use(item) => {
                    let is_public = !matches!(item.vis, syn::Visibility::Inherited);
                    imports(&item.tree, &mut Vec::new(), is_public, &mut module);
                }
                other => Names(&mut module.named).visit_item(other),
            }
        }
        self.modules.insert(at, module);
    }

    /// Returns the uses among files.
    pub fn files(&self) -> Edges {
        self.uses()
            .map(|(from, to, _)| (self.modules[from].file.clone(), to.file.clone()))
            .filter(|(from, to)| from != to && !is_folder_of(to, from))
            .collect()
    }

    /// Returns the uses among the modules right below the crate: the one that is named and the one
    /// with the definition. Files right below the crate are modules of their own.
    pub fn modules(&self) -> Edges {
        let top = |path: &ModulePath| path.first().cloned().unwrap_or_default();
        let mut edges = Edges::new();
        for (from, to, named) in self.uses() {
            let defined = self
                .modules
                .iter()
                .find(|(_, module)| module.file == to.file);
            edges.insert((top(from), named));
            edges.extend(defined.map(|(path, _)| (top(from), top(path))));
        }
        edges.retain(|(from, to)| from != to && !from.is_empty() && !to.is_empty());
        edges
    }

    /// Returns each use: the module that names something, the module that defines it, and the
    /// module right below the crate through which it was named.
    fn uses(&self) -> impl Iterator<Item = (&ModulePath, &Module, String)> {
        self.modules.iter().flat_map(move |(at, module)| {
            let imported = module.imports.values().filter(|import| !import.is_index);
            let paths = imported.map(|import| &import.path).chain(&module.globs);
            paths.chain(&module.named).filter_map(move |path| {
                let found = self.find(at, path, HOPS_MAX)?;
                let start = self.start(at, path)?;
                let through = start.0.first().or_else(|| start.1.first());
                Some((at, found, through.cloned().unwrap_or_default()))
            })
        })
    }

    /// Resolves the module that a written path begins in, and the names below it; `None` for a path
    /// into another crate.
    fn start<'a>(
        &'a self,
        at: &ModulePath,
        path: &'a [String],
    ) -> Option<(ModulePath, &'a [String])> {
        match path.first()?.as_str() {
            "crate" => Some((Vec::new(), path.get(1..)?)),
            "self" => Some((at.clone(), path.get(1..)?)),
            "super" => {
                let mut up = at.clone();
                let mut rest = path;
                while rest.first().is_some_and(|name| name == "super") {
                    up.pop()?;
                    rest = rest.get(1..)?;
                }
                Some((up, rest))
            }
            first => {
                let module = &self.modules[at];
                let mut child = at.clone();
                child.push(first.to_owned());
                if self.modules.contains_key(&child) {
                    Some((child, path.get(1..)?))
                } else if let Some(import) = module.imports.get(first) {
                    // What is imported from another crate, or under its own name, ends here.
                    let is_here = import.path.first().is_none_or(|name| name == first);
                    let (start, below) = (!is_here).then(|| self.start(at, &import.path))??;
                    let mut whole = start;
                    whole.extend(below.iter().cloned());
                    self.modules
                        .contains_key(&whole)
                        .then(|| (whole, path.get(1..).unwrap_or_default()))
                } else {
                    None
                }
            }
        }
    }

    /// Returns the module that defines the object of a path.
    fn find(&self, at: &ModulePath, path: &[String], hops: usize) -> Option<&Module> {
        let (mut place, mut rest) = self.start(at, path)?;
        while let Some(name) = rest.first() {
            let module = self.modules.get(&place)?;
            let mut child = place.clone();
            child.push(name.clone());
            if self.modules.contains_key(&child) {
                place = child;
                rest = rest.get(1..)?;
            } else if module.items.contains(name) || hops == 0 {
                return Some(module);
            } else if let Some(import) = module.imports.get(name) {
                return self.find(&place, &import.path, hops - 1);
            } else {
                let through = module.globs.iter().find_map(|glob| {
                    let whole: Vec<String> = glob.iter().chain(rest).cloned().collect();
                    self.find(&place, &whole, hops - 1)
                });
                return through.or(Some(module));
            }
        }
        self.modules.get(&place)
    }
}

/// True if `file` is that of a folder above `below`, at any depth.
fn is_folder_of(file: &str, below: &str) -> bool {
    let folder = file.strip_suffix("mod.rs").or(file.strip_suffix("lib.rs"));
    folder.is_some_and(|folder| below.starts_with(folder))
}

/// True if an item is compiled for tests alone.
fn is_test(attributes: &[Attribute]) -> bool {
    attributes.iter().any(|attribute| {
        attribute.path().is_ident("cfg")
            && attribute
                .parse_args::<syn::Path>()
                .is_ok_and(|path| path.is_ident("test"))
    })
}

fn attributes(item: &Item) -> &[Attribute] {
    match item {
        Item::Const(item) => &item.attrs,
        Item::Enum(item) => &item.attrs,
        Item::Fn(item) => &item.attrs,
        Item::Impl(item) => &item.attrs,
        Item::Macro(item) => &item.attrs,
        Item::Mod(item) => &item.attrs,
        Item::Static(item) => &item.attrs,
        Item::Struct(item) => &item.attrs,
        Item::Trait(item) => &item.attrs,
        Item::Type(item) => &item.attrs,
        Item::Use(item) => &item.attrs,
        _ => &[],
    }
}

fn defined(item: &Item) -> Option<String> {
    let name = match item {
        Item::Const(item) => &item.ident,
        Item::Enum(item) => &item.ident,
        Item::Fn(item) => &item.sig.ident,
        Item::Macro(item) => item.ident.as_ref()?,
        Item::Static(item) => &item.ident,
        Item::Struct(item) => &item.ident,
        Item::Trait(item) => &item.ident,
        Item::Type(item) => &item.ident,
        _ => return None,
    };
    Some(name.to_string())
}

fn imports(tree: &UseTree, before: &mut Vec<String>, is_public: bool, into: &mut Module) {
    let mut add = |name: String, path: Vec<String>| {
        let first = path.first().map(String::as_str);
        let is_index = is_public && !matches!(first, Some("crate" | "super"));
        into.imports.insert(name, Import { path, is_index });
    };
    match tree {
        UseTree::Path(tree) => {
            before.push(tree.ident.to_string());
            imports(&tree.tree, before, is_public, into);
            before.pop();
        }
        UseTree::Name(tree) if tree.ident == "self" => {
            add(before.last().cloned().unwrap_or_default(), before.clone());
        }
        UseTree::Name(tree) => {
            let name = tree.ident.to_string();
            add(name.clone(), [before.as_slice(), &[name]].concat());
        }
        UseTree::Rename(tree) => {
            let path = if tree.ident == "self" {
                before.clone()
            } else {
                [before.as_slice(), &[tree.ident.to_string()]].concat()
            };
            add(tree.rename.to_string(), path);
        }
        UseTree::Glob(_) => into.globs.push(before.clone()),
        UseTree::Group(group) => {
            for tree in &group.items {
                imports(tree, before, is_public, into);
            }
        }
    }
}

/// Collector of the paths that code names, including those inside a macro's call.
struct Names<'a>(&'a mut BTreeSet<Vec<String>>);

impl Names<'_> {
    fn tokens(&mut self, tokens: TokenStream) {
        let mut path: Vec<String> = Vec::new();
        let mut colons = 0;
        for token in tokens {
            match token {
                TokenTree::Ident(ident) => {
                    if colons != 2 {
                        self.add(&mut path);
                    }
                    path.push(ident.to_string());
                    colons = 0;
                }
                TokenTree::Punct(punct) if punct.as_char() == ':' => colons += 1,
                TokenTree::Group(group) => {
                    self.add(&mut path);
                    self.tokens(group.stream());
                }
                _ => {
                    self.add(&mut path);
                    colons = 0;
                }
            }
        }
        self.add(&mut path);
    }

    fn add(&mut self, path: &mut Vec<String>) {
        let path = std::mem::take(path);
        if path.len() > 1 {
            self.0.insert(path);
        }
    }
}

impl<'ast> Visit<'ast> for Names<'_> {
    fn visit_path(&mut self, path: &'ast syn::Path) {
        let names = path.segments.iter().map(|part| part.ident.to_string());
        self.add(&mut names.collect());
        visit::visit_path(self, path);
    }

    fn visit_macro(&mut self, call: &'ast syn::Macro) {
        self.tokens(call.tokens.clone());
        visit::visit_macro(self, call);
    }

    fn visit_impl_item_fn(&mut self, function: &'ast syn::ImplItemFn) {
        if !is_test(&function.attrs) {
            visit::visit_impl_item_fn(self, function);
        }
    }

    fn visit_item_use(&mut self, item: &'ast syn::ItemUse) {
        // Inside a function.
        let mut module = Module::default();
        imports(&item.tree, &mut Vec::new(), false, &mut module);
        let paths = module.imports.into_values().map(|import| import.path);
        self.0.extend(paths.chain(module.globs));
    }
}
