//! Elementary functions as straight lines of operations, beside the core's own.

use hgo_ir::elementary::{
    Function, Kind, NAMES, OF_NOISE, Operation, Precision, Row, Value, c, function, llvm, rust,
    source,
};
use hgo_rs::noise::{self, Channel, Law, Stream};
use hgo_rs::{Scalar, elementary};

const UNARY: [&str; 7] = ["exp", "ln", "sin", "cos", "tan", "atan", "tanh"];

fn of(name: &str, precision: Precision) -> Function {
    function(name, precision).unwrap()
}

/// Numbers of all sizes and signs, with the special ones.
fn numbers(count: usize) -> Vec<f64> {
    let mut stream = Stream::new(5, 0, Channel::Process);
    let special = [
        0.0,
        0.25,
        0.5,
        0.75,
        1.0,
        1.5,
        44.0,
        88.7,
        103.9,
        709.78,
        745.14,
        2e4,
        1e9,
        5e-324,
        1e-310,
        1e-45,
        1e-40,
        3.4e38,
        1.7e308,
        f64::MIN_POSITIVE,
        f64::MAX,
        f64::INFINITY,
        f64::NAN,
    ];
    let both = special.into_iter().flat_map(|x| [x, -x]);
    let drawn = (0..count).map(|i| match i % 3 {
        0 => f64::from_bits(stream.next_u64()),
        1 => (stream.uniform() - 0.5) * 60.0,
        _ => stream.normal() * 10_f64.powf(24.0 * stream.uniform() - 12.0),
    });
    both.chain(drawn).collect()
}

fn same<T: Scalar>(ours: T, core: T, bits: impl Fn(T) -> u64) -> bool {
    let is_nan = |x: T| x.to_f64().is_nan();
    bits(ours) == bits(core) || (is_nan(ours) && is_nan(core))
}

macro_rules! has_the_cores_bits {
    ($test:ident, $t:ident, $bits:ident, $precision:ident) => {
        #[test]
        #[allow(clippy::cast_possible_truncation, clippy::cast_lossless)]
        fn $test() {
            let number = |result: &[u64]| $t::from_bits(result[0] as $bits);
            let bits = |x: $t| u64::from(x.to_bits());
            let unary: [fn($t) -> $t; 7] = [
                elementary::exp,
                elementary::ln,
                elementary::sin,
                elementary::cos,
                elementary::tan,
                elementary::atan,
                elementary::tanh,
            ];
            let binary: [(&str, fn($t, $t) -> $t); 2] =
                [("atan2", elementary::atan2), ("powf", elementary::powf)];
            let xs: Vec<$t> = numbers(2000).into_iter().map(|x| x as $t).collect();
            for (name, core) in UNARY.into_iter().zip(unary) {
                let traced = of(name, Precision::$precision);
                for &x in &xs {
                    let ours = number(&traced.evaluate(&[bits(x)]));
                    assert!(same(ours, core(x), bits), "{name}({x:e}): {ours:e}, {:e}", core(x));
                }
            }
            for (name, core) in binary {
                let traced = of(name, Precision::$precision);
                let ends = xs.iter().take(46).flat_map(|x| xs.iter().take(46).map(|y| (*x, *y)));
                for (x, y) in ends.chain(xs.windows(2).map(|pair| (pair[0], pair[1]))) {
                    let ours = number(&traced.evaluate(&[bits(x), bits(y)]));
                    let core = core(x, y);
                    assert!(same(ours, core, bits), "{name}({x:e}, {y:e}): {ours:e}, {core:e}");
                }
            }
        }
    };
}

has_the_cores_bits!(double_precision_has_the_cores_bits, f64, u64, Double);
has_the_cores_bits!(single_precision_has_the_cores_bits, f32, u32, Single);

/// A stream's draws, made of the functions alone.
#[test]
fn noise_is_drawn_as_by_the_core() {
    let [advanced, fraction, parts, radius, turned, student_t, laplace, impulsive] =
        OF_NOISE.map(|name| of(name, Precision::Double));
    let mut stream = Stream::new(11, 3, Channel::Measurement);
    let mut state = vec![1, 2, 3, 4];
    let mut own = Stream::from_state([1, 2, 3, 4]);
    for _ in 0..1000 {
        let drawn = advanced.evaluate(&state);
        assert_eq!(drawn[0], own.next_u64());
        state = drawn[1..].to_vec();
        let start = stream;
        let [u, v] = [stream.next_u64(), stream.next_u64()];
        let after = stream.clone().next_u64();
        let [first, second] = [u, v].map(|bits| fraction.evaluate(&[bits])[0]);
        assert_eq!(first, noise::fraction::<f64>(u).to_bits());
        let r = radius.evaluate(&parts.evaluate(&[first]));
        let (a, b) = noise::turned(
            noise::radius_of(noise::radius_parts(f64::from_bits(first))),
            f64::from_bits(second),
        );
        assert_eq!(turned.evaluate(&[r[0], second]), [a.to_bits(), b.to_bits()]);
        // heavy tails: one function each
        let draw = |law: Law| vec![law.draw(&mut start.clone()).to_bits()];
        let third = fraction.evaluate(&[after])[0];
        let [nu, p, ratio] = [2.5_f64, 0.3, 20.0];
        let given = [first, second, nu.to_bits()];
        assert_eq!(student_t.evaluate(&given), draw(Law::StudentT { nu }));
        assert_eq!(laplace.evaluate(&[first, second]), draw(Law::Laplace));
        let given = [first, second, third, p.to_bits(), ratio.to_bits()];
        assert_eq!(impulsive.evaluate(&given), draw(Law::Impulsive { probability: p, ratio }));
    }
}

