//! Floor 0. An observer from the numbers that `hgo_ir::live` makes of it.

use hgo_rs::injection::Placement;
use hgo_rs::program::{Instruction, Operation, Program};

/// Operations, by the numbers that stand for them.
const OPERATIONS: [Operation; 33] = {
    use Operation as O;
    [
        O::Negate,
        O::Abs,
        O::Sign,
        O::Sqrt,
        O::Sin,
        O::Cos,
        O::Tan,
        O::Atan,
        O::Exp,
        O::Ln,
        O::Tanh,
        O::Add,
        O::Subtract,
        O::Multiply,
        O::Divide,
        O::Min,
        O::Max,
        O::Power,
        O::Atan2,
        O::CopySign,
        O::Less,
        O::LessEqual,
        O::Equal,
        O::Innovation,
        O::Select,
        O::MultiplyAdd,
        O::MultiplySubtract,
        O::SubtractProduct,
        O::Clip,
        O::AddRows,
        O::ShiftRow,
        O::ScaleRow,
        O::ScaleAddRow,
    ]
};

/// They stand in the order in which the core declares them.
const IN_ORDER: bool = {
    let (mut i, mut so) = (0, true);
    while i < OPERATIONS.len() {
        so &= OPERATIONS[i] as usize == i;
        i += 1;
    }
    so
};
const _: [(); 1] = [(); IN_ORDER as usize];

/// A program that is kept here.
pub struct Step {
    instructions: Vec<Instruction>,
    /// Registers of the outputs.
    pub outputs: Vec<u8>,
    /// Constants and their registers.
    pub constants: Vec<(u8, f64)>,
}

impl Step {
    /// The program itself.
    pub fn program(&self) -> Program<'_> {
        Program { instructions: &self.instructions, outputs: &self.outputs }
    }
}

/// An observer of one output whose gain is an input.
pub struct Live {
    /// Place of its law in the list of laws.
    pub law: usize,
    /// Estimated states.
    pub n: usize,
    /// Second size of its law.
    pub size: usize,
    /// Coefficients of its law, list after list.
    pub coefficients: Vec<f64>,
    /// How its corrections are placed, where their gains are inputs.
    pub placement: Option<Placement>,
    /// Known inputs.
    pub n_u: usize,
    /// Whether it filters.
    pub current: bool,
    /// Memory to start from.
    pub initial: Vec<f64>,
    /// Parameters, of which the last is the gain.
    pub parameters: Vec<f64>,
    /// Gains of corrections that are inputs.
    pub gains: usize,
    /// From sample to sample.
    pub whole: Step,
    /// The correction alone, where it filters.
    pub correct: Option<Step>,
}

impl Live {
    /// `None` where these are not the numbers of an observer.
    pub fn read(numbers: &[f64]) -> Option<Self> {
        let mut of = Reader(numbers);
        let (law, n, size) = (of.count()?, of.count()?, of.count()?);
        let coefficients = of.list()?;
        let placement = match of.number()? {
            0.0 => Some(Placement::Exact),
            1.0 => Some(Placement::Bilinear),
            2.0 => Some(Placement::ImplicitMap),
            _ => None,
        };
        let (memory, n_u, current) = (of.count()?, of.count()?, of.number()? > 0.0);
        let initial = of.some(memory)?;
        let (parameters, gains) = (of.list()?, of.count()?);
        let whole = of.step()?;
        let correct = if current { Some(of.step()?) } else { None };
        if !of.0.is_empty() || parameters.is_empty() || n > memory {
            return None;
        }
        Some(Self {
            law,
            n,
            size,
            coefficients,
            placement,
            n_u,
            current,
            initial,
            parameters,
            gains,
            whole,
            correct,
        })
    }

    /// Entries of the memory.
    pub fn memory(&self) -> usize {
        self.initial.len()
    }
}

/// What is left to read.
struct Reader<'a>(&'a [f64]);

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
impl Reader<'_> {
    fn number(&mut self) -> Option<f64> {
        let (first, rest) = self.0.split_first()?;
        self.0 = rest;
        Some(*first)
    }

    fn count(&mut self) -> Option<usize> {
        self.number().filter(|count| (0.0..1e9).contains(count)).map(|count| count as usize)
    }

    fn some(&mut self, count: usize) -> Option<Vec<f64>> {
        let (some, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(some.to_vec())
    }

    fn list(&mut self) -> Option<Vec<f64>> {
        let count = self.count()?;
        self.some(count)
    }

    fn step(&mut self) -> Option<Step> {
        let pairs = self.count()?;
        let pairs = self.some(2 * pairs)?;
        let constants = pairs.chunks_exact(2).map(|pair| (pair[0] as u8, pair[1])).collect();
        let outputs = self.list()?.into_iter().map(|register| register as u8).collect();
        let instruction = |packed: f64| {
            let [.., operation, result, a, b, c] = (packed as u64).to_be_bytes();
            let operation = *OPERATIONS.get(usize::from(operation))?;
            Some(Instruction { operation, result, a, b, c })
        };
        let instructions = self.list()?.into_iter().map(instruction).collect::<Option<_>>()?;
        Some(Step { instructions, outputs, constants })
    }
}
