//! Floor 2. The observers: the one list of laws, and one law a file, its paper and equations at the head.
//!
//! A law is added by its file, which is named here, and by its row in [`for_each_law!`](crate::for_each_law).
//! Whatever has to know all laws asks the list: [`LAWS`] at run time, the macro at compile time.

mod adaptive_ekf;
mod cascade;
mod collection;
mod filtered;
mod high_gain_ekf;
mod limited_gain;
mod low_power;
mod peaking_free;
mod reduced_chain;
mod reduced_order;
mod sampled_data;
mod sampled_ekf;
mod standard;
mod window;

pub use adaptive_ekf::{AdaptiveEkf, AdaptiveEkfState, InnovationGain};
pub use cascade::{CascadeObserver, CascadeState, cascade_from_poles};
pub use collection::{CopyState, ModifiedObserver, ModifiedState, RepelledCollection};
pub use filtered::{FilteredObserver, FilteredState, filter_from_poles};
pub use high_gain_ekf::{HighGainEkf, HighGainEkfState, PACKED};
pub use limited_gain::{LimitedGain, LimitedGainState, limited_from_poles};
pub use low_power::{BlockGains, LowPower, LowPowerObserver, LowPowerState};
pub use peaking_free::PeakingFreeObserver;
pub use reduced_chain::ReducedChainObserver;
pub use reduced_order::{ReducedOrderObserver, ReducedOrderState};
pub use sampled_data::SampledDataObserver;
pub use sampled_ekf::{SampledEkf, SampledEkfState};
pub use standard::{StandardObserver, StandardState};
pub use window::{WindowObserver, WindowState};

pub use crate::saturation::{HardClip, NoSaturation, Saturation, SmoothSaturation};

use crate::Scalar;
use crate::error::{DesignError, finite};
use crate::gain::GainLaw;
use crate::laws::{Design, Form, Gain, Law, Sizes, Steps, part};
use crate::memory::Memory;
use nalgebra::SVector;

/// Orders that the package is built and tested for.
pub const MAX_ORDER: usize = 12;

