//! Floor 11. Studies printed as LLVM IR: one function that moves vectors of runs over a span of samples.
//!
//! Every operation of the tables is one instruction without fast-math flags, so that it rounds as the
//! interpreter's does. What is the same for all runs is a number, computed once; everything else is a
//! vector, of which several copies stand side by side, operation by operation, since a processor works
//! on more of them at once than one chain of operations keeps busy.

use crate::elementary::{self, Precision};
use crate::sparing;
use crate::study::{DrawKind, Instant, LANES, Study};
use crate::table::{Table, operands};
use hgo_rs::program::Operation;
use std::collections::{BTreeSet, HashMap};
use std::fmt::Write as _;

/// Numbers of an [`Instant`](crate::study::Instant).
const ROW: usize = size_of::<Instant>() / size_of::<f64>();

/// Sums of squares that bounds are watched by, so that none waits for the other.
pub const SUMS: usize = 2;

/// A kernel's parameters, in order.
const PARAMETERS: [&str; 9] = [
    "columns",
    "shared",
    "measurement",
    "process",
    "rows",
    "recorded",
    "shown",
    "worst",
    "distances",
];

/// A value of the function: of all runs, or of each.
#[derive(Clone, Debug)]
enum Value {
    /// The name of a number.
    Uniform(String),
    /// Names of vectors, one a copy.
    Each(Vec<String>),
}

/// What kind of number a vector holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Float,
    Bits,
}

/// A function in the making.
struct Printer {
    lanes: usize,
    copies: usize,
    next: usize,
    lines: Vec<String>,
    /// The block that is being written, and its first line.
    label: String,
    start: usize,
    /// Vectors of a number, of this block.
    splats: HashMap<String, String>,
    /// Functions of the core that are called, with their lanes.
    functions: BTreeSet<(&'static str, usize)>,
}

impl Printer {
    fn name(&mut self) -> String {
        self.next += 1;
        format!("%v{}", self.next)
    }

    fn of(&self, kind: Kind, uniform: bool) -> String {
        let name = match kind {
            Kind::Float => "double",
            Kind::Bits => "i64",
        };
        if uniform || self.lanes == 1 { name.into() } else { format!("<{} x {name}>", self.lanes) }
    }

    fn line(&mut self, line: String) {
        self.lines.push(line);
    }

    /// The end of a block. One copy stands alone where many values are needed at a time: its lines come in
    /// an order that needs fewer. (Several copies hide each other's delays only as they are written:
    /// ordered so, they took up to 1.3 times as long.)
    fn leave(&mut self, end: &str) {
        if self.copies == 1 {
            let block = self.lines.split_off(self.start.min(self.lines.len()));
            self.lines.extend(sparing::ordered(block));
        }
        self.lines.push(format!("  {end}"));
    }

    /// What a block begins with, once it is known.
    fn insert(&mut self, at: usize, phis: Vec<String>) {
        self.start += if at < self.start { phis.len() } else { 0 };
        self.lines.splice(at..at, phis);
    }

    fn begin(&mut self, label: &str) {
        self.lines.push(format!("{label}:"));
        self.start = self.lines.len();
        label.clone_into(&mut self.label);
        self.splats.clear();
    }

    /// A constant of every run.
    fn constant(value: f64) -> Value {
        Value::Uniform(format!("0x{:016X}", value.to_bits()))
    }

