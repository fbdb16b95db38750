//! Floor 4. The core's elementary functions as straight lines of operations, and as source text.
//!
//! [`hgo_rs::elementary`] is their one definition. Run over numbers that write down what is computed with
//! them, each becomes a [`Function`]; C, Rust and LLVM's intermediate representation are printed from it.

pub mod c;
mod function;
pub mod llvm;
mod recorded;
pub mod rust;
mod text;

pub use function::{Function, Kind, Operation, Precision, Row, Value};

use crate::error::{Result, refused};
use hgo_rs::{elementary, noise};
use recorded::{Native, Number, Word, recorded};

/// Functions of a model's equations, in either precision.
pub const NAMES: [&str; 9] = ["exp", "ln", "sin", "cos", "tan", "atan", "tanh", "atan2", "powf"];

/// Functions that noise is drawn by, in double precision.
pub const OF_NOISE: [&str; 8] = [
    "advanced",
    "fraction",
    "radius_parts",
    "radius_of",
    "turned",
    "student_t",
    "laplace",
    "impulsive",
];

/// More numbers side by side than any processor has in a vector.
const MOST_LANES: usize = 1024;

/// A function of the core by its name: one of [`NAMES`], or of [`OF_NOISE`].
pub fn function(name: &str, precision: Precision) -> Option<Function> {
    match precision {
        Precision::Single => of_equations::<f32>(name),
        Precision::Double => of_equations::<f64>(name).or_else(|| of_noise(name)),
    }
}

fn unary<P: Native>(
    name: &'static str,
    meaning: &'static str,
    f: fn(Number<P>) -> Number<P>,
) -> Function {
    recorded::<P>(name, meaning, vec![("x", Kind::Number)], |given| vec![f(Number::at(given(0))).0])
}

