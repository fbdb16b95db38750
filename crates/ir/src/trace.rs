//! Floor 4. A number that remembers how it was computed: the laws of the core, run over it, write themselves
//! down as a table.
//!
//! Constants are computed with at once, in the precision that was asked for, so that construction and
//! its checks work as for numbers; what depends on an input is recorded, operation by operation and
//! in order, so that the table gives the bits of the law. A decision about a value that is not known
//! yet cannot be recorded: the trace then fails, and says so.

use crate::error::{Result, refused};
use crate::table::{Call, Scheduled, Slot, Table, operands};
use hgo_rs::Scalar;
use hgo_rs::program::Operation;
use std::cell::RefCell;
use std::cmp::Ordering;
use std::collections::HashMap;
use std::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Sub, SubAssign};
use std::sync::Arc;

/// A value of the trace of this thread.
#[derive(Clone, Copy, Debug)]
pub struct Traced(u32);

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Node {
    Constant(u64),
    Input(usize),
    /// A result of a call, counted through all calls.
    Called(usize),
    Result(Operation, [u32; 3]),
}

/// A function that laws call while they are traced.
#[derive(Clone, Debug)]
struct Function {
    table: Table,
    /// Its last inputs.
    parameters: Vec<Traced>,
}

#[derive(Default)]
struct Trace {
    nodes: Vec<Node>,
    known: HashMap<Node, u32>,
    names: Vec<String>,
    functions: Vec<Function>,
    /// Calls of Python functions, with their first results; each is made once for the same arguments.
    calls: Vec<(Call, usize)>,
    called: usize,
    single: bool,
    /// Whether samples are taken to be there.
    present: bool,
    /// What is answered to questions about values that are not known.
    answer: Option<Ordering>,
    /// Values that are known to be above 0: inputs, and products of such.
    positive: Vec<u32>,
    /// Why there is no table.
    refusal: Option<&'static str>,
}

const ZERO: Node = Node::Constant(0);
const ONE: Node = Node::Constant(1.0_f64.to_bits());
const NEG_ZERO: Node = Node::Constant((-0.0_f64).to_bits());

impl Trace {
    fn node(&mut self, node: Node) -> u32 {
        let next = u32::try_from(self.nodes.len()).unwrap_or(u32::MAX);
        let index = *self.known.entry(node).or_insert(next);
        if index == next {
            self.nodes.push(node);
        }
        index
    }

    fn constant(&mut self, value: f64) -> u32 {
        #[allow(clippy::cast_possible_truncation)]
        let held = if self.single { f64::from(value as f32) } else { value };
        self.node(Node::Constant(held.to_bits()))
    }

    fn value(&self, index: u32) -> Option<f64> {
        match self.nodes.get(index as usize) {
            Some(Node::Constant(bits)) => Some(f64::from_bits(*bits)),
            _ => None,
        }
    }

    fn apply(&mut self, operation: Operation, operands: [u32; 3], count: usize) -> u32 {
        let values = operands.map(|index| self.value(index));
        let known: Vec<f64> = values.iter().take(count).filter_map(|value| *value).collect();
        if known.len() == count {
            let [a, b, c] = std::array::from_fn(|i| known.get(i).copied().unwrap_or(0.0));
            #[allow(clippy::cast_possible_truncation)]
            let value = if self.single {
                f64::from(operation.apply(a as f32, b as f32, c as f32))
            } else {
                operation.apply(a, b, c)
            };
            return self.constant(value);
        }
        // what changes no bit is left out
        let [a, b, c] = operands;
        let is = |index, node| self.nodes.get(index as usize) == Some(&node);
        match operation {
            Operation::Add if is(b, NEG_ZERO) => return a,
            Operation::Add if is(a, NEG_ZERO) => return b,
            Operation::Subtract if is(b, ZERO) => return a,
            Operation::Multiply | Operation::Divide if is(b, ONE) => return a,
            Operation::Multiply if is(a, ONE) => return b,
            Operation::Innovation if values[0].is_some_and(|y| !y.is_finite()) => {
                return self.node(ZERO);
            }
            Operation::Select if values[0] == Some(0.0) => return c,
            Operation::Select if values[0].is_some() || b == c => return b,
            _ => {}
        }
        let above = |index| self.positive.contains(&index) || self.value(index) > Some(0.0);
        let of_positive = !self.positive.is_empty() && operation == Operation::Multiply;
        if of_positive && (is(a, ZERO) && above(b) || above(a) && is(b, ZERO)) {
            return self.node(ZERO);
        }
        let positive = of_positive && above(a) && above(b);
        let made = self.node(Node::Result(operation, operands));
        if positive {
            self.positive.push(made);
        }
        made
    }

