//! Floor 8. Functions of LLVM's intermediate representation in the making: values of one number or of vectors,
//! operation by operation.
//!
//! Every operation of a table is one instruction without fast-math flags, so that it rounds as the
//! interpreter's does.

use crate::elementary::{self, Precision};
use crate::sparing;
use crate::table::{Table, operands};
use hgo_rs::noise::Law;
use hgo_rs::program::Operation;
use std::collections::{BTreeSet, HashMap};
use std::fmt::Write as _;

/// A value of the function: of all runs, or of each.
#[derive(Clone, Debug)]
pub(super) enum Value {
    /// The name of a number.
    Uniform(String),
    /// Names of vectors, one a copy.
    Each(Vec<String>),
}

/// What kind of number a vector holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Float,
    Bits,
}

/// A function in the making.
pub(super) struct Printer {
    pub(super) lanes: usize,
    pub(super) copies: usize,
    pub(super) next: usize,
    pub(super) lines: Vec<String>,
    /// The block that is being written, and its first line.
    pub(super) label: String,
    pub(super) start: usize,
    /// Vectors of a number, of this block.
    pub(super) splats: HashMap<String, String>,
    /// Functions of the core that are called, with their lanes.
    pub(super) functions: BTreeSet<(&'static str, usize)>,
}

impl Printer {
    pub(super) fn new(lanes: usize, copies: usize) -> Self {
        Self {
            lanes,
            copies,
            next: 0,
            lines: Vec::new(),
            label: String::new(),
            start: 0,
            splats: HashMap::new(),
            functions: BTreeSet::new(),
        }
    }

    pub(super) fn name(&mut self) -> String {
        self.next += 1;
        format!("%v{}", self.next)
    }

    pub(super) fn of(&self, kind: Kind, uniform: bool) -> String {
        let name = match kind {
            Kind::Float => "double",
            Kind::Bits => "i64",
        };
        if uniform || self.lanes == 1 { name.into() } else { format!("<{} x {name}>", self.lanes) }
    }

    pub(super) fn line(&mut self, line: String) {
        self.lines.push(line);
    }

    /// The end of a block. One copy stands alone where many values are needed at a time: its lines come in
    /// an order that needs fewer. (Several copies hide each other's delays only as they are written:
    /// ordered so, they took up to 1.3 times as long.)
    pub(super) fn leave(&mut self, end: &str) {
        if self.copies == 1 {
            let block = self.lines.split_off(self.start.min(self.lines.len()));
            self.lines.extend(sparing::ordered(block));
        }
        self.lines.push(format!("  {end}"));
    }

    /// What a block begins with, once it is known.
    pub(super) fn insert(&mut self, at: usize, phis: Vec<String>) {
        self.start += if at < self.start { phis.len() } else { 0 };
        self.lines.splice(at..at, phis);
    }

    pub(super) fn begin(&mut self, label: &str) {
        self.lines.push(format!("{label}:"));
        self.start = self.lines.len();
        label.clone_into(&mut self.label);
        self.splats.clear();
    }

    /// A constant of every run.
    pub(super) fn constant(value: f64) -> Value {
        Value::Uniform(format!("0x{:016X}", value.to_bits()))
    }

    /// The name of a value in one copy, as a vector.
    pub(super) fn vector(&mut self, value: &Value, copy: usize) -> String {
        match value {
            Value::Each(names) => names[copy].clone(),
            Value::Uniform(name) if self.lanes == 1 => name.clone(),
            Value::Uniform(name) if !name.starts_with('%') => {
                let entries = vec![format!("double {name}"); self.lanes];
                format!("<{}>", entries.join(", "))
            }
            Value::Uniform(name) => {
                if let Some(splat) = self.splats.get(name) {
                    return splat.clone();
                }
                let (first, splat) = (self.name(), self.name());
                let of = self.of(Kind::Float, false);
                self.line(format!("  {first} = insertelement {of} poison, double {name}, i64 0"));
                let mask = format!("<{} x i32> zeroinitializer", self.lanes);
                self.line(format!("  {splat} = shufflevector {of} {first}, {of} poison, {mask}"));
                self.splats.insert(name.clone(), splat.clone());
                splat
            }
        }
    }

    /// One instruction of values, printed by `print` from its type and its operands: once where all are
    /// uniform, else once a copy.
    pub(super) fn apply(
        &mut self,
        values: &[&Value],
        print: impl Fn(&str, &[String]) -> String,
    ) -> Value {
        let names: Option<Vec<String>> = values
            .iter()
            .map(|value| match value {
                Value::Uniform(name) => Some(name.clone()),
                Value::Each(_) => None,
            })
            .collect();
        if let Some(names) = names {
            let result = self.name();
            self.line(format!("  {result} = {}", print("double", &names)));
            return Value::Uniform(result);
        }
        let of = self.of(Kind::Float, false);
        let results = (0..self.copies).map(|copy| {
            let names: Vec<String> = values.iter().map(|value| self.vector(value, copy)).collect();
            let result = self.name();
            self.line(format!("  {result} = {}", print(&of, &names)));
            result
        });
        Value::Each(results.collect())
    }

