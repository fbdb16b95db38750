//! Floor 0. What is wrong with a design: the parameter, its value, the range it must lie in.

use core::fmt;

/// A refused parameter. Fits no heap, so constructors on a chip return it too.
///
/// With feature `serde` it can be written, not read: its texts are the program's own.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct DesignError {
    /// Name of the parameter as the user wrote it.
    pub parameter: &'static str,
    /// Its value, widened to `f64`.
    pub value: f64,
    /// The range that it must lie in, and the remedy.
    pub allowed: &'static str,
}

impl fmt::Display for DesignError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { parameter, value, allowed } = self;
        let size = value.abs();
        if size != 0.0 && size.is_finite() && !(1e-4..1e7).contains(&size) {
            write!(f, "{parameter} = {value:e} is not allowed: {allowed}")
        } else {
            write!(f, "{parameter} = {value} is not allowed: {allowed}")
        }
    }
}

impl core::error::Error for DesignError {}

/// Feature `serde` for a type with a constructor: it is written as what the constructor takes and
/// read through it, so that a file can say nothing that the constructor would refuse.
///
/// `[generics] Type<arguments>: value => { field: type = what is written, … } => what is built`
macro_rules! through_constructor {
    (
        [$($generics:tt)*] $name:ident<$($argument:ident),*>: $value:ident
        => { $($field:ident: $kind:ty = $written:expr),+ $(,)? }
        => $built:expr
    ) => {
        #[cfg(feature = "serde")]
        #[allow(trivial_bounds, non_camel_case_types)]
        impl<$($generics)*> serde::Serialize for $name<$($argument),*>
        where
            $($kind: serde::Serialize),+
        {
            fn serialize<Out: serde::Serializer>(&self, out: Out) -> Result<Out::Ok, Out::Error> {
                #[derive(serde::Serialize)]
                struct $name<$($field),+> {
                    $($field: $field),+
                }
                let $value = self;
                $name { $($field: $written),+ }.serialize(out)
            }
        }

        #[cfg(feature = "serde")]
        #[allow(trivial_bounds, non_camel_case_types)]
        impl<'de, $($generics)*> serde::Deserialize<'de> for $name<$($argument),*>
        where
            $($kind: serde::Deserialize<'de>),+
        {
            fn deserialize<In: serde::Deserializer<'de>>(input: In) -> Result<Self, In::Error> {
                #[derive(serde::Deserialize)]
                struct $name<$($field),+> {
                    $($field: $field),+
                }
                let $name::<$($kind),+> { $($field),+ } = $name::deserialize(input)?;
                let built: Result<Self, crate::DesignError> = $built;
                built.map_err(serde::de::Error::custom)
            }
        }
    };
}
pub(crate) use through_constructor;

/// `value` if it is finite and greater than 0.
///
/// # Errors
/// [`DesignError`] naming `parameter` otherwise.
pub fn positive<T: crate::Scalar>(parameter: &'static str, value: T) -> Result<T, DesignError> {
    require(parameter, value, value.is_finite() && value > T::ZERO, "it must be finite and > 0")
}

/// `value` if it is neither NaN nor infinite.
///
/// # Errors
/// [`DesignError`] naming `parameter` otherwise.
pub fn finite<T: crate::Scalar>(parameter: &'static str, value: T) -> Result<T, DesignError> {
    require(parameter, value, value.is_finite(), "it must be finite")
}

/// `value` if `holds`.
///
/// # Errors
/// [`DesignError`] with `allowed` otherwise.
pub fn require<T: crate::Scalar>(
    parameter: &'static str,
    value: T,
    holds: bool,
    allowed: &'static str,
) -> Result<T, DesignError> {
    if holds { Ok(value) } else { Err(DesignError { parameter, value: value.to_f64(), allowed }) }
}
