//! Floor 1. Straight-line programs: right-hand sides that are known at run time only.
//!
//! A program is a list of instructions over a file of 256 registers: inputs first, then constants,
//! then what is computed. It has no branch and no jump, so it ends, never panics, needs no heap, and
//! evaluates a block of runs side by side as well as one. Every instruction is one operation of
//! [`Scalar`] (a product and a sum in two roundings count as one), in the order in which they stand:
//! a program gives the bits of compiled code that does the same. To choose an instruction costs more than
//! its arithmetic, so states are moved by instructions for a row of four registers.

// The form that a compiler makes vector code of: an index, and no branch between two truths.
#![allow(clippy::needless_range_loop)]

use crate::Scalar;

/// Registers of a row, one after the other.
pub const ROW: usize = 4;

/// Registers of a program: as many as a `u8` tells apart, and the rest of a row that begins in the
/// last of them, so that no index needs a check.
pub const REGISTERS: usize = 256 + ROW - 1;

/// An operation by its name: the one place that says what each computes.
macro_rules! operation {
    (Negate, $a:expr) => {
        -$a
    };
    (Abs, $a:expr) => {
        $a.abs()
    };
    (Sign, $a:expr) => {
        sign($a)
    };
    (Sqrt, $a:expr) => {
        $a.sqrt()
    };
    (Sin, $a:expr) => {
        $a.sin()
    };
    (Cos, $a:expr) => {
        $a.cos()
    };
    (Tan, $a:expr) => {
        $a.tan()
    };
    (Atan, $a:expr) => {
        $a.atan()
    };
    (Exp, $a:expr) => {
        $a.exp()
    };
    (Ln, $a:expr) => {
        $a.ln()
    };
    (Tanh, $a:expr) => {
        $a.tanh()
    };
    (Add, $a:expr, $b:expr) => {
        $a + $b
    };
    (Subtract, $a:expr, $b:expr) => {
        $a - $b
    };
    (Multiply, $a:expr, $b:expr) => {
        $a * $b
    };
    (Divide, $a:expr, $b:expr) => {
        $a / $b
    };
    (Min, $a:expr, $b:expr) => {
        $a.min($b)
    };
    (Max, $a:expr, $b:expr) => {
        $a.max($b)
    };
    (Power, $a:expr, $b:expr) => {
        $a.powf($b)
    };
    (Atan2, $a:expr, $b:expr) => {
        $a.atan2($b)
    };
    (CopySign, $a:expr, $b:expr) => {
        $a.copysign($b)
    };
    (Less, $a:expr, $b:expr) => {
        truth($a < $b)
    };
    (LessEqual, $a:expr, $b:expr) => {
        truth($a <= $b)
    };
    (Equal, $a:expr, $b:expr) => {
        truth($a == $b)
    };
    (Innovation, $a:expr, $b:expr) => {
        $a.innovation($b)
    };
    (Select, $a:expr, $b:expr, $c:expr) => {
        if $a == T::ZERO { $c } else { $b }
    };
    (MultiplyAdd, $a:expr, $b:expr, $c:expr) => {
        $a * $b + $c
    };
    (MultiplySubtract, $a:expr, $b:expr, $c:expr) => {
        $a * $b - $c
    };
    (SubtractProduct, $a:expr, $b:expr, $c:expr) => {
        $c - $a * $b
    };
    (Clip, $a:expr, $b:expr, $c:expr) => {
        $a.max($b).min($c)
    };
}

/// An operation that is known at run time.
macro_rules! compute {
    ($operation:expr, $a:expr, $b:expr, $c:expr) => {
        match $operation {
            Operation::Negate => operation!(Negate, $a),
            Operation::Abs => operation!(Abs, $a),
            Operation::Sign => operation!(Sign, $a),
            Operation::Sqrt => operation!(Sqrt, $a),
            Operation::Sin => operation!(Sin, $a),
            Operation::Cos => operation!(Cos, $a),
            Operation::Tan => operation!(Tan, $a),
            Operation::Atan => operation!(Atan, $a),
            Operation::Exp => operation!(Exp, $a),
            Operation::Ln => operation!(Ln, $a),
            Operation::Tanh => operation!(Tanh, $a),
            Operation::Add => operation!(Add, $a, $b),
            Operation::Subtract => operation!(Subtract, $a, $b),
            Operation::Multiply => operation!(Multiply, $a, $b),
            Operation::Divide => operation!(Divide, $a, $b),
            Operation::Min => operation!(Min, $a, $b),
            Operation::Max => operation!(Max, $a, $b),
            Operation::Power => operation!(Power, $a, $b),
            Operation::Atan2 => operation!(Atan2, $a, $b),
            Operation::CopySign => operation!(CopySign, $a, $b),
            Operation::Less => operation!(Less, $a, $b),
            Operation::LessEqual => operation!(LessEqual, $a, $b),
            Operation::Equal => operation!(Equal, $a, $b),
            Operation::Innovation => operation!(Innovation, $a, $b),
            Operation::Select => operation!(Select, $a, $b, $c),
            Operation::MultiplyAdd => operation!(MultiplyAdd, $a, $b, $c),
            Operation::MultiplySubtract => operation!(MultiplySubtract, $a, $b, $c),
            Operation::SubtractProduct => operation!(SubtractProduct, $a, $b, $c),
            Operation::Clip => operation!(Clip, $a, $b, $c),
            Operation::AddRows | Operation::ShiftRow => operation!(Add, $a, $b),
            Operation::ScaleRow => operation!(Multiply, $a, $b),
            Operation::ScaleAddRow => operation!(MultiplyAdd, $a, $b, $c),
        }
    };
}