    /// The name of a value in one copy, as a vector.
    fn vector(&mut self, value: &Value, copy: usize) -> String {
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
    fn apply(&mut self, values: &[&Value], print: impl Fn(&str, &[String]) -> String) -> Value {
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

    fn binary(&mut self, name: &str, a: &Value, b: &Value) -> Value {
        self.apply(&[a, b], |of, names| format!("{name} {of} {}, {}", names[0], names[1]))
    }

    /// A call of LLVM's own function of that name.
    fn intrinsic(&mut self, name: &str, values: &[&Value]) -> Value {
        let lanes = self.lanes;
        self.apply(values, |of, names| {
            let suffix = if of == "double" { "f64".into() } else { format!("v{lanes}f64") };
            let given: Vec<String> = names.iter().map(|name| format!("{of} {name}")).collect();
            format!("call {of} @llvm.{name}.{suffix}({})", given.join(", "))
        })
    }

    /// A call of an elementary function of the core.
    fn call(&mut self, name: &'static str, values: &[&Value]) -> Value {
        let uniform = values.iter().all(|value| matches!(value, Value::Uniform(_)));
        let lanes = if uniform { 1 } else { self.lanes };
        self.functions.insert((name, lanes));
        self.apply(values, |of, names| {
            let given: Vec<String> = names.iter().map(|name| format!("{of} {name}")).collect();
            format!("call {of} {}({})", function_name(name, lanes), given.join(", "))
        })
    }

    /// `then` where the comparison holds, else `otherwise`.
    fn choose(
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
    fn operation(&mut self, operation: Operation, of: &[&Value], finite: bool) -> Value {
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
    fn table(&mut self, table: &Table, inputs: &[&[Value]], finite: bool) -> Vec<Value> {
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
    fn load(&mut self, kind: Kind, base: &str, at: &str, uniform: bool) -> Value {
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

    fn store(&mut self, kind: Kind, base: &str, at: &str, value: &Value, uniform: bool) {
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
    fn offset(&mut self, at: &str, copy: usize) -> String {
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
    fn call_each(
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
    fn uniform(&mut self, state: &mut [Value; 4]) -> Value {
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
    fn normal_pair(&mut self, state: &mut [Value; 4]) -> [Value; 2] {
        use Kind::Float;
        let (first, second) = (self.uniform(state), self.uniform(state));
        let parts = self.call_each("radius_parts", &[(Float, &first)], &[Float; 2]);
        let given: Vec<(Kind, &Value)> = parts.iter().map(|part| (Float, part)).collect();
        let radius = self.call_each("radius_of", &given, &[Float]).swap_remove(0);
        let pair = self.call_each("turned", &[(Float, &radius), (Float, &second)], &[Float; 2]);
        [0, 1].map(|i| pair.get(i).cloned().unwrap_or(Self::constant(0.0)))
    }

    /// A sum of squares so far, and a square more: not below the square of the largest magnitude, and not
    /// a number once one was none. (Rounded once, which costs less; nothing else is made of it.)
    fn bounded(&mut self, sum: &Value, value: &Value) -> Value {
        self.intrinsic("fma", &[value, value, sum])
    }
}

/// The name of a function of the core for so many lanes.
fn function_name(name: &str, lanes: usize) -> String {
    elementary::function(name, Precision::Double)
        .map_or_else(String::new, |function| elementary::llvm::name(&function, lanes))
}

/// A study's kernels as source.
#[derive(Clone, Debug)]
pub struct Source {
    /// LLVM IR, with the functions of the core that it calls.
    pub text: String,
    /// For each number of open windows, with and without distances, the name of its function.
    pub names: Vec<(usize, bool, String)>,
}

impl Study {
    /// The study as LLVM IR for vectors of `lanes` runs, `copies` of them side by side; `None` where
    /// functions of the user's are called, or the block is no multiple of so many runs.
    pub fn kernel(&self, lanes: usize, copies: usize) -> Option<Source> {
        if self.tables.calls() || lanes * copies == 0 || !LANES.is_multiple_of(lanes * copies) {
            return None;
        }
        let mut source = Source { text: String::new(), names: Vec::new() };
        let mut functions = BTreeSet::new();
        for (open, distances) in self.forms() {
            let name = format!("span_{open}_{}", u8::from(distances));
            let kernel = Kernel { study: self, open, distances };
            let printer = kernel.print(lanes, copies);
            let given = PARAMETERS.map(|name| format!("ptr noalias %{name}")).join(", ");
            // writing to a string does not fail
            let _ = writeln!(source.text, "define void @{name}({given}, i64 %n) {{");
            for line in &printer.lines {
                let _ = writeln!(source.text, "{line}");
            }
            let _ = writeln!(source.text, "  ret void\n}}");
            functions.extend(printer.functions);
            source.names.push((open, distances, name));
        }
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
            source.text.push_str(&elementary::llvm::function_ir(&function, lanes));
        }
        for line in declared {
            let _ = writeln!(source.text, "{line}");
        }
        Some(source)
    }

    /// How many vectors of so many runs stand side by side. Few values leave room for more chains of
    /// operations than what is carried from sample to sample has registers for; many spill even alone.
    /// (Found by timing the five papers' studies.)
    pub fn copies(&self, lanes: usize) -> usize {
        let suited = match self.tables.width() {
            9..=24 => 4,
            0..=45 => 2,
            _ => 1,
        };
        suited.min(LANES / lanes.max(1))
    }

    /// Numbers of windows that are open at a time, with and without distances.
    pub(crate) fn forms(&self) -> BTreeSet<(usize, bool)> {
        let windows = self.plan.windows.iter();
        let all = windows.chain(&self.plan.histogram);
        let edges = all.flat_map(|window| [window.from, window.to]).chain([0]);
        let at = edges.filter(|k| *k < self.plan.steps);
        at.map(|k| {
            let open = self.plan.windows.iter().filter(|window| window.contains(k)).count();
            (open, self.plan.histogram.is_some_and(|window| window.contains(k)))
        })
        .collect()
    }
}

/// A function for spans in which so many windows are open.
struct Kernel<'a> {
    study: &'a Study,
    open: usize,
    distances: bool,
}

/// What a span carries from sample to sample.
struct State {
    x: Vec<Value>,
    z: Vec<Value>,
    noise: Vec<Value>,
    measurement: [Value; 4],
    process: [Value; 4],
    /// Peaks, the settling time, the moments of the open windows.
    sums: Vec<Value>,
    worst: [Value; SUMS],
}

impl Kernel<'_> {
    /// Columns of the state, the memory and the noise that a sample needs of the one before. The others are
    /// computed anew, also by the interpreter, which takes the last sample and all of a run that diverges.
    fn carried(&self) -> Vec<usize> {
        let (layout, plan) = (&self.study.layout, &self.study.plan);
        let now = layout.plant..layout.plant + layout.now;
        let holds =
            matches!(plan.draw, DrawKind::Uniform(..) | DrawKind::Normal(..)) && plan.hold > 1;
        let noise = if holds { layout.y } else { 0 };
        let anew = |column: &usize| now.contains(column) && !self.study.needs(*column);
        (0..layout.noise() + noise).filter(|column| !anew(column)).collect()
    }

    /// Every number that is carried, with its kind, where it is kept, and whether it is uniform.
    fn places(&self) -> Vec<(Kind, &'static str, usize, bool)> {
        let layout = &self.study.layout;
        let shared = self.study.plants_are_shared;
        let column = |at: usize| (Kind::Float, "columns", at * LANES, false);
        let carried = self.carried().into_iter();
        let mut places: Vec<_> =
            carried
                .map(|i| {
                    if shared && i < layout.x {
                        (Kind::Float, "shared", i, true)
                    } else {
                        column(i)
                    }
                })
                .collect();
        for name in ["measurement", "process"] {
            places.extend((0..4).map(|i| (Kind::Bits, name, i * LANES, false)));
        }
        let end = layout.open() + self.open * layout.moments();
        places.extend((layout.peak()..end).map(column));
        places.extend((0..SUMS).map(|i| (Kind::Float, "worst", i * LANES, false)));
        places
    }

    /// The numbers of [`Self::places`] by their names.
    fn state(&self, values: &[Value]) -> State {
        let layout = &self.study.layout;
        let mut rest = values.iter().cloned();
        let mut take = |count: usize| -> Vec<Value> { rest.by_ref().take(count).collect() };
        let four = |values: Vec<Value>| -> [Value; 4] {
            std::array::from_fn(|i| values.get(i).cloned().unwrap_or(Printer::constant(0.0)))
        };
        let carried = self.carried();
        let mut columns = vec![Printer::constant(0.0); layout.noise() + layout.y];
        for (column, value) in carried.iter().zip(take(carried.len())) {
            columns[*column] = value;
        }
        let noise = columns.split_off(layout.noise());
        let z = columns.split_off(layout.memory());
        let x = columns;
        let (measurement, process) = (four(take(4)), four(take(4)));
        let mut sums = take(values.len());
        let worst = sums.split_off(sums.len().saturating_sub(SUMS));
        let worst =
            std::array::from_fn(|i| worst.get(i).cloned().unwrap_or(Printer::constant(0.0)));
        State { x, z, noise, measurement, process, sums, worst }
    }

    fn values(&self, state: State) -> Vec<Value> {
        let State { x, z, noise, measurement, process, sums, worst } = state;
        let columns = [x, z, noise].concat();
        let carried: Vec<Value> = self.carried().iter().map(|at| columns[*at].clone()).collect();
        [carried, measurement.into(), process.into(), sums, worst.into()].concat()
    }

    fn print(&self, lanes: usize, copies: usize) -> Printer {
        let mut printer = Printer {
            lanes,
            copies,
            next: 0,
            lines: Vec::new(),
            label: String::new(),
            start: 0,
            splats: HashMap::new(),
            functions: BTreeSet::new(),
        };
        let p = &mut printer;
        p.begin("entry");
        let places = self.places();
        let mut starts = Vec::new();
        for (kind, base, at, uniform) in &places {
            starts.push(p.load(*kind, base, &at.to_string(), *uniform));
        }
        p.leave("br label %loop");
        p.begin("loop");
        // what is carried has a name now, and a line once it is known where it comes from
        let header = p.lines.len();
        let mut now = Vec::new();
        for (_, _, _, uniform) in &places {
            let count = if *uniform { 1 } else { copies };
            let names: Vec<String> = (0..count).map(|_| p.name()).collect();
            now.push(if *uniform { Value::Uniform(names[0].clone()) } else { Value::Each(names) });
        }
        let (next, shown) = self.sample(p, self.state(&now));
        let next = self.values(next);
        p.line("  %k.next = add i64 %k, 1".into());
        p.line("  %more = icmp ult i64 %k.next, %n".into());
        let latch = p.label.clone();
        let mut phis = vec![format!("  %k = phi i64 [ 0, %entry ], [ %k.next, %{latch} ]")];
        for (((kind, _, _, uniform), now), (start, next)) in
            places.iter().zip(&now).zip(starts.iter().zip(&next))
        {
            let of = p.of(*kind, *uniform);
            let of_copy = |value: &Value, copy: usize| match value {
                Value::Uniform(name) => name.clone(),
                Value::Each(names) => names[copy].clone(),
            };
            for copy in 0..if *uniform { 1 } else { copies } {
                let [now, start, next] = [now, start, next].map(|value| of_copy(value, copy));
                phis.push(format!("  {now} = phi {of} [ {start}, %entry ], [ {next}, %{latch} ]"));
            }
        }
        p.insert(header, phis);
        p.leave("br i1 %more, label %loop, label %done");
        p.begin("done");
        for ((kind, base, at, uniform), value) in places.iter().zip(&next) {
            p.store(*kind, base, &at.to_string(), value, *uniform);
            if *uniform {
                p.store(Kind::Float, "columns", &(at * LANES).to_string(), value, false);
            }
        }
        for (i, value) in shown.iter().enumerate() {
            p.store(Kind::Float, "shown", &(i * LANES).to_string(), value, false);
        }
        printer
    }

    /// A number of the sample's row.
    fn of_row(p: &mut Printer, row: &str, at: usize) -> Value {
        let (place, result) = (p.name(), p.name());
        p.line(format!("  {place} = getelementptr double, ptr {row}, i64 {at}"));
        p.line(format!("  {result} = load double, ptr {place}, align 8"));
        Value::Uniform(result)
    }

    /// A sample: the state after it, and what a frame shows.
    fn sample(&self, p: &mut Printer, mut state: State) -> (State, Vec<Value>) {
        let (study, tables) = (self.study, &self.study.tables);
        let (offset, row) = (p.name(), p.name());
        p.line(format!("  {offset} = mul i64 %k, {ROW}"));
        p.line(format!("  {row} = getelementptr double, ptr %rows, i64 {offset}"));
        let clock: Vec<Value> = (0..5).map(|at| Self::of_row(p, &row, at)).collect();
        let [t, dt, plant_t, h, sines] = &clock[..] else { return (state, Vec::new()) };
        self.draw(p, &mut state, &row);
        let later = study.layout.plant + study.layout.now;
        let (x, _) = state.x.split_at(study.layout.plant);
        let waiting = state.x.iter().skip(later);
        for (i, value) in state.z.iter().chain(x).chain(waiting).enumerate() {
            let sum = &mut state.worst[i % SUMS];
            *sum = p.bounded(sum, value);
        }
        let given = [t.clone(), dt.clone(), plant_t.clone(), sines.clone()];
        let inputs: [&[Value]; 4] = [&given, &state.z, &state.x, &state.noise];
        let mut made = p.table(&tables.sample, &inputs, study.samples_are_there).into_iter();
        let layout = &study.layout;
        let next = made.by_ref().take(layout.z).collect();
        let y: Vec<Value> = made.by_ref().take(layout.y).collect();
        let u: Vec<Value> = made.by_ref().take(layout.u).collect();
        let now = made.by_ref().take(layout.now).collect();
        let (plant, later) = (layout.plant, layout.plant + layout.now);
        let now = Self::each(p, now);
        state.x.splice(plant..later, now);
        if !tables.is_current {
            self.show(p, &mut state, t);
        }
        let before = std::mem::replace(&mut state.z, Self::each(p, next));
        if tables.is_current {
            self.show(p, &mut state, t);
        }
        let mut shown = Vec::new();
        if study.plan.every > 0 {
            let z = if tables.is_current { state.z.clone() } else { before };
            shown = [state.x.clone(), z, y].concat();
        }
        let waiting = made.by_ref().take(layout.x - later).collect();
        let waiting = Self::each(p, waiting);
        state.x.splice(later.., waiting);
        if tables.is_joint {
            let moved = Self::each(p, made.collect());
            state.x.splice(..plant, moved);
        }
        if let Some(predict) = &tables.predict {
            let inputs: [&[Value]; 3] = [&[t.clone(), dt.clone()], &state.z, &u];
            let next = p.table(predict, &inputs, study.samples_are_there);
            state.z = Self::each(p, next);
        }
        if let Some(plant) = &tables.plant {
            self.plants(p, &mut state, (plant_t, h), (plant, &u));
        }
        (state, shown)
    }

    /// The drawn or recorded noise.
    fn draw(&self, p: &mut Printer, state: &mut State, row: &str) {
        let plan = &self.study.plan;
        match plan.draw {
            DrawKind::None => {}
            DrawKind::Shared(_) => {
                let noise = Self::of_row(p, row, 5);
                // carried as a vector: the interpreter takes it from there
                let noise = Value::Each((0..p.copies).map(|copy| p.vector(&noise, copy)).collect());
                state.noise.fill(noise);
            }
            DrawKind::Recorded { .. } => {
                let at = p.name();
                p.line(format!("  {at} = mul i64 %k, {LANES}"));
                let noise = p.load(Kind::Float, "recorded", &at, false);
                state.noise.fill(noise);
            }
            DrawKind::Uniform(..) | DrawKind::Normal(..) if plan.hold <= 1 => {
                self.fresh(p, state);
            }
            DrawKind::Uniform(..) | DrawKind::Normal(..) => {
                let fresh = Self::of_row(p, row, 6);
                let (Value::Uniform(fresh), truth, from) = (fresh, p.name(), p.label.clone())
                else {
                    return;
                };
                p.line(format!("  {truth} = fcmp une double {fresh}, 0x{:016X}", 0));
                p.leave(&format!("br i1 {truth}, label %draw, label %drawn"));
                let held = [&state.noise[..], &state.measurement[..]].concat();
                p.begin("draw");
                self.fresh(p, state);
                p.leave("br label %drawn");
                let new = [&state.noise[..], &state.measurement[..]].concat();
                let by = p.label.clone();
                p.begin("drawn");
                let noises = state.noise.len();
                let mut joined = Vec::new();
                for (i, (held, new)) in held.iter().zip(&new).enumerate() {
                    let kind = if i < noises { Kind::Float } else { Kind::Bits };
                    let of = p.of(kind, false);
                    let (Value::Each(held), Value::Each(new)) = (held, new) else { continue };
                    let names = held.iter().zip(new).map(|(held, new)| {
                        let name = p.name();
                        p.line(format!(
                            "  {name} = phi {of} [ {held}, %{from} ], [ {new}, %{by} ]"
                        ));
                        name
                    });
                    joined.push(Value::Each(names.collect()));
                }
                let streams = joined.split_off(noises);
                state.noise = joined;
                for (word, stream) in state.measurement.iter_mut().zip(streams) {
                    *word = stream;
                }
            }
        }
    }

    /// New draws.
    fn fresh(&self, p: &mut Printer, state: &mut State) {
        for i in 0..state.noise.len() {
            state.noise[i] = match self.study.plan.draw {
                DrawKind::Uniform(low, high) => {
                    let fraction = p.uniform(&mut state.measurement);
                    let part = p.binary("fmul", &Printer::constant(high - low), &fraction);
                    p.binary("fadd", &Printer::constant(low), &part)
                }
                DrawKind::Normal(mean, std) => {
                    let [normal, _] = p.normal_pair(&mut state.measurement);
                    let part = p.binary("fmul", &Printer::constant(std), &normal);
                    p.binary("fadd", &Printer::constant(mean), &part)
                }
                _ => return,
            };
        }
    }

    /// A sample in the metrics.
    fn show(&self, p: &mut Printer, state: &mut State, t: &Value) {
        let layout = &self.study.layout;
        let (zero, signals) = (Printer::constant(0.0), layout.signals());
        let watched = state.x[layout.watch()..][..layout.watched].to_vec();
        let values = [&state.z[..layout.errors], &watched].concat();
        let largest = |p: &mut Printer, so_far: &Value, value: &Value| {
            let size = p.intrinsic("fabs", &[value]);
            p.choose(("ogt", &size, so_far), &size, so_far)
        };
        let peaks = if layout.peaks { signals } else { 0 };
        for (sum, value) in state.sums.iter_mut().zip(&values).take(peaks) {
            *sum = largest(p, sum, value);
        }
        let settled = peaks;
        let times = settled + usize::from(layout.settle.is_some());
        for (at, (signal, threshold)) in layout.settles.iter().enumerate() {
            let size = p.intrinsic("fabs", &[&watched[*signal]]);
            let far = ("oge", &size, &Printer::constant(*threshold));
            state.sums[times + at] = p.choose(far, t, &state.sums[times + at].clone());
        }
        let open = times + layout.settles.len();
        if self.open > 0 {
            let errors: Vec<Value> = (0..signals)
                .map(|i| {
                    let known = layout.truth.get(i).filter(|_| i < layout.errors);
                    let x = known.map(|at| state.x[*at].clone());
                    p.binary("fsub", &values[i], &x.unwrap_or_else(|| zero.clone()))
                })
                .collect();
            let [mean, rms, max] = layout.kinds;
            let squares: Vec<Value> = if rms {
                errors.iter().map(|e| p.binary("fmul", e, e)).collect()
            } else {
                Vec::new()
            };
            let mut at = open;
            for _ in 0..self.open {
                if mean {
                    for (i, e) in errors.iter().enumerate() {
                        state.sums[at + i] = p.binary("fadd", &state.sums[at + i].clone(), e);
                    }
                    at += signals;
                }
                if rms {
                    for (i, square) in squares.iter().enumerate() {
                        state.sums[at + i] = p.binary("fadd", &state.sums[at + i].clone(), square);
                    }
                    at += signals;
                }
                if max {
                    for (i, e) in errors.iter().enumerate() {
                        state.sums[at + i] = largest(p, &state.sums[at + i].clone(), e);
                    }
                    at += signals;
                }
            }
        }
        if layout.settle.is_none() && !self.distances {
            return;
        }
        let mut square = zero;
        for (i, at) in layout.truth.iter().enumerate() {
            let e = p.binary("fsub", &state.z[i].clone(), &state.x[*at].clone());
            let part = p.binary("fmul", &e, &e);
            square = p.binary("fadd", &square, &part);
        }
        if let Some(threshold) = layout.settle {
            let distance = p.intrinsic("sqrt", &[&square]);
            let far = ("oge", &distance, &Printer::constant(threshold));
            let last = state.sums[settled].clone();
            state.sums[settled] = p.choose(far, t, &last);
        }
        if self.distances {
            let at = p.name();
            p.line(format!("  {at} = mul i64 %k, {LANES}"));
            p.store(Kind::Float, "distances", &at, &square, false);
        }
    }

    /// The plants over their substeps.
    fn plants(
        &self,
        p: &mut Printer,
        state: &mut State,
        (plant_t, h): (&Value, &Value),
        (plant, u): (&Table, &[Value]),
    ) {
        let substeps = self.study.plan.substeps;
        if substeps == 1 {
            // the plant's time + 0·h is the plant's time, but for the sign of 0, which no sum keeps
            let zero = p.binary("fmul", &Printer::constant(0.0), h);
            let time = p.binary("fadd", plant_t, &zero);
            self.substep(p, state, (&time, h), (plant, u));
            return;
        }
        let from = p.label.clone();
        p.leave("br label %substep");
        p.begin("substep");
        let header = p.lines.len();
        let random = self.study.tables.is_random;
        let started = [&state.x[..], if random { &state.process[..] } else { &[] }].concat();
        let states = state.x.len();
        let mut inside = Vec::new();
        for value in &started {
            inside.push(match value {
                Value::Uniform(_) => Value::Uniform(p.name()),
                Value::Each(names) => Value::Each(names.iter().map(|_| p.name()).collect()),
            });
        }
        state.x = inside[..states].to_vec();
        for (word, value) in state.process.iter_mut().zip(&inside[states..]) {
            *word = value.clone();
        }
        let number = p.name();
        p.line(format!("  {number} = uitofp i64 %s to double"));
        let offset = p.binary("fmul", &Value::Uniform(number), h);
        let time = p.binary("fadd", plant_t, &offset);
        self.substep(p, state, (&time, h), (plant, u));
        let ended = [&state.x[..], if random { &state.process[..] } else { &[] }].concat();
        p.line("  %s.next = add i64 %s, 1".into());
        p.line(format!("  %s.more = icmp ult i64 %s.next, {substeps}"));
        let latch = p.label.clone();
        let mut phis = vec![format!("  %s = phi i64 [ 0, %{from} ], [ %s.next, %{latch} ]")];
        for (i, ((inside, start), end)) in inside.iter().zip(&started).zip(&ended).enumerate() {
            let kind = if i < states { Kind::Float } else { Kind::Bits };
            let each: Vec<[String; 3]> = match (inside, start, end) {
                (Value::Uniform(a), Value::Uniform(b), Value::Uniform(c)) => {
                    vec![[a.clone(), b.clone(), c.clone()]]
                }
                (Value::Each(a), Value::Each(b), Value::Each(c)) => {
                    let rows = a.iter().zip(b).zip(c);
                    rows.map(|((a, b), c)| [a.clone(), b.clone(), c.clone()]).collect()
                }
                _ => Vec::new(),
            };
            let of = p.of(kind, matches!(inside, Value::Uniform(_)));
            for [name, start, end] in each {
                phis.push(format!("  {name} = phi {of} [ {start}, %{from} ], [ {end}, %{latch} ]"));
            }
        }
        p.insert(header, phis);
        p.leave("br i1 %s.more, label %substep, label %moved");
        p.begin("moved");
    }

    fn substep(
        &self,
        p: &mut Printer,
        state: &mut State,
        (time, h): (&Value, &Value),
        (plant, u): (&Table, &[Value]),
    ) {
        let tables = &self.study.tables;
        let mut xi = [Printer::constant(0.0), Printer::constant(0.0)];
        if tables.is_random {
            xi = p.normal_pair(&mut state.process);
        }
        let n = self.study.layout.plant;
        let inputs: [&[Value]; 4] = [&[time.clone(), h.clone()], &state.x[..n], u, &xi];
        let next = p.table(plant, &inputs, true);
        let next = if self.study.plants_are_shared { next } else { Self::each(p, next) };
        state.x.splice(..n, next);
    }

    /// Values that are carried as vectors.
    fn each(p: &mut Printer, values: Vec<Value>) -> Vec<Value> {
        values
            .into_iter()
            .map(|value| match value {
                Value::Uniform(_) => {
                    Value::Each((0..p.copies).map(|copy| p.vector(&value, copy)).collect())
                }
                each @ Value::Each(_) => each,
            })
            .collect()
    }
}
