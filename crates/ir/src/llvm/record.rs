//! Floor 9. Records printed as LLVM IR: a function that steps an observer over samples, one after the other.
//!
//! It takes samples that are there, over steps of one length. The first sample that is not, and the first
//! step that ends in a memory that is not finite, are left to the interpreter, with all that is rare.

use super::printer::{Printer, Value, with_functions};
use crate::recursion::{Tabled, Widths};
use crate::table::Table;
use std::fmt::Write as _;

/// The function's name.
const NAME: &str = "record";
/// Its parameters, in order, before the number of samples.
const PARAMETERS: [&str; 7] = ["memory", "t", "y", "u", "fixed", "rows", "innovation"];

/// A record's kernel as source.
#[derive(Clone, Debug)]
pub struct RecordSource {
    /// LLVM IR, with the functions of the core that it calls.
    pub text: String,
    /// What its function is called.
    pub name: &'static str,
    /// Operations of a sample.
    pub operations: usize,
}

/// An observer over a record as LLVM IR; `None` where a function cannot be printed.
pub fn record_source(observer: &dyn Tabled) -> Option<RecordSource> {
    let table = observer.table().ok()?;
    let mut printer = Printer::new(1, 1);
    print(&mut printer, &table, observer.widths());
    let given = PARAMETERS.map(|name| format!("ptr noalias %{name}")).join(", ");
    let mut text = format!("define i64 @{NAME}({given}, double %dt, i64 %n) {{\n");
    for line in &printer.lines {
        // writing to a string does not fail
        let _ = writeln!(text, "{line}");
    }
    text.push_str("}\n");
    with_functions(&mut text, 1, printer.functions)?;
    Some(RecordSource { text, name: NAME, operations: table.operations.len() })
}

/// Numbers from row %k of such a width on.
fn row(p: &mut Printer, base: &str, width: usize) -> Vec<Value> {
    let at = if width == 1 { "%k".into() } else { p.name() };
    if width > 1 {
        p.line(format!("  {at} = mul i64 %k, {width}"));
    }
    (0..width).map(|i| number(p, base, &at, i)).collect()
}

/// The number at `base` + `at` + i.
fn number(p: &mut Printer, base: &str, at: &str, i: usize) -> Value {
    let place = place(p, base, at, i);
    let value = p.name();
    p.line(format!("  {value} = load double, ptr {place}, align 8"));
    Value::Uniform(value)
}

fn place(p: &mut Printer, base: &str, at: &str, i: usize) -> String {
    let (row, place) = (p.name(), p.name());
    p.line(format!("  {row} = getelementptr double, ptr %{base}, i64 {at}"));
    p.line(format!("  {place} = getelementptr double, ptr {row}, i64 {i}"));
    place
}

fn put(p: &mut Printer, base: &str, at: &str, values: &[Value]) {
    for (i, value) in values.iter().enumerate() {
        let place = place(p, base, at, i);
        let value = p.vector(value, 0);
        p.line(format!("  store double {value}, ptr {place}, align 8"));
    }
}

/// 0, or NaN where a value is not finite.
fn spoilt(p: &mut Printer, values: &[Value]) -> Value {
    let zero = Printer::constant(0.0);
    let parts: Vec<Value> = values.iter().map(|value| p.binary("fmul", value, &zero)).collect();
    let sum = parts.into_iter().reduce(|sum, part| p.binary("fadd", &sum, &part));
    sum.unwrap_or(zero)
}

/// Leave for `label` unless a sum of [`spoilt`] is a number.
fn leave_unless_finite(p: &mut Printer, values: &[Value], (on, out): (&str, &str)) {
    let sum = spoilt(p, values);
    let sum = p.vector(&sum, 0);
    let truth = p.name();
    p.line(format!("  {truth} = fcmp ord double {sum}, {sum}"));
    p.leave(&format!("br i1 {truth}, label %{on}, label %{out}"));
}

fn print(p: &mut Printer, table: &Table, of: Widths) {
    let Widths { memory: m, n_y, n_u, fixed, current } = of;
    p.begin("entry");
    let start: Vec<Value> = (0..m).map(|i| number(p, "memory", "0", i)).collect();
    let fixed: Vec<Value> = (0..fixed).map(|i| number(p, "fixed", "0", i)).collect();
    p.leave("br label %loop");

    p.begin("loop");
    let header = p.lines.len();
    let z: Vec<Value> = (0..m).map(|_| Value::Uniform(p.name())).collect();
    let t = row(p, "t", 1);
    let (y, u) = (row(p, "y", n_y), row(p, "u", n_u));
    leave_unless_finite(p, &y, ("sample", "done"));

    p.begin("sample");
    let dt = [Value::Uniform("%dt".into())];
    let made = p.table(table, &[&t, &dt, &z, &y, &u, &fixed], true);
    let (next, rest) = made.split_at(m);
    let (innovation, shown) = rest.split_at(n_y);
    leave_unless_finite(p, &[next, shown].concat(), ("step", "done"));

    p.begin("step");
    let (rows, errors) = (p.name(), p.name());
    p.line(format!("  {rows} = mul i64 %k, {m}"));
    p.line(format!("  {errors} = mul i64 %k, {n_y}"));
    put(p, "rows", &rows, if current { shown } else { &z });
    put(p, "innovation", &errors, innovation);
    p.line("  %k.next = add i64 %k, 1".into());
    p.line("  %more = icmp ult i64 %k.next, %n".into());
    let mut phis = vec!["  %k = phi i64 [ 0, %entry ], [ %k.next, %step ]".to_owned()];
    for ((z, start), next) in z.iter().zip(&start).zip(next) {
        let [z, start, next] = [z, start, next].map(|value| p.vector(value, 0));
        phis.push(format!("  {z} = phi double [ {start}, %entry ], [ {next}, %step ]"));
    }
    p.insert(header, phis);
    p.leave("br i1 %more, label %loop, label %ended");

    // all samples, or those before the one that stopped it: the memory there
    p.begin("ended");
    put(p, "memory", "0", next);
    p.leave("ret i64 %n");
    p.begin("done");
    put(p, "memory", "0", &z);
    p.leave("ret i64 %k");
}
