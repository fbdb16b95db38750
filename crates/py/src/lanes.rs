//! Floor 3. Studies in vector code: which pairs of plant and observer it is compiled for, and their blocks.
//!
//! The types that Python chooses at run time (model, gain law, saturation, scheme) are named here, so
//! that nothing is left to choose in the loop over runs. What is not named runs one run at a time,
//! with the same bits.

use crate::errors::Result;
use crate::interrupt::StopFlag;
use crate::plan::{AnySchedule, BlockOf, Plan, StudyResult};
use hgo_ir::choices::{AnySaturation, MovingGain};
use hgo_ir::systems::{AnyModel, AnyPlant};
use hgo_rs::gain::ConstantGain;
use hgo_rs::integrate::Integrator;
use hgo_rs::lanes::LaneMetrics;
use hgo_rs::model::{Plant, Unknown};
use hgo_rs::models::{Ship, VanDerPol};
use hgo_rs::observer::{
    BogackiShampine, ContinuousLaw, Discretisation, Discretised, Euler, Observer, Rk4,
};
use hgo_rs::observers::{
    LowPower, NoSaturation, ReducedOrderObserver, SampledDataObserver, StandardObserver,
};
use hgo_rs::simulate::Experiment;
use hgo_rs::vectors::Task;
use nalgebra::SVector;
use std::any::Any;

/// What a study of a continuous law gives, if its types are named here.
type Studied = Option<Result<StudyResult>>;

type NoInput = SVector<f64, 0>;

/// A block of runs with an observer in discrete time.
struct Sampled<'a, 'b, P, O>
where
    P: Plant<f64>,
    O: Observer<f64, Measurement = P::Output, Input = P::Input>,
{
    experiment: &'a Experiment<'a, f64, P, AnySchedule>,
    observer: &'a O,
    first_run: u64,
    block: BlockOf<P::State, O::State>,
    metrics: &'a mut LaneMetrics<'b, f64>,
    stop: &'a StopFlag,
}

impl<P, O> Task for Sampled<'_, '_, P, O>
where
    P: Plant<f64>,
    O: Observer<f64, Measurement = P::Output, Input = P::Input>,
{
    type Output = BlockOf<P::State, O::State>;
    #[inline(always)]
    fn run(self) -> Self::Output {
        let stop = || self.stop.is_set();
        let Self { experiment, observer, first_run, block, metrics, .. } = self;
        experiment.sampled_block(observer, first_run, block, metrics, stop)
    }
}

/// A block of runs with plant and law as one differential equation.
struct Joint<'a, 'b, P, L>
where
    P: Plant<f64, Output = f64>,
    L: ContinuousLaw<f64, Input = P::Input>,
{
    experiment: &'a Experiment<'a, f64, P, AnySchedule>,
    law: &'a L,
    integrator: Integrator,
    first_run: u64,
    block: BlockOf<P::State, L::State>,
    metrics: &'a mut LaneMetrics<'b, f64>,
    stop: &'a StopFlag,
}

impl<P, L> Task for Joint<'_, '_, P, L>
where
    P: Plant<f64, Output = f64>,
    L: ContinuousLaw<f64, Input = P::Input>,
{
    type Output = BlockOf<P::State, L::State>;
    #[inline(always)]
    fn run(self) -> Self::Output {
        let stop = || self.stop.is_set();
        let Self { experiment, law, integrator, first_run, block, metrics, .. } = self;
        match integrator {
            Integrator::BogackiShampine => {
                let scheme = Integrator::BogackiShampine;
                experiment.joint_block(law, scheme, first_run, block, metrics, stop)
            }
            // `continuous` lets no other through
            Integrator::Rk4 | Integrator::Euler => {
                let scheme = Integrator::Rk4;
                experiment.joint_block(law, scheme, first_run, block, metrics, stop)
            }
        }
    }
}

/// All runs of a study with an observer in discrete time.
fn sampled<P, O>(observer: O, plant: P, plan: &Plan, stop: &StopFlag, kept: usize) -> Studied
where
    P: Plant<f64> + Send + Sync,
    O: Observer<f64, Measurement = P::Output, Input = P::Input> + Sync,
{
    plan.execute_blocks::<P, O::State>(
        plant,
        kept,
        |vectors, experiment, first_run, block, metrics| {
            vectors.run(Sampled {
                experiment,
                observer: &observer,
                first_run,
                block,
                metrics,
                stop,
            })
        },
    )
}

