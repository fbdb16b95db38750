//! Floor 1. Work that is compiled for several instruction sets, and which of them a processor has.
//!
//! The one place with `unsafe`: the call of a function for instructions that were asked for.

use crate::error::{Result, refused};

/// Work that is compiled for several instruction sets. `run` must be `#[inline(always)]`, and so must
/// be all that it calls in its inner loop.
pub trait Task {
    /// What it gives.
    type Output;
    /// Do it.
    fn run(self) -> Self::Output;
}

/// Instructions on several numbers at once that tasks are compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Vectors {
    /// What every processor of the architecture has: SSE2 (two `f64`) on x86-64, NEON on `AArch64`.
    Baseline,
    /// AVX2: four `f64`.
    Avx2,
    /// AVX-512 (F, BW, CD, DQ, VL): eight `f64`.
    Avx512,
}

impl Vectors {
    /// Every one, the widest first.
    pub const ALL: [Self; 3] = [Self::Avx512, Self::Avx2, Self::Baseline];

    /// The widest that this processor has.
    pub fn widest() -> Self {
        Self::ALL.into_iter().find(|vectors| vectors.are_available()).unwrap_or(Self::Baseline)
    }
}

/// The variable that holds studies to an instruction set.
const FORCE: &str = "HGO_INSTRUCTION_SET";

impl Vectors {
    /// The instructions of studies: the widest of this processor, or those that the environment asks for.
    /// `None`: one run at a time.
    ///
    /// # Errors
    /// A set that is not known, or that this processor has not.
    pub fn asked() -> Result<Option<Self>> {
        let refuse = |given: &str, why: &str, remedy: &str| {
            Err(refused(format!("{FORCE} = {given:?} is not allowed: {why}; {remedy}")))
        };
        let asked = match std::env::var(FORCE).as_deref() {
            Err(_) => Some(Self::widest()),
            Ok("plain") => None,
            Ok("baseline") => Some(Self::Baseline),
            Ok("avx2") => Some(Self::Avx2),
            Ok("avx512") => Some(Self::Avx512),
            Ok(other) => {
                let known = "it must be plain, baseline, avx2 or avx512";
                return refuse(other, known, "choose one of them, or unset it");
            }
        };
        if let Some(vectors) = asked
            && !vectors.are_available()
        {
            let given = format!("{vectors:?}").to_lowercase();
            let lacking = format!("this processor has no {given}");
            return refuse(&given, &lacking, "choose a smaller one, or unset it");
        }
        Ok(asked)
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{Task, Vectors};

    #[target_feature(enable = "avx2")]
    fn avx2<K: Task>(task: K) -> K::Output {
        task.run()
    }

    #[target_feature(enable = "avx512f,avx512bw,avx512cd,avx512dq,avx512vl")]
    fn avx512<K: Task>(task: K) -> K::Output {
        task.run()
    }

    impl Vectors {
        /// Whether this processor has them.
        pub fn are_available(self) -> bool {
            match self {
                Self::Baseline => true,
                Self::Avx2 => is_x86_feature_detected!("avx2"),
                Self::Avx512 => {
                    is_x86_feature_detected!("avx512f")
                        && is_x86_feature_detected!("avx512bw")
                        && is_x86_feature_detected!("avx512cd")
                        && is_x86_feature_detected!("avx512dq")
                        && is_x86_feature_detected!("avx512vl")
                }
            }
        }

        /// Do the task with these instructions; `None` where the processor has them not.
        #[allow(unsafe_code)] // the call of a function for a processor that has been asked for it
        pub fn run<K: Task>(self, task: K) -> Option<K::Output> {
            self.are_available().then(|| match self {
                Self::Baseline => task.run(),
                // SAFETY: this processor has the instructions.
                Self::Avx2 => unsafe { avx2(task) },
                // SAFETY: as above.
                Self::Avx512 => unsafe { avx512(task) },
            })
        }
    }
}

#[cfg(not(target_arch = "x86_64"))]
impl Vectors {
    /// Whether this processor has them.
    pub fn are_available(self) -> bool {
        self == Self::Baseline
    }

    /// Do the task with these instructions; `None` where the processor has them not.
    pub fn run<K: Task>(self, task: K) -> Option<K::Output> {
        self.are_available().then(|| task.run())
    }
}
