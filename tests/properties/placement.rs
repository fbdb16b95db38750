//! Placed eigenvalues: the characteristic polynomial of one step, computed from the step itself.

use hgo_rs::gain::ConstantGain;
use hgo_rs::injection::{Injected, Placed, Placement};
use hgo_rs::memory::Memory;
use hgo_rs::model::{Unknown, no_input};
use hgo_rs::observer::{ContinuousLaw, Discretised, Observer};
use hgo_rs::observers::{HardClip, LowPower, NoSaturation, StandardObserver};
use hgo_rs::polynomial::{coefficients_from_poles, low_power_coefficients_from_poles, roots};
use hgo_rs::{DesignError, Scalar};
use nalgebra::SVector;

const STEPS: [f64; 6] = [1e-3, 0.1, 1.0, 3.0, 10.0, 100.0];
const ELL: f64 = 7.0;

/// One step from each unit memory, y = 0, in coordinates scaled by `powers` of dt.
fn matrix<T, L>(law: L, at: Placement, dt: f64, powers: &[usize]) -> Vec<Vec<f64>>
where
    T: Scalar,
    L: Injected<T, Input = SVector<T, 0>>,
{
    let scheme = Placed::new(&law, at).unwrap();
    let observer = Discretised { law, scheme }.prepared(T::from_f64(dt));
    let len = L::State::LEN;
    let column = |j: usize| {
        let mut values = vec![T::ZERO; len];
        values[j] = T::ONE;
        let mut z = L::State::read(&values);
        observer.step(&mut z, &T::ZERO, &no_input(), T::ZERO, T::from_f64(dt));
        z.write(&mut values);
        let power = |i: usize| dt.powi(i32::try_from(powers[i]).unwrap());
        values.iter().enumerate().map(|(i, z)| z.to_f64() * power(i) / power(j)).collect()
    };
    (0..len).map(column).collect() // transposed, which changes no eigenvalue
}

/// By Faddeev and LeVerrier: the trailing coefficients of det(z − A).
fn characteristic(a: &[Vec<f64>]) -> Vec<f64> {
    let n = a.len();
    let (mut m, mut out) = (vec![vec![0.0; n]; n], Vec::new());
    let mut last = 1.0;
    for k in 1..=n {
        for (i, row) in m.iter_mut().enumerate() {
            row[i] += last;
        }
        let product: Vec<Vec<f64>> = (0..n)
            .map(|i| (0..n).map(|j| (0..n).map(|l| a[i][l] * m[l][j]).sum()).collect())
            .collect();
        last = -(0..n).map(|i| product[i][i]).sum::<f64>() / k as f64;
        m = product;
        out.push(last);
    }
    out
}

/// Trailing coefficients of Π(z − z(λ)).
fn wanted(poles: &[f64], at: Placement, dt: f64) -> Vec<f64> {
    let mut p = vec![1.0];
    for pole in poles {
        let h = pole * dt;
        let z = match at {
            Placement::Exact => h.exp(),
            Placement::Bilinear => (2.0 + h) / (2.0 - h),
            Placement::ImplicitMap => 1.0 / (1.0 - h),
        };
        let above = p.clone();
        p.push(0.0);
        for (slot, c) in p[1..].iter_mut().zip(above) {
            *slot -= z * c;
        }
    }
    p.split_off(1)
}

fn off(found: &[f64], wanted: &[f64]) -> f64 {
    let largest = wanted.iter().fold(1.0_f64, |largest, c| largest.max(c.abs()));
    found.iter().zip(wanted).fold(0.0, |off, (a, b)| (a - b).abs().max(off)) / largest
}

fn spread<const N: usize>() -> [f64; N] {
    core::array::from_fn(|i| -1.0 - i as f64 / (N as f64 - 1.0).max(1.0))
}

fn standard<T: Scalar, const N: usize>(tolerance: f64) {
    let poles = spread::<N>();
    let k = coefficients_from_poles(poles.map(|p| (T::from_f64(p), T::ZERO))).unwrap();
    let gain = ConstantGain::new(T::from_f64(ELL)).unwrap();
    let law = StandardObserver::<T, _, _, N>::new(k, gain, Unknown).unwrap();
    let powers: Vec<usize> = (0..N).collect();
    for at in [Placement::Exact, Placement::Bilinear, Placement::ImplicitMap] {
        for c in STEPS {
            if Placed::new(&law, at).is_err() {
                assert!(at == Placement::Bilinear && N > 6);
                continue;
            }
            let dt = c / ELL;
            let found = characteristic(&matrix::<T, _>(law, at, dt, &powers));
            let off = off(&found, &wanted(&poles.map(|p| p * ELL), at, dt));
            assert!(off < tolerance, "n = {N}, c = {c}, {at:?}: off by {off:e}");
        }
    }
}

