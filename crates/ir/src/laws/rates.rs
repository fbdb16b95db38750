//! Laws that are given by a rate, a row of the list each: one builder, whose keys, counts, sizes and
//! choices are the row's.
#![allow(clippy::extra_unused_type_parameters)] // every row of the list has the same ones

use crate::choices::{AnyGain, AnyMethod, AnyMotion, AnySaturation, Chosen, ENTRIES, Manner};
use crate::error::{Result, refused};
use crate::model::{Given, Known};
use crate::order::MAX_INPUTS;
use crate::spec::Spec;
use crate::tabled::{Gains, Kept, LawTables};
use crate::tables::{PlacedChain, Shape, Tables};
use crate::trace::{self, Setting, Traced};
use hgo_rs::dual::Dual;
use hgo_rs::gain::{AdaptiveGain, ConstantGain, GainLaw};
use hgo_rs::laws::{Form, Gain, Law, Sizes};
use hgo_rs::model::{Model, PhaseVariable, Unknown};
use hgo_rs::observer::Timing;
use hgo_rs::observers::Saturation;
use hgo_rs::{Scalar, for_each_law};

/// A law as a spec describes it: what its row asks for, read and checked.
struct Described<'a> {
    law: &'static Law,
    spec: &'a Spec<'a>,
    given: &'a Given<'a>,
    setting: Setting,
    sizes: Sizes,
    lists: Vec<Vec<f64>>,
    manner: Manner,
}

/// What constructors of the list take behind the coefficients.
struct Taken<T, G, Md, S> {
    gain: G,
    adaptive: Option<AdaptiveGain<T>>,
    constant: Option<ConstantGain<T>>,
    model: Md,
    saturation: S,
    open_saturation: S,
    no_saturation: S,
}

impl<T: Copy, G, Md, const N: usize> Taken<T, G, Md, AnySaturation<N, T>> {
    fn new(gain: G, model: Md, saturation: AnySaturation<N, T>) -> Self {
        Self {
            gain,
            adaptive: None,
            constant: None,
            model,
            saturation,
            open_saturation: saturation,
            no_saturation: AnySaturation::None,
        }
    }
}

impl<'a> Described<'a> {
    fn read(
        law: &'static Law,
        spec: &'a Spec<'a>,
        given: &'a Given<'a>,
        setting: Setting,
    ) -> Result<Self> {
        let mut known = vec!["kind", "n"];
        known.extend(law.coefficients.iter().map(|list| list.name));
        known.extend(law.size.map(|(name, _)| name));
        known.extend(["gain", "model", "method", "motion", "substeps", "timing", "wrap"]);
        if law.saturated {
            known.extend(["saturation", "clip"]);
        }
        if law.gain == Gain::Any && law.design.is_some() {
            known.push("shape");
        }
        spec.only(&known)?;
        let n = among("n", spec.count("n")?, law.orders, law)?;
        let m = match law.size {
            Some((name, values)) => among(name, spec.count(name)?, values, law)?,
            None => 0,
        };
        let sizes = Sizes { n, m, ..Sizes::default() };
        let lists = law.coefficients.iter().map(|list| spec.list_of(list.name, (list.len)(&sizes)));
        let (lists, manner) = (lists.collect::<Result<_>>()?, Manner::read(spec)?);
        let gain = spec.sub("gain")?;
        let triangular = match given {
            Given::Own(own) if own.form == "triangular" => Some("a triangular model".to_owned()),
            Given::Paper(Some(model)) if model.text("kind")? == "sanfelice-praly" => {
                Some(format!("model = {:?}", model.text("kind")?))
            }
            _ => None,
        };
        if let (Form::Phase, Some(model)) = (law.form, triangular) {
            return Err(refused(format!(
                "{model} is not allowed here: the {} needs a phase-variable model (known terms in the \
                 last equation only); use the standard observer",
                law.title
            )));
        }
        if let (Form::Unknown, true) = (law.form, given.says()?) {
            return Err(refused(format!(
                "a model is not allowed here: the {} knows none; use the standard observer",
                law.title
            )));
        }
        let only = match law.gain {
            Gain::Adaptive => Some("adaptive"),
            Gain::Constant => Some("constant"),
            _ => None,
        };
        if let Some(only) = only.filter(|only| gain.text("law").is_ok_and(|law| law != *only)) {
            return Err(refused(format!(
                "gain[\"law\"] = {:?} is not allowed: the {} needs the {only} law, {}",
                gain.text("law")?,
                law.title,
                law.source
            )));
        }
        Ok(Self { law, spec, given, setting, sizes, lists, manner })
    }

