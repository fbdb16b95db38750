//! An observer whose model is known at run time only: read from an `observer.toml`, stepped over samples,
//! and studied beside a plant.
//!
//! Usage: cargo run -p hgo-ir --example observer_toml [FILE]

use hgo_ir::config::Config;
use hgo_ir::study::Study;
use hgo_ir::{Result, Spec, Value};

/// A pendulum with friction, measured by its angle q: q'' = −s sin q − d q'.
const PENDULUM: &str = r#"
format = 1
observer = "standard"
gain = 20.0  # 1/s

[model]
states = ["q", "v"]
parameters = { s = 9.81, d = 0.4 }

[model.table]
inputs = ["t", "q", "v", "s", "d"]
ops = [["sin", 1], ["mul", 3, 5], ["mul", 4, 2], ["add", 6, 7], ["neg", 8]]
outputs = [9]
"#;

/// The same as a plant: its drift and its output, beside the samples, the noise and what is asked for.
const STUDY: &str = r#"
steps = 2000
runs = 100
plant_method = "rk4"
schedule = { kind = "fixed", dt = 0.005 }
noise = { kind = "normal", std = 0.01 }
x0 = [1.0, 0.0]
windows = [[1000, 2001]]

[plant]
kind = "own-plant"
n = 2
parameters = [9.81, 0.4]

[plant.table]
inputs = ["t", "q", "v", "s", "d"]
ops = [["sin", 1], ["mul", 3, 5], ["mul", 4, 2], ["add", 6, 7], ["neg", 8]]
outputs = [2, 9, 1]
"#;

/// Sampling period, in s.
const DT: f64 = 0.005;

/// The estimates over so many samples y(k) of a movement that `y` tells by its time.
fn stepped(config: &Config, samples: u32, y: impl Fn(f64) -> f64) -> Result<Vec<Vec<f64>>> {
    let observer = config.observer()?;
    let (mut memory, no_input) = (config.memory()?, vec![0.0; observer.n_u()]);
    let mut estimates = Vec::new();
    for k in 0..samples {
        let t = f64::from(k) * DT;
        observer.recursion().correct(&mut memory, &[y(t)], t)?;
        estimates.push(memory[..observer.n()].to_vec());
        observer.recursion().advance(&mut memory, &[y(t)], &no_input, t, DT)?;
    }
    Ok(estimates)
}

/// Root mean squares of the errors x̂ − x of every run.
fn studied(config: &Config) -> Result<Vec<Vec<f64>>> {
    let mut value = Value::from_toml(STUDY)?;
    if let Value::Map(entries) = &mut value {
        let memory = config.memory()?.into_iter().map(Value::Number).collect();
        entries.push(("observer".to_owned(), config.spec().clone()));
        entries.push(("memory0".to_owned(), Value::List(memory)));
    }
    let study = Study::read(&Spec::new(&value, "study")?)?;
    let result = study.run(None, &|| false)?;
    Ok(result
        .runs
        .iter()
        .map(|run| run.moments.iter().map(hgo_rs::metrics::Moments::rms).collect())
        .collect())
}

/// What the observer of a file estimates of a swing of 1 rad at 0.5 Hz, and how well it does in a study.
///
/// # Errors
/// A file that is refused; an observer that does not fit the plant.
#[allow(clippy::type_complexity)] // rows of estimates, rows of errors
pub fn run(file: &str) -> Result<(Vec<Vec<f64>>, Vec<Vec<f64>>)> {
    let config = Config::from_toml(file)?;
    let estimates = stepped(&config, 400, |t| (std::f64::consts::PI * t).cos())?;
    Ok((estimates, studied(&config)?))
}

#[allow(dead_code)] // a test runs the rest
fn main() -> std::result::Result<(), Box<dyn std::error::Error>> {
    let file = match std::env::args().nth(1) {
        Some(path) => std::fs::read_to_string(path)?,
        None => PENDULUM.to_owned(),
    };
    let (estimates, errors) = run(&file)?;
    for (k, estimate) in estimates.iter().enumerate().step_by(50) {
        println!("{:6.3} s  {estimate:8.4?}", k as f64 * DT);
    }
    let runs = errors.len() as f64;
    for signal in 0..errors.first().map_or(0, Vec::len) {
        let mean = errors.iter().map(|run| run[signal]).sum::<f64>() / runs;
        println!("error of state {}: {mean:.5} rms, mean of {runs} runs", signal + 1);
    }
    Ok(())
}