#[test]
fn the_standard_law_has_the_eigenvalues_asked_for() {
    standard::<f64, 1>(1e-14);
    standard::<f64, 2>(1e-14);
    standard::<f64, 3>(1e-13);
    standard::<f64, 5>(1e-12);
    standard::<f64, 8>(1e-9);
    standard::<f64, 12>(1e-6);
    standard::<f32, 1>(1e-6);
    standard::<f32, 2>(1e-6);
    standard::<f32, 3>(1e-5);
    standard::<f32, 5>(1e-4);
}

fn low_power<const N: usize, const R: usize>(tolerance: f64) {
    let mut poles = [-2.0; R];
    for (i, pole) in poles.iter_mut().enumerate().take(R - 1) {
        *pole = -1.0 - i as f64 / (R as f64 - 2.0).max(1.0);
    }
    let (alpha, beta) =
        low_power_coefficients_from_poles::<f64, N, R>(poles.map(|p| (p, 0.0))).unwrap();
    let gain = ConstantGain::new(ELL).unwrap();
    let law = LowPower::<f64, _, _, _, N>::new(alpha, beta, gain, Unknown, NoSaturation).unwrap();
    let powers: Vec<usize> = (0..N).chain(1..N).collect();
    for at in [Placement::Exact, Placement::Bilinear, Placement::ImplicitMap] {
        for c in STEPS {
            if Placed::new(&law, at).is_err() {
                assert!(at != Placement::Exact && N > 4);
                continue;
            }
            let dt = c / ELL;
            let found = characteristic(&matrix::<f64, _>(law, at, dt, &powers));
            let off = off(&found, &wanted(&poles.map(|p| p * ELL), at, dt));
            assert!(off < tolerance, "n = {N}, c = {c}, {at:?}: off by {off:e}");
        }
    }
}

#[test]
fn the_low_power_law_has_them_too() {
    low_power::<2, 3>(1e-13);
    low_power::<3, 5>(1e-11);
    low_power::<4, 7>(1e-9);
    low_power::<5, 9>(1e-7);
    low_power::<6, 11>(1e-5);
}

/// Gains of the low-power law at ℓ = 1 by 60-digit arithmetic (mpmath): α, β; then T, a, b.
type Precise<const N: usize, const C: usize> = ([f64; N], [f64; N], [(f64, [f64; N], [f64; N]); C]);

#[rustfmt::skip]
const OF_7: Precise<7, 3> = (
    [2.999_999_999_999_959, 2.999_999_999_999_894_3, 2.999_999_999_999_93, 3.000_000_000_000_212_3, 3.000_000_000_000_478, 2.999_999_999_999_527_5, 2.0],
    [12.909_090_909_090_851, 5.377_022_465_370_596_5, 2.866_792_116_753_637, 1.612_027_749_568_949_7, 0.859_455_039_195_317_4, 0.357_982_626_479_159_24, 0.0],
    [
        (0.001, [0.002_992_821_106_503_041_7, 0.002_995_326_849_985_584, 0.002_995_952_378_016_368_7, 0.002_996_202_215_688_58, 0.002_996_326_781_255_814, 0.002_996_397_643_601_944, 0.001_998_001_332_666_933],
            [0.012_889_749_017_829_41, 0.005_368_964_686_955_259_5, 0.002_862_495_524_693_408, 0.001_609_611_639_841_601_3, 0.000_858_166_866_849_717_8, 0.000_357_446_069_262_264_25, 0.0]),
        (1.0, [-0.557_456_764_469_698_2, 0.711_642_321_340_937_7, 0.886_291_588_028_969_3, 0.947_641_582_390_791_1, 0.979_409_307_831_538, 0.999_723_368_422_861_9, 0.864_664_716_763_387_3],
            [5.221_394_041_411_686, 1.600_853_694_871_602_8, 0.736_015_917_467_310_5, 0.386_888_495_392_839_8, 0.198_921_649_388_006_66, 0.081_141_613_142_485_94, 0.0]),
        (10.0, [1.896_272_912_404_724_8, 5.129_281_496_402_186, 0.986_279_082_573_036_9, 1.915_272_920_779_015_3, 1.029_880_369_075_542_7, 1.0, 0.999_999_997_938_846_4],
            [0.004_293_718_734_115_149, 57.493_315_373_115_735, 0.085_739_923_521_651_97, 0.125_385_471_322_141_9, 0.032_026_430_436_003_48, 0.011_764_600_646_083_23, 0.0]),
    ],
);