    /// The results of a call, for arguments that are nodes.
    fn call(&mut self, call: &Call, arguments: Vec<usize>) -> Vec<u32> {
        let same = |(known, _): &&(Call, usize)| {
            Arc::ptr_eq(&known.function, &call.function) && known.arguments == arguments
        };
        let first = if let Some((_, first)) = self.calls.iter().find(same) {
            *first
        } else {
            let first = self.called;
            self.called += call.results;
            self.calls.push((Call { arguments, ..call.clone() }, first));
            first
        };
        (first..first + call.results).map(|result| self.node(Node::Called(result))).collect()
    }
}

const DECIDES: &str = "this observer branches on values while it runs, and cannot be compiled to a table \
                       of operations: choose a law or a method without branches";

thread_local! {
    static TRACE: RefCell<Trace> = RefCell::default();
}

fn with<R>(f: impl FnOnce(&mut Trace) -> R) -> R {
    TRACE.with(|trace| f(&mut trace.borrow_mut()))
}

/// How to trace.
#[derive(Clone, Copy, Debug)]
pub struct Setting {
    /// In single precision.
    pub single: bool,
    /// Whether samples are there.
    pub present: bool,
    /// What is answered to every comparison of values that are not known; `None`: it cannot be.
    pub answer: Option<Ordering>,
    /// What the gains of placed corrections are.
    pub gains: PlacedGains,
    /// Whether a constant gain ℓ is an input of the table, behind the parameters of the model.
    pub free_gain: bool,
}

/// Gains of a placed correction in a table.
#[derive(Clone, Copy, Debug)]
pub enum PlacedGains {
    /// Computed in the table from the time that the correction is for.
    Computed,
    /// Constants: for times of this length only.
    For(f64),
    /// Inputs of the table where they depend on that time alone; else computed.
    Given,
    /// Inputs where they depend on that time alone and no operations compute them; else computed.
    Held,
}

impl Setting {
    /// Samples are there, and nothing is decided.
    pub fn usual(single: bool) -> Self {
        Self { single, present: true, answer: None, gains: PlacedGains::Computed, free_gain: false }
    }
}

/// Trace `law`, which names its inputs and gives its outputs with their names.
pub fn trace(
    setting: Setting,
    law: impl FnOnce() -> Result<Vec<(String, Traced)>>,
) -> Result<Table> {
    begin(setting);
    end(law()?)
}

fn begin(Setting { single, present, answer, .. }: Setting) {
    with(|trace| {
        *trace = Trace { single, present, answer, ..Trace::default() };
        // in the order of the constants of `Scalar`
        for node in [ZERO, ONE, NEG_ZERO] {
            trace.node(node);
        }
    });
}

/// The table of what was traced.
fn end(outputs: Vec<(String, Traced)>) -> Result<Table> {
    let Trace { nodes, names, refusal, calls, called, .. } = with(std::mem::take);
    if let Some(reason) = refusal {
        return Err(refused(reason));
    }
    let constants = nodes.iter().filter(|node| matches!(node, Node::Constant(_))).count();
    let of_calls = names.len();
    let mut next_constant = of_calls + called;
    let mut next_result = next_constant + constants;
    let mut table = Table { inputs: names, ..Table::default() };
    let mut place: Vec<Slot> = Vec::with_capacity(nodes.len());
    for node in nodes {
        place.push(match node {
            Node::Input(index) => index,
            Node::Called(result) => of_calls + result,
            Node::Constant(bits) => {
                table.constants.push(f64::from_bits(bits));
                next_constant += 1;
                next_constant - 1
            }
            Node::Result(operation, values) => {
                let values = values.map(|value| place.get(value as usize).copied().unwrap_or(0));
                table.operations.push((operation, values));
                next_result += 1;
                next_result - 1
            }
        });
    }
    for (call, _) in calls {
        let arguments = call.arguments.iter().map(|node| place[*node]).collect();
        table.calls.push(Call { arguments, ..call });
    }
    for (name, Traced(index)) in outputs {
        table.outputs.push(place[index as usize]);
        table.output_names.push(name);
    }
    Ok(table.trimmed())
}

