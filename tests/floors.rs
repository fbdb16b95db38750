//! The floors of the house, read from the sources: who may import whom, and what the core may name.
//!
//! Five crates: the core (`src`: no heap, no std, no Python), the tables (`crates/ir`: std, no Python), logs as
//! text (`crates/logs`: std, no Python, no core), the module of pages (`crates/wasm`: std, no Python, the core alone)
//! and the Python module (`crates/py`), which knows the others. In each, a file says its floor in
//! its head (`//! Floor n.`); a file without one lies on the floor of its folder's `mod.rs`.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Imports between files of one floor, each with its reason. A file imports strictly lower floors
/// only; what stands here is an exception and the list is exact: an entry that no file needs any
/// more fails the test as well.
const SAME_FLOOR: &[(&str, &str, &str)] = &[
    ("scalar", "elementary", "a scalar has elementary functions"),
    ("error", "scalar", "a refused value is widened to f64"),
    ("memory", "scalar", "a memory is a number of scalars"),
    ("measurement", "memory", "a measurement is a memory that may be missing"),
    ("measurement", "scalar", "a measurement is a number of scalars"),
    ("polynomial", "error", "a polynomial may be refused"),
    ("polynomial", "scalar", "coefficients are scalars"),
    ("polynomial", "wide", "coefficients of high orders are computed in twice the digits"),
    ("wide", "scalar", "a wide number is two scalars"),
    ("gain", "shape", "a gain law may have a shape"),
    ("integrate", "model", "stochastic schemes take a plant's drift and diffusion"),
    ("observer", "integrate", "a Runge-Kutta observer takes an integrator"),
    ("injection", "observer", "a placed injection is a scheme"),
    ("injection", "motion", "between corrections the model moves"),
    ("inter_sample", "injection", "a correction that goes on between samples is an injection"),
    ("inter_sample", "motion", "and the model moves with it"),
    ("inter_sample", "observer", "it is a scheme too"),
    ("covariance", "simulate", "the covariance is a probe on a run"),
    ("observers/*", "observers/standard", "a law may be built on the standard one"),
    (
        "observers/sampled_ekf",
        "observers/high_gain_ekf",
        "between samples the filter moves by the law's rate",
    ),
    (
        "observers/adaptive_ekf",
        "observers/sampled_ekf",
        "the adaptive filter is that of sampled data, with a theta that moves",
    ),
    ("observers/adaptive_ekf", "observers/high_gain_ekf", "and has its estimate and covariance"),
    ("observers/peaking_free", "observers/low_power", "(11) is (5) with a saturation"),
];

/// One source file: its module, the text of its `//!` head, and its code without comments and
/// string literals.
struct Source {
    module: String,
    head: String,
    code: String,
    floor: u32,
}

/// The crates' folders.
const CORE: &str = ".";
const IR: &str = "crates/ir";
const LOGS: &str = "crates/logs";
const PY: &str = "crates/py";
const WASM: &str = "crates/wasm";

fn source_folder(of: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(of).join("src")
}

fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(rust_files(&path));
        } else if path.extension().is_some_and(|e| e == "rs") {
            files.push(path);
        }
    }
    files.sort();
    files
}

/// Code without comments and without the contents of string literals.
fn code_only(text: &str) -> String {
    let mut code = String::new();
    let mut rest = text.chars().peekable();
    while let Some(c) = rest.next() {
        match (c, rest.peek()) {
            ('/', Some('/')) => while rest.next_if(|c| *c != '\n').is_some() {},
            ('/', Some('*')) => {
                let mut last = ' ';
                for c in rest.by_ref() {
                    if last == '*' && c == '/' {
                        break;
                    }
                    last = c;
                }
            }
            ('"', _) => {
                code.push('"');
                while let Some(c) = rest.next() {
                    match c {
                        '\\' => drop(rest.next()),
                        '"' => break,
                        _ => {}
                    }
                }
                code.push('"');
            }
            _ => code.push(c),
        }
    }
    code
}

fn head(text: &str) -> String {
    let lines = text.lines().take_while(|line| line.starts_with("//!"));
    lines.map(|line| line.trim_start_matches("//!").trim()).collect::<Vec<_>>().join(" ")
}

fn stated_floor(head: &str) -> Option<u32> {
    head.strip_prefix("Floor ")?.split('.').next()?.parse().ok()
}