/// The one list of laws: hand its rows to a macro.
///
/// `for_each_law!(callback)` becomes `callback! { rates { … } … recursions { … } … }`, and
/// `for_each_law!(callback, tokens)` becomes `callback! { [tokens] rates { … } … }`. Laws that are given by
/// a rate come first. A row says, in this order:
///
/// - `kind`, `title`: the word for the law in specs and files, and its name;
/// - `law`: its type, of a scalar `T`, a gain law `G`, a model `Md`, a saturation `S`, an order `N`, a second
///   size `K` and inputs `M`, which the callback gives a meaning;
/// - `new`: what its constructor takes: lists of coefficients with their counts, then a gain law (`gain`, or
///   `adaptive` or `constant` where it takes no other), a `model` if it knows any, a saturation
///   (`saturation`, `open_saturation` where it may be left out, or `no_saturation` where it must be the one
///   that does nothing);
/// - `orders`: those built at run time;
/// - `size`: name and values of the second size, the usual one first; or nothing;
/// - `design`: how many poles make the coefficients, by which function, and the usual poles; or nothing;
/// - `form`: of the model; `steps`: `placed` where eigenvalues can be placed (`zoh`), `exact` where the chain can
///   move exactly (`proper`), else `rates`;
/// - `memory`: its parts with their counts;
/// - `source`: paper and equations.
///
/// Rows of recursions have neither constructor nor orders: what they are made of depends on their models.
#[macro_export]
macro_rules! for_each_law {
    ($callback:ident $(, $($given:tt)*)?) => {
        $callback! {
            $([$($given)*])?
            rates {
                kind: "standard", title: "standard high-gain observer",
                law: $crate::observers::StandardObserver<T, G, Md, N, M>,
                new: [k(n)] [gain, model],
                orders: [1 2 3 4 5 6 7 8 9 10 11 12], size: [],
                design: [(n) $crate::observers::chain_from_poles, $crate::observers::equidistant],
                form: Chain, steps: placed,
                memory: [x_hat(n) r(moves) sigma(threshold)],
                source: "Sanfelice and Praly (5)-(7); Astolfi et al. (2); Lee, Choi and Khalil (39)",
            }
            rates {
                kind: "low-power", title: "low-power observer",
                law: $crate::observers::LowPower<T, G, Md, S, N, M>,
                new: [alpha(n) beta(n - 1)] [gain, model, no_saturation],
                orders: [1 2 3 4 5 6 7 8 9 10 11 12], size: [],
                design: [
                    (2 n - 1) $crate::observers::blocks_from_poles,
                    $crate::observers::equidistant_blocks
                ],
                form: Phase, steps: placed,
                memory: [x_hat(n) eta(n - 1) r(moves) sigma(threshold)],
                source: "Astolfi, Marconi, Praly and Teel (5)",
            }
            rates {
                kind: "peaking-free", title: "low-power peaking-free observer",
                law: $crate::observers::LowPower<T, G, Md, S, N, M>,
                new: [alpha(n) beta(n - 1)] [gain, model, saturation],
                orders: [1 2 3 4 5 6 7 8 9 10 11 12], size: [],
                design: [
                    (2 n - 1) $crate::observers::blocks_from_poles,
                    $crate::observers::equidistant_blocks
                ],
                form: Phase, steps: placed,
                memory: [x_hat(n) eta(n - 1) r(moves) sigma(threshold)],
                source: "Astolfi, Marconi, Praly and Teel (11)",
            }
            rates {
                kind: "filtered", title: "observer behind a filter of its innovation",
                law: $crate::observers::FilteredObserver<T, G, Md, N, K, M>,
                new: [c(m) k(n)] [gain, model],
                orders: [1 2 3 4 5 6], size: [filters 1 2 3],
                design: [(n + m) $crate::observers::filter_from_poles, $crate::observers::equidistant],
                form: Chain, steps: exact,
                memory: [x_hat(n) eta(m) r(moves) sigma(threshold)],
                source: "Treangle, Farza and M'Saad (2019); Astolfi, Zaccarian and Jungers (2021)",
            }
            rates {
                kind: "limited-gain", title: "high-gain observer of limited gain power",
                law: $crate::observers::LimitedGain<T, G, Md, S, N, M>,
                new: [alpha(n - 1) beta(n - 1)] [gain, model, open_saturation],
                orders: [2 3 4 5 6 7 8], size: [],
                design: [(2 n - 2) $crate::observers::limited_from_poles, $crate::observers::equidistant],
                form: Triangular, steps: rates,
                memory: [x_hat(n) eta(n - 2) r(moves) sigma(threshold)],
                source: "Astolfi and Marconi (2015); Wang, Astolfi, Marconi and Su (2017)",
            }
            rates {
                kind: "cascade", title: "cascade of a differentiator and filters",
                law: $crate::observers::CascadeObserver<T, G, S, N, M>,
                new: [k(2) beta(n - 2)] [gain, open_saturation],
                orders: [2 3 4 5 6 7 8], size: [],
                design: [(n) $crate::observers::cascade_from_poles, $crate::observers::equidistant],
                form: Unknown, steps: rates,
                memory: [x_hat(n) behind(n - 1) r(moves) sigma(threshold)],
                source: "Khalil, Automatica 80 (2017)",
            }
            rates {
                kind: "reduced-chain", title: "reduced-order observer of a chain",
                law: $crate::observers::ReducedChainObserver<T, Md, N, M>,
                new: [k(n - 1)] [constant, model],
                orders: [2 3 4 5 6 7 8], size: [],
                design: [(n - 1) $crate::observers::chain_from_poles, $crate::observers::equidistant],
                form: Triangular, steps: rates,
                memory: [x_hat(n)],
                source: "Esfandiari and Khalil (1992); Khalil and Praly (2014)",
            }
            rates {
                kind: "high-gain-ekf", title: "high-gain extended Kalman filter",
                law: $crate::observers::HighGainEkf<T, G, Md, N, M>,
                new: [Q(n (n + 1)/2) R(1) P0(n (n + 1)/2)] [gain, model],
                orders: [1 2 3 4 5 6], size: [],
                design: [],
                form: Triangular, steps: rates,
                memory: [x_hat(n) p(n (n + 1)/2) r(moves)],
                source: "Deza, Busvelle, Gauthier and Rakotopara (1992); Boizot, Busvelle and Gauthier (2010)",
            }
            rates {
                kind: "collection", title: "collection of observers that repel each other",
                law: $crate::observers::RepelledCollection<T, Md, N, K, M>,
                new: [k(n) k_bar(n)] [adaptive, model],
                orders: [2], size: [copies 3 2 4 5],
                design: [],
                form: Chain, steps: rates,
                memory: [copies(m (n + 1))],
                source: "Sanfelice and Praly (23), (24)",
            }
            rates {
                kind: "modified", title: "observer with the nominal gain of a collection",
                law: $crate::observers::ModifiedObserver<T, Md, N, K, M>,
                new: [k(n) k_bar(n)] [adaptive, model],
                orders: [2], size: [copies 3 2 4 5],
                design: [],
                form: Chain, steps: rates,
                memory: [x_hat(n) r(1) copies(m (n + 1))],
                source: "Sanfelice and Praly (25)",
            }
            recursions {
                kind: "sampled-data", title: "sampled-data observer",
                law: $crate::observers::SampledDataObserver<Md, N, M>,
                new: [], form: Sampled,
                memory: [x_hat(n)],
                source: "Fu, Kang and Li (5)",
            }
            recursions {
                kind: "reduced-order", title: "reduced-order observer for sampled data",
                law: $crate::observers::ReducedOrderObserver<T, Md, K, N, M>,
                new: [h_bar(n) epsilon(1)], form: StrictFeedback,
                memory: [z_hat(n) y(outputs) u(inputs) elapsed(1) period(1)],
                source: "Katayama (8), (22)",
            }
            recursions {
                kind: "window", title: "gains on a window of innovations",
                law: $crate::observers::WindowObserver<T, N, K>,
                new: [W(n m) dt(1)], form: Phase,
                memory: [x_hat(n) d(m)],
                source: "Savitzky and Golay (1964); Benedict and Bordner (1962)",
            }
        }
    };
}

