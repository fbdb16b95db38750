//! Floor 1. What an observer knows of a system, and what a plant is.

use crate::Scalar;
use crate::measurement::Measurement;
use crate::memory::Memory;
use nalgebra::SVector;

/// What an observer of order N knows beside the chain of integrators, with M known inputs.
///
/// ẋᵢ = xᵢ₊₁ + f̂ᵢ(x₁ … xᵢ, u, t): f̂ᵢ may use the first i states only (triangular form), and xᵢ₊₁ where the
/// model tells its [slopes](Model::slopes) (nonlinear chain).
///
/// Write it over any [`Scalar`], whose `sin`, `exp`, `powf` and the like are the crate's own and give the
/// same bits on every machine. On a plain `f32` or `f64` the method `x.sin()` is the standard library's on a
/// host, which differs in the last bit, and is not there on a chip; `Scalar::sin(x)` is ours. A law that needs
/// slopes ([`crate::observers::HighGainEkf`]) asks for the model over [`crate::dual::Dual`] numbers: one with
/// parameters of type `T` is written over any `S: Scalar + From<T>`, as [`InputGain`] is.
///
/// ```
/// use hgo_rs::nalgebra::SVector;
/// use hgo_rs::prelude::*;
///
/// /// ẍ = u − sin x.
/// #[derive(Clone, Copy)]
/// struct Pendulum;
///
/// impl<T: Scalar> Model<T, 2, 1> for Pendulum {
///     fn f_hat(&self, _: T, x: &SVector<T, 2>, u: &SVector<T, 1>) -> SVector<T, 2> {
///         last(u.x - x.x.sin())
///     }
/// }
/// let (x, u) = (SVector::<f32, 2>::new(0.5, 0.0), SVector::<f32, 1>::new(1.0));
/// assert_eq!(Pendulum.f_hat(0.0, &x, &u).y, 1.0 - Scalar::sin(0.5_f32));
/// ```
pub trait Model<T: Scalar, const N: usize, const M: usize = 0>: Copy {
    /// The known part f̂(t, x̂, u), one entry a state.
    fn f_hat(&self, t: T, x_hat: &SVector<T, N>, u: &SVector<T, M>) -> SVector<T, N>;
    /// What stands in the place of `last`, a value of the last state, in the rate of the state before it.
    ///
    /// In a chain of integrators that is `last` itself. Where the last state is an unknown d in a unit of
    /// its own, it is φ(t, x̂, u, d), of which f̂ then has nothing, and ḋ = 0. It is asked for where the model
    /// [carries](Self::carries) such a state.
    #[inline(always)]
    fn enters(&self, _t: T, _x_hat: &SVector<T, N>, last: T, _u: &SVector<T, M>) -> T {
        last
    }
    /// Whether the last state is an unknown, which enters by [`enters`](Self::enters).
    #[inline(always)]
    fn carries(&self) -> bool {
        false
    }
    /// The slope of [`enters`](Self::enters) in the last state, by which its correction is divided.
    ///
    /// It must not be 0 anywhere, and may depend on the states alone: a correction is told neither time
    /// nor input.
    #[inline(always)]
    fn slope(&self, _x_hat: &SVector<T, N>) -> T {
        T::ONE
    }
    /// The slope of each state in the rate of the state before it, 1 for the first: row i of a correction is
    /// divided by the product of the first i.
    ///
    /// Of a nonlinear chain ẋᵢ = fᵢ(x₁ … xᵢ₊₁, u, t) = xᵢ₊₁ + f̂ᵢ they are ∂fᵢ₋₁/∂xᵢ: Farza, M'Saad and Rossignol,
    /// Automatica 40 (2004) 135; Hammouri and Farza, ESAIM COCV 9 (2003). None may be 0 anywhere, and all may
    /// depend on the states alone, as [`slope`](Self::slope).
    #[inline(always)]
    fn slopes(&self, x_hat: &SVector<T, N>) -> SVector<T, N> {
        SVector::from_fn(|i, _| if i + 1 == N { self.slope(x_hat) } else { T::ONE })
    }
}

/// A model whose known part enters the last equation only: ẋₙ = φ(x, u, t).
pub trait PhaseVariable<T: Scalar, const N: usize, const M: usize = 0>: Model<T, N, M> {
    /// φ(t, x̂, u).
    fn phi(&self, t: T, x_hat: &SVector<T, N>, u: &SVector<T, M>) -> T;
}