/// Every file of a crate but lib.rs, which only names the others.
fn sources(of: &str) -> Vec<Source> {
    let root = source_folder(of);
    let mut texts = BTreeMap::new();
    for path in rust_files(&root) {
        let name = path.strip_prefix(&root).unwrap().with_extension("");
        let name = name.to_str().unwrap().replace('\\', "/");
        let module = name.strip_suffix("/mod").unwrap_or(&name).to_owned();
        texts.insert(module, std::fs::read_to_string(&path).unwrap());
    }
    texts.remove("lib");
    let floor_of = |module: &str| {
        let own = stated_floor(&head(&texts[module]));
        let folder = module.rsplit_once('/').map(|(folder, _)| folder);
        let inherited = folder.and_then(|folder| stated_floor(&head(&texts[folder])));
        own.or(inherited).unwrap_or_else(|| panic!("{of}/src/{module}.rs states no floor"))
    };
    let build = |(module, text): (&String, &String)| Source {
        module: module.clone(),
        head: head(text),
        // without its quotes the feature's name stays
        code: code_only(&text.replace("feature = \"std\"", "feature = std")),
        floor: floor_of(module),
    };
    texts.iter().map(build).collect()
}

/// The paths of a `use` tree: `a::{b, c::d}` gives a::b and a::c::d.
fn expand(tree: &str, prefix: &str, paths: &mut Vec<String>) {
    let Some((start, inner)) = tree.split_once('{') else {
        paths.push(format!("{prefix}{}", tree.split(" as ").next().unwrap().trim()));
        return;
    };
    let inner = &inner[..inner.rfind('}').expect("a closed brace")];
    let prefix = format!("{prefix}{}", start.trim());
    let (mut depth, mut from) = (0, 0);
    for (i, c) in inner.char_indices().chain([(inner.len(), ',')]) {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                if !inner[from..i].trim().is_empty() {
                    expand(inner[from..i].trim(), &prefix, paths);
                }
                from = i + 1;
            }
            _ => {}
        }
    }
}

fn word(text: &str) -> &str {
    let end = text.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(text.len());
    &text[..end]
}

