//! Noise of any law of `rand_distr`, and coloured noise: the same bits as recorded noise.

use crate::experiment::FEW_AND_MANY;
use hgo_ir::study::{Study, StudyResult};
use hgo_ir::{Spec, Value};
use hgo_rs::noise::{Channel, Stream};
use rand_distr::{Cauchy, Distribution, Gamma, SkewNormal, StudentT, Triangular, Weibull};

const STEPS: usize = 200;
const SEED: u64 = 5;
const FIRST: u64 = 3;
const SCALE: f64 = 0.01;

fn text(noise: &str, runs: usize) -> String {
    format!(
        "runs = {runs}\nseed = {SEED}\nfirst_run = {FIRST}\nsteps = {STEPS}\nevery = 7\n\
         plant_method = 'rk4'\nschedule = {{ kind = 'fixed', dt = 0.01 }}\nnoise = {noise}\n\
         windows = [[50, 201]]\nx0 = [1.0, -0.5]\nmemory0 = [0.0, 0.0]\n\
         [plant]\nkind = 'lee'\n[observer]\nkind = 'standard'\nn = 2\nk = [2.0, 2.0]\n\
         method = 'euler'\ngain = {{ law = 'constant', ell = 10.0 }}"
    )
}

fn told(study: hgo_ir::Result<Study>) -> Vec<u64> {
    let result: StudyResult = study.unwrap().run(None, &|| false).unwrap();
    let runs = result.runs.iter().flat_map(|run| run.final_memory.iter().chain(&run.peak));
    let frames = result.frames.values.iter().flatten();
    runs.chain(frames).map(|value| value.to_bits()).collect()
}

fn read(text: &str, make: impl Fn(&Spec<'_>) -> hgo_ir::Result<Study>) -> Vec<u64> {
    let value = Value::from_toml(text).unwrap();
    told(make(&Spec::new(&value, "study").unwrap()))
}

/// Values drawn ahead, a row a run.
fn recorded(runs: usize, draw: impl Fn(&mut Stream) -> Vec<f64>) -> String {
    let rows = (0..runs as u64).map(|run| {
        let values = draw(&mut Stream::new(SEED, FIRST + run, Channel::Measurement));
        format!("{values:?}")
    });
    let rows: Vec<String> = rows.collect();
    format!("{{ kind = 'samples', values = [{}] }}", rows.join(", "))
}

#[test]
fn student_t_of_rand_distr() {
    let law = || StudentT::new(3.0).unwrap().map(|value| SCALE * value);
    for runs in FEW_AND_MANY {
        for hold in [1, 4] {
            let noise = format!("{{ kind = 'none', hold = {hold} }}");
            let ours = read(&text(&noise, runs), |spec| Study::with_noise(spec, law()));
            let ahead = recorded(runs, |stream| {
                let drawn: Vec<f64> = law().sample_iter(stream).take(STEPS / hold + 1).collect();
                (0..=STEPS).map(|k| drawn[k / hold]).collect()
            });
            assert_eq!(ours, read(&text(&ahead, runs), Study::read), "{runs} runs, hold {hold}");
        }
    }
}

/// However many numbers of the stream a draw takes.
#[test]
fn other_laws_of_rand_distr() {
    fn same(law: impl Distribution<f64> + Clone + Send + Sync + 'static) {
        let drawn = law.clone();
        let ours =
            read(&text("{ kind = 'none' }", 3), move |spec| Study::with_noise(spec, law.clone()));
        let ahead =
            recorded(3, |stream| drawn.clone().sample_iter(stream).take(STEPS + 1).collect());
        assert_eq!(ours, read(&text(&ahead, 3), Study::read));
    }
    same(Cauchy::new(0.0, SCALE).unwrap());
    same(Gamma::new(0.5, SCALE).unwrap());
    same(SkewNormal::new(0.0, SCALE, 2.0).unwrap());
    same(Triangular::new(-SCALE, 2.0 * SCALE, 0.0).unwrap());
    same(Weibull::new(SCALE, 0.7).unwrap());
}

#[test]
fn a_value_of_a_law_that_is_no_number_is_a_missing_sample() {
    let law = || StudentT::new(3.0).unwrap().map(|v| if v > 0.5 { f64::NAN } else { SCALE * v });
    let ours = read(&text("{ kind = 'none' }", 2), |spec| Study::with_noise(spec, law()));
    let ahead = recorded(2, |stream| law().sample_iter(stream).take(STEPS + 1).collect());
    let ahead = ahead.replace("NaN", "nan");
    assert_eq!(ours, read(&text(&ahead, 2), Study::read));
}

#[test]
fn noise_that_is_given_twice() {
    let value = Value::from_toml(&text("{ kind = 'normal', std = 0.1 }", 1)).unwrap();
    let spec = Spec::new(&value, "study").unwrap();
    let Err(error) = Study::with_noise(&spec, StudentT::new(3.0).unwrap()) else { panic!() };
    assert!(error.to_string().contains("given twice"), "{error}");
}

/// v(k) = a₁v(k−1) + a₂v(k−2) + s e(k), from v(−1) and v(−2).
#[test]
fn coloured_noise() {
    let (a, s) = ([1.2, -0.5], 0.02);
    let start = [[0.05, 0.0], [0.04, 0.03]];
    for runs in FEW_AND_MANY {
        for hold in [1, 3] {
            let noise = format!(
                "{{ kind = 'normal', std = {s}, ar = {a:?}, start = {start:?}, hold = {hold} }}"
            );
            let ahead = recorded(runs, |stream| {
                let normal = [stream.normal(), stream.normal()];
                let [mut v1, mut v2] = start.map(|[c, d]| c * normal[0] + d * normal[1]);
                let mut drawn = Vec::new();
                for _ in 0..=STEPS / hold {
                    let new = 0.0 + s * stream.normal() + a[0] * v1 + a[1] * v2;
                    (v1, v2) = (new, v1);
                    drawn.push(new);
                }
                (0..=STEPS).map(|k| drawn[k / hold]).collect()
            });
            let ours = read(&text(&noise, runs), Study::read);
            assert_eq!(ours, read(&text(&ahead, runs), Study::read), "{runs} runs, hold {hold}");
        }
    }
}
