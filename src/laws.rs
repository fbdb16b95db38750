//! Floor 1. What is said of a law in the one list of laws, [`for_each_law!`](crate::for_each_law).

use crate::error::DesignError;

/// A law, as a spec, a file or a table of the documentation describes it.
#[derive(Clone, Copy, Debug)]
pub struct Law {
    /// The word for it in specs and in `observer.toml`.
    pub kind: &'static str,
    /// Its name in words.
    pub title: &'static str,
    /// Lists of coefficients, by their names in specs.
    pub coefficients: &'static [Part],
    /// A second size beside the order: its name in specs, and what it may be, the usual value first.
    pub size: Option<(&'static str, &'static [usize])>,
    /// Orders that are built at run time.
    pub orders: &'static [usize],
    /// How coefficients are found from poles, for laws that are designed so.
    pub design: Option<Design>,
    /// Gain laws that it takes.
    pub gain: Gain,
    /// Whether it has a saturation, whose levels and clip a spec gives.
    pub saturated: bool,
    /// Whether that saturation may be left out.
    pub open: bool,
    /// Form of the model that it takes.
    pub form: Form,
    /// Whether it is given by a rate, which a scheme discretises; else it is a recursion.
    pub continuous: bool,
    /// The methods that it has beside those of rates.
    pub steps: Steps,
    /// Parts of its memory in order, without the time that current timing holds behind them.
    pub memory: &'static [Part],
    /// Paper and equations.
    pub source: &'static str,
}

/// A list of numbers that belongs to a law.
#[derive(Clone, Copy, Debug)]
pub struct Part {
    /// Its name.
    pub name: &'static str,
    /// How many numbers, in words: `n - 1`.
    pub count: &'static str,
    /// How many numbers.
    pub len: fn(&Sizes) -> usize,
}

/// Sizes that counts depend on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Sizes {
    /// Estimated states.
    pub n: usize,
    /// The second size: copies, or states of a filter.
    pub m: usize,
    /// Whether the gain moves, and r is a part of the memory.
    pub moves: bool,
    /// Whether the gain wears a shape that remembers a threshold, and σ is a part of the memory.
    pub threshold: bool,
    /// Measured outputs.
    pub outputs: usize,
    /// Known inputs.
    pub inputs: usize,
}

/// How the coefficients of a law are found from poles.
#[derive(Clone, Copy, Debug)]
pub struct Design {
    /// How many poles.
    pub poles: Part,
    /// The coefficients.
    pub place: Place,
    /// The poles of a design that names none.
    pub usual: fn(&mut [(f64, f64)]),
}

/// Writes a law's coefficients, list after list, from poles (real part, imaginary part).
pub type Place = fn(&Sizes, &[(f64, f64)], &mut [f64]) -> Result<(), DesignError>;

/// Gain laws that a law takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Gain {
    /// Any of [`crate::gain`].
    Any,
    /// [`crate::gain::AdaptiveGain`] alone.
    Adaptive,
    /// [`crate::gain::ConstantGain`] alone, without a shape.
    Constant,
    /// None: the gain is in the coefficients, or in the model.
    None,
}

/// Forms of a model: see [`crate::model`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Form {
    /// None: a differentiator.
    Unknown,
    /// Known terms in the last equation only: [`crate::model::PhaseVariable`].
    Phase,
    /// Known terms in every equation, or in the last only: [`crate::model::Model`].
    Triangular,
    /// The same, and known terms of the state that follows, by their [slopes](crate::model::Model::slopes).
    Chain,
    /// A recursion's right-hand side and correction: [`crate::model::SampledModel`].
    Sampled,
    /// Measured states, then unmeasured ones: [`crate::model::StrictFeedback`].
    StrictFeedback,
}

/// Methods of a law.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Steps {
    /// Those of rates alone.
    Rates,
    /// Its chain can move exactly (`proper`): see [`crate::motion::Flow`].
    Exact,
    /// Its eigenvalues can be placed too (`zoh`, `bilinear`, `implicit-map`): see [`crate::injection`].
    Placed,
}

impl Law {
    /// Whether its eigenvalues can be placed.
    pub fn placed(&self) -> bool {
        self.steps == Steps::Placed
    }

    /// Whether its chain can move exactly.
    pub fn flows(&self) -> bool {
        self.steps != Steps::Rates
    }

    /// The law that specs call `kind`.
    pub fn find(list: &'static [Law], kind: &str) -> Option<&'static Law> {
        list.iter().find(|law| law.kind == kind)
    }

    /// Entries of its memory.
    pub fn memory_len(&self, sizes: &Sizes) -> usize {
        self.memory.iter().map(|part| (part.len)(sizes)).sum()
    }
}

/// A [`Part`] from its name and its count in the words of [`for_each_law!`](crate::for_each_law).
macro_rules! part {
    ($name:ident ($($count:tt)+)) => {
        $crate::laws::Part {
            name: stringify!($name),
            count: stringify!($($count)+),
            len: $crate::laws::count!($($count)+),
        }
    };
}
pub(crate) use part;

/// A count in the words of [`for_each_law!`](crate::for_each_law), as a function of the sizes.
macro_rules! count {
    (1) => {
        |_| 1
    };
    (n) => {
        |sizes| sizes.n
    };
    (2) => {
        |_| 2
    };
    (n - 2) => {
        |sizes| sizes.n.saturating_sub(2)
    };
    (2 n - 2) => {
        |sizes| (2 * sizes.n).saturating_sub(2)
    };
    (n - 1) => {
        |sizes| sizes.n.saturating_sub(1)
    };
    (2 n - 1) => {
        |sizes| (2 * sizes.n).saturating_sub(1)
    };
    (m) => {
        |sizes| sizes.m
    };
    (n (n + 1)/2) => {
        |sizes| sizes.n * (sizes.n + 1) / 2
    };
    (n m) => {
        |sizes| sizes.n * sizes.m
    };
    (n + m) => {
        |sizes| sizes.n + sizes.m
    };
    (m (n + 1)) => {
        |sizes| sizes.m * (sizes.n + 1)
    };
    (moves) => {
        |sizes| usize::from(sizes.moves)
    };
    (threshold) => {
        |sizes| usize::from(sizes.threshold)
    };
    (outputs) => {
        |sizes| sizes.outputs
    };
    (inputs) => {
        |sizes| sizes.inputs
    };
}
pub(crate) use count;
