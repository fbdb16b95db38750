//! `libhgo.a`: observers of hgo-rs behind a C interface.
//!
//! The caller owns every state, and integer codes take the place of panics. This file is the one
//! definition of the interface: `header.py` writes `include/hgo.h` from its tables, structs,
//! functions and their comments. What the observers compute stands in the core.
#![no_std]
#![deny(unsafe_op_in_unsafe_fn)]

mod law;

use core::ffi::c_char;
use core::mem::MaybeUninit;
use hgo_rs::Estimator;
use hgo_rs::estimator::Counts;
use hgo_rs::memory::Memory;
use hgo_rs::nalgebra::Vector1;
use hgo_rs::prelude::{DesignError, Scalar, Status};
use law::{
    AdaptiveConfig, Guarded, Law, LowPowerConfig, PeakingFreeConfig, Remembered, StandardConfig,
};

/// An image links only if no panic is reachable in it: this calls a function that exists nowhere.
#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    unsafe extern "C" {
        fn hgo_panic_is_reachable() -> !;
    }
    // SAFETY: the symbol is defined nowhere, so no image holds this call.
    unsafe { hgo_panic_is_reachable() }
}

/// Layout of the structs and meaning of the functions.
const VERSION: u32 = 2;

macro_rules! codes {
    ($($name:ident = $value:literal, $text:literal;)*) => {
        $(const $name: i32 = $value;)*
        fn text(code: i32) -> &'static [u8] {
            match code {
                // each a static of its own, which a linker leaves out with this function
                $($name => {
                    static TEXT: [u8; $text.len()] = *$text;
                    &TEXT
                })*
                _ => {
                    static TEXT: [u8; 27] = *b"not a code of this library\0";
                    &TEXT
                }
            }
        }
    };
}

// What a step made of its sample (>= 0), and what a function refused (< 0), with no state changed.
codes! {
    UPDATED = 0, b"done: the sample was used\0";
    PREDICTED = 1, b"the sample is missing (NaN or infinite): predicted over it\0";
    MODEL_UNDEFINED = 2, b"phi, or what a step makes of it, is not finite: the estimate was held\0";
    STEP_TOO_LONG = 3, b"dt is above dt_max: predicted over the sample as over a missing one\0";
    STEP_REFUSED = 4, b"dt is zero, negative, NaN or infinite: no step was taken\0";
    DIVERGED = 5, b"the memory is not finite any more: restart\0";
    NULL_POINTER = -1, b"a pointer is NULL\0";
    UNALIGNED = -2, b"a pointer is not aligned for its type\0";
    STATE_TOO_SMALL = -3, b"size is below the state's: pass sizeof of the state\0";
    WRONG_VERSION = -4, b"header and library differ in version: pass HGO_VERSION, rebuild both\0";
    BAD_PARAMETER = -5, b"a number is outside its range: init and step_limit name it\0";
    NOT_INITIALISED = -6, b"not a state of this type that init has made\0";
    BUFFER_LENGTH = -7, b"n is not the order, nor within the length of the memory\0";
}

const _: () = {
    assert!(UPDATED == Status::Updated as i32 && PREDICTED == Status::Predicted as i32);
    assert!(MODEL_UNDEFINED == Status::ModelUndefined as i32);
    assert!(STEP_TOO_LONG == Status::StepTooLong as i32);
    assert!(STEP_REFUSED == Status::StepRefused as i32 && DIVERGED == Status::Diverged as i32);
};

/// Which parameter init refused, and why.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct Error {
    /// name as in the configuration, NUL-terminated
    pub parameter: [c_char; 16],
    /// the range that it must lie in, NUL-terminated
    pub allowed: [c_char; 112],
    /// its value; of an array that is refused as a whole, the first entry
    pub value: f64,
}

/// Copy a text as C reads it, cut where it does not fit. The last byte of `out` is 0 already.
fn fill(out: &mut [c_char], text: &str) {
    let room = out.len().saturating_sub(1);
    for (slot, byte) in out.iter_mut().take(room).zip(text.bytes()) {
        *slot = c_char::from_ne_bytes([byte]);
    }
}

