//! Floor 10. `observer.toml`: one file that says what an observer is, read without Python.
//!
//! Keys and defaults are those of docs/configuration.md. Three things differ:
//!
//! - Expressions (`phi = "-sin(q)"`) are compiled in Python only. Here a model of the user's own is its
//!   table of operations, in the place of the expressions:
//!
//!   ```toml
//!   [model]
//!   form = "phase"  # or triangular, chains, sampled, strict-feedback
//!   states = ["q", "v"]
//!   parameters = { damping = 0.5 }
//!
//!   [model.table]
//!   inputs = ["t", "q", "v", "damping"]  # time, states, inputs, parameters
//!   ops = [["sin", 1], ["mul", 3, 2], ["add", 4, 5], ["neg", 6]]
//!   outputs = [7]
//!   ```
//!
//!   Of the strict-feedback form `n_z` says how many of the states, the last, are not measured.
//! - `[log]` is handed on as it is: no file of samples is read here.
//! - No step is compared with a stability limit, so that `allow_unstable` changes nothing.

use crate::choices::AnyMethod;
use crate::design::{covariances, of_law};
use crate::error::{Result, refused};
use crate::observer::build;
use crate::recursion::AnyObserver;
use crate::spec::Spec;
use crate::systems::AnyModel;
use crate::value::{Numbers, Value};
use hgo_rs::laws::{Form, Gain, Law, Part, Sizes};
use hgo_rs::motion::SUBSTEPS;
use hgo_rs::observers::LAWS;
use std::sync::Arc;

/// The format of `observer.toml` that is read.
pub const FORMAT: u64 = 1;

/// The keys that say what a structure is.
fn keys(kind: &str) -> Option<Vec<&'static str>> {
    let law = match kind {
        "sampled-data" => return Some(vec!["gain", "wrap"]),
        "reduced-order" => return Some(vec!["epsilon", "h_bar", "wrap"]),
        "window" => return Some(vec!["order", "window", "W", "dt", "wrap"]),
        "chains" => return Some(vec!["observers"]),
        _ => Law::find(LAWS, kind)?,
    };
    let mut keys = vec!["gain"];
    if law.orders.len() > 1 {
        keys.push("order");
    }
    if law.gain == Gain::Constant {
        keys.push("epsilon");
    }
    if law.gain == Gain::Any {
        keys.extend(if filters(law) { ["theta"].as_slice() } else { &["epsilon", "shape"] });
    }
    if law.design.is_some() {
        keys.push("poles");
    }
    keys.extend(law.coefficients.iter().map(|list| list.name));
    keys.extend(law.size.map(|(name, _)| name));
    keys.extend(["method", "motion", "substeps", "timing", "wrap"]);
    if law.saturated {
        keys.extend(["saturation", "clip"]);
    }
    Some(keys)
}

/// Whether a law's gains come from a covariance.
fn filters(law: &Law) -> bool {
    law.coefficients.iter().any(|list| list.name == "P0")
}

/// Keys of a model's expressions.
const EXPRESSIONS: [&str; 7] = ["phi", "f", "f1", "g", "f2", "h", "K_T"];

/// What a file leaves open.
const METHOD: &str = "zoh";
const SAMPLED: &str = "sampled";
const TIMING: &str = "current";

/// An observer as a file says it.
#[derive(Clone, Debug)]
pub struct Config {
    observer: Value,
    start: Value,
    log: Option<Value>,
}

impl Config {
    /// From the text of an `observer.toml`.
    ///
    /// # Errors
    /// A text that is not TOML; another format; a key that is unknown, missing, of a wrong type or out of
    /// range; a model that is written as expressions.
    pub fn from_toml(text: &str) -> Result<Self> {
        let value = Value::from_toml(text)?;
        let spec = Spec::new(&value, "observer.toml")?;
        let format: u64 = spec.whole("format")?;
        if format != FORMAT {
            return Err(refused(format!(
                "format = {format} is not allowed: this version reads format {FORMAT}"
            )));
        }
        let model = if spec.has("model") { Some(model(&spec.sub("model")?)?) } else { None };
        let config = Self {
            observer: law(
                &spec,
                model.as_ref(),
                model.as_ref(),
                &["format", "model", "start", "log"],
            )?,
            start: spec.get("start").cloned().unwrap_or_else(|| Value::Map(Vec::new())),
            log: spec.get("log").cloned(),
        };
        config.start_spec()?.only(&["x_hat", "r", "memory", "t", "from"])?;
        if let Some(log) = &config.log {
            let known = ["time", "output", "input", "dt", "unit", "resets", "schedule"];
            let columns = ["unwrap", "scale", "offset"];
            Spec::new(log, "log")?.only(&[known.as_slice(), &columns].concat())?;
        }
        Ok(config)
    }