/// All runs of a study of a continuous law, sampled or joint.
fn continuous<P, L>(
    law: L,
    scheme: Discretisation,
    plant: P,
    plan: &Plan,
    stop: &StopFlag,
) -> Studied
where
    P: Plant<f64, Output = f64, Input = NoInput> + Send + Sync,
    L: ContinuousLaw<f64, Input = NoInput> + Sync,
{
    let kept = plan.memory_len();
    if plan.is_joint() {
        let integrator = match scheme {
            Discretisation::RungeKutta(Rk4::CHOICE) => Integrator::Rk4,
            Discretisation::RungeKutta(BogackiShampine::CHOICE) => Integrator::BogackiShampine,
            _ => return None,
        };
        if !plan.has_no_sines() {
            return None;
        }
        return plan.execute_blocks::<P, L::State>(
            plant,
            kept,
            |vectors, experiment, first_run, block, metrics| {
                vectors.run(Joint {
                    experiment,
                    law: &law,
                    integrator,
                    first_run,
                    block,
                    metrics,
                    stop,
                })
            },
        );
    }
    match scheme {
        Discretisation::Euler => {
            sampled(Discretised { law, scheme: Euler }, plant, plan, stop, kept)
        }
        Discretisation::RungeKutta(Rk4::CHOICE) => {
            sampled(Discretised { law, scheme: Rk4 }, plant, plan, stop, kept)
        }
        _ => None,
    }
}

/// A study of a law of order 2, if its types and the plant are named here.
pub fn order_2<L: 'static>(
    law: &L,
    scheme: Discretisation,
    plan: &Plan,
    stop: &StopFlag,
) -> Studied {
    type Standard<G> = StandardObserver<f64, G, AnyModel, 2, 1>;
    let law: &dyn Any = law;
    if let Some(law) = law.downcast_ref::<Standard<ConstantGain<f64>>>() {
        let (gain, model) = law.parts();
        return match (plan.plant, model) {
            (AnyPlant::Lee(plant), AnyModel::Unknown) => {
                continuous(law.typed::<_, _, 0>(gain, Unknown), scheme, plant, plan, stop)
            }
            (AnyPlant::Lee(plant), AnyModel::Lee(own)) => {
                continuous(law.typed::<_, _, 0>(gain, own), scheme, plant, plan, stop)
            }
            _ => None,
        };
    }
    if let Some(law) = law.downcast_ref::<Standard<MovingGain>>() {
        let (AnyPlant::SanfelicePraly(plant), (gain, AnyModel::SanfelicePraly(own))) =
            (plan.plant, law.parts())
        else {
            return None;
        };
        return match gain {
            MovingGain::Adaptive(gain) => {
                continuous(law.typed::<_, _, 0>(gain, own), scheme, plant, plan, stop)
            }
            MovingGain::DeadZone(gain) => {
                continuous(law.typed::<_, _, 0>(gain, own), scheme, plant, plan, stop)
            }
        };
    }
    None
}

/// A study of a law of order 5, if its types are named here.
pub fn order_5<L: 'static>(
    law: &L,
    scheme: Discretisation,
    plan: &Plan,
    stop: &StopFlag,
) -> Studied {
    type Fixed = ConstantGain<f64>;
    let AnyPlant::Crackle(plant) = plan.plant else { return None };
    let law: &dyn Any = law;
    if let Some(law) = law.downcast_ref::<StandardObserver<f64, Fixed, AnyModel, 5, 1>>() {
        let (gain, AnyModel::Crackle(own)) = law.parts() else { return None };
        return continuous(law.typed::<_, _, 0>(gain, own), scheme, plant, plan, stop);
    }
    if let Some(law) = law.downcast_ref::<LowPower<f64, Fixed, AnyModel, AnySaturation<5>, 5, 1>>()
    {
        let (AnyModel::Crackle(own), saturation) = law.parts() else { return None };
        return match saturation {
            AnySaturation::None => {
                continuous(law.typed::<_, _, 0>(own, NoSaturation), scheme, plant, plan, stop)
            }
            AnySaturation::Hard(clip) => {
                continuous(law.typed::<_, _, 0>(own, clip), scheme, plant, plan, stop)
            }
            AnySaturation::Smooth(smooth) => {
                continuous(law.typed::<_, _, 0>(own, smooth), scheme, plant, plan, stop)
            }
        };
    }
    None
}

/// A study of the sampled-data observer.
pub fn sampled_data(
    observer: &SampledDataObserver<VanDerPol<f64>, 2>,
    plant: VanDerPol<f64>,
    plan: &Plan,
    stop: &StopFlag,
) -> Studied {
    sampled(*observer, plant, plan, stop, 2)
}

/// A study of the reduced-order observer.
pub fn reduced_order(
    observer: &ReducedOrderObserver<f64, Ship<f64>, 3, 3, 2>,
    plant: Ship<f64>,
    plan: &Plan,
    stop: &StopFlag,
) -> Studied {
    sampled(*observer, plant, plan, stop, 3)
}