    /// A list of coefficients, with zeros behind it.
    fn list<T: Scalar, const L: usize>(&self, name: &str) -> [T; L] {
        let of = self.law.coefficients.iter().zip(&self.lists).find(|(list, _)| list.name == name);
        let value = |i| of.and_then(|(_, values)| values.get(i)).copied().unwrap_or(0.0);
        core::array::from_fn(|i| T::from_f64(value(i)))
    }

    fn saturation<T: Scalar, const N: usize>(&self) -> Result<AnySaturation<N, T>> {
        let (law, spec) = (self.law, self.spec);
        let given = ["saturation", "clip"].iter().any(|key| spec.has(key));
        if law.saturated && (given || !law.open) {
            AnySaturation::read(spec)
        } else {
            Ok(AnySaturation::None)
        }
    }

    /// What the law is made of over traced numbers, within a trace.
    fn traced<const N: usize>(
        &self,
    ) -> Result<Taken<Traced, Chosen<Traced, N>, Known, AnySaturation<N, Traced>>> {
        let (model, saturation) = (self.given.install(N)?, self.saturation()?);
        let mut chosen = Chosen::<Traced, N>::read(self.spec)?;
        if self.setting.free_gain && matches!(chosen.gain, AnyGain::Constant(_)) {
            chosen.gain = AnyGain::Constant(ConstantGain::new(trace::positive("ell"))?);
        }
        let (adaptive, constant) = match chosen.gain {
            AnyGain::Adaptive(law) => (Some(law), None),
            AnyGain::Constant(law) => (None, Some(law)),
            _ => (None, None),
        };
        Ok(Taken { adaptive, constant, ..Taken::new(chosen, model, saturation) })
    }

    /// What it is made of where its model does not matter.
    fn numbers<T: Scalar, const N: usize>(
        &self,
    ) -> Result<Taken<T, Chosen<T, N>, Unknown, AnySaturation<N, T>>> {
        Ok(Taken::new(Chosen::read(self.spec)?, Unknown, self.saturation()?))
    }

    /// What is known of a law with the gain that the spec chooses.
    fn kept<const N: usize>(&self) -> Result<Kept> {
        let chosen = Chosen::<f64, N>::read(self.spec)?;
        let spare = ENTRIES.saturating_sub(chosen.entries());
        Ok(Kept { n_u: self.given.n_u()?, still: chosen.is_still(), spare })
    }
}

/// A size that is one of those that are built.
fn among(name: &str, value: usize, built: &[usize], law: &Law) -> Result<usize> {
    if built.contains(&value) {
        return Ok(value);
    }
    let least = built.iter().min().copied().unwrap_or_default();
    let most = built.iter().max().copied().unwrap_or_default();
    let allowed = if least == most { least.to_string() } else { format!("{least} to {most}") };
    Err(refused(format!("{name} = {value} is not allowed: the {} takes {allowed}", law.title)))
}