fn binary<P: Native>(
    name: &'static str,
    meaning: &'static str,
    parameters: [&'static str; 2],
    f: fn(Number<P>, Number<P>) -> Number<P>,
) -> Function {
    recorded::<P>(name, meaning, parameters.map(|name| (name, Kind::Number)).to_vec(), |given| {
        vec![f(Number::at(given(0)), Number::at(given(1))).0]
    })
}

fn of_equations<P: Native>(name: &str) -> Option<Function> {
    Some(match name {
        "exp" => {
            unary::<P>("exp", "The exponential: 2^n e^r, where x = n ln 2 + r.", elementary::exp)
        }
        "ln" => unary::<P>(
            "ln",
            "The natural logarithm: k ln 2 + 2 artanh(f/(2 + f)), where x = 2^k (1 + f).",
            elementary::ln,
        ),
        "sin" => {
            unary::<P>("sin", "The sine; NaN where x is too large for an angle.", elementary::sin)
        }
        "cos" => {
            unary::<P>("cos", "The cosine; NaN where x is too large for an angle.", elementary::cos)
        }
        "tan" => unary::<P>(
            "tan",
            "The tangent; NaN where x is too large for an angle.",
            elementary::tan,
        ),
        "atan" => unary::<P>("atan", "The arc tangent.", elementary::atan),
        "tanh" => {
            unary::<P>("tanh", "The hyperbolic tangent: (e^2x - 1)/(e^2x + 1).", elementary::tanh)
        }
        "atan2" => binary::<P>(
            "atan2",
            "The angle of the point (x, y), zeros and infinities as in IEEE 754.",
            ["y", "x"],
            elementary::atan2,
        ),
        "powf" => binary::<P>(
            "powf",
            "x^p = 2^(p log2 x) for x >= 0; NaN for x < 0.",
            ["x", "p"],
            elementary::powf,
        ),
        _ => return None,
    })
}

fn of_noise(name: &str) -> Option<Function> {
    type Double = Number<f64>;
    let numbers = |names: &[&'static str]| names.iter().map(|name| (*name, Kind::Number)).collect();
    Some(match name {
        "advanced" => {
            let state = ["s0", "s1", "s2", "s3"].map(|name| (name, Kind::Bits)).to_vec();
            let meaning =
                "64 random bits of a generator's state, and its next state: xoshiro256++.";
            recorded::<f64>("advanced", meaning, state, |given| {
                let (bits, state) = noise::advanced([0, 1, 2, 3].map(|i| Word(given(i))));
                std::iter::once(bits).chain(state).map(|word| word.0).collect()
            })
        }
        "fraction" => {
            let meaning = "The highest 53 of 64 bits as a fraction of 2^53.";
            recorded::<f64>("fraction", meaning, vec![("bits", Kind::Bits)], |given| {
                vec![noise::fraction::<Double>(Word(given(0))).0]
            })
        }
        "radius_parts" => {
            let meaning = "What the radius of a normal pair is made of, u uniform on [0, 1).";
            recorded::<f64>("radius_parts", meaning, numbers(&["u"]), |given| {
                let (k, s) = noise::radius_parts(Double::at(given(0)));
                vec![k.0, s.0]
            })
        }
        "radius_of" => {
            let meaning = "The radius of a normal pair, of its parts.";
            recorded::<f64>("radius_of", meaning, numbers(&["k", "s"]), |given| {
                vec![noise::radius_of((Double::at(given(0)), Double::at(given(1)))).0]
            })
        }
        "turned" => {
            let meaning = "radius cos 2 pi u and radius sin 2 pi u, u in [0, 1).";
            recorded::<f64>("turned", meaning, numbers(&["radius", "u"]), |given| {
                let (a, b) = noise::turned(Double::at(given(0)), Double::at(given(1)));
                vec![a.0, b.0]
            })
        }
        "student_t" => {
            let meaning = "Student's t with nu degrees of freedom, of u and v in [0, 1).";
            recorded::<f64>("student_t", meaning, numbers(&["u", "v", "nu"]), |given| {
                let [u, v, nu] = [0, 1, 2].map(|i| Double::at(given(i)));
                vec![noise::student_t(u, v, nu).0]
            })
        }
        "laplace" => {
            let meaning = "Laplace's law of scale 1, of u and v in [0, 1).";
            recorded::<f64>("laplace", meaning, numbers(&["u", "v"]), |given| {
                vec![noise::laplace(Double::at(given(0)), Double::at(given(1))).0]
            })
        }
        "impulsive" => {
            let meaning = "A normal value of u and v, ratio times as large where w < probability.";
            let names = numbers(&["u", "v", "w", "probability", "ratio"]);
            recorded::<f64>("impulsive", meaning, names, |given| {
                let [u, v, w, probability, ratio] = std::array::from_fn(|i| Double::at(given(i)));
                vec![noise::impulsive([u, v, w], probability, ratio).0]
            })
        }
        _ => return None,
    })
}

/// The source of these functions and of what they need.
///
/// `language` is "c" (functions `prefix_name`), "rust" (functions of their own names) or "llvm" (of `lanes`
/// numbers side by side, with the declarations that a module needs); `precision` "single" or "double".
///
/// # Errors
///
/// A language, a precision or a function that is not known; no lanes.
pub fn source(
    language: &str,
    precision: &str,
    names: &[String],
    prefix: &str,
    lanes: usize,
) -> Result<String> {
    let Some(of) = Precision::named(precision) else {
        return Err(refused(format!(
            "precision = {precision:?} is not known: choose \"double\" or \"single\""
        )));
    };
    if !(1..=MOST_LANES).contains(&lanes) {
        return Err(refused(format!("lanes = {lanes} is not allowed: 1 to {MOST_LANES}")));
    }
    let functions = names.iter().map(|name| {
        function(name, of).ok_or_else(|| {
            refused(format!(
                "names: {name:?} is no elementary function in {precision} precision; known: {}",
                known(of).join(", ")
            ))
        })
    });
    let functions: Vec<Function> = functions.collect::<Result<_>>()?;
    let parts: Vec<String> = match language {
        "c" => {
            let bodies: Vec<String> =
                functions.iter().map(|function| c::function(function, prefix)).collect();
            let all = bodies.concat();
            let views = c::views(of, prefix).into_iter().zip(["_to_bits(", "_from_bits("]);
            let used = views.filter(|(_, call)| all.contains(&format!("{prefix}{call}")));
            used.map(|(view, _)| view).chain(bodies).collect()
        }
        "rust" => functions.iter().map(rust::function).collect(),
        "llvm" => {
            let declared = llvm::declarations(&functions, lanes).join("\n") + "\n";
            let defined = functions.iter().map(|function| llvm::function_ir(function, lanes));
            std::iter::once(declared).chain(defined).collect()
        }
        other => {
            return Err(refused(format!(
                "language = {other:?} is not known: choose \"c\", \"rust\" or \"llvm\""
            )));
        }
    };
    Ok(parts.join("\n"))
}

/// The functions that there are in a precision.
fn known(precision: Precision) -> Vec<&'static str> {
    let of_noise: &[&str] = if precision == Precision::Double { &OF_NOISE } else { &[] };
    NAMES.iter().chain(of_noise).copied().collect()
}