    /// The observer as a spec: what [`build`], [`Tables`](crate::tables::Tables) and, as its part
    /// "observer", a [`Study`](crate::study::Study) are read from.
    pub fn spec(&self) -> &Value {
        &self.observer
    }

    /// The observer, as it is stepped.
    ///
    /// # Errors
    /// Values that do not fit each other.
    pub fn observer(&self) -> Result<Box<dyn AnyObserver>> {
        build(&Spec::new(&self.observer, "observer")?)
    }

    /// The memory to start from.
    ///
    /// # Errors
    /// A start that does not fit the observer.
    pub fn memory(&self) -> Result<Vec<f64>> {
        let (start, observer) = (self.start_spec()?, self.observer()?);
        let mut memory = observer.initial();
        let mut put = |key: &str, first: usize, count: usize| {
            let given = start.numbers(key)?;
            match memory.get_mut(first..first + count) {
                Some(entries) if given.values.len() == count => {
                    entries.copy_from_slice(&given.values);
                    Ok(())
                }
                _ => Err(refused(format!(
                    "start[{key:?}] has {} entries; it must have {count}",
                    given.values.len()
                ))),
            }
        };
        if start.has("memory") {
            if start.has("x_hat") || start.has("r") {
                return Err(refused("start: give the whole memory, or x_hat and r"));
            }
            put("memory", 0, observer.initial().len())?;
        }
        if start.has("x_hat") {
            put("x_hat", 0, observer.n())?;
        }
        if start.has("r") {
            put("r", self.gain_index(observer.n())?, 1)?;
        }
        Ok(memory)
    }

    /// Of an observer in use the time at which it stands, in s: its first sample is taken.
    ///
    /// # Errors
    /// No number.
    pub fn time(&self) -> Result<Option<f64>> {
        let start = self.start_spec()?;
        if start.has("t") { start.f64("t").map(Some) } else { Ok(None) }
    }

    /// `[log]`: how a file of samples is read for it.
    pub fn log(&self) -> Option<&Value> {
        self.log.as_ref()
    }

    fn start_spec(&self) -> Result<Spec<'_>> {
        Spec::new(&self.start, "start")
    }

    /// Where r stands in the memory.
    fn gain_index(&self, n: usize) -> Result<usize> {
        let spec = Spec::new(&self.observer, "observer")?;
        let kind = spec.text("kind")?;
        let moves = matches!(spec.get("gain"), Some(Value::Map(_)))
            && matches!(spec.sub("gain")?.text("law")?.as_str(), "adaptive" | "dead-zone");
        let Some(law) = Law::find(LAWS, &kind).filter(|_| moves) else {
            let message = "start[\"r\"] is not allowed: this observer remembers no gain r";
            return Err(refused(message));
        };
        let sizes = Sizes { n, moves, ..Sizes::default() };
        match law.memory.iter().position(|part| part.name == "r") {
            Some(r) => Ok(law.memory.iter().take(r).map(|part| (part.len)(&sizes)).sum()),
            None => Ok(n), // of the first copy
        }
    }
}

fn text(value: &str) -> Value {
    Value::Text(value.to_owned())
}

fn whole(value: usize) -> Value {
    Value::Whole(value as i128)
}

fn numbers(values: Vec<f64>) -> Value {
    let shape = vec![values.len()];
    Value::Numbers(Arc::new(Numbers { values, shape }))
}

/// A map under construction.
#[derive(Default)]
struct Map(Vec<(String, Value)>);

impl Map {
    fn put(&mut self, key: &str, value: Value) {
        self.0.push((key.to_owned(), value));
    }

    fn put_given(&mut self, spec: &Spec<'_>, key: &str) {
        if let Some(value) = spec.get(key) {
            self.put(key, value.clone());
        }
    }
}