/// 1 or 0.
#[inline(always)]
fn truth<T: Scalar>(holds: bool) -> T {
    if holds { T::ONE } else { T::ZERO }
}

/// −1, 0 or 1, and NaN of NaN.
#[inline(always)]
fn sign<T: Scalar>(a: T) -> T {
    let up = if a > T::ZERO { T::ONE } else { a };
    if a < T::ZERO { -T::ONE } else { up }
}

/// What one instruction computes from its operands a, b and c.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum Operation {
    /// −a.
    Negate,
    /// |a|.
    Abs,
    /// The sign of a: −1, 0 or 1; NaN of NaN.
    Sign,
    /// √a.
    Sqrt,
    /// sin a.
    Sin,
    /// cos a.
    Cos,
    /// tan a.
    Tan,
    /// atan a.
    Atan,
    /// eᵃ.
    Exp,
    /// ln a.
    Ln,
    /// tanh a.
    Tanh,
    /// a + b.
    Add,
    /// a − b.
    Subtract,
    /// a·b.
    Multiply,
    /// a/b.
    Divide,
    /// The smaller of the two, see [`Scalar::min`].
    Min,
    /// The larger of the two, see [`Scalar::max`].
    Max,
    /// aᵇ for a ≥ 0.
    Power,
    /// The angle of the point (b, a), in rad.
    Atan2,
    /// Magnitude of a, sign of b; the sign of NaN is not defined.
    CopySign,
    /// 1 where a < b, else 0.
    Less,
    /// 1 where a ≤ b, else 0.
    LessEqual,
    /// 1 where a = b, else 0.
    Equal,
    /// a − b, and 0 where a is not finite: the innovation of a sample that may be missing.
    Innovation,
    /// b where a is not 0, else c.
    Select,
    /// a·b + c, in two roundings.
    MultiplyAdd,
    /// a·b − c, in two roundings.
    MultiplySubtract,
    /// c − a·b, in two roundings.
    SubtractProduct,
    /// The smaller of c and the larger of a and b.
    Clip,
    /// a + b for a row: entry i is aᵢ + bᵢ, i < [`ROW`], one after the other.
    AddRows,
    /// a + bᵢ.
    ShiftRow,
    /// a·bᵢ.
    ScaleRow,
    /// a·bᵢ + cᵢ, in two roundings.
    ScaleAddRow,
}

impl Operation {
    /// Those for rows: of which operation each is, and how far each operand goes from entry to entry.
    pub const ROWS: [(Self, Self, [u8; 3]); 4] = [
        (Self::ScaleAddRow, Self::MultiplyAdd, [0, 1, 1]),
        (Self::ScaleRow, Self::Multiply, [0, 1, 0]),
        (Self::AddRows, Self::Add, [1, 1, 0]),
        (Self::ShiftRow, Self::Add, [0, 1, 0]),
    ];

    /// Apply it to numbers; an operation for a row to one entry of it.
    #[inline]
    pub fn apply<T: Scalar>(self, a: T, b: T, c: T) -> T {
        compute!(self, a, b, c)
    }
}

/// One instruction: registers of its operands (those it does not need: any) and of its result; of a
/// row, the first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Instruction {
    /// What is computed.
    pub operation: Operation,
    /// Register of the result.
    pub result: u8,
    /// Register of operand a.
    pub a: u8,
    /// Register of operand b.
    pub b: u8,
    /// Register of operand c.
    pub c: u8,
}

/// One number of each of L runs side by side.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(64))]
pub struct Lane<T, const L: usize>(pub [T; L]);