/// A new input.
pub fn input(name: &str) -> Traced {
    with(|trace| {
        let index = trace.names.len();
        trace.names.push(name.to_owned());
        Traced(trace.node(Node::Input(index)))
    })
}

/// A new input that is above 0.
pub fn positive(name: &str) -> Traced {
    let Traced(index) = input(name);
    with(|trace| trace.positive.push(index));
    Traced(index)
}

/// Let the trace end without a table, for this reason.
pub fn refuse(reason: &'static str) {
    with(|trace| trace.refusal = Some(reason));
}

/// New inputs `name[0]`, `name[1]`, …
pub fn inputs(name: &str, count: usize) -> Vec<Traced> {
    (0..count).map(|i| input(&format!("{name}[{i}]"))).collect()
}

/// Outputs `name[0]`, `name[1]`, …
pub fn named(name: &str, values: &[Traced]) -> Vec<(String, Traced)> {
    values.iter().enumerate().map(|(i, value)| (format!("{name}[{i}]"), *value)).collect()
}

/// The outputs of a table for these inputs.
pub fn inline(table: &Table, inputs: &[Traced]) -> Vec<Traced> {
    with(|trace| {
        let mut values: Vec<u32> = inputs.iter().map(|Traced(index)| *index).collect();
        values.resize(table.inputs.len() + table.called(), 0);
        for constant in &table.constants {
            values.push(trace.constant(*constant));
        }
        let calls = Scheduled::of(table);
        let mut result = table.inputs.len();
        for index in 0..=table.operations.len() {
            for call in calls.before(index) {
                let given = call.arguments.iter().map(|value| values[*value] as usize).collect();
                for node in trace.call(call, given) {
                    values[result] = node;
                    result += 1;
                }
            }
            if let Some((operation, from)) = table.operations.get(index) {
                let from = from.map(|value| values.get(value).copied().unwrap_or(0));
                values.push(trace.apply(*operation, from, operands(*operation)));
            }
        }
        table.outputs.iter().map(|value| Traced(values[*value])).collect()
    })
}

/// The results of a function of numbers, called where the table stands.
pub fn native(
    function: Arc<dyn crate::Function>,
    arguments: &[Traced],
    results: usize,
) -> Vec<Traced> {
    let call = Call { function, arguments: Vec::new(), results };
    let arguments = arguments.iter().map(|Traced(index)| *index as usize).collect();
    with(|trace| trace.call(&call, arguments)).into_iter().map(Traced).collect()
}

/// Keep a function for the rest of the trace; its last inputs are `parameters`.
pub fn function(table: Table, parameters: Vec<Traced>) -> usize {
    with(|trace| {
        trace.functions.push(Function { table, parameters });
        trace.functions.len() - 1
    })
}

/// A function that was kept, and its parameters.
pub fn kept(function: usize) -> (Table, Vec<Traced>) {
    let found = with(|trace| trace.functions.get(function).cloned());
    found.map_or_else(Default::default, |Function { table, parameters }| (table, parameters))
}

/// Call a function that was kept.
pub fn call(function: usize, arguments: &[Traced]) -> Vec<Traced> {
    let (table, parameters) = kept(function);
    inline(&table, &[arguments, &parameters].concat())
}

/// The result of an operation of this trace.
pub fn apply<const K: usize>(operation: Operation, operands: [Traced; K]) -> Traced {
    record(operation, std::array::from_fn(|i| operands.get(i).copied().unwrap_or(Traced(0))), K)
}

/// The same for all numbers of operands.
#[inline(never)]
fn record(operation: Operation, operands: [Traced; 3], count: usize) -> Traced {
    Traced(with(|trace| trace.apply(operation, operands.map(|Traced(index)| index), count)))
}

/// `a` where the value is positive, else `b`.
pub fn if_positive(value: Traced, a: Traced, b: Traced) -> Traced {
    if_above(value, Traced::ZERO, a, b)
}

/// `a` where `value` > `other`, else `b`.
#[inline(never)]
fn if_above(value: Traced, other: Traced, a: Traced, b: Traced) -> Traced {
    apply(Operation::Select, [apply(Operation::Less, [other, value]), a, b])
}

/// 0 where the value is finite, else NaN.
pub fn nothing(value: Traced) -> Traced {
    apply(Operation::Subtract, [value, value])
}

/// `a` where the values are equal, else `b`.
pub fn if_equal(values: [Traced; 2], a: Traced, b: Traced) -> Traced {
    apply(Operation::Select, [apply(Operation::Equal, values), a, b])
}

