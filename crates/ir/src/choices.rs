//! Floor 3. What a spec chooses by name: gain law, saturation, method, motion and timing.

use crate::error::{Error, Result, refused};
use crate::spec::Spec;
use hgo_rs::Scalar;
use hgo_rs::gain::{AdaptiveGain, ConstantGain, DeadZoneGain, GainLaw};
use hgo_rs::injection::Placement;
use hgo_rs::memory::Memory;
use hgo_rs::motion::{Flow, Held, ImplicitMotion, Motion, Rk4Motion, SUBSTEPS};
use hgo_rs::observer::{BogackiShampine, Discretisation, Rk4, Rk4InnovationHeld, Timing};
use hgo_rs::observers::{HardClip, LAWS, NoSaturation, Saturation, SmoothSaturation};

/// The adaptive and the dead-zone law behind one memory r.
#[derive(Clone, Copy)]
pub enum MovingGain<T = f64> {
    /// Sanfelice and Praly (6).
    Adaptive(AdaptiveGain<T>),
    /// With a dead zone, Sanfelice and Praly (4).
    DeadZone(DeadZoneGain<T>),
}

impl<T: Scalar> GainLaw<T> for MovingGain<T> {
    hgo_rs::moves_in_one_to_infinity!();
    #[inline(always)]
    fn rate<const N: usize>(&self, r: &T, e: T) -> T {
        match self {
            Self::Adaptive(law) => law.rate::<N>(r, e),
            Self::DeadZone(law) => law.rate::<N>(r, e),
        }
    }
}

/// A gain law by its name.
#[derive(Clone, Copy)]
pub enum AnyGain<T = f64> {
    /// ℓ.
    Constant(ConstantGain<T>),
    /// r, which moves.
    Moving(MovingGain<T>),
}

/// With one memory r for all of them: that of a constant gain is 1 and stays.
impl<T: Scalar> GainLaw<T> for AnyGain<T> {
    type Memory = T;
    fn initial(&self) -> T {
        T::ONE
    }
    fn fixed(&self) -> T {
        match self {
            Self::Constant(law) => law.fixed(),
            Self::Moving(law) => law.fixed(),
        }
    }
    fn moving(&self, r: &T) -> T {
        *r
    }
    fn rate<const N: usize>(&self, r: &T, e: T) -> T {
        match self {
            Self::Constant(_) => T::ZERO,
            Self::Moving(law) => law.rate::<N>(r, e),
        }
    }
    fn admissible(&self, r: T) -> T {
        match self {
            Self::Constant(_) => r,
            Self::Moving(law) => law.admissible(r),
        }
    }
}

impl<T: Scalar> AnyGain<T> {
    /// The gain law that a spec names.
    pub fn read(spec: &Spec<'_>) -> Result<Self> {
        let law = spec.text("law")?;
        if law == "constant" {
            spec.only(&["law", "ell"])?;
            return Ok(Self::Constant(ConstantGain::new(T::from_f64(spec.f64("ell")?))?));
        }
        let moving = ["law", "p1", "p2", "b"];
        let of = |key| spec.f64(key).map(T::from_f64);
        match law.as_str() {
            "adaptive" => {
                spec.only(&moving)?;
                let law = AdaptiveGain::new(of("p1")?, of("p2")?, of("b")?)?;
                Ok(Self::Moving(MovingGain::Adaptive(law)))
            }
            "dead-zone" => {
                spec.only(&moving)?;
                let law = DeadZoneGain::new(of("p1")?, of("p2")?, of("b")?)?;
                Ok(Self::Moving(MovingGain::DeadZone(law)))
            }
            other => Err(spec.unknown("law", other, &["constant", "adaptive", "dead-zone"])),
        }
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
const METHODS: [(&str, AnyMethod); 7] = {
    use AnyMethod::{Known, Placed};
    use Discretisation::{Euler, RungeKutta, StaggeredEuler};
    [
        ("euler", Known(Euler)),
        ("staggered-euler", Known(StaggeredEuler)),
        ("rk4", Known(RungeKutta(Rk4::CHOICE))),
        ("rk4-innovation-held", Known(RungeKutta(Rk4InnovationHeld::CHOICE))),
        ("bogacki-shampine", Known(RungeKutta(BogackiShampine::CHOICE))),
        ("zoh", Placed(Placement::Exact)),
        ("bilinear", Placed(Placement::Bilinear)),
    ]
};

/// Refusal of a placed step by a law that has none.
pub fn not_placed() -> Error {
    let placed: Vec<&str> = LAWS.iter().filter(|law| law.placed).map(|law| law.kind).collect();
    refused(format!(
        "method = 'zoh' or 'bilinear' is not allowed here: it is defined for the laws {}; choose another \
         method",
        placed.join(", ")
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
#[derive(Clone, Copy)]
pub enum AnyMethod {
    /// One of the schemes that the core steps any law with.
    Known(Discretisation),
    /// One that places the eigenvalues of the correction.
    Placed(Placement),
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
        if let (AnyMethod::Known(_), Some(key)) = (method, given) {
            return Err(refused(format!(
                "{key} is not allowed with this method, which moves the model itself: leave it out, or \
                 choose method zoh or bilinear"
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
        let Some((_, method)) = METHODS.iter().find(|(name, _)| *name == method) else {
            return Err(spec.unknown("method", &method, &METHODS.map(|(name, _)| name)));
        };
        let timing = spec.text_or("timing", "predictor")?;
        let timing = match timing.as_str() {
            "predictor" => Timing::Predictor,
            "current" => Timing::Current,
            other => return Err(spec.unknown("timing", other, &["predictor", "current"])),
        };
        Ok(Self { method: *method, motion: AnyMotion::read(spec, *method)?, timing })
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