/// Registers of one evaluation: numbers, or [`Lane`]s of them.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub struct Registers<V>(pub [V; REGISTERS]);

impl<T: Scalar> Registers<T> {
    /// All 0.
    #[inline(always)]
    pub fn zero() -> Self {
        Self([T::ZERO; REGISTERS])
    }
}

impl<T: Scalar, const L: usize> Registers<Lane<T, L>> {
    /// These numbers for every run.
    pub fn in_lanes(numbers: &Registers<T>) -> Self {
        Self(numbers.0.map(|number| Lane([number; L])))
    }
}

/// A program that is borrowed from wherever it is kept: the flash of a chip, or memory.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Program<'a> {
    /// The instructions, in order.
    pub instructions: &'a [Instruction],
    /// Registers in which the results stand at the end.
    pub outputs: &'a [u8],
}

impl Program<'_> {
    /// Evaluate once. Inputs and constants stand in `r`, which nothing but the program's own results
    /// is written to.
    #[inline]
    pub fn run<T: Scalar>(&self, r: &mut Registers<T>) {
        let r = &mut r.0;
        for Instruction { operation, result, a, b, c } in self.instructions {
            let [result, a, b, c] = [*result, *a, *b, *c].map(usize::from);
            match operation {
                Operation::AddRows => {
                    for i in 0..ROW {
                        r[result + i] = operation!(Add, r[a + i], r[b + i]);
                    }
                }
                Operation::ShiftRow => {
                    for i in 0..ROW {
                        r[result + i] = operation!(Add, r[a], r[b + i]);
                    }
                }
                Operation::ScaleRow => {
                    for i in 0..ROW {
                        r[result + i] = operation!(Multiply, r[a], r[b + i]);
                    }
                }
                Operation::ScaleAddRow => {
                    for i in 0..ROW {
                        r[result + i] = operation!(MultiplyAdd, r[a], r[b + i], r[c + i]);
                    }
                }
                one => r[result] = compute!(*one, r[a], r[b], r[c]),
            }
        }
    }

    /// Evaluate for a block of runs.
    #[inline(always)]
    pub fn run_lanes<T: Scalar, const L: usize>(&self, r: &mut Registers<Lane<T, L>>) {
        for instruction in self.instructions {
            step_lanes(&mut r.0, *instruction);
        }
    }
}

/// One instruction for all runs of a block.
#[inline(always)]
fn step_lanes<T: Scalar, const L: usize>(
    r: &mut [Lane<T, L>; REGISTERS],
    instruction: Instruction,
) {
    let Instruction { operation, result, a, b, c } = instruction;
    let [result, a, b, c] = [result, a, b, c].map(usize::from);
    // one result; all is read before it is written: registers may be equal
    macro_rules! lanes {
        ($name:ident, $result:expr, $($operand:ident = $from:expr),+) => {{
            let mut out = [T::ZERO; L];
            $(let $operand = &r[$from].0;)+
            for lane in 0..L {
                $(let $operand = $operand[lane];)+
                out[lane] = operation!($name, $($operand),+);
            }
            r[$result].0 = out;
        }};
    }
    // the choice outside of the loops; of an operand for a row, how far it goes from entry to entry
    macro_rules! choice {
        ({ $($name:ident($($operand:ident),+);)+ } rows { $($row:ident: $single:ident($($of:ident $step:literal),+);)+ }) => {
            match operation {
                $(Operation::$name => lanes!($name, result, $($operand = $operand),+),)+
                $(Operation::$row => {
                    for i in 0..ROW {
                        lanes!($single, result + i, $($of = $of + $step * i),+);
                    }
                })+
            }
        };
    }
    choice! {
        {
            Negate(a); Abs(a); Sign(a); Sqrt(a); Sin(a); Cos(a); Tan(a); Atan(a); Exp(a); Ln(a);
            Tanh(a); Add(a, b); Subtract(a, b); Multiply(a, b); Divide(a, b); Min(a, b); Max(a, b);
            Power(a, b); Atan2(a, b); CopySign(a, b); Less(a, b); LessEqual(a, b); Equal(a, b);
            Innovation(a, b); Select(a, b, c); MultiplyAdd(a, b, c); MultiplySubtract(a, b, c);
            SubtractProduct(a, b, c); Clip(a, b, c);
        }
        rows {
            AddRows: Add(a 1, b 1);
            ShiftRow: Add(a 0, b 1);
            ScaleRow: Multiply(a 0, b 1);
            ScaleAddRow: MultiplyAdd(a 0, b 1, c 1);
        }
    }
}