/// The spec of a law; `known` is the model of all chains of which it may be one, `also` are keys beside its
/// own.
fn law(
    spec: &Spec<'_>,
    model: Option<&Value>,
    known: Option<&Value>,
    also: &[&str],
) -> Result<Value> {
    let kind = spec.text("observer")?;
    let Some(keys) = keys(&kind) else {
        let known: Vec<&str> = LAWS.iter().map(|law| law.kind).chain(["chains"]).collect();
        return Err(spec.unknown("observer", &kind, &known));
    };
    spec.only(&[&["observer", "allow_unstable"], keys.as_slice(), also].concat())?;
    spec.flag_or("allow_unstable", false)?;
    let mut made = Map::default();
    made.put("kind", text(&kind));
    match kind.as_str() {
        "sampled-data" => made.put_given(spec, "gain"),
        "reduced-order" => {
            made.put("epsilon", Value::Number(spec.f64("epsilon")?));
            made.put("h_bar", numbers(h_bar(spec, model)?));
        }
        "window" => {
            made.put("n", whole(spec.count("order")?));
            for key in ["window", "W", "dt"] {
                made.put_given(spec, key);
            }
            made.put("model", kind_alone("none"));
        }
        "chains" => {
            let inner = spec.list("observers")?;
            let inner = inner.iter().map(|one| law(one, None, known, &[]));
            made.put("observers", Value::List(inner.collect::<Result<_>>()?));
        }
        _ => rates(&mut made, spec, model, known)?,
    }
    made.put_given(spec, "wrap");
    match model {
        Some(model) => made.put("model", model.clone()),
        None if kind == "sampled-data" => made.put("model", kind_alone("van-der-pol")),
        None if kind == "reduced-order" => made.put("model", kind_alone("ship")),
        None => {}
    }
    Ok(Value::Map(made.0))
}

fn kind_alone(kind: &str) -> Value {
    Value::Map(vec![("kind".to_owned(), text(kind))])
}

/// The order that is named, or the model's.
fn order(spec: &Spec<'_>, model: Option<&Value>) -> Result<usize> {
    let of_model = match model {
        Some(model) if !spec.has("order") => {
            let model = Spec::new(model, "model")?;
            let own = model.text("kind")? == "own";
            if own { Some(model.count("n")?) } else { AnyModel::<f64>::read(&model)?.order() }
        }
        _ => None,
    };
    of_model.map_or_else(|| spec.count("order"), Ok)
}

/// A law of the list that is given by a rate.
fn rates(
    made: &mut Map,
    spec: &Spec<'_>,
    model: Option<&Value>,
    known: Option<&Value>,
) -> Result<()> {
    let kind = spec.text("observer")?;
    let Some(law) = Law::find(LAWS, &kind) else { return Ok(()) };
    let n = if let [only] = law.orders { *only } else { order(spec, model)? };
    let m = match law.size {
        Some((name, [usual, ..])) if !spec.has(name) => *usual,
        Some((name, _)) => spec.count(name)?,
        None => 0,
    };
    made.put("n", whole(n));
    if let Some((name, _)) = law.size {
        made.put(name, whole(m));
    }
    let gain = gain(spec)?;
    let of_gain = Spec::new(&gain, "gain")?.text("law")?;
    let moves = of_gain != "constant";
    let placed = law.placed() && !(moves && law.form == Form::Phase) && !of_rows(spec)?;
    let filters = filters(law);
    let method = if filters {
        SAMPLED
    } else if placed {
        METHOD
    } else if of_gain == "homogeneous" && !law.placed() {
        "proper"
    } else {
        "rk4"
    };
    let lists =
        if filters { noises(spec, n, method, &gain)? } else { coefficients(law, spec, n, m)? };
    made.put("gain", gain);
    for (list, values) in law.coefficients.iter().zip(lists) {
        made.put(list.name, numbers(values));
    }
    made.put_given(spec, "shape");
    manner(made, spec, method, known)?;
    if law.saturated && (spec.has("saturation") || spec.has("clip") || !law.open) {
        let levels = spec.numbers("saturation")?.values.clone();
        let levels = if levels.len() == 1 { vec![levels[0]; n - 1] } else { levels };
        made.put("saturation", numbers(levels));
        made.put_given(spec, "clip");
    }
    Ok(())
}

/// Whether a shape gives each row of the injection a value of its own.
fn of_rows(spec: &Spec<'_>) -> Result<bool> {
    Ok(spec.has("shape")
        && !matches!(spec.sub("shape")?.text("law")?.as_str(), "stubborn" | "dead-zone"))
}

