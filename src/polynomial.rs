//! Floor 0. Polynomials: from poles to coefficients and back to a stable design.
//!
//! A monic polynomial sⁿ + c₁sⁿ⁻¹ + … + cₙ is the slice [c₁, …, cₙ].

use crate::Scalar;
use crate::error::{DesignError, finite, require};
use crate::wide::Number;

/// Highest degree: 2n − 1 for the low-power observer of order 12.
const MAX_DEGREE: usize = 23;

/// A polynomial by ascending powers, c₀ + c₁s + … of a degree up to [`MAX_DEGREE`].
#[derive(Clone, Copy, Debug)]
struct Ascending<T> {
    c: [T; MAX_DEGREE + 1],
    degree: usize,
}

impl<T: Number> Ascending<T> {
    fn one() -> Self {
        let mut c = [T::ZERO; MAX_DEGREE + 1];
        c[0] = T::ONE;
        Self { c, degree: 0 }
    }

    /// From a monic polynomial's trailing coefficients; `None` above the highest degree.
    fn from_monic(coefficients: &[T]) -> Option<Self> {
        let degree = coefficients.len();
        let mut c = [T::ZERO; MAX_DEGREE + 1];
        *c.get_mut(degree)? = T::ONE;
        for (slot, value) in c.iter_mut().zip(coefficients.iter().rev()) {
            *slot = *value;
        }
        Some(Self { c, degree })
    }

    /// The coefficients below the leading one, from the highest power down.
    fn trailing(&self) -> impl Iterator<Item = T> {
        self.c.into_iter().take(self.degree).rev()
    }

    /// (s + a)·self; the degree saturates at the highest one.
    #[inline(never)]
    fn times_linear(&mut self, a: T) {
        self.degree = (self.degree + 1).min(MAX_DEGREE);
        let mut below = T::ZERO;
        for c in self.c.iter_mut().take(self.degree + 1) {
            (*c, below) = (below + a * *c, *c);
        }
    }

    /// self / (s + a), the remainder dropped, for a > 0.
    ///
    /// Composite deflation (Peters and Wilkinson): dividing from the top is stable for the small
    /// roots, from the bottom for the large ones; the two meet at the largest term |cⱼ| aʲ.
    fn without_linear(self, a: T) -> Self {
        let (mut joint, mut largest, mut power) = (0, T::ZERO, T::ONE);
        for (j, c) in self.c.iter().take(self.degree + 1).enumerate() {
            if c.abs() * power > largest {
                (joint, largest) = (j, c.abs() * power);
            }
            power = power * a;
        }
        let degree = self.degree.saturating_sub(1);
        let mut c = [T::ZERO; MAX_DEGREE + 1];
        let mut carry = T::ZERO;
        let above = self.c.iter().skip(1);
        for (slot, value) in c.iter_mut().zip(above).take(self.degree).skip(joint).rev() {
            carry = *value - a * carry;
            *slot = carry;
        }
        carry = T::ZERO;
        for (slot, value) in c.iter_mut().zip(self.c).take(joint.min(self.degree)) {
            carry = (value - carry) / a;
            *slot = carry;
        }
        Self { c, degree }
    }

    /// (self − self(0))/s.
    fn without_zero(self) -> Self {
        let mut c = [T::ZERO; MAX_DEGREE + 1];
        for (slot, value) in c.iter_mut().zip(self.c.iter().skip(1)) {
            *slot = *value;
        }
        Self { c, degree: self.degree.saturating_sub(1) }
    }

    fn at(&self, s: T) -> T {
        self.c.iter().take(self.degree + 1).rev().fold(T::ZERO, |value, c| value * s + *c)
    }

    /// self − a·other.
    fn less(mut self, a: T, other: &Self) -> Self {
        let terms = self.degree.max(other.degree) + 1;
        for (c, other) in self.c.iter_mut().zip(&other.c).take(terms) {
            *c = *c - a * *other;
        }
        self
    }

