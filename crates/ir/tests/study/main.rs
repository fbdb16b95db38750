//! Studies over tables against the core's experiment of the typed plant and observer, run by run and bit
//! for bit: one lane and many, under every instruction set.
#![allow(clippy::format_push_string, clippy::float_cmp, clippy::trivially_copy_pass_by_ref)] // texts of specs; numbers that are exact

mod derivatives;
mod experiment;
mod feedback;
mod laws;
mod missing;
mod noise;
mod own;
mod undefined;

use hgo_ir::vectors::Vectors;
use std::process::Command;

/// All tests of this file again, each time in a process that is held to an instruction set: the variable
/// is one of the whole process.
#[test]
fn every_instruction_set_gives_the_same_bits() {
    let tests = std::env::current_exe().unwrap();
    let sets =
        [("baseline", Vectors::Baseline), ("avx2", Vectors::Avx2), ("avx512", Vectors::Avx512)];
    // checked builds are slow: there the widest, which the other tests take, and none; all in release,
    // and in the Python tests
    let wanted =
        |(_, vectors): &(&str, Vectors)| vectors.are_available() && !cfg!(debug_assertions);
    let available = sets.into_iter().filter(wanted);
    for name in available.map(|(name, _)| name).chain(["plain"]) {
        let mut command = Command::new(&tests);
        command.env("HGO_INSTRUCTION_SET", name);
        let run = command.args(["--skip", "every_instruction_set"]).output().unwrap();
        let told = String::from_utf8_lossy(&run.stdout);
        assert!(run.status.success(), "{name}: {told}");
        assert!(!told.contains("running 0 tests"), "{name}: {told}");
    }
}