/// How many steps ended in which code; they stop at UINT32_MAX.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct StepCounts {
    /// HGO_UPDATED
    pub updated: u32,
    /// HGO_PREDICTED
    pub predicted: u32,
    /// HGO_MODEL_UNDEFINED
    pub model_undefined: u32,
    /// HGO_STEP_TOO_LONG
    pub step_too_long: u32,
    /// HGO_STEP_REFUSED
    pub step_refused: u32,
    /// HGO_DIVERGED
    pub diverged: u32,
}

impl From<Counts> for StepCounts {
    fn from(counts: Counts) -> Self {
        let Counts { updated, predicted, model_undefined, step_too_long, step_refused, diverged } =
            counts;
        Self { updated, predicted, model_undefined, step_too_long, step_refused, diverged }
    }
}

/// The sizes of what C and Rust both lay out; the header asserts the same.
macro_rules! sizes {
    ($($type:ty = $bytes:literal;)*) => {
        const _: () = {
            $(assert!(size_of::<$type>() == $bytes);)*
        };
    };
}

sizes! {
    Error = 136;
    StepCounts = 24;
    StandardConfig<f32> = 28;
    StandardConfig<f64> = 56;
    AdaptiveConfig<f32> = 36;
    AdaptiveConfig<f64> = 72;
    LowPowerConfig<f32> = 44;
    LowPowerConfig<f64> = 88;
    PeakingFreeConfig<f32> = 60;
    PeakingFreeConfig<f64> = 120;
}

/// The version of the library, to be compared with HGO_VERSION.
#[unsafe(no_mangle)]
pub extern "C" fn hgo_version() -> u32 {
    VERSION
}

/// What a code means, NUL-terminated; for every number, and never NULL.
#[unsafe(no_mangle)]
pub extern "C" fn hgo_status_text(status: i32) -> *const c_char {
    text(status).as_ptr().cast()
}

/// What a C state holds: a mark of its type, and the estimator.
#[repr(C)]
pub struct State<T: Scalar, L: Law<T>> {
    mark: u32,
    estimator: MaybeUninit<Estimator<T, Guarded<L, true>>>,
}

/// A mark from a type's name and the version (FNV-1a).
const fn mark(name: &str) -> u32 {
    let (mut hash, bytes, mut i) = (0x811c_9dc5_u32 ^ VERSION, name.as_bytes(), 0);
    while i < bytes.len() {
        hash = (hash ^ bytes[i] as u32).wrapping_mul(0x0100_0193);
        i += 1;
    }
    hash
}

/// Refuse what no pointer to a `P` can be.
#[inline(always)]
fn plausible<P>(pointer: *const P) -> Result<(), i32> {
    if pointer.is_null() {
        Err(NULL_POINTER)
    } else if pointer.is_aligned() {
        Ok(())
    } else {
        Err(UNALIGNED)
    }
}

/// The estimator in a state that `init` made.
///
/// # Safety
/// A pointer that is neither null nor unaligned points to a state's bytes; nothing else uses them.
#[inline(always)]
unsafe fn open<T: Scalar, L: Law<T>>(
    state: *const State<T, L>,
    mark: u32,
) -> Result<*const Estimator<T, Guarded<L, true>>, i32> {
    plausible(state)?;
    // SAFETY: not null and aligned; the caller vouches for the rest.
    if unsafe { (*state).mark } == mark {
        // `init` alone writes the mark, after the estimator.
        // SAFETY: as above.
        Ok(unsafe { &raw const (*state).estimator }.cast())
    } else {
        Err(NOT_INITIALISED)
    }
}

/// The same, to be changed.
///
/// # Safety
/// As [`open`].
#[inline(always)]
unsafe fn open_mut<'a, T: Scalar, L: Law<T>>(
    state: *mut State<T, L>,
    mark: u32,
) -> Result<&'a mut Estimator<T, Guarded<L, true>>, i32> {
    // SAFETY: the caller vouches for it; an opened state holds an estimator.
    unsafe { open(state, mark).map(|estimator| &mut *estimator.cast_mut()) }
}

