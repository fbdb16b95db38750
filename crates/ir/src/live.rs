//! Floor 9. An observer as numbers, for the module of a page (`crates/wasm`): its step from sample to
//! sample as a program whose gain ℓ is an input.
//!
//! The numbers, in order, counts before what they count:
//!
//! - place of the law in the list of laws; order; second size; the number of its coefficients, these, list
//!   after list;
//! - placement of its corrections: 0 exact, 1 bilinear, 2 implicit map; −1 where gains are no inputs;
//! - entries of the memory; known inputs; 1 where it filters (its last entry is then the time that the next
//!   correction is for); the memory to start from;
//! - parameters, of which the last is ℓ; how many gains are inputs behind them;
//! - the program from sample to sample (t, dt, z, y, u, parameters, gains) → (z⁺, innovation, with current
//!   timing z after the correction), then with current timing the correction alone, which is a record's last
//!   step → (z, innovation).
//!
//! A program: the number of constants, and register and value of each; of outputs, and the register of each; of
//! instructions, and each as one number, (((operation · 256 + result) · 256 + a) · 256 + b) · 256 + c, operations
//! counted as [`Operation`](hgo_rs::program::Operation) declares them.

use crate::compile::Compiled;
use crate::error::{Result, refused};
use crate::spec::Spec;
use crate::tables::{PlacedChain, Tables};
use crate::trace::{PlacedGains, Setting};
use hgo_rs::laws::{Gain, Law, Sizes};
use hgo_rs::observers::LAWS;

/// The numbers of an observer of one output whose gain is constant.
///
/// # Errors
/// Another observer; a model of functions; a step that is no program.
pub fn numbers(spec: &Spec<'_>) -> Result<Vec<f64>> {
    let kind = spec.text("kind")?;
    let place = LAWS.iter().position(|law| law.kind == kind && takes_gain(law));
    let (Some(place), true) = (place, is_constant(spec)) else {
        return Err(refused(format!(
            "{kind:?} is not allowed: a law of one chain, its gain constant"
        )));
    };
    let law = &LAWS[place];
    let setting = Setting { gains: PlacedGains::Given, free_gain: true, ..Setting::usual(false) };
    let tables = Tables::read(spec, setting)?;
    let shape = &tables.shape;
    if tables.missing.is_some() || tables.unstarted.is_some() || shape.n_y != 1 {
        return Err(refused(format!("{kind:?} is not allowed: its step is not one program")));
    }
    let m = law.size.map_or(Ok(0), |(name, _)| spec.count(name))?;
    let sizes = Sizes { n: shape.n, m, ..Sizes::default() };
    let lists = law.coefficients.iter().map(|list| spec.list_of(list.name, (list.len)(&sizes)));
    let coefficients: Vec<f64> = lists.collect::<Result<Vec<_>>>()?.concat();
    let mut out = vec![number(place), number(shape.n), number(m)];
    put(&mut out, &coefficients);
    let gains = tables.placed.first().map_or(0, |PlacedChain { gains, .. }| gains.count);
    let method = spec.text_or("method", "")?;
    let at = ["zoh", "bilinear", "implicit-map"].iter().position(|name| *name == method);
    out.push(at.filter(|_| gains > 0).map_or(-1.0, number));
    out.extend([number(shape.memory), number(shape.n_u), f64::from(u8::from(shape.current))]);
    out.extend(&shape.initial);
    put(&mut out, &tables.parameters);
    out.push(number(gains));
    match &tables.correct {
        None => program(&mut out, &tables.advance.compile()?),
        Some(correct) => {
            program(&mut out, &tables.whole(correct)?.compile()?);
            program(&mut out, &correct.compile()?);
        }
    }
    Ok(out)
}

/// Whether a law takes a constant gain.
fn takes_gain(law: &Law) -> bool {
    law.continuous && matches!(law.gain, Gain::Any | Gain::Constant)
}

fn is_constant(spec: &Spec<'_>) -> bool {
    let law = spec.sub("gain").and_then(|gain| gain.text("law"));
    law.is_ok_and(|law| law == "constant")
}

fn number(count: usize) -> f64 {
    count as f64
}

fn put(out: &mut Vec<f64>, values: &[f64]) {
    out.push(number(values.len()));
    out.extend(values);
}

fn program(out: &mut Vec<f64>, compiled: &Compiled) {
    out.push(number(compiled.constants().len()));
    for (register, value) in compiled.constants() {
        out.extend([f64::from(*register), *value]);
    }
    put(out, &compiled.outputs.iter().map(|register| f64::from(*register)).collect::<Vec<_>>());
    let packed = compiled.program().instructions.iter().map(|of| {
        let parts = [of.operation as u8, of.result, of.a, of.b, of.c];
        parts.iter().fold(0.0, |sum, part| 256.0 * sum + f64::from(*part))
    });
    put(out, &packed.collect::<Vec<_>>());
}