/// What constructors take behind the coefficients, as the gain laws and the saturation of a [`Law`].
macro_rules! taken {
    (gain) => {
        Gain::Any
    };
    (adaptive) => {
        Gain::Adaptive
    };
    (constant) => {
        Gain::Constant
    };
    (@saturated model, saturation) => {
        (true, false)
    };
    (@saturated $(model,)? open_saturation) => {
        (true, true)
    };
    (@saturated model $(, no_saturation)?) => {
        (false, false)
    };
}

macro_rules! table {
    (
        $(rates {
            kind: $kind:literal, title: $title:literal,
            law: $law:ty,
            new: [$($name:ident $count:tt)*] [$gain:ident $(, $taken:ident)*],
            orders: [$($order:literal)*], size: [$($size:ident $($value:literal)*)?],
            design: [$($poles:tt $place:path, $usual:path)?],
            form: $form:ident, steps: $steps:ident,
            memory: [$($part:ident $len:tt)*],
            source: $source:literal,
        })*
        $(recursions {
            kind: $r_kind:literal, title: $r_title:literal,
            law: $r_law:ty,
            new: [$($r_name:ident $r_count:tt)*], form: $r_form:ident,
            memory: [$($r_part:ident $r_len:tt)*],
            source: $r_source:literal,
        })*
    ) => {
        /// The laws, in the order of their list.
        pub const LAWS: &[Law] = &[
            $(Law {
                kind: $kind,
                title: $title,
                coefficients: &[$(part!($name $count)),*],
                size: table!(@first $((stringify!($size), &[$($value),*]))?),
                orders: &[$($order),*],
                design: table!(@first $(
                    Design { poles: part!(poles $poles), place: $place, usual: $usual }
                )?),
                gain: taken!($gain),
                saturated: taken!(@saturated $($taken),*).0,
                open: taken!(@saturated $($taken),*).1,
                form: Form::$form,
                continuous: true,
                steps: table!(@steps $steps),
                memory: &[$(part!($part $len)),*],
                source: $source,
            },)*
            $(Law {
                kind: $r_kind,
                title: $r_title,
                coefficients: &[$(part!($r_name $r_count)),*],
                size: None,
                orders: &[],
                design: None,
                gain: Gain::None,
                saturated: false,
                open: false,
                form: Form::$r_form,
                continuous: false,
                steps: Steps::Rates,
                memory: &[$(part!($r_part $r_len)),*],
                source: $r_source,
            },)*
        ];
    };
    (@steps rates) => { Steps::Rates };
    (@steps exact) => { Steps::Exact };
    (@steps placed) => { Steps::Placed };
    (@first) => { None };
    (@first $value:expr) => { Some($value) };
}
for_each_law!(table);

