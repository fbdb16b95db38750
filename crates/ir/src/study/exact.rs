//! Floor 4. What studies are held against: one Brownian motion in two steps, and a covariance without runs.

use super::plan::{Plan, STOCHASTIC_METHODS, stochastic};
use crate::error::{Result, refused};
use crate::spec::Spec;
use crate::systems::AnyPlant;
use hgo_rs::covariance::ErrorCovariance;
use hgo_rs::error::positive;
use hgo_rs::gain::ConstantGain;
use hgo_rs::memory::Memory;
use hgo_rs::metrics::Moments;
use hgo_rs::model::{Plant, StochasticIntegrator, Unknown};
use hgo_rs::noise::{Channel, Draw, Noise, Stream};
use hgo_rs::observer::{Discretised, Euler};
use hgo_rs::observers::StandardObserver;
use hgo_rs::simulate::{Experiment, coupled_paths as coupled_paths_of};
use nalgebra::Vector2;
use rayon::prelude::*;

const N: usize = 2;

/// Where coarse and fine paths of a stochastic plant end, for each run, on the same Brownian motion.
///
/// # Errors
/// A plant without process noise, a method that it does not support, a count that is not at least 1.
pub fn coupled_paths(
    spec: &Spec<'_>,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Vec<[[f64; N]; 2]>> {
    spec.only(&["plant", "x0", "t_end", "coarse", "fine", "method", "runs", "seed", "first_run"])?;
    let AnyPlant::VanDerPol(plant) = AnyPlant::<f64>::read(&spec.sub("plant")?)? else {
        return Err(refused("plant must have process noise: choose van-der-pol"));
    };
    let runs = if spec.has("runs") { spec.count("runs")? } else { 1 };
    let x0 = spec.rows("x0", N, runs)?;
    let t_end = positive("t_end", spec.f64("t_end")?)?;
    let count = |key: &str| -> Result<u32> {
        let value = spec.whole(key)?;
        let fits = u32::try_from(value).ok().filter(|n| *n >= 1);
        fits.ok_or_else(|| refused(format!("{key} = {value} is not allowed: 1 to 4294967295")))
    };
    let steps = (count("coarse")?, count("fine")?);
    let method = spec.text("method")?;
    let scheme = stochastic(&method)
        .filter(|scheme| Plant::<f64>::supports(&plant, *scheme))
        .ok_or_else(|| spec.unknown("method", &method, &STOCHASTIC_METHODS))?;
    let finest = if Plant::<f64>::supports(&plant, StochasticIntegrator::Taylor15) {
        StochasticIntegrator::Taylor15
    } else {
        StochasticIntegrator::Milstein
    };
    let (seed, first) = (spec.whole_or("seed", 0)?, spec.whole_or("first_run", 0)?);
    let pair = |run: usize| {
        let start = Vector2::read(if x0.len() == N { &x0 } else { &x0[N * run..] });
        let mut stream = Stream::new(seed, first.wrapping_add(run as u64), Channel::Process);
        let (coarse, fine) =
            coupled_paths_of(&plant, scheme, finest, start, t_end, steps, &mut stream, stop);
        [coarse.into(), fine.into()]
    };
    Ok((0..runs).into_par_iter().map(pair).collect())
}

/// Errors of a linear observer under white noise, without a run.
pub struct Covariances {
    /// RMS of each error, window by window.
    pub rms: Vec<f64>,
    /// How many windows.
    pub windows: usize,
    /// The covariance of the error at the end.
    pub last: [[f64; N]; N],
}

/// Exact RMS error of a linear standard observer of order 2 under forward Euler and white noise. `variance`,
/// if given, stands for the noise's.
///
/// # Errors
/// An observer that is not linear, noise without one variance, a plant other than Lee's.
pub fn covariances(spec: &Spec<'_>, stop: &(dyn Fn() -> bool + Sync)) -> Result<Covariances> {
    let observer = spec.sub("observer")?;
    let (k, gain) = (observer.vector::<N>("k", N)?, observer.sub("gain")?);
    let linear = observer.text("kind")? == "standard"
        && gain.text("law")? == "constant"
        && observer.sub("model")?.text("kind")? == "none"
        && observer.text_or("method", "euler")? == "euler";
    if !linear {
        return Err(refused(
            "observer must be linear: kind standard, constant gain, model none, method euler",
        ));
    }
    let ell = gain.f64("ell")?;
    let plan = Plan::read(spec, &["variance"])?.starting(spec, (N, N))?;
    let variance = match (spec.get("variance"), plan.noise_variance()) {
        (Some(_), _) => positive("variance", spec.f64("variance")?)?,
        (None, Some(variance)) => variance,
        (None, None) => {
            return Err(refused(
                "give variance, or uniform or normal noise without hold, sines or mean",
            ));
        }
    };
    let AnyPlant::Lee(plant) = AnyPlant::<f64>::read(&spec.sub("plant")?)? else {
        return Err(refused("plant must be without process noise: choose lee"));
    };
    let law: StandardObserver<f64, _, _, N, 0> =
        StandardObserver::new(k, ConstantGain::new(ell)?, Unknown)?;
    let experiment = Experiment {
        plant,
        plant_scheme: plan.plant_scheme,
        substeps: plan.substeps,
        schedule: plan.schedule,
        plant_schedule: plan.plant_schedule,
        noise: Noise { draw: Draw::None, hold: 1, sines: &[] },
        steps: plan.steps,
        seed: 0,
    };
    experiment.check()?;
    let mut moments = vec![Moments::default(); plan.windows.len() * N];
    let gains = [k[0] * ell, k[1] * ell * ell];
    let (schedule, windows) = (plan.schedule, &plan.windows);
    let mut probe = ErrorCovariance::new(schedule, gains, variance, windows, &mut moments, stop);
    let (x0, z0) = (Memory::read(&plan.x0), Memory::read(&plan.memory0));
    let observer = Discretised { law, scheme: Euler };
    experiment.sampled(&observer, |u| *u, 0, x0, z0, &mut probe);
    let last = probe.covariance.into();
    let rms = moments.iter().map(Moments::rms).collect();
    Ok(Covariances { rms, windows: plan.windows.len(), last })
}