/// The lists of a law: given, or from poles.
fn coefficients(law: &Law, spec: &Spec<'_>, n: usize, m: usize) -> Result<Vec<Vec<f64>>> {
    let lists = law.coefficients;
    let sizes = Sizes { n, m, ..Sizes::default() };
    let given = lists.iter().filter(|list| spec.has(list.name)).count();
    if given == 0 && law.design.is_some() {
        let poles = if spec.has("poles") { Some(poles(spec)?) } else { None };
        return of_law(law, &sizes, poles.as_deref());
    }
    let names: Vec<&str> = lists.iter().map(|list| list.name).collect();
    let names = names.join(" and ");
    let open = |list: &&Part| !spec.has(list.name) && (list.len)(&sizes) == 0;
    if given + lists.iter().filter(open).count() < lists.len() {
        return Err(refused(format!("{names} must be given together and without poles")));
    }
    if law.design.is_some() && spec.has("poles") {
        let message = format!("{names} is not allowed beside poles: give one of them");
        return Err(refused(message));
    }
    let values = |list: &Part| {
        if open(&list) { Ok(Vec::new()) } else { Ok(spec.numbers(list.name)?.values.clone()) }
    };
    lists.iter().map(values).collect()
}

/// Q, R and P(0) of a Kalman filter.
fn noises(spec: &Spec<'_>, n: usize, usual: &str, gain: &Value) -> Result<Vec<Vec<f64>>> {
    let gain = Spec::new(gain, "gain")?;
    let theta = if gain.text("law")? == "constant" { gain.f64("ell")? } else { 1.0 };
    let sampled = spec.text_or("method", usual)? == SAMPLED;
    let (q, r) = (spec.numbers("Q")?, spec.numbers("R")?);
    let [variance] = r.values.as_slice() else {
        return Err(refused("R is not allowed: give one number, the variance of a sample"));
    };
    let p0 = if spec.has("P0") { Some(spec.numbers("P0")?) } else { None };
    let given = p0.as_ref().map(|p0| p0.values.as_slice());
    let made = covariances(n, sampled, &q.values, *variance, given, theta)?;
    Ok(vec![made.q, vec![*variance], made.p0])
}

/// A number is ℓ, a table a law.
fn gain(spec: &Spec<'_>) -> Result<Value> {
    let ell = match (spec.get("gain"), spec.has("epsilon")) {
        (Some(law @ Value::Map(_)), false) => return Ok(law.clone()),
        (Some(_), false) => spec.f64("gain")?,
        (None, false) if spec.has("theta") => spec.f64("theta")?,
        (None, false) if spec.has("Q") => 1.0,
        (None, true) => 1.0 / hgo_rs::error::positive("epsilon", spec.f64("epsilon")?)?,
        _ => return Err(refused("gain: give either gain [1/s] or epsilon = 1/gain [s]")),
    };
    let mut law = Map::default();
    law.put("law", text("constant"));
    law.put("ell", Value::Number(ell));
    Ok(Value::Map(law.0))
}

fn manner(made: &mut Map, spec: &Spec<'_>, method: &str, known: Option<&Value>) -> Result<()> {
    let method = spec.text_or("method", method)?;
    let by_motion = AnyMethod::find(&method).is_some_and(AnyMethod::moves_by_motion);
    if by_motion || spec.has("motion") {
        let motion = spec.text_or("motion", usual_motion(made, known)?)?;
        if motion != "held" {
            made.put("substeps", spec.get("substeps").cloned().unwrap_or(whole(SUBSTEPS.into())));
        } else if spec.has("motion") {
            made.put_given(spec, "substeps"); // which the law refuses
        }
        made.put("motion", Value::Text(motion));
    } else {
        made.put_given(spec, "substeps");
    }
    let timing = if method == "inter-sample" { "predictor" } else { TIMING };
    made.put("method", Value::Text(method));
    made.put("timing", Value::Text(spec.text_or("timing", timing)?));
    Ok(())
}

/// The motion of a model where the file leaves it open: implicit where it may be steeper than the gain in the
/// state that it moves. A table tells no bound of its slopes: one that moves is implicit where it turns out to be
/// stiff.
fn usual_motion(made: &Map, known: Option<&Value>) -> Result<&'static str> {
    let Some(model) = known else { return Ok("held") };
    let model = Spec::new(model, "model")?;
    let slope = match model.text("kind")?.as_str() {
        "none" | "input" => return Ok("held"),
        "own" => return Ok("implicit"),
        "sanfelice-praly" => model.f64("nu1")?.abs(),
        "van-der-pol" => model.f64_or("epsilon", 0.8)?.abs(),
        "lee" | "crackle" => 1.0,
        _ => 0.0, // not known
    };
    let mut least = 1.0;
    if let Some((_, gain)) = made.0.iter().find(|(key, _)| key == "gain") {
        let gain = Spec::new(gain, "gain")?;
        least = if gain.text("law")? == "constant" { gain.f64("ell")? } else { 1.0 };
    }
    Ok(if slope <= least { "rk4" } else { "implicit" })
}