/// B·φ: the known part of a phase-variable model as a vector.
#[inline(always)]
pub fn last<T: Scalar, const N: usize>(phi: T) -> SVector<T, N> {
    SVector::from_fn(|i, _| if i + 1 == N { phi } else { T::NEG_ZERO })
}

/// Nothing is known: φ = 0. The observer is then a differentiator.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Unknown;

impl<T: Scalar, const N: usize, const M: usize> Model<T, N, M> for Unknown {
    #[inline(always)]
    fn f_hat(&self, _: T, _: &SVector<T, N>, _: &SVector<T, M>) -> SVector<T, N> {
        SVector::from_element(T::NEG_ZERO)
    }
}

impl<T: Scalar, const N: usize, const M: usize> PhaseVariable<T, N, M> for Unknown {
    #[inline(always)]
    fn phi(&self, _: T, _: &SVector<T, N>, _: &SVector<T, M>) -> T {
        T::NEG_ZERO
    }
}

/// A chain of integrators driven by one known input: φ = b₀·u.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct InputGain<T> {
    /// Input gain b₀.
    pub b0: T,
}

impl<T: Scalar, S: Scalar + From<T>, const N: usize> Model<S, N, 1> for InputGain<T> {
    #[inline(always)]
    fn f_hat(&self, t: S, x_hat: &SVector<S, N>, u: &SVector<S, 1>) -> SVector<S, N> {
        last(self.phi(t, x_hat, u))
    }
}

impl<T: Scalar, S: Scalar + From<T>, const N: usize> PhaseVariable<S, N, 1> for InputGain<T> {
    #[inline(always)]
    fn phi(&self, _: S, _: &SVector<S, N>, u: &SVector<S, 1>) -> S {
        S::from(self.b0) * u.x
    }
}

/// The input of a system that has none.
#[inline(always)]
pub fn no_input<T: Scalar>() -> SVector<T, 0> {
    SVector::from_array_storage(nalgebra::ArrayStorage([[]]))
}

/// A system to be observed: dx = a(t, x, u) dt + b(t, x, u) dW, y = h(t, x, u), with one Wiener process W.
///
/// A plant without process noise leaves the last six methods as they are. Its functions of numbers are
/// [`Scalar`]'s, as a [`Model`]'s are.
pub trait Plant<T: Scalar>: Copy {
    /// State x.
    type State: Memory<T>;
    /// Control input u.
    type Input: Memory<T>;
    /// Measured output y, without measurement noise.
    type Output: Measurement<T>;
    /// Where in the state the entries stand that an observer is asked for: the first, and how many.
    const TRUTH: (usize, usize);
    /// a(t, x, u).
    fn drift(&self, t: T, x: &Self::State, u: &Self::Input) -> Self::State;
    /// h(t, x, u).
    fn output(&self, t: T, x: &Self::State, u: &Self::Input) -> Self::Output;
    /// The entries of x that an observer is asked for.
    fn truth<'a>(&self, x: &'a Self::State) -> &'a [T];
    /// Control input at the sampling instant t, held over the period `dt`.
    fn control(&self, t: T, x: &Self::State, dt: T) -> Self::Input;
    /// Whether there is process noise, so that a deterministic scheme would leave it out.
    #[inline(always)]
    fn has_process_noise(&self) -> bool {
        false
    }
    /// Whether the plant gives what this stochastic scheme needs.
    #[inline(always)]
    fn supports(&self, _: StochasticIntegrator) -> bool {
        false
    }
    /// b(t, x, u).
    #[inline(always)]
    fn diffusion(&self, _t: T, _x: &Self::State, _u: &Self::Input) -> Self::State {
        Self::State::zero()
    }
    /// (∂b/∂x)·b, for Milstein's scheme. Zero for additive noise.
    #[inline(always)]
    fn diffusion_slope(&self, _t: T, _x: &Self::State, _u: &Self::Input) -> Self::State {
        Self::State::zero()
    }
    /// (∂a/∂x)·v, for the strong order 1.5 scheme.
    #[inline(always)]
    fn jacobian_times(
        &self,
        _t: T,
        _x: &Self::State,
        _u: &Self::Input,
        _v: &Self::State,
    ) -> Self::State {
        Self::State::zero()
    }
    /// ∂a/∂t + ½ bᵀ(∂²a/∂x²)b, for the strong order 1.5 scheme.
    #[inline(always)]
    fn curvature(&self, _t: T, _x: &Self::State, _u: &Self::Input) -> Self::State {
        Self::State::zero()
    }
}