    pub(super) fn binary(&mut self, name: &str, a: &Value, b: &Value) -> Value {
        self.apply(&[a, b], |of, names| format!("{name} {of} {}, {}", names[0], names[1]))
    }

    /// A call of LLVM's own function of that name.
    pub(super) fn intrinsic(&mut self, name: &str, values: &[&Value]) -> Value {
        let lanes = self.lanes;
        self.apply(values, |of, names| {
            let suffix = if of == "double" { "f64".into() } else { format!("v{lanes}f64") };
            let given: Vec<String> = names.iter().map(|name| format!("{of} {name}")).collect();
            format!("call {of} @llvm.{name}.{suffix}({})", given.join(", "))
        })
    }

    /// A call of an elementary function of the core.
    pub(super) fn call(&mut self, name: &'static str, values: &[&Value]) -> Value {
        let uniform = values.iter().all(|value| matches!(value, Value::Uniform(_)));
        let lanes = if uniform { 1 } else { self.lanes };
        self.functions.insert((name, lanes));
        self.apply(values, |of, names| {
            let given: Vec<String> = names.iter().map(|name| format!("{of} {name}")).collect();
            format!("call {of} {}({})", function_name(name, lanes), given.join(", "))
        })
    }

    /// `then` where the comparison holds, else `otherwise`.
    pub(super) fn choose(
        &mut self,
        compare: (&str, &Value, &Value),
        then: &Value,
        otherwise: &Value,
    ) -> Value {
        let (predicate, a, b) = compare;
        let lanes = self.lanes;
        let truth = self.apply(&[a, b], |of, names| {
            format!("fcmp {predicate} {of} {}, {}", names[0], names[1])
        });
        // a truth of each run chooses between vectors, one of all between numbers
        if let (Value::Uniform(truth), Value::Uniform(x), Value::Uniform(y)) =
            (&truth, then, otherwise)
        {
            let result = self.name();
            self.line(format!("  {result} = select i1 {truth}, double {x}, double {y}"));
            return Value::Uniform(result);
        }
        let of = self.of(Kind::Float, false);
        let results = (0..self.copies).map(|copy| {
            let (x, y) = (self.vector(then, copy), self.vector(otherwise, copy));
            let truth = match &truth {
                Value::Uniform(name) => format!("i1 {name}"),
                Value::Each(names) if lanes == 1 => format!("i1 {}", names[copy]),
                Value::Each(names) => format!("<{lanes} x i1> {}", names[copy]),
            };
            let result = self.name();
            self.line(format!("  {result} = select {truth}, {of} {x}, {of} {y}"));
            result
        });
        Value::Each(results.collect())
    }

    /// An operation of a table; `finite` where a sample is known to be there.
    pub(super) fn operation(&mut self, operation: Operation, of: &[&Value], finite: bool) -> Value {
        let (zero, one) = (Self::constant(0.0), Self::constant(1.0));
        match operation {
            Operation::Negate => self.apply(of, |of, names| format!("fneg {of} {}", names[0])),
            Operation::Abs => self.intrinsic("fabs", of),
            Operation::Sqrt => self.intrinsic("sqrt", of),
            Operation::CopySign => self.intrinsic("copysign", of),
            Operation::Sign => {
                let up = self.choose(("ogt", of[0], &zero), &one, of[0]);
                self.choose(("olt", of[0], &zero), &Self::constant(-1.0), &up)
            }
            Operation::Add => self.binary("fadd", of[0], of[1]),
            Operation::Subtract => self.binary("fsub", of[0], of[1]),
            Operation::Multiply => self.binary("fmul", of[0], of[1]),
            Operation::Divide => self.binary("fdiv", of[0], of[1]),
            Operation::Min => self.choose(("olt", of[1], of[0]), of[1], of[0]),
            Operation::Max => self.choose(("ogt", of[1], of[0]), of[1], of[0]),
            Operation::Less => self.choose(("olt", of[0], of[1]), &one, &zero),
            Operation::LessEqual => self.choose(("ole", of[0], of[1]), &one, &zero),
            Operation::Equal => self.choose(("oeq", of[0], of[1]), &one, &zero),
            Operation::Select => self.choose(("oeq", of[0], &zero), of[2], of[1]),
            Operation::Innovation if finite => self.binary("fsub", of[0], of[1]),
            Operation::Innovation => {
                let size = self.intrinsic("fabs", &of[..1]);
                let e = self.binary("fsub", of[0], of[1]);
                self.choose(("olt", &size, &Self::constant(f64::INFINITY)), &e, &zero)
            }
            Operation::Sin => self.call("sin", of),
            Operation::Cos => self.call("cos", of),
            Operation::Tan => self.call("tan", of),
            Operation::Atan => self.call("atan", of),
            Operation::Exp => self.call("exp", of),
            Operation::Ln => self.call("ln", of),
            Operation::Tanh => self.call("tanh", of),
            Operation::Power => self.call("powf", of),
            Operation::Atan2 => self.call("atan2", of),
            // compiled programs alone hold these
            _ => zero,
        }
    }

