//! A study whose noise is a law of the crate `rand_distr`: what heavy tails do to a velocity.
//!
//! Usage: cargo run --release -p hgo-ir --example heavy_tails

use hgo_ir::study::Study;
use hgo_ir::{Result, Spec, Value};
use rand_distr::{Distribution, Normal, StudentT};

/// Lee's oscillator beside an observer of its model; the noise is "none" here, since a law is given.
const STUDY: &str = r#"
runs = 200
seed = 1
steps = 2000
schedule = { kind = "fixed", dt = 1e-3 }
noise = { kind = "none" }
windows = [[1000, 2001]]
x0 = [1.0, 0.0]
memory0 = [0.0, 0.0]
[plant]
kind = "lee"
[observer]
kind = "standard"
n = 2
k = [2.0, 1.0]
method = "rk4"
gain = { law = "constant", ell = 30.0 }
[observer.model]
kind = "lee"
"#;

/// Root mean square and largest error of the second state over all runs, after the start.
fn errors(law: impl Distribution<f64> + Send + Sync + 'static) -> Result<(f64, f64)> {
    let value = Value::from_toml(STUDY)?;
    let result = Study::with_noise(&Spec::new(&value, "study")?, law)?.run(None, &|| false)?;
    let of = |run: &hgo_ir::study::RunResult| (run.moments[1].rms(), run.moments[1].max());
    let told: Vec<(f64, f64)> = result.runs.iter().map(of).collect();
    let square = told.iter().map(|(rms, _)| rms * rms).sum::<f64>() / told.len() as f64;
    Ok((square.sqrt(), told.iter().map(|(_, max)| *max).fold(0.0, f64::max)))
}

fn main() -> Result<()> {
    // of one variance, 1e-4: Student's t of nu degrees has nu / (nu - 2)
    let normal = errors(Normal::new(0.0, 0.01).expect("a deviation above 0"))?;
    let scale = 0.01 / 3.0_f64.sqrt();
    let tails = errors(StudentT::new(3.0).expect("degrees above 0").map(move |v| scale * v))?;
    println!("normal       rms {:.4}, largest {:.3}", normal.0, normal.1);
    println!("Student-t, 3 rms {:.4}, largest {:.3}", tails.0, tails.1);
    // an observer is nearly linear here: the same variance, and outliers that are larger
    assert!((tails.0 / normal.0 - 1.0).abs() < 0.1 && tails.1 > 2.0 * normal.1);
    Ok(())
}