    /// The derivative.
    fn slope(&self) -> Self {
        let mut slope = self.without_zero();
        for (c, power) in slope.c.iter_mut().zip(1..=self.degree) {
            *c = *c * T::from_f64(power as f64);
        }
        slope
    }

    /// A real root of a monic polynomial of odd degree: the one to which Newton's method leads from `start`
    /// within 12 steps that stay between 0 and 2 `start`. A longer way would end at one root or another by
    /// rounding alone; where there is none, the leftmost one that a grid of `unit`/4 shows.
    fn real_root_near(&self, start: T, unit: T) -> T {
        let (slope, mut s, mut near) = (self.slope(), start, false);
        for round in 0..40 {
            let step = self.at(s) / slope.at(s);
            s = s - step;
            near = near || step.abs() <= T::from_f64(1e-6) * s.abs();
            let within = (s - start).abs() <= start.abs();
            if !near && (round == 11 || !within) {
                break;
            }
            if step.abs() <= T::from_f64(T::SETTLED) * s.abs() {
                break;
            }
        }
        if near {
            return s;
        }
        let mut low = -self.bound();
        for quarters in -64..=16 {
            let place = T::from_f64(0.25 * f64::from(quarters)) * unit;
            if self.at(place) >= T::ZERO {
                return self.root_between(low, place);
            }
            low = place;
        }
        self.root_between(low, self.bound())
    }

    /// Cauchy's: no root is larger.
    fn bound(&self) -> T {
        let mut bound = T::ONE;
        for c in self.c.iter().take(self.degree) {
            let least = T::ONE + c.abs();
            bound = if least > bound { least } else { bound };
        }
        bound
    }

    /// A real root of a monic polynomial of odd degree.
    fn real_root(&self) -> T {
        self.root_between(-self.bound(), self.bound())
    }

    /// A real root between two places, of a polynomial that is negative at the first one alone, by bisection.
    fn root_between(&self, mut low: T, mut high: T) -> T {
        let half = T::from_f64(0.5);
        for _ in 0..2200 {
            let middle = half * (low + high);
            if middle <= low || middle >= high {
                break;
            }
            if self.at(middle) < T::ZERO {
                low = middle;
            } else {
                high = middle;
            }
        }
        half * (low + high)
    }
}

/// Routh and Hurwitz: whether all roots of sⁿ + c₁sⁿ⁻¹ + … + cₙ have negative real parts; never
/// above degree 23.
#[inline(never)]
pub fn is_hurwitz<T: Scalar>(coefficients: &[T]) -> bool {
    let degree = coefficients.len();
    if degree > MAX_DEGREE {
        return false;
    }
    // Routh's array in place: at step i the entries from i on, every other one, are its rows.
    let mut row = [T::ONE; MAX_DEGREE + 1];
    for (slot, c) in row.iter_mut().skip(1).zip(coefficients) {
        *slot = *c;
    }
    for i in 0..degree {
        let (upper, lower) = (row[i], row[i + 1]);
        if lower <= T::ZERO || !lower.is_finite() {
            return false;
        }
        let factor = upper / lower;
        let mut j = i + 2;
        while j < degree {
            row[j] -= factor * row[j + 1];
            j += 2;
        }
    }
    true
}

/// Whether a forward Euler step of length c is stable for the polynomial of the trailing
/// `coefficients`: every root λ has |1 + cλ| < 1.
fn euler_is_stable<T: Scalar>(coefficients: &[T], c: f64) -> bool {
    // 1 + k₁v + … + kₙvⁿ with v = c(w − 1)/2, by Horner, then made monic
    let mut q = Ascending { c: [0.0; MAX_DEGREE + 1], degree: 0 };
    for k in coefficients.iter().rev() {
        q.c[0] += k.to_f64();
        q.times_linear(-1.0);
        for entry in &mut q.c {
            *entry *= 0.5 * c;
        }
    }
    q.c[0] += 1.0;
    let leading = q.c.get(q.degree).copied().unwrap_or(1.0);
    let mut trailing = [0.0; MAX_DEGREE];
    for (slot, value) in trailing.iter_mut().zip(q.trailing()) {
        *slot = value / leading;
    }
    trailing.get(..q.degree).is_some_and(is_hurwitz)
}