/// Trailing coefficients of the polynomial of these poles: see [`Design::place`].
///
/// # Errors
/// As [`crate::polynomial::coefficients_from_poles`].
pub fn chain_from_poles(
    _: &Sizes,
    poles: &[(f64, f64)],
    out: &mut [f64],
) -> Result<(), DesignError> {
    crate::polynomial::write_coefficients(poles, out)
}

/// α, then β of n blocks: see [`Design::place`].
///
/// # Errors
/// As [`crate::polynomial::low_power_coefficients_from_poles`].
pub fn blocks_from_poles(
    sizes: &Sizes,
    poles: &[(f64, f64)],
    out: &mut [f64],
) -> Result<(), DesignError> {
    let mut beta = [0.0; MAX_ORDER];
    let (alpha, trailing) = out.split_at_mut(sizes.n.min(out.len()));
    crate::polynomial::write_low_power_coefficients(poles, alpha, &mut beta)?;
    for (slot, value) in trailing.iter_mut().zip(beta) {
        *slot = value;
    }
    Ok(())
}

/// Equidistant poles from −1 to −2: see [`Design::usual`].
pub fn equidistant(poles: &mut [(f64, f64)]) {
    let last = poles.len().saturating_sub(1);
    let step = -1.0 / last.max(1) as f64;
    for (i, pole) in poles.iter_mut().enumerate() {
        *pole = (if i > 0 && i == last { -2.0 } else { i as f64 * step - 1.0 }, 0.0);
    }
}

/// Equidistant poles from −1 to −2 of the blocks of order two, and −2, the last one's own.
pub fn equidistant_blocks(poles: &mut [(f64, f64)]) {
    if let Some((last, blocks)) = poles.split_last_mut() {
        equidistant(blocks);
        *last = (-2.0, 0.0);
    }
}

/// Coefficients that are finite, for an order within 1 to [`MAX_ORDER`].
fn checked<T: Scalar, const N: usize>(
    name: &'static str,
    k: [T; N],
) -> Result<SVector<T, N>, DesignError> {
    crate::error::require(
        "n",
        T::from_f64(N as f64),
        (1..=MAX_ORDER).contains(&N),
        "the order must be 1 to 12",
    )?;
    for entry in k {
        finite(name, entry)?;
    }
    Ok(SVector::from_fn(|i, _| k[i]))
}

/// Refuse order 1, where a law is no law of its own.
fn from_second_order<const N: usize>() -> Result<(), DesignError> {
    let allowed = "the order must be 2 to 12; of order 1 take the standard observer";
    crate::error::require("n", N as f64, N > 1, allowed).map(|_| ())
}

/// Coefficient i times ℓ to the power of `exponent(i)`, which the precision must be able to hold.
fn folded<T: Scalar, const N: usize>(
    k: &SVector<T, N>,
    ell: T,
    exponent: impl Fn(usize) -> usize,
) -> Result<SVector<T, N>, DesignError> {
    let allowed = "a power of the gain times a coefficient overflows or underflows in this precision: take \
                   another unit of time, in which the gain is nearer to 1";
    let products: SVector<T, N> = SVector::from_fn(|i, _| k[i] * ell.powi(exponent(i)));
    let held =
        |(k, product): (&T, &T)| product.is_finite() && (*product != T::ZERO || *k == T::ZERO);
    let fits = k.iter().zip(products.iter()).all(held);
    crate::error::require("ell", ell, fits, allowed).map(|_| products)
}