#[rustfmt::skip]
const OF_12: Precise<12, 3> = (
    [2.999_999_999_999_990_2, 3.000_000_000_000_147_4, 3.000_000_000_004_438_2, 3.000_000_000_084_619_4, 3.000_000_000_782_743_6, 3.000_000_004_260_314, 3.000_000_015_586_795, 3.000_000_040_567_086_6, 3.000_000_072_144_290_5, 3.000_000_054_053_708, 2.999_999_812_515_870_4, 2.0],
    [23.746_031_746_031_704, 10.792_116_846_738_779, 6.474_344_689_753_226, 4.315_609_462_859_131, 3.020_490_011_143_801, 2.157_179_289_851_409_3, 1.540_617_143_120_845_7, 1.078_273_496_635_127_7, 0.718_742_752_449_877_1, 0.431_181_548_604_487_93, 0.195_962_300_061_934_96, 0.0],
    [
        (0.001, [0.002_990_118_772_394_409_2, 0.002_994_428_912_767_554_6, 0.002_995_505_499_790_686_6, 0.002_995_936_053_737_482, 0.002_996_151_203_084_801, 0.002_996_274_024_106_573_2, 0.002_996_350_682_054_499_7, 0.002_996_401_700_386_879_7, 0.002_996_437_331_692_161_4, 0.002_996_463_116_731_865_5, 0.002_996_482_148_284_142, 0.001_998_001_332_666_933],
            [0.023_710_461_885_542_48, 0.010_775_946_826_144_363, 0.006_464_641_876_050_598_5, 0.004_309_141_413_411_126, 0.003_015_962_904_050_502, 0.002_153_946_066_592_406_4, 0.001_538_308_017_189_200_3, 0.001_076_657_338_147_126, 0.000_717_665_469_233_627_2, 0.000_430_535_273_394_962_77, 0.000_195_668_582_261_605_87, 0.0]),
        (1.0, [2.728_117_202_971_973, 6.112_039_390_789_774, 0.863_855_846_148_078_3, 1.798_679_922_288_961, 1.002_368_414_763_218, 0.917_441_594_908_530_5, 0.944_478_187_089_885_8, 0.964_108_049_353_526_5, 0.978_927_699_982_818_7, 0.990_540_713_055_852_6, 0.999_937_555_692_603_9, 0.864_664_716_763_387_3],
            [-1.436_452_015_285_006_9, -27.465_316_897_449_195, 1.106_117_978_590_417_2, 2.153_822_664_145_192, 0.870_918_669_698_666_8, 0.521_068_305_041_986_2, 0.361_508_538_333_168_6, 0.247_996_142_502_464_6, 0.162_911_555_186_814_44, 0.096_669_343_011_058_38, 0.043_568_978_777_213_37, 0.0]),
        (10.0, [12.051_652_850_173_559, 15.710_234_267_626_11, 1.968_167_648_098_652_5, 1.267_452_463_783_831_1, 0.705_995_946_595_057_7, 1.128_378_612_802_052_8, 1.010_163_770_561_802, 0.995_107_558_537_429_3, 1.593_476_055_128_587_1, 1.000_534_218_049_72, 1.0, 0.999_999_997_938_846_4],
            [-1.643_128_322_260_724_5, -1.768_931_360_229_201_2, 0.039_188_935_192_844_71, 1.206_333_755_593_362_9, 0.098_447_115_703_709_34, 0.093_804_171_937_498_22, 0.063_353_366_707_042_61, 0.034_616_875_171_619_8, 0.040_040_687_721_612_206, 0.014_357_325_482_945_884, 0.006_249_953_189_957_419, 0.0]),
    ],
);