/// A choice among the stochastic schemes of [`crate::integrate`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum StochasticIntegrator {
    /// Euler-Maruyama: strong order ½, 1 for additive noise.
    EulerMaruyama,
    /// Milstein: strong order 1.
    Milstein,
    /// Strong order 1.5 Taylor scheme for additive noise.
    Taylor15,
}

/// What a sampled-data observer knows: f, the correction `K_T` (Fu, Kang and Li (5)) and the output h.
pub trait SampledModel<T: Scalar, const N: usize, const M: usize = 0>: Copy {
    /// f(t, x̂, u).
    fn f(&self, t: T, x_hat: &SVector<T, N>, u: &SVector<T, M>) -> SVector<T, N>;
    /// `K_T(t, x̂, u, y)` for the period `dt`.
    fn correction(
        &self,
        t: T,
        x_hat: &SVector<T, N>,
        u: &SVector<T, M>,
        y: T,
        dt: T,
    ) -> SVector<T, N>;
    /// h(t, x̂, u), of which the innovation is y − h.
    fn output(&self, t: T, x_hat: &SVector<T, N>, u: &SVector<T, M>) -> T;
}

/// Strict-feedback form (Katayama (1)): ẋ = f₁(t, x, u) + g(t, x, u)z, ż = f₂(t, x, z, u), y = x.
pub trait StrictFeedback<T: Scalar, const NX: usize, const NZ: usize, const M: usize>:
    Copy
{
    /// f₁(t, x, u).
    fn f1(&self, t: T, x: &SVector<T, NX>, u: &SVector<T, M>) -> SVector<T, NX>;
    /// g(t, x, u), NX by NZ, of full column rank (A2).
    fn g(&self, t: T, x: &SVector<T, NX>, u: &SVector<T, M>) -> nalgebra::SMatrix<T, NX, NZ>;
    /// f₂(t, x, z, u).
    fn f2(&self, t: T, x: &SVector<T, NX>, z: &SVector<T, NZ>, u: &SVector<T, M>)
    -> SVector<T, NZ>;
    /// Φ⁻¹gᵀv with Φ = gᵀg: the z that explains v = g(t, x, u)z best.
    #[inline(always)]
    fn explain(
        &self,
        t: T,
        x: &SVector<T, NX>,
        u: &SVector<T, M>,
        v: &SVector<T, NX>,
    ) -> SVector<T, NZ> {
        least_squares(&self.g(t, x, u), v)
    }
}

/// (gᵀg)⁻¹gᵀv by an LDLᵀ factorisation; entries are NaN where g loses rank.
fn least_squares<T: Scalar, const NX: usize, const NZ: usize>(
    g: &nalgebra::SMatrix<T, NX, NZ>,
    v: &SVector<T, NX>,
) -> SVector<T, NZ> {
    let column_dot = |i: usize, w: &dyn Fn(usize) -> T| {
        let mut sum = T::ZERO;
        for row in 0..NX {
            sum += g[(row, i)] * w(row);
        }
        sum
    };
    // Φ = L D Lᵀ, L unit lower triangular.
    let mut l = [[T::ZERO; NZ]; NZ];
    let mut d = [T::ZERO; NZ];
    for i in 0..NZ {
        for j in 0..=i {
            let mut entry = column_dot(i, &|row| g[(row, j)]);
            for m in 0..j {
                entry -= l[i][m] * l[j][m] * d[m];
            }
            if i == j {
                d[i] = entry;
            } else {
                l[i][j] = entry / d[j];
            }
        }
    }
    let mut z = SVector::<T, NZ>::from_fn(|i, _| column_dot(i, &|row| v[row]));
    for i in 0..NZ {
        for m in 0..i {
            let lower = l[i][m] * z[m];
            z[i] -= lower;
        }
    }
    for i in 0..NZ {
        z[i] /= d[i];
    }
    for i in (0..NZ).rev() {
        for m in i + 1..NZ {
            let upper = l[m][i] * z[m];
            z[i] -= upper;
        }
    }
    z
}