/// Coefficients that [`folded`] turns into `products` again, bit for bit: a quotient that does not
/// give its product back is one rounding off, and moved by it.
#[cfg(feature = "serde")]
fn unfolded<T: Scalar, const N: usize>(
    products: &SVector<T, N>,
    ell: T,
    exponent: impl Fn(usize) -> usize,
) -> SVector<T, N> {
    SVector::from_fn(|i, _| {
        let (product, power) = (products[i], ell.powi(exponent(i)));
        let k = product / power;
        if k * power == product { k } else { k + (product - k * power) / power }
    })
}

/// What of the gain's rate is due to the innovation.
#[inline(always)]
fn driven<T: Scalar, G: GainLaw<T>, const N: usize>(
    gain: &G,
    memory: &G::Memory,
    e: T,
) -> G::Memory {
    gain.rate::<N>(memory, e).zip(&gain.rate::<N>(memory, T::ZERO), |rate, free| rate - free)
}

/// A x̂: the chain of integrators ẋᵢ = xᵢ₊₁, without a last state that a model carries as an unknown.
#[inline(always)]
fn chain<T: Scalar, const N: usize>(x: &SVector<T, N>, carries: bool) -> SVector<T, N> {
    let linked = |i: usize| i + 1 < N && !(carries && i + 2 == N);
    SVector::from_fn(|i, _| if linked(i) { x[i + 1] } else { T::NEG_ZERO })
}

/// Staggered sweep of a chain: xᵢ⁺ += dt·(xᵢ₊₁⁺ − xᵢ₊₁), from the bottom up, each times its
/// [slope](crate::model::Model::slopes).
#[inline(always)]
fn swept<T: Scalar, const N: usize>(
    old: &SVector<T, N>,
    mut new: SVector<T, N>,
    slopes: &SVector<T, N>,
    dt: T,
) -> SVector<T, N> {
    for i in (1..N).rev() {
        let moved = dt * (new[i] - old[i]);
        new[i - 1] += moved * slopes[i];
    }
    new
}

/// What a law of x̂ and a gain says of both, inside its `impl ContinuousLaw`: the name of its memory, where its
/// gain law stands, and how e is read from an innovation. With `shown` before them the law says itself what
/// is admissible: its estimates are shown from other states.
macro_rules! of_gain_and_estimate {
    ($state:ident, $($gain:ident).+, $e:ident in $innovation:pat) => {
        super::of_gain_and_estimate!(shown $state, $($gain).+, $e in $innovation);
        #[inline(always)]
        fn admissible(&self, z: Self::State) -> Self::State {
            $state { r: self.$($gain).+.admissible(z.r), ..z }
        }
    };
    (shown $state:ident, $($gain:ident).+, $e:ident in $innovation:pat) => {
        #[inline(always)]
        fn jumped(&self, z: Self::State, $innovation: &Self::Innovation) -> Self::State {
            $state { r: self.$($gain).+.jumped(z.r, *$e), ..z }
        }
        #[inline(always)]
        fn speed(&self, z: &Self::State) -> T {
            self.$($gain).+.speed(&z.r)
        }
        #[inline(always)]
        fn estimate<'a>(&self, z: &'a Self::State) -> &'a [T] {
            z.x_hat.as_slice()
        }
    };
}
use of_gain_and_estimate;

/// What a structure that passes one value takes in the place of the innovation e.
#[inline(always)]
fn one_row<T: Scalar, G: GainLaw<T>>(gain: &G, memory: &G::Memory, e: T) -> T {
    let mut row = e;
    gain.rows(memory, e, core::slice::from_mut(&mut row));
    row
}