/// Equal rows stand once, constants are computed, and every row counts.
#[test]
fn no_row_is_idle() {
    let single = NAMES.map(|name| of(name, Precision::Single));
    let double = NAMES.iter().chain(&OF_NOISE).map(|name| of(name, Precision::Double));
    for function in single.into_iter().chain(double) {
        let rows = &function.rows;
        for (index, row) in rows.iter().enumerate() {
            let is_used = |value: &Value| *value == Value::Row(index);
            let used = rows[index..].iter().flat_map(Row::operands).chain(&function.results);
            assert!(used.into_iter().any(is_used), "{}: row {index}", function.name);
            assert!(!rows[..index].contains(row), "{}: row {index} twice", function.name);
            let constant = row.operands().iter().all(|value| value.constant().is_some());
            assert!(!constant, "{}: row {index} is a constant", function.name);
            for (place, value) in row.operands().iter().enumerate() {
                let asked = match (row.operation, place) {
                    (Operation::Select, 0) | (Operation::Both | Operation::Either, _) => {
                        Kind::Truth
                    }
                    (operation, _) if operation.kind() == Kind::Bits => match operation {
                        Operation::ToBits => Kind::Number,
                        _ => Kind::Bits,
                    },
                    (Operation::FromBits | Operation::SameBits, _) => Kind::Bits,
                    _ => Kind::Number,
                };
                assert_eq!(function.kind(*value), asked, "{}: row {index}", function.name);
            }
        }
    }
    // sine and cosine share their argument and its powers
    assert_eq!(of("sin", Precision::Double).rows.len(), 51);
}

/// A function by hand: its rows stand as they are meant in each language.
#[test]
fn operands_keep_their_order_and_their_parentheses() {
    let [x, y] = [Value::Parameter(0), Value::Parameter(1)];
    let number = |value: f64| Value::Number(value.to_bits());
    let function = Function {
        name: "odd",
        meaning: "Signs.",
        precision: Precision::Double,
        parameters: vec![("x", Kind::Number), ("y", Kind::Number)],
        rows: vec![
            Row::new(Operation::Subtract, [x, number(-1.5)]),
            Row::new(Operation::Add, [x, y]),
            Row::new(Operation::Subtract, [Value::Row(0), Value::Row(1)]),
            Row::new(Operation::Negate, [Value::Row(2)]),
            Row::new(Operation::Less, [Value::Row(3), number(f64::NEG_INFINITY)]),
            Row::new(Operation::Divide, [number(1e22), y]),
            Row::new(Operation::Select, [Value::Row(4), Value::Row(5), number(f64::NAN)]),
            Row::new(Operation::Multiply, [Value::Row(6), x]),
        ],
        results: vec![Value::Row(7)],
    };
    assert_eq!(
        c::function(&function, "p"),
        "/* Signs. */\nstatic double p_odd(double x, double y)\n{\n    const double a1 = -(x - -1.5 - (x + \
         y)) < -(double)INFINITY ? 1e22 / y : (double)NAN;\n    return a1 * x;\n}\n"
    );
    assert_eq!(
        rust::function(&function),
        "/// Signs.\nfn odd(x: f64, y: f64) -> f64 {\n    let a1 = if -(x - -1.5 - (x + y)) < \
         -f64::INFINITY { 1e22 / y } else { f64::NAN };\n    a1 * x\n}\n"
    );
    let ir = llvm::function_ir(&function, 2);
    assert!(ir.starts_with(
        "define internal <2 x double> @hgo_odd_v2(<2 x double> %x, <2 x double> %y) alwaysinline \
         nounwind readnone {\n  %r0 = fsub <2 x double> %x, <double 0xBFF8000000000000, double \
         0xBFF8000000000000>\n"
    ));
    assert!(ir.ends_with("  %r7 = fmul <2 x double> %r6, %x\n  ret <2 x double> %r7\n}\n"));
}

#[test]
fn what_is_not_known_is_refused() {
    let refused = |language, precision, name: &str, lanes| {
        source(language, precision, &[name.to_owned()], "p", lanes).unwrap_err().to_string()
    };
    assert_eq!(
        refused("ada", "double", "exp", 1),
        "language = \"ada\" is not known: choose \"c\", \"rust\" or \"llvm\""
    );
    assert_eq!(
        refused("c", "half", "exp", 1),
        "precision = \"half\" is not known: choose \"double\" or \"single\""
    );
    assert!(refused("c", "single", "turned", 1).starts_with("names: \"turned\" is no elementary"));
    assert_eq!(refused("llvm", "double", "exp", 0), "lanes = 0 is not allowed: 1 to 1024");
}

/// Views of bits stand in a program once, and only where they are needed.
#[test]
fn a_program_has_what_its_functions_call() {
    let of = |names: &[&str]| {
        let names: Vec<String> = names.iter().map(|name| (*name).to_owned()).collect();
        source("c", "single", &names, "axis", 1).unwrap()
    };
    let both = of(&["sin", "exp"]);
    for view in ["static uint32_t axis_to_bits(float x)", "static float axis_from_bits(uint32_t x)"]
    {
        assert_eq!(both.matches(view).count(), 1);
    }
    assert!(!of(&["atan"]).contains("memcpy"));
}
