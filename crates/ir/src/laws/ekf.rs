//! The high-gain EKF of sampled data: of one chain, or of all chains of a model with several outputs.

use super::outputs;
use crate::error::{Result, refused};
use crate::model::{Given, OwnChains, OwnModel};
use crate::order::MAX_INPUTS;
use crate::spec::Spec;
use crate::tables::{Build, Shape, Tables, half_table, halves, shape_of};
use crate::trace::{self, Setting, Traced, input};
use hgo_rs::Scalar;
use hgo_rs::dual::Dual;
use hgo_rs::laws::Law;
use hgo_rs::model::Model;
use hgo_rs::observers::{AdaptiveEkf, InnovationGain, SampledEkf};
use nalgebra::SMatrix;

/// The word for the law.
pub(super) const KIND: &str = "high-gain-ekf";

/// The word for the method.
const METHOD: &str = "sampled";

/// Whether a spec of this law asks for the filter of sampled data, not for a scheme of its rate.
pub(super) fn is_sampled(spec: &Spec<'_>) -> Result<bool> {
    Ok(spec.text_or("method", "euler")? == METHOD)
}

/// Whether these are the filters of all chains of a model.
pub(super) fn all(specs: &[Spec<'_>]) -> Result<bool> {
    let mut count = 0;
    for spec in specs {
        count += usize::from(spec.text("kind")? == KIND && is_sampled(spec)?);
    }
    if count != 0 && count != specs.len() {
        return Err(refused(
            "the high-gain EKF of sampled data has one covariance over all chains: give one for each \
             output, or for none",
        ));
    }
    Ok(count != 0)
}

/// What a spec says of one chain.
struct Chain {
    n: usize,
    /// Lower triangles, row by row.
    q: Vec<f64>,
    p0: Vec<f64>,
    r: f64,
    theta: f64,
}

/// The word for a gain that moves by the innovation of a window.
const ADAPTIVE: &str = "innovation";

impl Chain {
    /// θ of an adaptive one is told by [`Window`].
    fn read(spec: &Spec<'_>, adaptive: bool) -> Result<Self> {
        spec.only(&["kind", "n", "Q", "R", "P0", "gain", "model", "method", "timing", "wrap"])?;
        let n = spec.count("n")?;
        let timing = spec.text_or("timing", "predictor")?;
        if timing != "current" {
            return Err(refused(format!(
                "timing = {timing:?} is not allowed: the high-gain EKF of sampled data uses a sample at \
                 its own time; choose current, or another method"
            )));
        }
        let gain = spec.sub("gain")?;
        if !adaptive && gain.text("law")? != "constant" {
            return Err(refused(format!(
                "gain[\"law\"] = {:?} is not allowed: the high-gain EKF of sampled data takes a \
                 constant theta, of one output also the gain {ADAPTIVE:?}; choose constant, or another method",
                gain.text("law")?
            )));
        }
        let theta = if adaptive { 1.0 } else { gain.f64("ell")? };
        if !adaptive {
            gain.only(&["law", "ell"])?;
        }
        let [r] = spec.vector::<1>("R", 1)?;
        let packed = n * (n + 1) / 2;
        let (q, p0) = (spec.list_of("Q", packed)?, spec.list_of("P0", packed)?);
        Ok(Self { n, q, p0, r, theta })
    }
}

/// How θ moves by the innovation of so many samples.
struct Window {
    samples: usize,
    /// θ_max, ΔT, λ, β, m.
    numbers: [f64; 5],
}

impl Window {
    /// If a spec's gain is such a one.
    fn read(spec: &Spec<'_>) -> Result<Option<Self>> {
        let gain = spec.sub("gain")?;
        if gain.text("law")? != ADAPTIVE {
            return Ok(None);
        }
        let names = ["most", "rise", "fall", "slope", "threshold"];
        gain.only(&[&["law", "samples"], &names[..]].concat())?;
        let mut numbers = [0.0; 5];
        for (number, name) in numbers.iter_mut().zip(names) {
            *number = gain.f64(name)?;
        }
        Ok(Some(Self { samples: gain.count("samples")?, numbers }))
    }

    fn gain(&self) -> Result<InnovationGain<Traced>> {
        let [most, rise, fall, slope, threshold] = self.numbers.map(Traced::from_f64);
        Ok(InnovationGain::new(most, rise, fall, slope, threshold)?)
    }
}

/// The covariance of all chains, which are independent of each other.
fn joined<const N: usize>(
    chains: &[Chain],
    of: impl Fn(&Chain) -> &[f64],
) -> SMatrix<Traced, N, N> {
    let mut matrix = SMatrix::from_element(Traced::ZERO);
    let mut first = 0;
    for chain in chains {
        let mut entries = of(chain).iter();
        for i in 0..chain.n {
            for j in 0..=i {
                let value = Traced::from_f64(entries.next().copied().unwrap_or(0.0));
                matrix[(first + i, first + j)] = value;
                matrix[(first + j, first + i)] = value;
            }
        }
        first += chain.n;
    }
    matrix
}

/// Tables of the filter of these chains with the model that `model` makes within a trace.
fn of<Md, const N: usize, const K: usize>(
    chains: &[Chain],
    (n_u, parameters): (usize, &[f64]),
    setting: Setting,
    model: impl Fn() -> Result<Md>,
) -> Result<Tables>
where
    Md: Model<Dual<Traced, N>, N, MAX_INPUTS> + 'static,
{
    let build = || {
        let of = |value: &dyn Fn(&Chain) -> f64| {
            std::array::from_fn(|q| Traced::from_f64(chains.get(q).map_or(1.0, value)))
        };
        let orders = std::array::from_fn(|q| chains.get(q).map_or(0, |chain| chain.n));
        let (q, p0) = (joined(chains, |chain| &chain.q), joined(chains, |chain| &chain.p0));
        let (r, theta) = (of(&|chain| chain.r), of(&|chain| chain.theta));
        let model = model()?;
        let observer =
            SampledEkf::<_, Md, N, K, MAX_INPUTS>::new(&q, r, &p0, theta, orders, model)?;
        Ok(halves(observer))
    };
    finished(chains, (n_u, parameters), setting, &build)
}

/// Tables of the filter that `build` makes within a trace.
fn finished(
    chains: &[Chain],
    (n_u, parameters): (usize, &[f64]),
    setting: Setting,
    build: Build<'_>,
) -> Result<Tables> {
    let shape = shape_of(n_u, build)?;
    let mut end = 0;
    let firsts = chains.iter().map(|chain| {
        end += chain.n;
        end - chain.n
    });
    let start = outputs::start_at(&firsts.collect::<Vec<_>>(), &shape, setting)?;
    let correct = Some(half_table(setting, &shape, true, build)?);
    let advance = half_table(setting, &shape, false, build)?;
    // the time that has passed is no signal; of several outputs, as of other chains, the estimates are
    let signals = if shape.n_y == 1 { shape.memory - 1 } else { shape.n };
    let tables = Tables::of_halves(Shape { signals, ..shape }, correct, advance, parameters);
    Ok(Tables { start: Some(start), ..tables })
}

/// Of one chain.
pub(super) fn tables(
    law: &'static Law,
    spec: &Spec<'_>,
    given: &Given<'_>,
    setting: Setting,
) -> Result<Tables> {
    let window = Window::read(spec)?;
    let chains = [Chain::read(spec, window.is_some())?];
    let with = (given.n_u()?, given.parameters());
    if let Some(window) = window {
        macro_rules! sizes {
            ($(($n:literal, $w:literal))*) => {
                match (chains[0].n, window.samples) {
                    $(($n, $w) => finished(&chains, with, setting, &|| {
                        let (q, p0) = (joined(&chains, |of| &of.q), joined(&chains, |of| &of.p0));
                        let (r, model) = (Traced::from_f64(chains[0].r), given.install($n)?);
                        let gain = window.gain()?;
                        let observer =
                            AdaptiveEkf::<_, _, $n, $w, MAX_INPUTS>::new(&q, r, &p0, gain, model)?;
                        Ok(halves(observer))
                    }),)*
                    (n, samples) => Err(refused(format!(
                        "n = {n} with a window of {samples} samples is not allowed: the adaptive {} takes \
                         n = 1 to 4, and 5 or 10 samples",
                        law.title
                    ))),
                }
            };
        }
        return sizes! {
            (1, 5) (2, 5) (3, 5) (4, 5) (1, 10) (2, 10) (3, 10) (4, 10)
        };
    }
    macro_rules! orders {
        ($($n:literal)*) => {
            match chains[0].n {
                $($n => of::<_, $n, 1>(&chains, with, setting, || given.install($n)),)*
                n => Err(refused(format!(
                    "n = {n} is not allowed: the {} takes 1 to 6",
                    law.title
                ))),
            }
        };
    }
    orders!(1 2 3 4 5 6)
}

/// Of all chains of a model with several outputs.
pub(super) fn joint(spec: &Spec<'_>, setting: Setting) -> Result<Tables> {
    spec.only(&["kind", "observers", "model"])?;
    let (own, specs) = (OwnModel::read(&spec.sub("model")?)?, spec.list("observers")?);
    if own.form != "chains" {
        return Err(refused("an observer of several outputs needs a model of chains"));
    }
    if own.unknown.contains(&true) {
        return Err(refused(
            "an unknown of a model of several outputs is not allowed for high-gain EKFs: write it as a \
             state of its chain, or choose the standard observer",
        ));
    }
    if specs.iter().any(|spec| spec.has("wrap")) {
        return Err(refused(
            "wrap is not allowed for high-gain EKFs of several outputs: unwrap the samples",
        ));
    }
    let chains: Vec<Chain> =
        specs.iter().map(|spec| Chain::read(spec, false)).collect::<Result<_>>()?;
    let given: Vec<usize> = chains.iter().map(|chain| chain.n).collect();
    if given != own.orders {
        return Err(refused(format!(
            "observers of orders {given:?} do not fit a model of chains of orders {:?}",
            own.orders
        )));
    }
    macro_rules! sizes {
        ($(($n:literal, $k:literal))*) => {
            match (own.n, chains.len()) {
                $(($n, $k) => over::<$n, $k>(&chains, &own, setting),)*
                (n, outputs) => Err(refused(format!(
                    "{outputs} outputs and {n} states are not allowed: the high-gain EKF takes up to 4 \
                     outputs, and up to 8 states in all"
                ))),
            }
        };
    }
    sizes! {
        (1, 1) (2, 1) (3, 1) (4, 1) (5, 1) (6, 1)
        (2, 2) (3, 2) (4, 2) (5, 2) (6, 2) (7, 2) (8, 2)
        (3, 3) (4, 3) (5, 3) (6, 3) (7, 3) (8, 3)
        (4, 4) (5, 4) (6, 4) (7, 4) (8, 4)
    }
}

fn over<const N: usize, const K: usize>(
    chains: &[Chain],
    own: &OwnModel,
    setting: Setting,
) -> Result<Tables> {
    of::<_, N, K>(chains, (own.n_u, &own.parameters), setting, || {
        let parameters = own.names().iter().map(|name| input(name)).collect();
        let function = trace::function(own.table.clone(), parameters);
        let mut end = 0;
        let last = std::array::from_fn(|q| {
            end += chains.get(q).map_or(0, |chain| chain.n);
            end.saturating_sub(1)
        });
        Ok(OwnChains::<N, K> { function, n_u: own.n_u, last })
    })
}