/// A pointer's target with nothing in it, if there is a pointer.
///
/// # Safety
/// A pointer that is neither null nor unaligned points to an [`Error`]'s bytes.
unsafe fn clear(error: *mut Error) -> Result<(), i32> {
    if !error.is_null() {
        plausible(error)?;
        // SAFETY: not null and aligned; the caller vouches for the rest.
        unsafe { error.write_bytes(0, 1) };
    }
    Ok(())
}

/// The code of a refused parameter, the parameter written to `error` if there is one.
///
/// # Safety
/// `clear` has accepted `error`.
#[inline(never)]
unsafe fn refuse(error: *mut Error, refused: &DesignError) -> i32 {
    // SAFETY: null, or aligned and all zeros since `clear`; the caller vouches for the rest.
    if let Some(error) = unsafe { error.as_mut() } {
        fill(&mut error.parameter, refused.parameter);
        fill(&mut error.allowed, refused.allowed);
        error.value = refused.value;
    }
    BAD_PARAMETER
}

/// # Safety
/// Each pointer that is neither null nor unaligned points to bytes of its type, `state` to `size`
/// of them; nothing else uses them.
unsafe fn init<T: Scalar, L: Law<T>>(
    state: *mut State<T, L>,
    size: usize,
    version: u32,
    config: *const L::Config,
    error: *mut Error,
    mark: u32,
) -> Result<(), i32> {
    // SAFETY: the caller vouches for it.
    unsafe { clear(error) }?;
    plausible(state)?;
    plausible(config)?;
    if version != VERSION {
        return Err(WRONG_VERSION);
    }
    if size < size_of::<State<T, L>>() {
        return Err(STATE_TOO_SMALL);
    }
    // SAFETY: not null and aligned, of this version's layout; the caller vouches for the rest.
    let config = unsafe { &*config };
    // SAFETY: the caller vouches for `error`.
    let estimator = L::estimator(config).map_err(|refused| unsafe { refuse(error, &refused) })?;
    let made = State { mark, estimator: MaybeUninit::new(estimator) };
    // SAFETY: not null, aligned and large enough; the caller vouches for the rest.
    unsafe { state.write(made) };
    Ok(())
}

/// # Safety
/// Each pointer that is neither null nor unaligned points to bytes of its type.
unsafe fn limit<T: Scalar, L: Law<T>>(
    config: *const L::Config,
    dt_max: *mut T,
    error: *mut Error,
    computed: fn(&L::Config) -> T,
) -> Result<(), i32> {
    // SAFETY: the caller vouches for it.
    unsafe { clear(error) }?;
    plausible(config)?;
    plausible(dt_max)?;
    // SAFETY: not null and aligned; the caller vouches for the rest.
    let limit = L::limit(unsafe { &*config }, computed);
    // SAFETY: the caller vouches for `error`.
    let limit = limit.map_err(|refused| unsafe { refuse(error, &refused) })?;
    // SAFETY: not null and aligned; the caller vouches for the rest.
    unsafe { dt_max.write(limit) };
    Ok(())
}

/// # Safety
/// As [`open`]; `numbers` points to `n` numbers.
unsafe fn estimate<T: Scalar, L: Law<T>>(
    state: *const State<T, L>,
    numbers: *mut T,
    n: usize,
    mark: u32,
) -> Result<(), i32> {
    // SAFETY: the caller vouches for it; an opened state holds an estimator.
    let estimator = unsafe { &*open(state, mark)? };
    plausible(numbers)?;
    if !(L::ORDER..=Remembered::<T, L>::LEN).contains(&n) {
        return Err(BUFFER_LENGTH);
    }
    // SAFETY: not null and aligned, n is small; the caller vouches for the rest.
    let out = unsafe { core::slice::from_raw_parts_mut(numbers.cast::<MaybeUninit<T>>(), n) };
    let mut slots = out.iter_mut();
    estimator.memory().visit(&mut |entry| {
        if let Some(slot) = slots.next() {
            slot.write(entry);
        }
    });
    Ok(())
}