/// aᵢ and bᵢ from two corrections of e = 1 in every block: one shows small aᵢ, one small bᵢ.
fn gains_are<const N: usize, const C: usize>((alpha, beta, cases): Precise<N, C>) {
    let gain = ConstantGain::new(1.0).unwrap();
    let law = LowPower::<f64, _, _, _, N>::new(alpha, beta, gain, Unknown, NoSaturation).unwrap();
    let poles = law.poles(Placement::Exact).unwrap();
    for (dt, a, b) in cases {
        let gains = law.gains(Placement::Exact, &poles, &law.initial(), &0.0, dt);
        let mut z = law.initial();
        z.eta.fill(1.0); // e_i = eta_(i-1)
        let moved = law.inject(&z, &1.0, &gains, dt);
        let compare = |name: &str, found: &[f64], wanted: &[f64]| {
            for (i, (found, wanted)) in found.iter().zip(wanted).enumerate() {
                let near = (found / wanted - 1.0).abs() < 1e-12;
                assert!(near, "n = {N}, T = {dt}, {name}_{}: {found}, {wanted}", i + 1);
            }
        };
        compare("a", moved.x_hat.as_slice(), &a);
        z.eta.fill(0.0);
        z.x_hat.fill(-1.0); // e_i = -x_hat_i
        let moved = law.inject(&z, &1.0, &gains, dt);
        compare("b", &moved.eta.as_slice()[..N - 1], &b[..N - 1]);
    }
}

#[test]
fn gains_of_high_orders_are_those_of_sixty_digits() {
    gains_are(OF_7);
    gains_are(OF_12);
}

/// From far away the law stays bounded at any step, and comes back up to `returns` = ell dt.
fn bounded<const N: usize>(
    alpha: [f64; N],
    beta: [f64; N],
    returns: f64,
) -> Result<(), DesignError> {
    let gain = ConstantGain::new(ELL)?;
    let clip = HardClip::new([2.0; N])?;
    let law = LowPower::<f64, _, _, _, N>::new(alpha, beta, gain, Unknown, clip)?;
    for c in STEPS {
        let dt = c / ELL;
        let scheme = Placed::new(&law, Placement::Exact)?;
        let observer = Discretised { law, scheme }.prepared(dt);
        let mut z = observer.initial();
        z.x_hat.fill(1e6);
        z.eta.fill(-1e7);
        let steps = 200.0 + 100.0 / c.min(1.0);
        let mut k = 0.0;
        while k < steps {
            observer.step(&mut z, &0.0, &no_input(), k * dt, dt);
            k += 1.0;
        }
        // in units of the levels, 2/dt^i
        let far = if c > returns { 1e3 * (1.0 + dt.powf(1.0 - N as f64)) } else { 1e-3 };
        assert!(z.within(far), "n = {N}, c = {c}: {z:?}");
    }
    Ok(())
}

#[test]
fn saturations_leave_it_stable() {
    let find = |poles: [(f64, f64); 7]| low_power_coefficients_from_poles::<f64, 4, 7>(poles);
    let (alpha, beta) = find([1.0, 1.2, 1.4, 1.6, 1.8, 2.0, 2.0].map(|p| (-p, 0.0))).unwrap();
    bounded(alpha, beta, 2.0).unwrap();
    bounded(crate::catalogue::ALPHA, crate::catalogue::BETA, 1.0).unwrap();
}

#[test]
fn roots_give_their_polynomial_back() {
    let poles: [(f64, f64); 23] = spread::<23>().map(|p| (p, 0.0));
    let trailing: [f64; 23] = coefficients_from_poles(poles).unwrap();
    let mut found = [(0.0, 0.0); 23];
    roots(&trailing, &mut found);
    let mut product = vec![(1.0, 0.0)];
    for (re, im) in found {
        let above = product.clone();
        product.push((0.0, 0.0));
        for (slot, c) in product[1..].iter_mut().zip(above) {
            slot.0 -= c.0 * re - c.1 * im;
            slot.1 -= c.0 * im + c.1 * re;
        }
    }
    for (found, wanted) in product[1..].iter().zip(trailing) {
        assert!((found.0 / wanted - 1.0).abs() < 1e-9, "{found:?} {wanted}");
        assert!((found.1 / wanted).abs() < 1e-9, "{found:?} {wanted}");
    }
}
