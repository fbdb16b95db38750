//! Floor 4. Studies: which observer runs beside which plants.

use crate::errors::{Result, refused};
use crate::interrupt::StopFlag;
use crate::lanes;
use crate::plan::{NO_PLANT, Plan, SAMPLED_ONLY, StudyResult, joint_integrator, told_nothing};
use hgo_ir::systems::AnyPlant;
use hgo_rs::model::Plant;
use hgo_rs::models::{Ship, VanDerPol};
use hgo_rs::observer::{ContinuousLaw, Discretisation, Discretised};
use hgo_rs::observers::{ReducedOrderObserver, SampledDataObserver};
use nalgebra::{SVector, Vector2};

type Continuous<L> = Discretised<L, Discretisation>;

/// A SISO plant with a continuous law, sampled or joint.
fn with_plant<P, L>(
    observer: &Continuous<L>,
    plant: P,
    plan: &Plan,
    stop: &StopFlag,
) -> Result<StudyResult>
where
    P: Plant<f64, Output = f64, Input = SVector<f64, 0>> + Send + Sync,
    L: ContinuousLaw<f64, Input = SVector<f64, 1>> + Sync,
{
    let kept = plan.memory_len();
    if !plan.is_joint() {
        return plan.sampled(observer, plant, kept, stop);
    }
    let integrator = joint_integrator(observer.scheme)?;
    plan.execute(plant, kept, stop, |experiment, run, x0, z0, watch| {
        experiment.joint(&observer.law, told_nothing, integrator, run, x0, z0, watch)
    })
}

/// Laws of order 2 with the plants of order 2.
pub fn of_order_2<L>(o: &Continuous<L>, plan: &Plan, stop: &StopFlag) -> Result<StudyResult>
where
    L: ContinuousLaw<f64, Input = SVector<f64, 1>> + Sync + 'static,
{
    if let Some(studied) = lanes::order_2(&o.law, o.scheme, plan, stop) {
        return studied;
    }
    match plan.plant {
        AnyPlant::Lee(plant) => with_plant(o, plant, plan, stop),
        AnyPlant::SanfelicePraly(plant) => with_plant(o, plant, plan, stop),
        AnyPlant::VanDerPol(plant) => with_plant(o, plant, plan, stop),
        _ => Err(refused(NO_PLANT)),
    }
}

/// Collections with the plant that they are made for; with others they run as programs.
pub fn of_copies<L>(o: &Continuous<L>, plan: &Plan, stop: &StopFlag) -> Result<StudyResult>
where
    L: ContinuousLaw<f64, Input = SVector<f64, 1>> + Sync + 'static,
{
    match plan.plant {
        AnyPlant::SanfelicePraly(plant) => with_plant(o, plant, plan, stop),
        _ => Err(refused(NO_PLANT)),
    }
}

/// Laws of order 5 with the plant of order 5.
pub fn of_order_5<L>(o: &Continuous<L>, plan: &Plan, stop: &StopFlag) -> Result<StudyResult>
where
    L: ContinuousLaw<f64, Input = SVector<f64, 1>> + Sync + 'static,
{
    if let Some(studied) = lanes::order_5(&o.law, o.scheme, plan, stop) {
        return studied;
    }
    match plan.plant {
        AnyPlant::Crackle(plant) => with_plant(o, plant, plan, stop),
        _ => Err(refused(NO_PLANT)),
    }
}

pub fn of_sampled_data(
    observer: &SampledDataObserver<VanDerPol<f64>, 2>,
    plan: &Plan,
    stop: &StopFlag,
) -> Result<StudyResult> {
    let AnyPlant::VanDerPol(plant) = plan.plant else { return Err(refused(NO_PLANT)) };
    if plan.is_joint() {
        return Err(refused(SAMPLED_ONLY));
    }
    if let Some(studied) = lanes::sampled_data(observer, plant, plan, stop) {
        return studied;
    }
    plan.execute(plant, 2, stop, |experiment, run, x0, z0, watch| {
        experiment.sampled(observer, |u| *u, run, x0, z0, watch)
    })
}

pub fn of_reduced_order(
    observer: &ReducedOrderObserver<f64, Ship<f64>, 3, 3, 2>,
    plan: &Plan,
    stop: &StopFlag,
) -> Result<StudyResult> {
    let AnyPlant::Ship(plant) = plan.plant else { return Err(refused(NO_PLANT)) };
    if plan.is_joint() {
        return Err(refused(SAMPLED_ONLY));
    }
    if let Some(studied) = lanes::reduced_order(observer, plant, plan, stop) {
        return studied;
    }
    plan.execute(plant, 3, stop, |experiment, run, x0, z0, watch| {
        experiment.sampled(observer, |u: &Vector2<f64>| *u, run, x0, z0, watch)
    })
}