/// A function that traces each law of the list, by its kind.
macro_rules! traced {
    (
        $(rates {
            kind: $kind:literal, title: $title:literal,
            law: $law:ty,
            new: [$($name:ident $count:tt)*] [$gain:ident $(, $taken:ident)*],
            orders: $orders:tt, size: $size:tt,
            design: $design:tt,
            form: $form:ident, steps: $steps:ident,
            memory: $memory:tt,
            source: $source:literal,
        })*
        $(recursions $rest:tt)*
    ) => {
        fn traced(of: &Described<'_>) -> Result<LawTables> {
            match of.law.kind {
                $($kind => {
                    fn new<T, G, Md, S, const N: usize, const K: usize, const M: usize>(
                        of: &Described<'_>,
                        taken: Taken<T, G, Md, S>,
                    ) -> Result<$law>
                    where
                        T: Scalar,
                        G: GainLaw<T>,
                        Md: PhaseVariable<T, N, M> + Model<T, N, M> + Model<Dual<T, N>, N, M>,
                        S: Saturation<T>,
                    {
                        Ok(<$law>::new(
                            $(of.list(stringify!($name)),)*
                            traced!(@gain $gain taken),
                            $(taken.$taken,)*
                        )?)
                    }
                    fn sized<const N: usize, const K: usize>(
                        of: &Described<'_>,
                    ) -> Result<LawTables> {
                        traced!(@gains $gain $steps of)
                    }
                    traced!(@sizes $size $orders of)
                })*
                other => Err(refused(format!("kind {other:?} is not given by a rate"))),
            }
        }
    };
    (@gain gain $taken:ident) => {
        $taken.gain
    };
    (@gain adaptive $taken:ident) => {
        $taken.adaptive.ok_or_else(|| refused("another gain law"))?
    };
    (@gain constant $taken:ident) => {
        $taken.constant.ok_or_else(|| refused("another gain law"))?
    };
    (@gains gain $steps:ident $of:ident) => {{
        let kept = $of.kept::<N>()?;
        traced!(@steps $steps $of kept)
    }};
    (@gains adaptive $steps:ident $of:ident) => {{
        let kept = Kept { n_u: $of.given.n_u()?, still: false, spare: 0 };
        traced!(@steps $steps $of kept)
    }};
    (@gains constant $steps:ident $of:ident) => {{
        let kept = Kept { n_u: $of.given.n_u()?, still: true, spare: 0 };
        traced!(@steps $steps $of kept)
    }};
    (@steps placed $of:ident $kept:ident) => {
        LawTables::any(
            $of.setting,
            $of.manner,
            $kept,
            || new::<Traced, _, _, _, N, K, MAX_INPUTS>($of, $of.traced::<N>()?),
            |at| {
                let double = || new::<f64, _, _, _, N, K, 0>($of, $of.numbers::<_, N>()?);
                let single = || new::<f32, _, _, _, N, K, 0>($of, $of.numbers::<_, N>()?);
                Gains::of($of.setting, at, double, single)
            },
        )
    };
    (@steps exact $of:ident $kept:ident) => {
        LawTables::flowing($of.setting, $of.manner, $kept, || {
            new::<Traced, _, _, _, N, K, MAX_INPUTS>($of, $of.traced::<N>()?)
        })
    };
    (@steps rates $of:ident $kept:ident) => {
        LawTables::known($of.setting, $of.manner, $kept, || {
            new::<Traced, _, _, _, N, K, MAX_INPUTS>($of, $of.traced::<N>()?)
        })
    };
    (@sizes [] $orders:tt $of:ident) => {
        traced!(@orders $orders 0 $of)
    };
    (@sizes [$name:ident $($value:literal)*] $orders:tt $of:ident) => {
        match $of.sizes.m {
            $($value => traced!(@orders $orders $value $of),)*
            other => Err(refused(format!("{} = {other} is not built", stringify!($name)))),
        }
    };
    (@orders [$($order:literal)*] $k:literal $of:ident) => {
        match $of.sizes.n {
            $($order => sized::<$order, $k>($of),)*
            other => Err(refused(format!("n = {other} is not built"))),
        }
    };
}
for_each_law!(traced);

/// The tables of the law of this row.
pub(super) fn tables(
    law: &'static Law,
    spec: &Spec<'_>,
    given: &Given<'_>,
    setting: Setting,
) -> Result<Tables> {
    let of = Described::read(law, spec, given, setting)?;
    let (manner, law) = (of.manner, traced(&of)?);
    let mut parameters = given.parameters().to_vec();
    let of_gain = spec.sub("gain")?;
    if setting.free_gain && of_gain.text("law")? == "constant" {
        parameters.push(of_gain.f64("ell")?);
    }
    let current = manner.timing == Timing::Current;
    let memory = law.memory(manner);
    let mut initial = law.initial.clone();
    initial.resize(memory, 0.0);
    let together = !current && matches!(manner.method, AnyMethod::Known(_));
    Ok(Tables {
        shape: Shape {
            n: law.n,
            n_y: 1,
            n_u: given.n_u()?,
            memory,
            signals: law.len,
            current,
            initial,
        },
        correct: law.correct(setting, manner)?,
        advance: law.advance(setting, manner)?,
        missing: None,
        unstarted: None,
        placed: law.gains().map_or_else(Vec::new, |gains| {
            let elapsed = current.then_some(law.len);
            vec![PlacedChain { channel: 0, elapsed, gains: gains.clone() }]
        }),
        law: if together && !law.jumps { Some(law.together(setting)?) } else { None },
        moving: (manner.motion != AnyMotion::Held).then(|| (Box::new(law), manner.motion)),
        parameters,
        start: None,
    })
}