/// # Safety
/// As [`open`]; `numbers` points to `n` numbers.
unsafe fn restart<T: Scalar, L: Law<T>>(
    state: *mut State<T, L>,
    numbers: *const T,
    n: usize,
    mark: u32,
) -> Result<(), i32> {
    // SAFETY: the caller vouches for it.
    let estimator = unsafe { open_mut(state, mark) }?;
    plausible(numbers)?;
    if n != L::ORDER && n != Remembered::<T, L>::LEN {
        return Err(BUFFER_LENGTH);
    }
    // SAFETY: not null and aligned, n is small; the caller vouches for the rest.
    let numbers = unsafe { core::slice::from_raw_parts(numbers, n) };
    if !L::admits(numbers) {
        return Err(BAD_PARAMETER);
    }
    estimator.restart(L::memory(numbers));
    Ok(())
}

/// # Safety
/// As [`open`]; `counts` points to one struct.
unsafe fn counts<T: Scalar, L: Law<T>>(
    state: *const State<T, L>,
    counts: *mut StepCounts,
    mark: u32,
) -> Result<(), i32> {
    // SAFETY: the caller vouches for it; an opened state holds an estimator.
    let estimator = unsafe { &*open(state, mark)? };
    plausible(counts)?;
    // SAFETY: not null and aligned; the caller vouches for the rest.
    unsafe { counts.write(estimator.counts().into()) };
    Ok(())
}

#[inline(always)]
fn code(outcome: Result<(), i32>) -> i32 {
    outcome.err().unwrap_or(UPDATED)
}

