//! Floor 3. What a spec chooses by name: gain law, saturation, method, motion and timing.

use crate::error::{Error, Result, refused};
use crate::spec::Spec;
use hgo_rs::Scalar;
use hgo_rs::error::DesignError;
use hgo_rs::gain::{
    AdaptiveGain, ConstantGain, DeadZoneGain, GainLaw, HomogeneousGain, PrescribedTimeGain,
    SwitchedGain, unshaped,
};
use hgo_rs::injection::Placement;
use hgo_rs::laws::Law;
use hgo_rs::memory::Memory;
use hgo_rs::motion::{Flow, Held, ImplicitMotion, Motion, Rk4Motion, SUBSTEPS};
use hgo_rs::observer::{BogackiShampine, Discretisation, Rk4, Rk4InnovationHeld, Timing};
use hgo_rs::observers::{HardClip, LAWS, NoSaturation, Saturation, SmoothSaturation};
use hgo_rs::shape::{BiHomogeneous, DeadZone, Fal, PiecewiseLinear, Shape, Stubborn};
use nalgebra::SVector;

/// A choice among laws by their names in specs: an enum of them, how one is read, and `$of!(choice, law =>
/// answer)`, which asks the law that was chosen.
macro_rules! choice {
    (
        $d:tt $(#[$doc:meta])* $any:ident[$($generics:tt)*]<$($argument:ident),*>, $of:ident;
        $($(#[$law_doc:meta])* $word:literal $variant:ident($law:ty)
            [$($key:literal),*] |$spec:ident, $order:pat_param| $new:expr;)+
    ) => {
        $(#[$doc])*
        #[derive(Clone, Copy)]
        pub enum $any<$($generics)*> {
            $($(#[$law_doc])* $variant($law),)+
        }

        /// The answer of the law that was chosen.
        macro_rules! $of {
            ($d choice:expr, $d one:ident => $d answer:expr) => {
                match $d choice { $($any::$variant($d one) => $d answer,)+ }
            };
        }

        impl<$($generics)*> $any<$($argument),*>
        where
            T: Scalar,
        {
            /// The one that a spec names, for a chain of this order.
            pub fn read(spec: &Spec<'_>, order: usize) -> Result<Self> {
                let word = spec.text("law")?;
                match word.as_str() {
                    $($word => {
                        spec.only(&["law", $($key),*])?;
                        let ($spec, $order) = (spec, order);
                        Ok(Self::$variant($new?))
                    })+
                    other => Err(spec.unknown("law", other, &[$($word),+])),
                }
            }
        }
    };
}

choice! {
    $
    /// A gain law by its name.
    AnyGain[T, const N: usize]<T, N>, of_gain;
    /// ℓ.
    "constant" Constant(ConstantGain<T>) ["ell"] |of, _| ConstantGain::new(number(of, "ell")?);
    /// Sanfelice and Praly (6).
    "adaptive" Adaptive(AdaptiveGain<T>) ["p1", "p2", "b"] |of, _|
        AdaptiveGain::new(number(of, "p1")?, number(of, "p2")?, number(of, "b")?);
    /// With a dead zone, Sanfelice and Praly (4).
    "dead-zone" DeadZone(DeadZoneGain<T>) ["p1", "p2", "b"] |of, _|
        DeadZoneGain::new(number(of, "p1")?, number(of, "p2")?, number(of, "b")?);
    /// Of the innovation alone.
    "homogeneous" Homogeneous(HomogeneousGain<T>) ["rho", "degree", "mu"] |of, order|
        HomogeneousGain::new(
            number(of, "rho")?, number(of, "degree")?, number_or_0(of, "mu")?, order
        );
    /// Two gains and a timer.
    "switched" Switched(SwitchedGain<T>) ["fast", "slow", "zone", "delay"] |of, _|
        SwitchedGain::new(
            number(of, "fast")?, number(of, "slow")?, number(of, "zone")?, number_or_0(of, "delay")?
        );
    /// Of a clock.
    "prescribed-time" PrescribedTime(PrescribedTimeGain<T>) ["mu0", "deadline", "r_max"] |of, _|
        PrescribedTimeGain::new(number(of, "mu0")?, number(of, "deadline")?, number(of, "r_max")?);
}

choice! {
    $
    /// A shape by its name.
    AnyShape[T, const N: usize]<T, N>, of_shape;
    /// A threshold on what is injected.
    "stubborn" Stubborn(Stubborn<T>) ["decay", "growth", "sigma0"] |of, _|
        Stubborn::new(number(of, "decay")?, number(of, "growth")?, number_or_0(of, "sigma0")?);
    /// A threshold on what is not.
    "dead-zone" DeadZone(DeadZone<T>) ["decay", "growth", "sigma0"] |of, _|
        DeadZone::new(number(of, "decay")?, number(of, "growth")?, number_or_0(of, "sigma0")?);
    /// Two gains.
    "piecewise-linear" PiecewiseLinear(PiecewiseLinear<T>) ["ratio", "zone"] |of, _|
        PiecewiseLinear::new(number(of, "ratio")?, number(of, "zone")?);
    /// Powers of the innovation.
    "fal" Fal(Fal<T, N>) ["alpha", "delta"] |of, _|
        Fal::new(vector(of, "alpha")?, number(of, "delta")?);
    /// One degree near 0, another far away.
    "bi-homogeneous" BiHomogeneous(BiHomogeneous<T, N>) ["near", "far", "kappa", "theta"] |of, _|
        BiHomogeneous::new(
            number(of, "near")?, number(of, "far")?, vector(of, "kappa")?, vector(of, "theta")?
        );
}

fn vector<T: Scalar, const N: usize>(spec: &Spec<'_>, key: &str) -> Result<[T; N]> {
    Ok(spec.vector::<N>(key, N)?.map(T::from_f64))
}

fn number<T: Scalar>(spec: &Spec<'_>, key: &str) -> Result<T> {
    spec.f64(key).map(T::from_f64)
}

fn number_or_0<T: Scalar>(spec: &Spec<'_>, key: &str) -> Result<T> {
    spec.f64_or(key, 0.0).map(T::from_f64)
}

/// Room for what a gain law and a shape remember.
pub const ENTRIES: usize = 2;

/// The gain law of a spec, under its shape if it has one. Its memory: the gain's entries, then the shape's,
/// then room that is not used.
#[derive(Clone, Copy)]
pub struct Chosen<T, const N: usize> {
    /// The gain law.
    pub gain: AnyGain<T, N>,
    shape: Option<AnyShape<T, N>>,
}

fn len_of<T: Scalar, M: Memory<T>>(_: &M) -> usize {
    M::LEN
}

#[allow(clippy::unit_arg, clippy::let_unit_value)] // some laws have no memory
impl<T: Scalar, const N: usize> Chosen<T, N> {
    /// As an observer's spec has them.
    pub fn read(spec: &Spec<'_>) -> Result<Self> {
        let shape = if spec.has("shape") { Some(spec.sub("shape")?) } else { None };
        let order = N + if spec.has("filters") { spec.count("filters")? } else { 0 };
        let shape = shape.as_ref().map(|shape| AnyShape::read(shape, order)).transpose()?;
        Ok(Self { gain: AnyGain::read(&spec.sub("gain")?, order)?, shape })
    }

    /// Entries of memory that it needs.
    pub fn entries(&self) -> usize {
        let of_shape = self
            .shape
            .as_ref()
            .map_or(0, |shape| of_shape!(shape, law => len_of::<T, _>(&law.initial())));
        self.of_gain() + of_shape
    }

    /// Whether its gain is the same at every sample.
    pub fn is_still(&self) -> bool {
        fn still<T: Scalar, G: GainLaw<T>>(_: &G) -> bool {
            G::STILL
        }
        of_gain!(&self.gain, law => still(law))
    }

    /// Entries that are the gain's.
    fn of_gain(&self) -> usize {
        of_gain!(&self.gain, law => len_of::<T, _>(&law.initial()))
    }

    /// A memory of both, from what each makes of its own part.
    fn both(
        &self,
        memory: &SVector<T, ENTRIES>,
        gain: impl FnOnce(&AnyGain<T, N>, &[T], &mut [T]),
        shape: impl FnOnce(&AnyShape<T, N>, &[T], &mut [T]),
    ) -> SVector<T, ENTRIES> {
        let mut made = *memory;
        let at = self.of_gain().min(ENTRIES);
        let (of_gain, of_shape) = memory.as_slice().split_at(at);
        let (to_gain, to_shape) = made.as_mut_slice().split_at_mut(at);
        gain(&self.gain, of_gain, to_gain);
        if let Some(law) = &self.shape {
            shape(law, of_shape, to_shape);
        }
        made
    }
}

#[allow(clippy::unit_arg, clippy::let_unit_value)] // some laws have no memory
impl<T: Scalar, const N: usize> GainLaw<T> for Chosen<T, N> {
    type Memory = SVector<T, ENTRIES>;
    const STILL: bool = false;
    const ALIKE: bool = false;
    fn initial(&self) -> Self::Memory {
        self.both(
            &SVector::zero(),
            |gain, _, out| of_gain!(gain, law => law.initial().write(out)),
            |shape, _, out| of_shape!(shape, law => law.initial().write(out)),
        )
    }
    fn fixed(&self) -> T {
        of_gain!(&self.gain, law => law.fixed())
    }
    fn moving(&self, memory: &Self::Memory, e: T) -> T {
        of_gain!(&self.gain, law => law.moving(&Memory::read(memory.as_slice()), e))
    }
    fn speed(&self, memory: &Self::Memory) -> T {
        of_gain!(&self.gain, law => law.speed(&Memory::read(memory.as_slice())))
    }
    fn rows(&self, memory: &Self::Memory, e: T, rows: &mut [T]) {
        match &self.shape {
            None => rows.fill(e),
            Some(shape) => {
                let own = memory.as_slice().get(self.of_gain()..).unwrap_or(&[]);
                of_shape!(shape, law => law.rows(&Memory::read(own), e, rows));
            }
        }
    }
    fn fits(&self, order: Option<usize>, k: Option<&[T]>) -> std::result::Result<(), DesignError> {
        of_gain!(&self.gain, law => law.fits(order, k))?;
        self.shape.as_ref().map_or(Ok(()), |shape| of_shape!(shape, law => law.fits(k)))
    }
    fn seen(&self, e: T, filtered: T) -> T {
        of_gain!(&self.gain, law => GainLaw::<T>::seen(law, e, filtered))
    }
    fn closed(&self) -> std::result::Result<(), DesignError> {
        if self.shape.is_some() {
            return Err(unshaped());
        }
        of_gain!(&self.gain, law => law.closed())
    }
    fn closing(&self, memory: &Self::Memory, b: T, g: &[T]) -> T {
        of_gain!(&self.gain, law => law.closing(&Memory::read(memory.as_slice()), b, g))
    }
    fn placed(&self) -> std::result::Result<(), DesignError> {
        of_gain!(&self.gain, law => law.placed())?;
        self.shape.as_ref().map_or(Ok(()), |shape| of_shape!(shape, law => law.placed()))
    }
    fn jumped(&self, memory: Self::Memory, e: T) -> Self::Memory {
        self.both(
            &memory,
            |gain, of, out| of_gain!(gain, law => law.jumped(Memory::read(of), e).write(out)),
            |_, of, out| out.copy_from_slice(of),
        )
    }
    fn rate<const ORDER: usize>(&self, memory: &Self::Memory, e: T) -> Self::Memory {
        self.both(
            memory,
            |gain, of, out| of_gain!(gain, law => law.rate::<ORDER>(&Memory::read(of), e).write(out)),
            |shape, of, out| of_shape!(shape, law => law.rate(&Memory::read(of), e).write(out)),
        )
    }
    fn admissible(&self, memory: Self::Memory) -> Self::Memory {
        self.both(
            &memory,
            |gain, of, out| of_gain!(gain, law => law.admissible(Memory::read(of)).write(out)),
            |shape, of, out| of_shape!(shape, law => law.admissible(Memory::read(of)).write(out)),
        )
    }
}

/// A saturation by its name.
#[derive(Clone, Copy)]
pub enum AnySaturation<const N: usize, T = f64> {
    /// η as it is.
    None,
    /// Clipped.
    Hard(HardClip<T, N>),
    /// Bent towards its level.
    Smooth(SmoothSaturation<T, N>),
}

impl<T: Scalar, const N: usize> Saturation<T> for AnySaturation<N, T> {
    #[inline(always)]
    fn apply(&self, i: usize, eta: T) -> T {
        match self {
            Self::None => NoSaturation.apply(i, eta),
            Self::Hard(clip) => clip.apply(i, eta),
            Self::Smooth(smooth) => smooth.apply(i, eta),
        }
    }
    #[inline(always)]
    fn is_identity(&self) -> bool {
        matches!(self, Self::None)
    }
}

impl<T: Scalar, const N: usize> AnySaturation<N, T> {
    /// The saturation that a spec gives: levels, and how they are kept.
    pub fn read(spec: &Spec<'_>) -> Result<Self> {
        let levels = spec.vector::<N>("saturation", N - 1)?.map(T::from_f64);
        let clip = spec.text_or("clip", "hard")?;
        match clip.as_str() {
            "hard" => Ok(Self::Hard(HardClip::new(levels)?)),
            "smooth" => Ok(Self::Smooth(SmoothSaturation::new(levels)?)),
            other => Err(spec.unknown("clip", other, &["hard", "smooth"])),
        }
    }
}

/// The methods by their names.
const METHODS: [(&str, AnyMethod); 11] = {
    use AnyMethod::{Implicit, InterSample, Known, Placed, Proper};
    use Discretisation::{Euler, RungeKutta, StaggeredEuler};
    [
        ("euler", Known(Euler)),
        ("staggered-euler", Known(StaggeredEuler)),
        ("rk4", Known(RungeKutta(Rk4::CHOICE))),
        ("rk4-innovation-held", Known(RungeKutta(Rk4InnovationHeld::CHOICE))),
        ("bogacki-shampine", Known(RungeKutta(BogackiShampine::CHOICE))),
        ("zoh", Placed(Placement::Exact)),
        ("bilinear", Placed(Placement::Bilinear)),
        ("implicit-map", Placed(Placement::ImplicitMap)),
        ("proper", Proper),
        ("implicit", Implicit),
        ("inter-sample", InterSample),
    ]
};

/// Refusal of a method that a law has not.
pub fn not_placed(method: AnyMethod) -> Error {
    let has = |law: &&Law| match method {
        AnyMethod::Proper => law.flows(),
        AnyMethod::Implicit | AnyMethod::InterSample => law.kind == "standard",
        _ => law.placed(),
    };
    let laws: Vec<&str> = LAWS.iter().filter(has).map(|law| law.kind).collect();
    refused(format!(
        "method = '{}' is not allowed here: it is defined for the laws {}; choose another method",
        method.name(),
        laws.join(", ")
    ))
}

/// How a continuous law is stepped.
#[derive(Clone, Copy)]
pub struct Manner {
    /// How it moves and corrects.
    pub method: AnyMethod,
    /// How the model moves between placed corrections.
    pub motion: AnyMotion,
    /// What a sample is for: the next estimate, or its own.
    pub timing: Timing,
}

/// A method by its name.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum AnyMethod {
    /// One of the schemes that the core steps any law with.
    Known(Discretisation),
    /// One that places the eigenvalues of the correction.
    Placed(Placement),
    /// [`Proper`](hgo_rs::injection::Proper).
    Proper,
    /// [`Implicit`](hgo_rs::injection::Implicit).
    Implicit,
    /// [`InterSample`](hgo_rs::inter_sample::InterSample).
    InterSample,
}

impl AnyMethod {
    /// Of a name, if there is one.
    pub fn find(name: &str) -> Option<Self> {
        METHODS.iter().find(|(known, _)| *known == name).map(|(_, method)| *method)
    }

    fn name(self) -> &'static str {
        METHODS.iter().find(|(_, method)| *method == self).map_or("", |(name, _)| name)
    }

    /// Whether the model moves by a [`Motion`] of its own.
    pub fn moves_by_motion(self) -> bool {
        matches!(self, Self::Placed(_) | Self::Proper | Self::InterSample)
    }
}

/// A motion of the model by its name.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum AnyMotion {
    /// Its value of the period's beginning.
    Held,
    /// By RK4.
    Rk4(Rk4Motion),
    /// Implicit where it is stiff.
    Implicit(ImplicitMotion),
}

impl Motion for AnyMotion {
    fn moved<T, Z, U, L>(&self, law: &L, t: T, z: &Z, u: &U, dt: T) -> Z
    where
        T: Scalar,
        Z: Memory<T>,
        L: Flow<T, Z, U>,
    {
        match self {
            Self::Held => Held.moved(law, t, z, u, dt),
            Self::Rk4(motion) => motion.moved(law, t, z, u, dt),
            Self::Implicit(motion) => motion.moved(law, t, z, u, dt),
        }
    }
}

impl AnyMotion {
    /// The motion of an observer's spec, "held" where left out, and the steps that a period is cut into.
    fn read(spec: &Spec<'_>, method: AnyMethod) -> Result<Self> {
        let motion = spec.text_or("motion", "held")?;
        let substeps = || -> Result<u8> {
            let count = spec.whole_or("substeps", u64::from(SUBSTEPS))?;
            Ok(u8::try_from(count).unwrap_or(u8::MAX))
        };
        let given = ["motion", "substeps"].into_iter().find(|key| spec.has(key));
        if let (false, Some(key)) = (method.moves_by_motion(), given) {
            return Err(refused(format!(
                "{key} is not allowed with this method, which moves the model itself: leave it out, or \
                 choose method zoh or proper"
            )));
        }
        match motion.as_str() {
            "held" if spec.has("substeps") => Err(refused(
                "substeps is not allowed where the model is held over the period: leave it out, or choose \
                 motion rk4 or implicit",
            )),
            "held" => Ok(Self::Held),
            "rk4" => Ok(Self::Rk4(Rk4Motion::new(substeps()?)?)),
            "implicit" => Ok(Self::Implicit(ImplicitMotion::new(substeps()?)?)),
            other => Err(spec.unknown("motion", other, &["held", "rk4", "implicit"])),
        }
    }
}

impl Manner {
    /// Method, motion and timing of an observer's spec.
    pub fn read(spec: &Spec<'_>) -> Result<Self> {
        let method = spec.text_or("method", "euler")?;
        let Some(method) = AnyMethod::find(&method) else {
            return Err(spec.unknown("method", &method, &METHODS.map(|(name, _)| name)));
        };
        let timing = spec.text_or("timing", "predictor")?;
        let timing = match timing.as_str() {
            "predictor" => Timing::Predictor,
            "current" => Timing::Current,
            other => return Err(spec.unknown("timing", other, &["predictor", "current"])),
        };
        match (method, timing) {
            (AnyMethod::Implicit, Timing::Predictor) => Err(refused(
                "timing = 'predictor' is not allowed with method implicit, whose step ends with its sample: \
                 choose timing current",
            )),
            (AnyMethod::InterSample, Timing::Current) => Err(refused(
                "timing = 'current' is not allowed with method inter-sample, whose estimate does not jump at a \
                 sample: choose timing predictor",
            )),
            _ => Ok(()),
        }?;
        Ok(Self { method, motion: AnyMotion::read(spec, method)?, timing })
    }

    /// Entries of an observer's memory behind its law's: see [`Timing::held`]; what decays between samples.
    pub fn held(self) -> usize {
        self.timing.held() + usize::from(self.method == AnyMethod::InterSample)
    }

    /// The scheme of a law that is compiled as one loop.
    pub fn whole(self) -> Option<Discretisation> {
        match self {
            Self { method: AnyMethod::Known(scheme), timing: Timing::Predictor, .. } => {
                Some(scheme)
            }
            _ => None,
        }
    }
}