/// The stability limit of forward Euler: the c below which every 1 + cλ lies in the unit disc, λ the
/// roots of the Hurwitz polynomial sⁿ + c₁sⁿ⁻¹ + … + cₙ. A step dt under the gain ℓ is stable for
/// ℓ·dt < c. 0 where the polynomial is not Hurwitz or its degree is above 23.
///
/// z = 1 + cs and w = (z + 1)/(z − 1) turn the disc |z| < 1 into the half plane Re w < 0, so that
/// each trial of a bisection is a Routh test. A limit that roots of high multiplicity set is only
/// as good as these roots are in double precision: (s + 1)¹² gives 1.88, not 2. Stay below it.
pub fn euler_limit<T: Scalar>(coefficients: &[T]) -> T {
    let first = coefficients.first().map_or(0.0, |k| k.to_f64());
    if coefficients.is_empty() || !is_hurwitz(coefficients) {
        return T::ZERO;
    }
    // Re λ > −2/c for each of the n roots, whose sum is −k₁
    let (mut low, mut high) = (0.0, 2.0 * coefficients.len() as f64 / first);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if euler_is_stable(coefficients, middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    T::from_f64(low)
}

/// The same for current timing, where forward Euler predicts, and then corrects: of the trailing
/// coefficients p of a law (k₁, …, kₙ of the standard one) and d of what it is without a sample (none
/// for a chain of integrators), or 0.
///
/// For F − GC the two halves make (I + cF)(I − cGC): forward Euler's I + c(F − G′C) of the gains
/// G′ = (I + cF)G, with the polynomial p + c(s(p − d) − g₁d), g₁ = p₁ − d₁.
pub fn euler_current_limit<T: Scalar>(p: &[T], d: &[T]) -> T {
    let at = |q: &[T], i: usize| q.get(i).map_or(0.0, |c| c.to_f64());
    let stable = |c: f64| {
        let mut q = [0.0; MAX_DEGREE];
        for (i, entry) in q.iter_mut().enumerate().take(p.len()) {
            let moved = at(p, i + 1) - at(d, i + 1) - (at(p, 0) - at(d, 0)) * at(d, i);
            *entry = at(p, i) + c * moved;
        }
        q.get(..p.len()).is_some_and(|q| euler_is_stable(q, c))
    };
    // the first c that is not stable: it may lie beyond the limit of a step
    let (mut low, mut high) = (0.0, 1e-3 * euler_limit(p).to_f64());
    for _ in 0..500 {
        if !stable(high) {
            break;
        }
        (low, high) = (high, 1.03 * high);
    }
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if stable(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    T::from_f64(low)
}

/// Refuse coefficients whose polynomial is not Hurwitz.
///
/// # Errors
/// [`DesignError`] on `k`.
pub fn require_hurwitz<T: Scalar>(k: &[T]) -> Result<(), DesignError> {
    let first = k.first().copied().unwrap_or(T::ZERO);
    let allowed = "s^n + k_1 s^(n-1) + ... + k_n must have all roots in the left half plane";
    require("k", first, is_hurwitz(k), allowed).map(|_| ())
}

/// Turn the trailing coefficients of a monic polynomial of degree `degree` into those of itself times
/// s − root.
#[inline(always)]
pub(crate) fn times_root<T: Number>(trailing: &mut [(T, T)], degree: usize, (re, im): (T, T)) {
    let mut above = (T::ONE, T::ZERO);
    for c in trailing.iter_mut().take(degree + 1) {
        let old = *c;
        *c = (old.0 - (above.0 * re - above.1 * im), old.1 - (above.0 * im + above.1 * re));
        above = old;
    }
}

/// The roots of sⁿ + c₁sⁿ⁻¹ + … + cₙ, as many as there is room for; never above degree 23.
///
/// Laguerre's method from 0, so that small roots come first, and division by what was found. A
/// root of high multiplicity is only as good as the coefficients tell; their product is good.
pub fn roots(coefficients: &[f64], found: &mut [(f64, f64)]) {
    roots_of(coefficients, found);
}

/// The same over any numbers.
pub(crate) fn roots_of<T: Number>(coefficients: &[T], found: &mut [(T, T)]) {
    let mut quotient = [(T::ZERO, T::ZERO); MAX_DEGREE];
    for (slot, c) in quotient.iter_mut().zip(coefficients) {
        slot.0 = *c;
    }
    for (i, slot) in found.iter_mut().enumerate().take(coefficients.len()) {
        let Some(trailing) = quotient.get_mut(..coefficients.len() - i) else { return };
        *slot = laguerre(trailing);
        // forward division keeps the large roots, which are still to come
        let mut carry = (T::ONE, T::ZERO);
        for c in trailing {
            let (re, im) = times(carry, *slot);
            carry = (c.0 + re, c.1 + im);
            *c = carry;
        }
    }
}

fn times<T: Number>(a: (T, T), b: (T, T)) -> (T, T) {
    (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0)
}

fn over<T: Number>(a: (T, T), b: (T, T)) -> (T, T) {
    let square = b.0 * b.0 + b.1 * b.1;
    let (re, im) = times(a, (b.0, -b.1));
    (re / square, im / square)
}

fn size<T: Number>((re, im): (T, T)) -> T {
    (re * re + im * im).sqrt()
}

/// The root with a real part ≥ 0.
fn root_of<T: Number>(z: (T, T)) -> (T, T) {
    let (size, half) = (size(z), T::from_f64(0.5));
    let part = |square: T| half * if T::ZERO > square { T::ZERO } else { square };
    let re = part(size + z.0).sqrt();
    (re, part(size - z.0).sqrt().copysign(z.1))
}

/// A root of a monic polynomial.
fn laguerre<T: Number>(trailing: &[(T, T)]) -> (T, T) {
    let degree = T::from_f64(trailing.len() as f64);
    let mut s = (T::ZERO, T::ZERO);
    for _ in 0..80 {
        // p, its derivative and half its second one; what rounding makes of p
        let (mut p, mut slope, mut curve) =
            ((T::ONE, T::ZERO), (T::ZERO, T::ZERO), (T::ZERO, T::ZERO));
        let (mut noise, away) = (T::ONE, size(s));
        for c in trailing {
            let (a, b, d) = (times(curve, s), times(slope, s), times(p, s));
            curve = (a.0 + slope.0, a.1 + slope.1);
            slope = (b.0 + p.0, b.1 + p.1);
            p = (d.0 + c.0, d.1 + c.1);
            noise = noise * away + size(p);
        }
        if size(p) <= T::from_f64(2.0 * T::EPSILON) * noise {
            break;
        }
        let g = over(slope, p);
        let (g2, bend) = (times(g, g), over(curve, p));
        let two = T::from_f64(2.0);
        let h = (g2.0 - two * bend.0, g2.1 - two * bend.1);
        let spread = root_of((
            (degree - T::ONE) * (degree * h.0 - g2.0),
            (degree - T::ONE) * (degree * h.1 - g2.1),
        ));
        let (plus, minus) = ((g.0 + spread.0, g.1 + spread.1), (g.0 - spread.0, g.1 - spread.1));
        let largest = if size(minus) > size(plus) { minus } else { plus };
        if size(largest) == T::ZERO {
            break;
        }
        let step = over((degree, T::ZERO), largest);
        s = (s.0 - step.0, s.1 - step.1);
    }
    s
}

/// Coefficients [k₁ … kₙ] from N poles (real part, imaginary part).
///
/// # Errors
/// A pole that is not finite, has a real part ≥ 0, or lacks its complex conjugate.
pub fn coefficients_from_poles<T: Scalar, const N: usize>(
    poles: [(T, T); N],
) -> Result<[T; N], DesignError> {
    let mut product = [(T::ZERO, T::ZERO); N];
    times_poles(&poles, &mut product)?;
    Ok(product.map(|(re, _)| re))
}

/// The same, written into as many places as there are poles; at most 23.
///
/// # Errors
/// As [`coefficients_from_poles`]; more poles; another number of places.
pub fn write_coefficients<T: Scalar>(poles: &[(T, T)], out: &mut [T]) -> Result<(), DesignError> {
    let (count, allowed) = (poles.len(), "there must be one for each coefficient, and at most 23");
    let fits = count == out.len() && count <= MAX_DEGREE;
    require("number of poles", T::from_f64(count as f64), fits, allowed)?;
    let mut product = [(T::ZERO, T::ZERO); MAX_DEGREE];
    times_poles(poles, &mut product)?;
    for (slot, (re, _)) in out.iter_mut().zip(product) {
        *slot = re;
    }
    Ok(())
}

/// Trailing coefficients, complex, of the polynomial of these poles.
fn times_poles<T: Scalar>(poles: &[(T, T)], product: &mut [(T, T)]) -> Result<(), DesignError> {
    for (count, (re, im)) in poles.iter().enumerate() {
        finite("poles", *im)?;
        let allowed = "every pole must be finite and have a negative real part";
        require("poles", *re, re.is_finite() && *re < T::ZERO, allowed)?;
        let conjugate = |p: &&(T, T)| p.0 == *re && p.1 == *im;
        let mirrored = |p: &&(T, T)| p.0 == *re && p.1 == -*im;
        let (same, mirror) = (poles.iter().filter(conjugate), poles.iter().filter(mirrored));
        let paired = same.count() == mirror.count();
        let allowed = "a complex pole needs its complex conjugate among the poles";
        require("poles", *im, paired, allowed)?;
        times_root(product, count, (*re, *im));
    }
    Ok(())
}

/// Turn P₀ = 1 into P_m of the low-power recursion Pᵢ = s(s + αᵢ)Pᵢ₋₁ + β₁…βᵢ.
#[inline(never)]
fn low_power_inner<T: Number>(p: &mut Ascending<T>, alpha: &[T], beta: &[T]) {
    let mut product = T::ONE;
    for (a, b) in alpha.iter().zip(beta) {
        product = product * *b;
        p.times_linear(*a);
        p.times_linear(T::ZERO);
        p.c[0] = product;
    }
}

/// Characteristic polynomial of the matrix Mₙ of the low-power observer, Astolfi et al. (6):
/// (s + αₙ)Pₙ₋₁, written as its 2n − 1 trailing coefficients into `out`.
///
/// α has n entries, the first n − 1 of β count.
pub fn low_power_polynomial<T: Scalar>(alpha: &[T], beta: &[T], out: &mut [T]) {
    let Some((last, inner)) = alpha.split_last() else { return };
    let mut p = Ascending::one();
    low_power_inner(&mut p, inner, beta);
    p.times_linear(*last);
    for (slot, c) in out.iter_mut().zip(p.trailing()) {
        *slot = c;
    }
}

/// Characteristic polynomial of all blocks but the last, whose eigenvalue is −αₙ: Pₙ₋₁, written as its
/// 2n − 2 trailing coefficients into `out`.
pub(crate) fn low_power_inner_polynomial<T: Number>(alpha: &[T], beta: &[T], out: &mut [T]) {
    let mut p = Ascending::one();
    low_power_inner(&mut p, alpha, beta);
    for (slot, c) in out.iter_mut().zip(p.trailing()) {
        *slot = c;
    }
}

/// The low-power observer in discrete time: aᵢ/T and bᵢ/T of the blocks 1 … n−1 that step by T = `dt`,
/// from the 2n − 2 trailing coefficients of the polynomial of their eigenvalues in δ = (z − 1)/T;
/// aᵢ/T is sought near `near`.
///
/// Lemma 1 of Astolfi et al. with cₖ Mₖ(Tδ) in the place of cₖ = P(0): Σⱼ (jT)ᵏ/k! z⁻ʲ = Mₖ/(T δᵏ⁺¹) is what
/// an innovation of the k-th derivative makes of the prediction; M₀ = 1, and with w = z − 1
/// Mₖ₊₁ = (1 + w)(Mₖ − w Mₖ′/(k + 1)).
pub(crate) fn low_power_steps<T: Number, const N: usize>(
    polynomial: &[T],
    near: [T; N],
    dt: T,
) -> ([T; N], [T; N]) {
    let (mut a, mut b, mut c) = ([T::ZERO; N], [T::ZERO; N], [T::ONE; N]);
    let mut moved = [Ascending::one(); N]; // Mₖ(Tδ), by powers of δ
    for k in 1..N {
        let mut slope = moved[k - 1].slope();
        slope.times_linear(T::ZERO);
        moved[k] = moved[k - 1].less(T::ONE / T::from_f64(k as f64), &slope);
        let mut above = moved[k];
        above.times_linear(T::ZERO);
        moved[k] = moved[k].less(-dt, &above);
        moved[k].degree = k;
    }
    let Some(mut p) = Ascending::from_monic(polynomial) else { return (a, b) };
    for k in (1..N).rev() {
        c[k] = p.c[0];
        let odd = p.less(c[k], &moved[k]).without_zero();
        a[k - 1] = -odd.real_root_near(-near[k - 1], T::ONE / dt);
        p = odd.without_linear(a[k - 1]);
    }
    for k in 1..N {
        b[k - 1] = c[k] / c[k - 1];
    }
    (a, b)
}

/// Refuse low-power coefficients whose matrix Mₙ is not Hurwitz (Definition 1).
///
/// # Errors
/// [`DesignError`] on `alpha`.
pub fn require_low_power_hurwitz<T: Scalar>(alpha: &[T], beta: &[T]) -> Result<(), DesignError> {
    let allowed = "alpha and beta must make the matrix M_n Hurwitz (low-power stability)";
    let Some((last, inner)) = alpha.split_last() else { return Ok(()) };
    require("alpha", *last, *last > T::ZERO, allowed)?;
    let mut p = Ascending::one();
    low_power_inner(&mut p, inner, beta);
    let mut trailing = [T::ZERO; MAX_DEGREE];
    for (slot, c) in trailing.iter_mut().zip(p.trailing()) {
        *slot = c;
    }
    let stable = trailing.get(..p.degree).is_some_and(is_hurwitz);
    require("alpha", inner.first().copied().unwrap_or(*last), stable, allowed).map(|_| ())
}

/// α and β (the last β is 0) of the low-power observer from the Hurwitz polynomial of degree
/// 2N − 1 whose trailing coefficients are given (Astolfi et al., Lemma 1).
///
/// αₙ is minus a real root; P is what is left. For k = n−1 … 1: cₖ = P(0); (P − cₖ)/s has odd
/// degree and so a real root −αₖ; P becomes (P − cₖ)/(s(s + αₖ)); βₖ = cₖ/cₖ₋₁ with c₀ = 1.
///
/// # Errors
/// N outside 1 to 12; a number of coefficients other than 2N − 1; a polynomial not Hurwitz.
pub fn low_power_coefficients<T: Scalar, const N: usize>(
    polynomial: &[T],
) -> Result<([T; N], [T; N]), DesignError> {
    let degree = polynomial.len();
    let allowed = "the polynomial must have degree 2n - 1, n = 1 to 12";
    let fits = N >= 1 && degree == 2 * N - 1 && degree <= MAX_DEGREE;
    require("polynomial", T::from_f64(degree as f64), fits, allowed)?;
    require_hurwitz(polynomial)?;
    let Some(whole) = Ascending::from_monic(polynomial) else {
        return Err(DesignError { parameter: "polynomial", value: degree as f64, allowed });
    };
    let alpha_n = -whole.real_root();
    let (mut alpha, mut beta) = ([T::ZERO; N], [T::ZERO; N]);
    blocks_from(whole.without_linear(alpha_n), alpha_n, &mut alpha, &mut beta)?;
    Ok((alpha, beta))
}

/// α and β from 2N − 1 poles: the fastest real pole becomes −αₙ.
///
/// # Errors
/// As [`coefficients_from_poles`]; `R` must be 2N − 1.
pub fn low_power_coefficients_from_poles<T: Scalar, const N: usize, const R: usize>(
    poles: [(T, T); R],
) -> Result<([T; N], [T; N]), DesignError> {
    let (mut alpha, mut beta) = ([T::ZERO; N], [T::ZERO; N]);
    write_low_power_coefficients(&poles, &mut alpha, &mut beta)?;
    Ok((alpha, beta))
}

/// The same, written into n places for α and at least n − 1 for β.
///
/// # Errors
/// As [`coefficients_from_poles`]; another number of poles than 2n − 1; n outside 1 to 12.
pub fn write_low_power_coefficients<T: Scalar>(
    poles: &[(T, T)],
    alpha: &mut [T],
    beta: &mut [T],
) -> Result<(), DesignError> {
    let count = poles.len();
    let fits = count + 1 == 2 * alpha.len() && count <= MAX_DEGREE;
    let allowed = "the low-power observer of order n needs 2n - 1 poles, n = 1 to 12";
    require("poles", T::from_f64(count as f64), fits, allowed)?;
    let mut trailing = [T::ZERO; MAX_DEGREE];
    let whole = match trailing.get_mut(..count) {
        Some(trailing) => {
            write_coefficients(poles, trailing)?;
            Ascending::from_monic(trailing)
        }
        None => None,
    };
    let Some(whole) = whole else {
        return Err(DesignError { parameter: "poles", value: count as f64, allowed });
    };
    let mut fastest = T::ZERO;
    for (re, im) in poles {
        if *im == T::ZERO {
            fastest = fastest.min(*re);
        }
    }
    blocks_from(whole.without_linear(-fastest), -fastest, alpha, beta)
}

/// α and β of blocks of order two alone, as many as each has places, from twice as many poles.
///
/// # Errors
/// As [`coefficients_from_poles`]; another number of poles; more than 11 blocks.
pub fn write_block_coefficients<T: Scalar>(
    poles: &[(T, T)],
    alpha: &mut [T],
    beta: &mut [T],
) -> Result<(), DesignError> {
    let count = poles.len();
    let allowed = "the observer of limited gain power of order n needs 2n - 2 poles";
    let mut trailing = [T::ZERO; MAX_DEGREE];
    let whole = match trailing.get_mut(..count) {
        Some(trailing) if count == 2 * alpha.len() => {
            write_coefficients(poles, trailing)?;
            Ascending::from_monic(trailing)
        }
        _ => None,
    };
    let refused = DesignError { parameter: "poles", value: count as f64, allowed };
    inner_blocks_from(whole.ok_or(refused)?, alpha, beta)
}

fn blocks_from<T: Scalar>(
    p: Ascending<T>,
    alpha_n: T,
    alpha: &mut [T],
    beta: &mut [T],
) -> Result<(), DesignError> {
    let Some((last, inner)) = alpha.split_last_mut() else { return Ok(()) };
    *last = alpha_n;
    finite("poles", alpha_n)?;
    inner_blocks_from(p, inner, beta)
}

fn inner_blocks_from<T: Scalar>(
    mut p: Ascending<T>,
    inner: &mut [T],
    beta: &mut [T],
) -> Result<(), DesignError> {
    // βₖ = cₖ/cₖ₋₁: its place holds cₖ until cₖ₋₁ is known
    let mut above: Option<&mut T> = None;
    for (alpha, beta) in inner.iter_mut().zip(beta.iter_mut()).rev() {
        let c = p.c[0];
        let odd = p.without_zero();
        *alpha = -odd.real_root();
        p = odd.without_linear(*alpha);
        if let Some(above) = above {
            *above /= c;
        }
        *beta = c;
        above = Some(beta);
    }
    for entry in inner.iter().chain(beta.iter()) {
        finite("poles", *entry)?;
    }
    Ok(())
}