    /// The outputs of a table.
    pub(super) fn table(&mut self, table: &Table, inputs: &[&[Value]], finite: bool) -> Vec<Value> {
        let mut values: Vec<Value> = inputs.concat();
        values.resize(table.inputs.len(), Self::constant(0.0));
        values.extend(table.constants.iter().map(|value| Self::constant(*value)));
        for (operation, from) in &table.operations {
            let given: Vec<Value> =
                from.iter().take(operands(*operation)).map(|at| values[*at].clone()).collect();
            let given: Vec<&Value> = given.iter().collect();
            let made = self.operation(*operation, &given, finite);
            values.push(made);
        }
        table.outputs.iter().map(|output| values[*output].clone()).collect()
    }

    /// A column of numbers at `base` + `at` doubles.
    pub(super) fn load(&mut self, kind: Kind, base: &str, at: &str, uniform: bool) -> Value {
        let of = self.of(kind, uniform);
        let one = |printer: &mut Self, copy: usize| {
            let (place, result) = (printer.name(), printer.name());
            let name = if kind == Kind::Float { "double" } else { "i64" };
            let offset = printer.offset(at, copy);
            printer.line(format!("  {place} = getelementptr {name}, ptr %{base}, i64 {offset}"));
            printer.line(format!("  {result} = load {of}, ptr {place}, align 8"));
            result
        };
        if uniform {
            return Value::Uniform(one(self, 0));
        }
        Value::Each((0..self.copies).map(|copy| one(self, copy)).collect())
    }

    pub(super) fn store(&mut self, kind: Kind, base: &str, at: &str, value: &Value, uniform: bool) {
        let of = self.of(kind, uniform);
        let copies = if uniform { 1 } else { self.copies };
        for copy in 0..copies {
            let name = match (value, uniform) {
                (Value::Uniform(name), true) => name.clone(),
                (value, _) => self.vector(value, copy),
            };
            let (place, offset) = (self.name(), self.offset(at, copy));
            let entry = if kind == Kind::Float { "double" } else { "i64" };
            self.line(format!("  {place} = getelementptr {entry}, ptr %{base}, i64 {offset}"));
            self.line(format!("  store {of} {name}, ptr {place}, align 8"));
        }
    }

    /// The place of a copy: a number, or the name of one and the copy's distance.
    pub(super) fn offset(&mut self, at: &str, copy: usize) -> String {
        let far = copy * self.lanes;
        match at.parse::<usize>() {
            Ok(at) => (at + far).to_string(),
            Err(_) if far == 0 => at.to_owned(),
            Err(_) => {
                let sum = self.name();
                self.line(format!("  {sum} = add i64 {at}, {far}"));
                sum
            }
        }
    }

    // --- random numbers --------------------------------------------------------------------------

    /// A call of a function of the core for vectors; its results.
    pub(super) fn call_each(
        &mut self,
        name: &'static str,
        values: &[(Kind, &Value)],
        results: &[Kind],
    ) -> Vec<Value> {
        let lanes = self.lanes;
        self.functions.insert((name, lanes));
        let types: Vec<String> = results.iter().map(|kind| self.of(*kind, false)).collect();
        let whole = match types.as_slice() {
            [one] => one.clone(),
            several => format!("{{ {} }}", several.join(", ")),
        };
        let mut made = vec![Vec::new(); results.len()];
        for copy in 0..self.copies {
            let given: Vec<String> = values
                .iter()
                .map(|(kind, value)| {
                    let of = self.of(*kind, false);
                    format!("{of} {}", self.vector(value, copy))
                })
                .collect();
            let result = self.name();
            let function = function_name(name, lanes);
            self.line(format!("  {result} = call {whole} {function}({})", given.join(", ")));
            if let [only] = made.as_mut_slice() {
                only.push(result);
                continue;
            }
            for (i, made) in made.iter_mut().enumerate() {
                let part = self.name();
                self.line(format!("  {part} = extractvalue {whole} {result}, {i}"));
                made.push(part);
            }
        }
        made.into_iter().map(Value::Each).collect()
    }

