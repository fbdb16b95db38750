//! Programs of all operations, for the tests of the core and of the instruction sets.

use hgo_rs::program::{Instruction, Lane, Operation, Program, REGISTERS, Registers};
use proptest::prelude::*;
use proptest::test_runner::TestCaseResult;

/// Runs of a block.
pub const LANES: usize = 32;

/// Registers of a block.
pub type Block = Box<Registers<Lane<f64, LANES>>>;

/// Every operation.
pub const OPERATIONS: [Operation; 33] = [
    Operation::Negate,
    Operation::Abs,
    Operation::Sign,
    Operation::Sqrt,
    Operation::Sin,
    Operation::Cos,
    Operation::Tan,
    Operation::Atan,
    Operation::Exp,
    Operation::Ln,
    Operation::Tanh,
    Operation::Add,
    Operation::Subtract,
    Operation::Multiply,
    Operation::Divide,
    Operation::Min,
    Operation::Max,
    Operation::Power,
    Operation::Atan2,
    Operation::CopySign,
    Operation::Less,
    Operation::LessEqual,
    Operation::Equal,
    Operation::Innovation,
    Operation::Select,
    Operation::MultiplyAdd,
    Operation::MultiplySubtract,
    Operation::SubtractProduct,
    Operation::Clip,
    Operation::AddRows,
    Operation::ShiftRow,
    Operation::ScaleRow,
    Operation::ScaleAddRow,
];

/// One instruction over few registers, so that results are used again.
pub fn instruction() -> impl Strategy<Value = Instruction> {
    (0..OPERATIONS.len(), any::<u8>(), any::<u8>(), any::<u8>(), any::<u8>()).prop_map(
        |(operation, result, a, b, c)| {
            let [result, a, b, c] = [result, a, b, c].map(|register| register % 24);
            Instruction { operation: OPERATIONS[operation], result, a, b, c }
        },
    )
}

/// The bits of a number; those of NaN are not defined.
pub fn bits(value: f64) -> u64 {
    if value.is_nan() { f64::NAN.to_bits() } else { value.to_bits() }
}

/// A block of runs that `run` moves through a program, against each run alone.
pub fn check_block(
    instructions: &[Instruction],
    start: &[f64],
    run: impl Fn(Program<'_>, Block) -> Block,
) -> TestCaseResult {
    let program = Program { instructions, outputs: &[] };
    let mut lanes = Box::new(Registers::in_lanes(&Registers::zero()));
    for (i, value) in start.iter().enumerate() {
        lanes.0[i / LANES].0[i % LANES] = *value;
    }
    let alone = |lane: usize| {
        let mut alone = Registers::zero();
        for register in 0..REGISTERS {
            alone.0[register] = lanes.0[register].0[lane];
        }
        alone
    };
    // the sign of NaN is not defined, and CopySign shows it
    let shows_it = |lane: usize| {
        let mut r = alone(lane);
        instructions.iter().any(|one| {
            let of_nan = one.operation == Operation::CopySign && r.0[usize::from(one.b)].is_nan();
            Program { instructions: std::slice::from_ref(one), outputs: &[] }.run(&mut r);
            of_nan
        })
    };
    prop_assume!(!(0..LANES).any(shows_it));
    let moved = run(program, lanes.clone());
    for lane in 0..LANES {
        let mut alone = alone(lane);
        program.run(&mut alone);
        for register in 0..REGISTERS {
            prop_assert_eq!(bits(moved.0[register].0[lane]), bits(alone.0[register]));
        }
    }
    Ok(())
}