/// The types and their functions: the law of a type, the struct that it is configured from, the
/// bytes of its state and the numbers of its memory.
macro_rules! observers {
    ($($name:ident: $law:ident<$t:ident, $n:literal> from $config:ident,
        $bytes:literal bytes, $memory:literal numbers;)*) => {$(
        mod $name {
            use super::{Error, Memory, Remembered, StepCounts, law};

            type Law = law::$law<$t, $n>;
            type Config = law::$config<$t>;
            type State = super::State<$t, Law>;
            const MARK: u32 = super::mark(stringify!($name));
            const _: () = {
                assert!(size_of::<State>() == $bytes && align_of::<State>() == align_of::<$t>());
                assert!(<Remembered<$t, Law> as Memory<$t>>::LEN == $memory);
            };

            /// Make a state of `size` bytes from a configuration, with the estimate 0. `error` may
            /// be NULL; after HGO_BAD_PARAMETER it says what was refused.
            #[unsafe(export_name = concat!("hgo_", stringify!($name), "_init"))]
            unsafe extern "C" fn init(
                state: *mut State,
                size: usize,
                version: u32,
                config: *const Config,
                error: *mut Error,
            ) -> i32 {
                // SAFETY: the C caller vouches for the pointers.
                super::code(unsafe { super::init(state, size, version, config, error, MARK) })
            }

            /// Write the stability limit of step [s], above which dt_max must not be, for the law of
            /// a configuration; its dt_max is not read. `error` may be NULL.
            #[unsafe(export_name = concat!("hgo_", stringify!($name), "_step_limit"))]
            unsafe extern "C" fn step_limit(
                config: *const Config,
                dt_max: *mut $t,
                error: *mut Error,
            ) -> i32 {
                let computed = <Law as law::Law<$t>>::euler_limit;
                // SAFETY: the C caller vouches for the pointers.
                super::code(unsafe { super::limit::<$t, Law>(config, dt_max, error, computed) })
            }

            /// The same for correct and predict, whose limit is another one: mostly about half.
            #[unsafe(export_name = concat!("hgo_", stringify!($name), "_predict_limit"))]
            unsafe extern "C" fn predict_limit(
                config: *const Config,
                dt_max: *mut $t,
                error: *mut Error,
            ) -> i32 {
                let computed = <Law as law::Law<$t>>::causal_limit;
                // SAFETY: the C caller vouches for the pointers.
                super::code(unsafe { super::limit::<$t, Law>(config, dt_max, error, computed) })
            }

            /// Use the present sample y (NaN: it is missing) and advance by dt [s], the time until the
            /// next sample: the papers' recursion, one call for each sample. phi: the model's n-th
            /// derivative of y over that time, computed from the estimate before this step and from
            /// the inputs; 0 without a model. The estimate is then the prediction for the next sample.
            #[unsafe(export_name = concat!("hgo_", stringify!($name), "_step"))]
            unsafe extern "C" fn step(state: *mut State, y: $t, phi: $t, dt: $t) -> i32 {
                // SAFETY: the C caller vouches for the pointer.
                match unsafe { super::open_mut(state, MARK) } {
                    Ok(estimator) => {
                        let recursion = estimator.observer().recursion();
                        estimator.step_by(&recursion, &y, &super::Vector1::new(phi), dt) as i32
                    }
                    Err(code) => code,
                }
            }

            /// Use the present sample y (NaN: it is missing, and nothing changes). The estimate is
            /// then that of its time. The correction covers the period of the last predict; without
            /// one, as at the start, it changes nothing.
            #[unsafe(export_name = concat!("hgo_", stringify!($name), "_correct"))]
            unsafe extern "C" fn correct(state: *mut State, y: $t) -> i32 {
                // SAFETY: the C caller vouches for the pointer.
                match unsafe { super::open_mut(state, MARK) } {
                    Ok(estimator) => estimator.correct(&y) as i32,
                    Err(code) => code,
                }
            }

            /// Predict over the coming period of dt [s], without a sample: HGO_PREDICTED. phi: the
            /// model's n-th derivative of y over it, computed from the present estimate and from the
            /// inputs applied in it; 0 without a model. After a period above dt_max the next sample is
            /// not used, and correct returns HGO_STEP_TOO_LONG.
            #[unsafe(export_name = concat!("hgo_", stringify!($name), "_predict"))]
            unsafe extern "C" fn predict(state: *mut State, phi: $t, dt: $t) -> i32 {
                // SAFETY: the C caller vouches for the pointer.
                match unsafe { super::open_mut(state, MARK) } {
                    Ok(estimator) => estimator.predict(&super::Vector1::new(phi), dt) as i32,
                    Err(code) => code,
                }
            }

            /// Copy the first n numbers of the memory: x_hat_1 ... x_hat_n, which estimate y and its
            /// derivatives now (after correct), or at the next sample (after step and predict). A
            /// larger n, up to the length of the memory, gives what the law remembers beside: eta_1
            /// ... eta_(n-1) or r, and last the time [s] that the next correction is for.
            #[unsafe(export_name = concat!("hgo_", stringify!($name), "_estimate"))]
            unsafe extern "C" fn estimate(state: *const State, x_hat: *mut $t, n: usize) -> i32 {
                // SAFETY: the C caller vouches for the pointers.
                super::code(unsafe { super::estimate(state, x_hat, n, MARK) })
            }

            /// Start again at time 0 from an estimate of n numbers, n the order, or from a whole
            /// memory; every number finite, r at least 1, the time not negative. The counts go on.
            #[unsafe(export_name = concat!("hgo_", stringify!($name), "_restart"))]
            unsafe extern "C" fn restart(state: *mut State, x_hat: *const $t, n: usize) -> i32 {
                // SAFETY: the C caller vouches for the pointers.
                super::code(unsafe { super::restart(state, x_hat, n, MARK) })
            }

            /// Copy the counts of what step and correct ended in, one a sample, and of what predict
            /// refused or held.
            #[unsafe(export_name = concat!("hgo_", stringify!($name), "_counts"))]
            unsafe extern "C" fn counts(state: *const State, counts: *mut StepCounts) -> i32 {
                // SAFETY: the C caller vouches for the pointers.
                super::code(unsafe { super::counts(state, counts, MARK) })
            }
        }
    )*};
}