/// A question about values: its answer if they are constants.
#[inline(never)]
fn decide(a: Traced, b: Traced) -> Option<Ordering> {
    with(|trace| {
        if let (Some(a), Some(b)) = (trace.value(a.0), trace.value(b.0)) {
            return a.partial_cmp(&b);
        }
        if trace.positive.contains(&a.0) && trace.value(b.0) == Some(0.0) {
            return Some(Ordering::Greater);
        }
        if trace.answer.is_none() {
            trace.refusal = Some(DECIDES);
        }
        trace.answer
    })
}

impl Default for Traced {
    fn default() -> Self {
        Self::ZERO
    }
}

impl PartialEq for Traced {
    fn eq(&self, other: &Self) -> bool {
        decide(*self, *other) == Some(Ordering::Equal)
    }
}

impl PartialOrd for Traced {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        decide(*self, *other)
    }
}

// Out of line, since laws of all orders are full of them.
macro_rules! arithmetic {
    ($($name:ident $method:ident $assign:ident $assigned:ident $operation:ident;)+) => {$(
        impl $name for Traced {
            type Output = Self;
            #[inline(never)]
            fn $method(self, other: Self) -> Self {
                apply(Operation::$operation, [self, other])
            }
        }
        impl $assign for Traced {
            fn $assigned(&mut self, other: Self) {
                *self = $name::$method(*self, other);
            }
        }
    )+};
}

arithmetic! {
    Add add AddAssign add_assign Add;
    Sub sub SubAssign sub_assign Subtract;
    Mul mul MulAssign mul_assign Multiply;
    Div div DivAssign div_assign Divide;
}

impl Neg for Traced {
    type Output = Self;
    #[inline(never)]
    fn neg(self) -> Self {
        apply(Operation::Negate, [self])
    }
}

macro_rules! recorded {
    ($($method:ident($($other:ident)?) $operation:ident;)+) => {$(
        #[inline(never)]
        fn $method(self $(, $other: Self)?) -> Self {
            apply(Operation::$operation, [self $(, $other)?])
        }
    )+};
}

impl Scalar for Traced {
    const ZERO: Self = Self(0);
    const ONE: Self = Self(1);
    const NEG_ZERO: Self = Self(2);
    #[inline(never)]
    fn from_f64(value: f64) -> Self {
        Self(with(|trace| trace.constant(value)))
    }
    fn from_u64(value: u64) -> Self {
        Self::from_f64(value as f64)
    }
    #[inline(never)]
    fn to_f64(self) -> f64 {
        with(|trace| trace.value(self.0)).unwrap_or(f64::NAN)
    }
    #[inline(never)]
    fn is_finite(self) -> bool {
        // of the inputs only samples are asked; a result that is not finite is found when it is there
        with(|trace| match trace.nodes.get(self.0 as usize) {
            Some(Node::Constant(bits)) => f64::from_bits(*bits).is_finite(),
            Some(Node::Input(_)) => trace.present,
            _ => true,
        })
    }
    recorded! {
        abs() Abs; sqrt() Sqrt; sin() Sin; cos() Cos; tan() Tan; atan() Atan; exp() Exp; ln() Ln;
        tanh() Tanh; copysign(sign) CopySign; powf(power) Power; atan2(x) Atan2;
        min(other) Min; max(other) Max; innovation(x_hat) Innovation;
    }
    #[inline(never)]
    fn nearest(self) -> Self {
        // as the numbers of the trace's precision do it
        let single = with(|trace| trace.single);
        let shift = Self::from_f64(if single { 12_582_912.0 } else { 6_755_399_441_055_744.0 });
        self + shift - shift
    }
    #[inline(never)]
    fn or(self, other: Self) -> Self {
        apply(Operation::Select, [self, self, other])
    }
    #[inline(never)]
    fn while_missing(self, y: Self) -> Self {
        let nothing = apply(Operation::Subtract, [y, y]); // NaN if y is not finite
        let present = apply(Operation::Equal, [nothing, nothing]);
        apply(Operation::Select, [present, Self::ZERO, self])
    }
    #[inline(never)]
    fn where_above(self, other: Self, then: Self, otherwise: Self) -> Self {
        if_above(self, other, then, otherwise)
    }
    #[inline(never)]
    fn passed(self, dt: Self) -> Self {
        let none = apply(Operation::Less, [self, Self::ZERO]);
        apply(Operation::Select, [none, self, self + dt])
    }
}