/// Numbers, and pairs of a real and an imaginary part.
fn poles(spec: &Spec<'_>) -> Result<Vec<(f64, f64)>> {
    let refuse = || {
        let message = "poles are not allowed: give numbers, and pairs [real, imaginary], such as \
                       [-1.0, [-2.0, 1.0], [-2.0, -1.0]]";
        refused(message)
    };
    let given = spec.get("poles").and_then(Value::as_list).ok_or_else(refuse)?;
    let pole = |value: &Value| {
        let parts = value.as_numbers().ok_or_else(refuse)?;
        match (value.as_f64(), parts.values.as_slice()) {
            (Some(real), _) => Ok((real, 0.0)),
            (None, [re, im]) => Ok((*re, *im)),
            _ => Err(refuse()),
        }
    };
    given.iter().map(pole).collect()
}

/// The paper's rates for its ship, 0.2 for each unmeasured state of another model.
fn h_bar(spec: &Spec<'_>, model: Option<&Value>) -> Result<Vec<f64>> {
    if spec.has("h_bar") {
        return Ok(spec.numbers("h_bar")?.values.clone());
    }
    let model = model.map(|model| Spec::new(model, "model")).transpose()?;
    match model {
        Some(model) if model.has("n_z") => Ok(vec![0.2; model.count("n_z")?]),
        _ => Ok(vec![0.1, 0.2, 0.2]),
    }
}

/// The spec of a model.
fn model(spec: &Spec<'_>) -> Result<Value> {
    let kind = spec.text_or("kind", "own")?;
    let mut made = Map::default();
    if kind != "own" {
        made.put("kind", text(if kind == "unknown" { "none" } else { &kind }));
        for key in spec.keys().filter(|key| *key != "kind") {
            made.put_given(spec, key);
        }
        return Ok(Value::Map(made.0));
    }
    if let Some(key) = EXPRESSIONS.into_iter().find(|key| spec.has(key)) {
        return Err(refused(format!(
            "model[{key:?}] is not read here: expressions are compiled in Python; give the model's form \
             and its table of operations"
        )));
    }
    let names = ["states", "inputs", "parameters", "unknown", "units"];
    spec.only(&[&["kind", "form", "orders", "n_z", "table"], &names[..]].concat())?;
    let states = spec.texts("states")?.unwrap_or_default();
    let inputs = spec.texts("inputs")?.unwrap_or_default();
    let n_z = if spec.has("n_z") { spec.count("n_z")? } else { 0 };
    let unknown = unknown(spec)?;
    let n = states.len().saturating_sub(n_z) + unknown.len();
    let form = spec.text_or("form", if spec.has("orders") { "chains" } else { "phase" })?;
    let mut parameters = Vec::new();
    if spec.has("parameters") {
        let given = spec.sub("parameters")?;
        for name in given.keys() {
            parameters.push(given.f64(name)?);
        }
    }
    made.put("kind", text("own"));
    made.put("form", Value::Text(form));
    made.put("n", whole(n));
    made.put("n_u", whole(inputs.len()));
    made.put("parameters", numbers(parameters));
    if !unknown.is_empty() {
        made.put("unknown", Value::List(unknown.iter().map(|_| whole(1)).collect()));
    }
    if let Some(orders) = spec.wholes("orders")? {
        let more = |chain| usize::from(chain < unknown.len());
        let longer = orders.iter().enumerate().map(|(chain, n)| whole(n + more(chain)));
        made.put("orders", Value::List(longer.collect()));
    }
    for key in ["n_z", "table"] {
        made.put_given(spec, key);
    }
    Ok(Value::Map(made.0))
}

/// The names of unknowns, one or as many as there are chains, each the last state of its chain.
fn unknown(spec: &Spec<'_>) -> Result<Vec<String>> {
    let named = match spec.text("unknown") {
        Ok(name) => vec![name],
        Err(_) => spec.texts("unknown")?.unwrap_or_default(),
    };
    let chains = spec.wholes("orders")?.map_or(1, |orders| orders.len());
    if named.is_empty() || named.len() == chains {
        return Ok(named);
    }
    let count = named.len();
    Err(refused(format!(
        "model[\"unknown\"] has {count} names; it must have {chains}, one a chain"
    )))
}
