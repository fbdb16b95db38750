//! Floor 0. Work that is compiled for several instruction sets, and which of them a processor has.
//!
//! The one place with `unsafe`: the call of a function for instructions that were asked for.

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
    /// AVX2: four `f64`.
    Avx2,
    /// AVX-512 (F, BW, CD, DQ, VL): eight `f64`.
    Avx512,
}

#[cfg(all(feature = "std", target_arch = "x86_64"))]
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
                // SAFETY: this processor has the instructions.
                Self::Avx512 => unsafe { avx512(task) },
                // SAFETY: as above.
                Self::Avx2 => unsafe { avx2(task) },
            })
        }
    }
}

#[cfg(not(all(feature = "std", target_arch = "x86_64")))]
impl Vectors {
    /// Whether this processor has them.
    pub fn are_available(self) -> bool {
        false
    }

    /// Do the task with these instructions; `None` where the processor has them not.
    pub fn run<K: Task>(self, _: K) -> Option<K::Output> {
        None
    }
}

impl Vectors {
    /// The widest that this processor has.
    pub fn widest() -> Option<Self> {
        [Self::Avx512, Self::Avx2].into_iter().find(|vectors| vectors.are_available())
    }
}
