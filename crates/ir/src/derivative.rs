//! Floor 5. Derivatives of tables along a direction, by the rules of calculus, operation by operation.

use crate::error::{Result, refused};
use crate::table::Table;
use crate::trace::{self, Setting, Traced, apply, named, trace};
use hgo_rs::Scalar;
use hgo_rs::dual::Dual;
use hgo_rs::program::Operation;

impl Table {
    /// (inputs, direction) → the derivatives of the outputs along the direction, one entry an input.
    ///
    /// # Errors
    /// A table that calls functions.
    pub fn derivative(&self) -> Result<Self> {
        if !self.calls.is_empty() {
            return Err(refused(
                "this scheme needs derivatives, which a system of Python functions that could not be \
                 compiled has not: write its equations as expressions, or choose euler-maruyama",
            ));
        }
        trace(Setting::usual(false), || {
            let named_inputs = |prefix: &str| -> Vec<Traced> {
                self.inputs.iter().map(|name| trace::input(&format!("{prefix}{name}"))).collect()
            };
            let values = named_inputs("");
            let direction = named_inputs("d ").into_iter().map(Some).collect();
            let slopes = self.slopes(values, direction).into_iter().map(Option::unwrap_or_default);
            Ok(named("slope", &slopes.collect::<Vec<_>>()))
        })
    }

    /// Within a trace: the derivatives of the outputs at these inputs along a direction; `None` is 0.
    fn slopes(
        &self,
        mut values: Vec<Traced>,
        mut slopes: Vec<Option<Traced>>,
    ) -> Vec<Option<Traced>> {
        values.extend(self.constants.iter().map(|value| Traced::from_f64(*value)));
        slopes.resize(values.len(), None);
        for (operation, from) in &self.operations {
            let value = |i: usize| from.get(i).and_then(|at| values.get(*at)).copied();
            let [a, b, c] = [0, 1, 2].map(|i| value(i).unwrap_or_default());
            let [da, db, dc] =
                [0, 1, 2].map(|i| from.get(i).and_then(|at| slopes.get(*at).copied()).flatten());
            let made = apply(*operation, [a, b, c]);
            slopes.push(slope(*operation, made, [a, b, c], [da, db, dc]));
            values.push(made);
        }
        self.outputs.iter().map(|output| slopes[*output]).collect()
    }
}

/// Call a function that was kept over dual numbers. One that calls functions has no slopes: refused.
pub(crate) fn call_dual<const N: usize>(
    function: usize,
    arguments: &[Dual<Traced, N>],
) -> Vec<Dual<Traced, N>> {
    let (table, parameters) = trace::kept(function);
    let values: Vec<Traced> = arguments.iter().map(|x| x.value).chain(parameters).collect();
    let made = trace::inline(&table, &values).into_iter().map(Dual::from);
    let mut made: Vec<Dual<Traced, N>> = made.collect();
    if !table.calls.is_empty() {
        trace::refuse(
            "this law needs the slopes of its model, which a model of Python functions that could not be \
             compiled has not: write its equations as expressions, or choose the standard observer",
        );
        return made;
    }
    for direction in 0..N {
        let along = arguments.iter().map(|x| x.slopes[direction]);
        // a constant 0 is no slope
        let mut along: Vec<_> =
            along.map(|slope| (slope.to_f64() != 0.0).then_some(slope)).collect();
        along.resize(values.len(), None);
        let slopes = table.slopes(values.clone(), along);
        for (made, slope) in made.iter_mut().zip(slopes) {
            made.slopes[direction] = slope.unwrap_or(Traced::NEG_ZERO);
        }
    }
    made
}

/// The derivative of one operation's result; `None` is 0.
fn slope(
    operation: Operation,
    made: Traced,
    [a, b, _]: [Traced; 3],
    [da, db, dc]: [Option<Traced>; 3],
) -> Option<Traced> {
    let one = Traced::ONE;
    let sign_of = |x: Traced| one.copysign(x);
    let sum = |x: Option<Traced>, y: Option<Traced>| match (x, y) {
        (Some(x), Some(y)) => Some(x + y),
        (x, y) => x.or(y),
    };
    let minus = |x: Option<Traced>| x.map(|x| -x);
    // b where the truth holds, else c
    let choose = |truth: Traced, x: Option<Traced>, y: Option<Traced>| {
        (x.is_some() || y.is_some()).then(|| {
            apply(Operation::Select, [truth, x.unwrap_or_default(), y.unwrap_or_default()])
        })
    };
    match operation {
        Operation::Negate => minus(da),
        Operation::Abs => da.map(|d| d * sign_of(a)),
        Operation::Sqrt => da.map(|d| d / (made + made)),
        Operation::Sin => da.map(|d| d * a.cos()),
        Operation::Cos => da.map(|d| -(d * a.sin())),
        Operation::Tan => da.map(|d| d * (one + made * made)),
        Operation::Atan => da.map(|d| d / (one + a * a)),
        Operation::Exp => da.map(|d| d * made),
        Operation::Ln => da.map(|d| d / a),
        Operation::Tanh => da.map(|d| d * (one - made * made)),
        Operation::Add => sum(da, db),
        Operation::Subtract | Operation::Innovation => sum(da, minus(db)),
        Operation::Multiply => sum(da.map(|d| d * b), db.map(|d| a * d)),
        Operation::Divide => sum(da.map(|d| d / b), db.map(|d| -(made * d / b))),
        Operation::Min => choose(apply(Operation::Less, [b, a, one]), db, da),
        Operation::Max => choose(apply(Operation::Less, [a, b, one]), db, da),
        Operation::Power => sum(da.map(|d| d * b * a.powf(b - one)), db.map(|d| made * a.ln() * d)),
        Operation::Atan2 => {
            let square = a * a + b * b;
            sum(da.map(|d| d * b / square), db.map(|d| -(a * d / square)))
        }
        Operation::CopySign => da.map(|d| d * sign_of(a) * sign_of(b)),
        Operation::Select => choose(a, db, dc),
        // steps: their slope is 0 wherever they have one; the rest stand in no table
        _ => None,
    }
}
