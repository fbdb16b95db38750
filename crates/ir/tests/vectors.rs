//! Programs of all operations under every instruction set that this processor has.

#[path = "../../../tests/programs/mod.rs"]
mod programs;

use hgo_ir::vectors::{Task, Vectors};
use hgo_rs::program::Program;
use programs::{Block, LANES, OPERATIONS, check_block, instruction};
use proptest::prelude::*;

struct InLanes<'a>(Program<'a>, Block);

impl Task for InLanes<'_> {
    type Output = Block;
    #[inline(always)]
    fn run(mut self) -> Block {
        self.0.run_lanes(&mut self.1);
        self.1
    }
}

proptest! {
    #[test]
    fn every_instruction_set_has_the_bits_of_each_run(
        instructions in prop::collection::vec(instruction(), 0..40),
        start in prop::collection::vec(-3.0..3.0_f64, 24 * LANES),
    ) {
        let named = |operation| OPERATIONS.contains(&operation);
        prop_assert!(instructions.iter().all(|instruction| named(instruction.operation)));
        for vectors in Vectors::ALL.into_iter().filter(|vectors| vectors.are_available()) {
            let moved = check_block(&instructions, &start, |program, lanes| {
                vectors.run(InLanes(program, lanes)).unwrap()
            });
            match moved {
                Err(TestCaseError::Fail(why)) => {
                    return Err(TestCaseError::fail(format!("{vectors:?}: {why}")));
                }
                moved => moved?,
            }
        }
    }
}
