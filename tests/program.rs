//! Programs: the same as the operations they are made of, alone and in a block of runs.

mod programs;

use hgo_rs::program::{Instruction, Operation, Program, REGISTERS, ROW, Registers};
use programs::{LANES, OPERATIONS, bits, check_block, instruction};
use proptest::prelude::*;

/// Entries of an operation's result, and how far each operand goes from entry to entry.
fn entries(operation: Operation) -> (usize, [usize; 3]) {
    match operation {
        Operation::AddRows => (ROW, [1, 1, 0]),
        Operation::ShiftRow | Operation::ScaleRow => (ROW, [0, 1, 0]),
        Operation::ScaleAddRow => (ROW, [0, 1, 1]),
        _ => (1, [0; 3]),
    }
}

/// What an operation is, written down a second time.
fn expected(operation: Operation, a: f64, b: f64, c: f64) -> Option<f64> {
    let truth = |holds: bool| f64::from(u8::from(holds));
    Some(match operation {
        Operation::Negate => -a,
        Operation::Abs => a.abs(),
        Operation::Sqrt => a.sqrt(),
        Operation::Add | Operation::AddRows | Operation::ShiftRow => a + b,
        Operation::Subtract => a - b,
        Operation::Multiply | Operation::ScaleRow => a * b,
        Operation::Divide => a / b,
        Operation::CopySign => a.copysign(b),
        Operation::Less => truth(a < b),
        Operation::LessEqual => truth(a <= b),
        #[allow(clippy::float_cmp)]
        Operation::Equal => truth(a == b),
        Operation::Sign if a.is_nan() => a,
        Operation::Sign if a == 0.0 => a,
        Operation::Sign => a.signum(),
        Operation::Innovation if a.is_finite() => a - b,
        Operation::Innovation => 0.0,
        Operation::Select if a == 0.0 => c,
        Operation::Select => b,
        Operation::MultiplyAdd | Operation::ScaleAddRow => a * b + c,
        Operation::MultiplySubtract => a * b - c,
        Operation::SubtractProduct => c - a * b,
        Operation::Clip => {
            let above = if b > a { b } else { a };
            if c < above { c } else { above }
        }
        Operation::Min if b < a => b,
        Operation::Max if b > a => b,
        Operation::Min | Operation::Max => a,
        _ => return None, // elementary functions have tests of their own
    })
}

proptest! {
    #[test]
    fn an_operation_is_what_it_says(
        operation in 0..OPERATIONS.len(), a in any::<f64>(), b in any::<f64>(), c in any::<f64>(),
    ) {
        if let Some(value) = expected(OPERATIONS[operation], a, b, c) {
            prop_assert_eq!(bits(OPERATIONS[operation].apply(a, b, c)), bits(value));
        }
    }

    #[test]
    fn a_program_is_its_operations_one_after_the_other(
        instructions in prop::collection::vec(instruction(), 0..60),
        start in prop::collection::vec(-3.0..3.0_f64, 24),
    ) {
        let program = Program { instructions: &instructions, outputs: &[] };
        let mut registers = Registers::zero();
        registers.0[..24].copy_from_slice(&start);
        let mut by_hand = registers;
        program.run(&mut registers);
        for Instruction { operation, result, a, b, c } in &instructions {
            let (entries, goes) = entries(*operation);
            for i in 0..entries {
                let of = |k: usize| by_hand.0[usize::from([*a, *b, *c][k]) + goes[k] * i];
                by_hand.0[usize::from(*result) + i] = operation.apply(of(0), of(1), of(2));
            }
        }
        for register in 0..REGISTERS {
            prop_assert_eq!(bits(registers.0[register]), bits(by_hand.0[register]));
        }
    }

    #[test]
    fn a_block_of_runs_has_the_bits_of_each(
        instructions in prop::collection::vec(instruction(), 0..40),
        start in prop::collection::vec(-3.0..3.0_f64, 24 * LANES),
    ) {
        check_block(&instructions, &start, |program, mut lanes| {
            program.run_lanes(&mut lanes);
            lanes
        })?;
    }
}

#[test]
fn a_chip_runs_a_program_from_its_flash() {
    // φ = −x₁/(1 + x₁²) − x₂ of Lee, Choi and Khalil (38), in single precision
    const PROGRAM: Program<'static> = Program {
        instructions: &[
            Instruction { operation: Operation::MultiplyAdd, result: 3, a: 0, b: 0, c: 2 },
            Instruction { operation: Operation::Negate, result: 4, a: 0, b: 0, c: 0 },
            Instruction { operation: Operation::Divide, result: 4, a: 4, b: 3, c: 0 },
            Instruction { operation: Operation::Subtract, result: 4, a: 4, b: 1, c: 0 },
        ],
        outputs: &[4],
    };
    let mut registers = Registers::<f32>::zero();
    registers.0[..3].copy_from_slice(&[0.5, 0.25, 1.0]);
    PROGRAM.run(&mut registers);
    assert_eq!(registers.0[usize::from(PROGRAM.outputs[0])].to_bits(), (-0.65_f32).to_bits());
}
