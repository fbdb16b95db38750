//! Floor 1. Lines of LLVM IR in an order that needs few registers.

use std::cmp::Reverse;
use std::collections::{BTreeSet, HashMap};

/// The names of values in a line: what it makes, and what it takes, each once.
fn names(line: &str) -> (Option<&str>, Vec<&str>) {
    let is_part = |c: char| c.is_ascii_alphanumeric() || matches!(c, '%' | '.' | '_');
    let (made, rest) = match line.split_once(" = ") {
        Some((made, rest)) => (Some(made.trim()), rest),
        None => (None, line),
    };
    let mut taken: Vec<&str> =
        rest.split(|c| !is_part(c)).filter(|word| word.starts_with('%')).collect();
    taken.sort_unstable();
    taken.dedup();
    (made, taken)
}

/// The lines of a block but its end, ordered anew: next is always the line after which the fewest values
/// are needed, of equal ones the first. What a block begins with (`phi`) stays, and what it takes from the
/// block's end is needed until then. Lines that only store keep their values' order alone: they must not
/// write what others read.
pub fn ordered(lines: Vec<String>) -> Vec<String> {
    let begins = lines.iter().take_while(|line| line.contains(" = phi ")).count();
    let mut uses: HashMap<&str, usize> = HashMap::new();
    for line in &lines[..begins] {
        names(line).1.into_iter().for_each(|name| *uses.entry(name).or_default() += 1);
    }
    let body: Vec<_> = lines[begins..].iter().map(|line| names(line)).collect();
    let mut users: HashMap<&str, Vec<usize>> = HashMap::new();
    for (at, (_, taken)) in body.iter().enumerate() {
        for name in taken {
            *uses.entry(name).or_default() += 1;
            users.entry(name).or_default().push(at);
        }
    }
    let made: HashMap<&str, usize> =
        body.iter().enumerate().filter_map(|(at, (made, _))| Some(((*made)?, at))).collect();
    let waits = |taken: &Vec<&str>| taken.iter().filter(|name| made.contains_key(*name)).count();
    let mut waits: Vec<usize> = body.iter().map(|(_, taken)| waits(taken)).collect();
    let mut ready: BTreeSet<usize> = (0..body.len()).filter(|at| waits[*at] == 0).collect();
    let mut order = Vec::with_capacity(body.len());
    // values that end with a line, less the one that it makes
    let freed = |at: usize, uses: &HashMap<&str, usize>| {
        let (made, taken) = &body[at];
        let last = taken.iter().filter(|name| uses.get(*name) == Some(&1)).count();
        (last + 1).saturating_sub(usize::from(made.is_some()))
    };
    while let Some(at) = ready.iter().copied().min_by_key(|at| (Reverse(freed(*at, &uses)), *at)) {
        ready.remove(&at);
        order.push(at);
        let (made, taken) = &body[at];
        for name in taken {
            uses.entry(name).and_modify(|count| *count -= 1);
        }
        for user in made.and_then(|name| users.get(name)).into_iter().flatten() {
            waits[*user] -= 1;
            if waits[*user] == 0 {
                ready.insert(*user);
            }
        }
    }
    let mut rest: Vec<Option<String>> = lines.into_iter().map(Some).collect();
    let body = rest.split_off(begins);
    let mut body = body;
    let ordered = order.into_iter().filter_map(|at| body[at].take());
    rest.into_iter().flatten().chain(ordered).collect()
}