observers! {
    standard2_f32: Standard<f32, 2> from StandardConfig, 76 bytes, 3 numbers;
    standard3_f32: Standard<f32, 3> from StandardConfig, 84 bytes, 4 numbers;
    standard4_f32: Standard<f32, 4> from StandardConfig, 92 bytes, 5 numbers;
    standard5_f32: Standard<f32, 5> from StandardConfig, 100 bytes, 6 numbers;
    standard2_f64: Standard<f64, 2> from StandardConfig, 128 bytes, 3 numbers;
    standard3_f64: Standard<f64, 3> from StandardConfig, 144 bytes, 4 numbers;
    standard4_f64: Standard<f64, 4> from StandardConfig, 160 bytes, 5 numbers;
    standard5_f64: Standard<f64, 5> from StandardConfig, 176 bytes, 6 numbers;
    adaptive2_f32: Adaptive<f32, 2> from AdaptiveConfig, 92 bytes, 4 numbers;
    adaptive3_f32: Adaptive<f32, 3> from AdaptiveConfig, 100 bytes, 5 numbers;
    adaptive4_f32: Adaptive<f32, 4> from AdaptiveConfig, 108 bytes, 6 numbers;
    adaptive5_f32: Adaptive<f32, 5> from AdaptiveConfig, 116 bytes, 7 numbers;
    adaptive2_f64: Adaptive<f64, 2> from AdaptiveConfig, 160 bytes, 4 numbers;
    adaptive3_f64: Adaptive<f64, 3> from AdaptiveConfig, 176 bytes, 5 numbers;
    adaptive4_f64: Adaptive<f64, 4> from AdaptiveConfig, 192 bytes, 6 numbers;
    adaptive5_f64: Adaptive<f64, 5> from AdaptiveConfig, 208 bytes, 7 numbers;
    dead_zone2_f32: DeadZone<f32, 2> from AdaptiveConfig, 92 bytes, 4 numbers;
    dead_zone3_f32: DeadZone<f32, 3> from AdaptiveConfig, 100 bytes, 5 numbers;
    dead_zone4_f32: DeadZone<f32, 4> from AdaptiveConfig, 108 bytes, 6 numbers;
    dead_zone5_f32: DeadZone<f32, 5> from AdaptiveConfig, 116 bytes, 7 numbers;
    dead_zone2_f64: DeadZone<f64, 2> from AdaptiveConfig, 160 bytes, 4 numbers;
    dead_zone3_f64: DeadZone<f64, 3> from AdaptiveConfig, 176 bytes, 5 numbers;
    dead_zone4_f64: DeadZone<f64, 4> from AdaptiveConfig, 192 bytes, 6 numbers;
    dead_zone5_f64: DeadZone<f64, 5> from AdaptiveConfig, 208 bytes, 7 numbers;
    low_power2_f32: LowPowerFixed<f32, 2> from LowPowerConfig, 92 bytes, 4 numbers;
    low_power3_f32: LowPowerFixed<f32, 3> from LowPowerConfig, 108 bytes, 6 numbers;
    low_power4_f32: LowPowerFixed<f32, 4> from LowPowerConfig, 124 bytes, 8 numbers;
    low_power5_f32: LowPowerFixed<f32, 5> from LowPowerConfig, 140 bytes, 10 numbers;
    low_power2_f64: LowPowerFixed<f64, 2> from LowPowerConfig, 160 bytes, 4 numbers;
    low_power3_f64: LowPowerFixed<f64, 3> from LowPowerConfig, 192 bytes, 6 numbers;
    low_power4_f64: LowPowerFixed<f64, 4> from LowPowerConfig, 224 bytes, 8 numbers;
    low_power5_f64: LowPowerFixed<f64, 5> from LowPowerConfig, 256 bytes, 10 numbers;
    peaking_free2_f32: PeakingFree<f32, 2> from PeakingFreeConfig, 100 bytes, 4 numbers;
    peaking_free3_f32: PeakingFree<f32, 3> from PeakingFreeConfig, 120 bytes, 6 numbers;
    peaking_free4_f32: PeakingFree<f32, 4> from PeakingFreeConfig, 140 bytes, 8 numbers;
    peaking_free5_f32: PeakingFree<f32, 5> from PeakingFreeConfig, 160 bytes, 10 numbers;
    peaking_free2_f64: PeakingFree<f64, 2> from PeakingFreeConfig, 176 bytes, 4 numbers;
    peaking_free3_f64: PeakingFree<f64, 3> from PeakingFreeConfig, 216 bytes, 6 numbers;
    peaking_free4_f64: PeakingFree<f64, 4> from PeakingFreeConfig, 256 bytes, 8 numbers;
    peaking_free5_f64: PeakingFree<f64, 5> from PeakingFreeConfig, 296 bytes, 10 numbers;
}