fn is_word_start(code: &str, at: usize) -> bool {
    !code[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_' || c == ':')
}

/// Every path that starts with `crate::` or `super::`, from `use` trees and from expressions.
fn paths(code: &str) -> Vec<String> {
    let mut found = Vec::new();
    for (at, _) in code.match_indices("use ").filter(|(at, _)| is_word_start(code, *at)) {
        let tree = &code[at + 4..];
        expand(tree[..tree.find(';').unwrap_or(0)].trim(), "", &mut found);
    }
    for start in ["crate::", "super::"] {
        for (at, _) in code.match_indices(start).filter(|(at, _)| is_word_start(code, *at)) {
            let mut path = start.trim_end_matches(':').to_owned();
            let mut rest = &code[at + start.len()..];
            while !word(rest).is_empty() {
                path = format!("{path}::{}", word(rest));
                rest = rest[word(rest).len()..].strip_prefix("::").unwrap_or("");
            }
            found.push(path);
        }
    }
    found.retain(|path| path.starts_with("crate::") || path.starts_with("super::"));
    found
}

/// Names that a file re-exports: name → module within it.
fn reexports(code: &str) -> BTreeMap<String, String> {
    let mut names = BTreeMap::new();
    for (at, _) in code.match_indices("pub use ") {
        let tree = &code[at + 8..];
        let mut paths = Vec::new();
        expand(&tree[..tree.find(';').unwrap()], "", &mut paths);
        for path in paths {
            if let Some((module, name)) = path.rsplit_once("::") {
                names.insert(name.to_owned(), module.trim_start_matches("crate::").to_owned());
            }
        }
    }
    names
}

/// (importing module, imported module), without a file's own folder and children.
fn imports(of: &str, sources: &[Source]) -> BTreeSet<(String, String)> {
    let modules: BTreeSet<&str> = sources.iter().map(|s| s.module.as_str()).collect();
    let lib = std::fs::read_to_string(source_folder(of).join("lib.rs")).unwrap();
    let mut exported = BTreeMap::from([(String::new(), reexports(&code_only(&lib)))]);
    for source in sources {
        exported.insert(source.module.clone(), reexports(&source.code));
        // a macro made a path lies at the root
        for (at, _) in source.code.match_indices("macro_rules! ") {
            let name = word(&source.code[at + 13..]).to_owned();
            exported.entry(String::new()).or_default().insert(name, source.module.clone());
        }
    }
    let is_folder = |module: &str| modules.iter().any(|m| m.starts_with(&format!("{module}/")));
    let mut edges = BTreeSet::new();
    for source in sources {
        let folder = match source.module.rsplit_once('/') {
            _ if is_folder(&source.module) => source.module.clone(),
            Some((folder, _)) => folder.to_owned(),
            None => String::new(),
        };
        for path in paths(&source.code) {
            let mut segments = path.split("::").collect::<Vec<_>>();
            let start = segments.remove(0);
            // `super` within an inline module means this file
            let inline = start == "super" && !source.module.contains('/');
            let mut target = match start {
                "super" if inline => continue,
                "super" => folder.clone(),
                _ => String::new(),
            };
            for segment in segments {
                let below = if target.is_empty() {
                    segment.to_owned()
                } else {
                    format!("{target}/{segment}")
                };
                if modules.contains(below.as_str()) {
                    target = below;
                } else if let Some(module) = exported.get(&target).and_then(|e| e.get(segment)) {
                    let inside = format!("{target}/{module}");
                    target =
                        if modules.contains(inside.as_str()) { inside } else { module.clone() };
                    break;
                } else {
                    break;
                }
            }
            assert!(modules.contains(target.as_str()), "{}: {path} -> {target}", source.module);
            let below =
                target.strip_prefix(&source.module).is_some_and(|rest| rest.starts_with('/'));
            let own = target == source.module || folder == target || below;
            if !own {
                edges.insert((source.module.clone(), target));
            }
        }
    }
    edges
}

#[test]
fn the_reader_reads_rust() {
    let code = code_only("use crate::a::{b, c::{D, E}}; // crate::no\nlet x = \"crate::no\\\"\";");
    let found = paths(&code);
    for path in ["crate::a::b", "crate::a::c::D", "crate::a::c::E"] {
        assert!(found.iter().any(|p| p == path), "{found:?}");
    }
    assert!(!found.iter().any(|p| p.contains("no")), "{found:?}");
    let inline = paths("f(crate::error::require(1), super::x, not_crate::y)");
    assert_eq!(inline, ["crate::error::require", "super::x"]);
    let all = sources(CORE);
    let edges = imports(CORE, &all);
    let has = |from: &str, to: &str| edges.contains(&(from.to_owned(), to.to_owned()));
    // one by `use`, one in an expression, one through a re-export of lib.rs
    assert!(has("simulate", "schedule") && has("observers/low_power", "polynomial"));
    assert!(has("gain", "scalar"));
    assert!(all.len() > 25 && edges.len() > 60, "{} files, {} imports", all.len(), edges.len());
}

#[test]
fn a_file_imports_strictly_lower_floors() {
    let mut unused: BTreeSet<(&str, &str)> = SAME_FLOOR.iter().map(|(a, b, _)| (*a, *b)).collect();
    let mut wrong = Vec::new();
    for of in [CORE, IR, LOGS, PY, WASM] {
        let sources = sources(of);
        let floor: BTreeMap<&str, u32> =
            sources.iter().map(|s| (s.module.as_str(), s.floor)).collect();
        for (from, to) in &imports(of, &sources) {
            let (above, below) = (floor[from.as_str()], floor[to.as_str()]);
            let names = |a: &str| match a.strip_suffix('*') {
                Some(folder) => from.starts_with(folder),
                None => a == from,
            };
            let exception = SAME_FLOOR.iter().find(|(a, b, _)| of == CORE && names(a) && b == to);
            let excepted = exception.is_some_and(|(a, b, _)| {
                unused.remove(&(*a, *b));
                true
            });
            let fine = below < above || (above == below && excepted);
            if !fine || (excepted && below < above) {
                wrong.push(format!("{of}: {from} (floor {above}) imports {to} (floor {below})"));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(unused.is_empty(), "exceptions that nothing needs any more: {unused:?}");
}

/// `name`, `name` (floor); … under the heading of floors in a crate's lib.rs.
#[test]
fn a_crate_names_its_files_with_their_floors() {
    for of in [CORE, IR, LOGS] {
        let lib = std::fs::read_to_string(source_folder(of).join("lib.rs")).unwrap();
        let told = lib.split("//! # Floors").nth(1).unwrap().split("\n\n").next().unwrap();
        let told = told.split("\n#!").next().unwrap().replace("\n//!", "");
        let (mut floors, mut waiting) = (BTreeMap::new(), Vec::new());
        for part in told.split_inclusive(['`', ')']) {
            let floor = part.rsplit_once('(').and_then(|(_, number)| number.strip_suffix(')'));
            if let Some(Ok(floor)) = floor.map(str::parse::<u32>) {
                floors.extend(waiting.drain(..).map(|name: String| (name, floor)));
            } else {
                waiting.push(part.trim_end_matches('`').to_owned());
            }
        }
        for source in sources(of).iter().filter(|source| !source.module.contains('/')) {
            assert_eq!(floors.get(&source.module), Some(&source.floor), "{of}: {}", source.module);
        }
    }
}

#[test]
fn the_core_has_no_import_cycle() {
    let sources = sources(CORE);
    let mut edges = imports(CORE, &sources);
    // Take away files that import nothing that is left, until nothing is left.
    let mut left: BTreeSet<String> = sources.into_iter().map(|s| s.module).collect();
    edges.retain(|(from, to)| from != to);
    loop {
        let free: Vec<String> = left
            .iter()
            .filter(|m| !edges.iter().any(|(from, to)| from == *m && left.contains(to)))
            .cloned()
            .collect();
        if free.is_empty() {
            break;
        }
        left.retain(|module| !free.contains(module));
    }
    assert!(left.is_empty(), "a cycle runs through {left:?}");
}

/// Names of a crate's dependencies, those for its tests and optional ones included.
fn dependencies(of: &str) -> BTreeSet<String> {
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR")).join(of).join("Cargo.toml");
    let text = std::fs::read_to_string(manifest).unwrap();
    let mut names = BTreeSet::new();
    for section in
        text.split("\n[").filter(|s| s.split(']').next().unwrap().ends_with("dependencies"))
    {
        if section.starts_with("workspace.") {
            continue;
        }
        let lines = section.lines().skip(1).map(str::trim);
        let names_of = lines.filter(|line| !line.is_empty() && !line.starts_with('#'));
        names.extend(names_of.map(|line| line.split(['.', ' ', '=']).next().unwrap().to_owned()));
    }
    names
}

/// The core knows neither of the others, the tables the core alone, the Python module both.
#[test]
fn a_crate_knows_those_before_it() {
    let python = ["pyo3", "numpy", "hgo-py"];
    let knows = |of: &str, name: &str| {
        let depends = dependencies(of).contains(name);
        let word = name.replace('-', "_");
        let named: Vec<String> = sources(of)
            .into_iter()
            .filter(|source| names(&source.code, &word))
            .map(|source| source.module)
            .collect();
        assert!(depends || named.is_empty(), "{of}: {named:?} name {name}");
        depends
    };
    assert!(!knows(CORE, "hgo-ir") && !knows(CORE, "rayon"));
    assert!(knows(IR, "hgo-rs") && knows(PY, "hgo-rs") && knows(PY, "hgo-ir"));
    for name in python {
        assert!(![CORE, IR, LOGS].iter().any(|of| knows(of, name)), "{name}");
    }
    assert!(knows(PY, "pyo3"));
}

/// Whether a path that starts with `name::`, or a macro or type of that name, stands in the code.
fn names(code: &str, name: &str) -> bool {
    code.match_indices(name).any(|(at, _)| is_word_start(code, at) && word(&code[at..]) == name)
}

/// The code without the items behind `#[cfg(feature = "std")]`; how many there were.
fn without_std_items(code: &str) -> (String, usize) {
    let attribute = "#[cfg(feature = std)]";
    let (mut kept, mut rest, mut items) = (String::new(), code, 0);
    while let Some((before, gated)) = rest.split_once(attribute) {
        kept.push_str(before);
        items += 1;
        let mut depth = 0;
        let end = gated.char_indices().find(|(_, c)| {
            depth += i32::from(*c == '{') - i32::from(*c == '}');
            depth == 0 && (*c == '}' || *c == ';')
        });
        rest = end.map_or("", |(i, _)| &gated[i + 1..]);
    }
    kept.push_str(rest);
    (kept, items)
}

#[test]
fn the_core_names_neither_python_nor_std_nor_the_heap() {
    let core = sources(CORE);
    assert!(core.iter().any(|s| s.module == "simulate"));
    let mut gated = Vec::new();
    for Source { module, code, .. } in &core {
        for name in ["pyo3", "numpy", "rayon", "unsafe", "Vec", "Box", "String", "Rc", "Arc"] {
            assert!(!names(code, name), "src/{module}.rs names {name}");
        }
        let (code, items) = without_std_items(code);
        if items > 0 {
            gated.push(module.as_str());
        }
        for path in ["std::", "alloc::", "extern crate"] {
            let hit = code.match_indices(path).any(|(at, _)| is_word_start(&code, at));
            assert!(!hit, "src/{module}.rs names {path}");
        }
    }
    assert_eq!(gated, ["elementary"], "the square root is the one thing that std gives");
}

#[test]
fn no_crate_writes_a_panic() {
    for of in [CORE, IR, LOGS, PY, WASM] {
        for Source { module, code, .. } in sources(of) {
            for call in [".unwrap()", ".expect(", "panic!(", "unreachable!(", "todo!(", "assert!("]
            {
                assert!(!code.contains(call), "{of}/src/{module}.rs has {call}");
            }
        }
    }
}

#[test]
fn every_observer_and_plant_names_its_paper_and_equation() {
    let papers = [
        "Lee, Choi and Khalil",
        "Sanfelice and Praly",
        "Fu, Kang and Li",
        "Katayama",
        "Khalil",
        "Astolfi",
        "Busvelle",
        "Savitzky and Golay",
    ];
    let mut laws = 0;
    for Source { module, head, .. } in sources(CORE) {
        if !(module.starts_with("observers/") || module.starts_with("models/")) {
            continue;
        }
        laws += 1;
        assert!(papers.iter().any(|paper| head.contains(paper)), "src/{module}.rs names no paper");
        let numbers = head.split('(').skip(1).filter_map(|s| s.split(')').next());
        let equations = numbers.filter(|s| s.len() <= 3 && s.parse::<u32>().is_ok());
        assert!(equations.count() > 0, "src/{module}.rs names no equation");
    }
    assert!(laws >= 11, "{laws}");
}

/// A memory of a law is declared by `memory_struct!`, which names its parts and visits them in order.
#[test]
fn no_law_visits_its_memory_by_hand() {
    for Source { module, code, .. } in sources(CORE) {
        let by_hand = code.contains("Memory<T> for");
        assert!(!by_hand || module == "memory", "src/{module}.rs implements Memory by hand");
    }
}

/// Public types that borrow what they hold, describe a law by functions, are constants of the code or are
/// working memory, so that nothing could be read into them; whether they are written and logged all the same.
const BORROWING: &[(&str, bool)] = &[
    ("Constant", false),
    ("Design", false),
    ("DesignError", true),
    ("Draw", true),
    ("Dual", false),
    ("ErrorCovariance", false),
    ("Experiment", true),
    ("Lane", false),
    ("Law", false),
    ("LogHistogram", false),
    ("Noise", true),
    ("Part", false),
    ("Program", false),
    ("Registers", false),
    ("RunMetrics", false),
    ("Sample", false),
];

#[test]
fn every_public_type_of_the_core_can_be_written_read_and_logged() {
    let mut borrowing: BTreeMap<&str, bool> = BORROWING.iter().copied().collect();
    let mut types = 0;
    for Source { module, code, .. } in sources(CORE) {
        let by_constructor = |name: &str| {
            code.split("through_constructor! {").skip(1).any(|call| {
                let head = call.split("=> {").next().unwrap_or_default();
                head.contains(&format!(" {name}<"))
            })
        };
        let mut attributes = String::new();
        for line in code.lines().map(str::trim).filter(|line| !line.is_empty()) {
            let kind = ["pub struct ", "pub enum "].iter().find_map(|k| line.strip_prefix(k));
            let Some(name) = kind.map(word) else {
                if !line.starts_with("#[") {
                    attributes.clear();
                }
                attributes.push_str(line);
                continue;
            };
            types += 1;
            let logged = attributes.contains("defmt::Format");
            let written = attributes.contains("serde::Serialize") || by_constructor(name);
            let read = attributes.contains("serde::Deserialize") || by_constructor(name);
            let expected = match borrowing.remove(name) {
                Some(out) => (out, out, false),
                None => (true, true, true),
            };
            assert_eq!((logged, written, read), expected, "src/{module}.rs: {name}");
            attributes.clear();
        }
    }
    assert!(types > 40, "{types}");
    assert!(borrowing.is_empty(), "types that are gone: {borrowing:?}");
}

/// A Rust block in a page is run by rustdoc, whole: nothing is marked to be passed over, and every page
/// with such a block is an example of lib.rs.
#[test]
fn every_rust_block_of_the_docs_runs() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let lib = std::fs::read_to_string(source_folder(CORE).join("lib.rs")).unwrap();
    let mut blocks = 0;
    let pages = std::fs::read_dir(root.join("docs")).unwrap().map(|page| page.unwrap().path());
    for page in pages.chain([root.join("README.md"), root.join("firmware/README.md")]) {
        if page.extension().is_none_or(|extension| extension != "md") {
            continue;
        }
        let text = std::fs::read_to_string(&page).unwrap();
        let name = page.strip_prefix(root).unwrap().display().to_string();
        for fence in text.lines().filter(|line| line.trim_start().starts_with("```rust")) {
            assert_eq!(fence, "```rust", "{name}");
            assert!(lib.contains(&format!("include_str!(\"../{name}\")")), "{name}");
            blocks += 1;
        }
    }
    assert!(blocks >= 4, "{blocks}");
}