    /// Uniform on [0, 1).
    pub(super) fn uniform(&mut self, state: &mut [Value; 4]) -> Value {
        use Kind::{Bits, Float};
        let given: Vec<(Kind, &Value)> = state.iter().map(|word| (Bits, word)).collect();
        let mut made = self.call_each("advanced", &given, &[Bits; 5]).into_iter();
        let bits = made.next().unwrap_or(Self::constant(0.0));
        for (word, next) in state.iter_mut().zip(made) {
            *word = next;
        }
        if self.lanes < 8 {
            return self.call_each("fraction", &[(Bits, &bits)], &[Float]).swap_remove(0);
        }
        // AVX-512 converts whole numbers: the same fraction, exactly
        let (of, from) = (self.of(Float, false), self.of(Bits, false));
        let by = format!("<{}>", vec!["i64 11"; self.lanes].join(", "));
        let Value::Each(words) = bits else { return bits };
        let whole = words.iter().map(|word| {
            let (high, whole) = (self.name(), self.name());
            self.line(format!("  {high} = lshr {from} {word}, {by}"));
            self.line(format!("  {whole} = uitofp {from} {high} to {of}"));
            whole
        });
        let whole = Value::Each(whole.collect());
        self.binary("fmul", &whole, &Self::constant(2.0_f64.powi(-53)))
    }

    /// A standard normal pair.
    pub(super) fn normal_pair(&mut self, state: &mut [Value; 4]) -> [Value; 2] {
        use Kind::Float;
        let (first, second) = (self.uniform(state), self.uniform(state));
        let parts = self.call_each("radius_parts", &[(Float, &first)], &[Float; 2]);
        let given: Vec<(Kind, &Value)> = parts.iter().map(|part| (Float, part)).collect();
        let radius = self.call_each("radius_of", &given, &[Float]).swap_remove(0);
        let pair = self.call_each("turned", &[(Float, &radius), (Float, &second)], &[Float; 2]);
        [0, 1].map(|i| pair.get(i).cloned().unwrap_or(Self::constant(0.0)))
    }

    /// A draw of a law of heavy tails.
    pub(super) fn of_law(&mut self, law: Law, state: &mut [Value; 4]) -> Value {
        let (name, numbers, parameters) = match law {
            Law::StudentT { nu } => ("student_t", 2, vec![nu]),
            Law::Laplace => ("laplace", 2, vec![]),
            Law::Impulsive { probability, ratio } => ("impulsive", 3, vec![probability, ratio]),
        };
        let mut given: Vec<Value> = (0..numbers).map(|_| self.uniform(state)).collect();
        given.extend(parameters.into_iter().map(Self::constant));
        let given: Vec<(Kind, &Value)> = given.iter().map(|value| (Kind::Float, value)).collect();
        self.call_each(name, &given, &[Kind::Float]).swap_remove(0)
    }

    /// A sum of squares so far, and a square more: not below the square of the largest magnitude, and not
    /// a number once one was none. (Rounded once, which costs less; nothing else is made of it.)
    pub(super) fn bounded(&mut self, sum: &Value, value: &Value) -> Value {
        self.intrinsic("fma", &[value, value, sum])
    }
}

/// The name of a function of the core for so many lanes.
fn function_name(name: &str, lanes: usize) -> String {
    elementary::function(name, Precision::Double)
        .map_or_else(String::new, |function| elementary::llvm::name(&function, lanes))
}

/// The functions of the core that a text calls, behind it, and what it declares.
pub(super) fn with_functions(
    text: &mut String,
    lanes: usize,
    functions: BTreeSet<(&'static str, usize)>,
) -> Option<()> {
    let mut declared = BTreeSet::new();
    for lanes in BTreeSet::from([1, lanes]) {
        let of = |kind: &str| {
            if lanes == 1 { kind.to_owned() } else { format!("<{lanes} x {kind}>") }
        };
        let vector = if lanes == 1 { String::new() } else { format!("v{lanes}") };
        let float = of("double");
        for (name, count) in [("fabs", 1), ("sqrt", 1), ("copysign", 2), ("fma", 3)] {
            let given = vec![float.clone(); count].join(", ");
            declared.insert(format!("declare {float} @llvm.{name}.{vector}f64({given})"));
        }
    }
    for (name, lanes) in functions {
        let function = elementary::function(name, Precision::Double)?;
        declared.extend(elementary::llvm::declarations([&function], lanes));
        text.push_str(&elementary::llvm::function_ir(&function, lanes));
    }
    for line in declared {
        let _ = writeln!(text, "{line}");
    }
    Some(())
}
