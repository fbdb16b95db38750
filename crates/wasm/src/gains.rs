//! Floor 1. Gains of placed corrections, computed by the laws of the list themselves.
#![allow(clippy::extra_unused_type_parameters)] // every row of the list has the same ones

use crate::numbers::Live;
use hgo_rs::for_each_law;
use hgo_rs::gain::ConstantGain;
use hgo_rs::injection::{Injected, Placement};
use hgo_rs::model::Unknown;
use hgo_rs::observers::{BlockGains, NoSaturation};
use nalgebra::SVector;

/// The time that a correction is for [s] → its gains.
pub type Gains = dyn Fn(f64) -> Vec<f64>;

/// Gains as numbers, in the order of a step's inputs.
trait Numbers {
    fn numbers(&self) -> Vec<f64>;
}

impl<const N: usize> Numbers for SVector<f64, N> {
    fn numbers(&self) -> Vec<f64> {
        self.as_slice().to_vec()
    }
}

impl<const N: usize> Numbers for [BlockGains<f64, N>; 2] {
    fn numbers(&self) -> Vec<f64> {
        self.iter().flat_map(|of| [of.a, of.b]).flat_map(|part| part.numbers()).collect()
    }
}

/// Of any law whose eigenvalues can be placed.
fn of<L>(law: L, at: Placement) -> Option<Box<Gains>>
where
    L: Injected<f64, Innovation = f64, Gains: Numbers> + 'static,
{
    let poles = law.poles(at).ok()?;
    let at_rest = law.initial();
    Some(Box::new(move |length| law.gains(at, &poles, &at_rest, &0.0, length).numbers()))
}

/// A function that finds the gains of each law of the list, by its place there; `None` of a law that has
/// none, or refuses them.
macro_rules! placed {
    (
        $(rates {
            kind: $kind:literal, title: $title:literal,
            law: $law:ty,
            new: [$($name:ident $count:tt)*] [$gain:ident $(, $taken:ident)*],
            orders: [$($order:literal)*], size: $size:tt,
            design: $design:tt,
            form: $form:ident, steps: $steps:ident,
            memory: $memory:tt,
            source: $source:literal,
        })*
        $(recursions $recursion:tt)*
    ) => {
        /// The gains of an observer's corrections at a gain ℓ.
        pub fn gains(live: &Live, ell: f64) -> Option<Box<Gains>> {
            let at = live.placement?;
            let mut place = 0;
            $(
                if place == live.law {
                    placed!(@steps $steps $law [$($name)*] [$($taken)*] [$($order)*] live ell at);
                }
                place += 1;
            )*
            let _ = (place, ell, at);
            None
        }
    };
    (@steps placed $law:ty [$($name:ident)*] [$($taken:ident)*] [$($order:literal)*] $live:ident $ell:ident $at:ident) => {{
        type T = f64;
        type G = ConstantGain<f64>;
        type Md = Unknown;
        #[allow(dead_code)] // of laws with one
        type S = NoSaturation;
        const M: usize = 0;
        fn sized<const N: usize>(live: &Live, ell: f64, at: Placement) -> Option<Box<Gains>> {
            let mut lists = live.coefficients.as_slice();
            let law = <$law>::new(
                $(placed!(@list $name lists),)*
                ConstantGain::new(ell).ok()?,
                $(placed!(@taken $taken),)*
            );
            of(law.ok()?, at)
        }
        return match $live.n {
            $($order => sized::<$order>($live, $ell, $at),)*
            _ => None,
        };
    }};
    (@steps $other:ident $($rest:tt)*) => {};
    (@list $name:ident $lists:ident) => {{
        let (list, rest) = list(stringify!($name), N, $lists)?;
        $lists = rest;
        let _ = $lists;
        list
    }};
    (@taken model) => { Unknown };
    (@taken $other:ident) => { NoSaturation };
}
for_each_law!(placed);

/// The next list of coefficients, with zeros behind it, and what is left: of n numbers, of n − 1 for `beta`.
fn list<'a, const L: usize>(
    name: &str,
    n: usize,
    lists: &'a [f64],
) -> Option<([f64; L], &'a [f64])> {
    let (list, rest) = lists.split_at_checked(n - usize::from(name == "beta"))?;
    Some((std::array::from_fn(|i| list.get(i).copied().unwrap_or(0.0)), rest))
}
