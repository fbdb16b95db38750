//! Floor 2. Coefficients of laws from poles, for sizes that are known at run time.

use crate::dispatch_order;
use crate::error::{Result, refused};
use crate::order::order_refused;
use hgo_rs::laws::{Law, Sizes};
use hgo_rs::observers::MAX_ORDER;
use hgo_rs::polynomial;

/// The lists of coefficients of a law, from poles by their real and imaginary parts; from the usual ones
/// where none are named.
pub fn of_law(law: &Law, sizes: &Sizes, poles: Option<&[(f64, f64)]>) -> Result<Vec<Vec<f64>>> {
    let Some(design) = law.design else {
        let lists: Vec<&str> = law.coefficients.iter().map(|list| list.name).collect();
        let lists = lists.join(" and ");
        return Err(refused(format!("the {} is not designed by poles: give {lists}", law.title)));
    };
    let mut placed = vec![(0.0, 0.0); (design.poles.len)(sizes)];
    match poles {
        None => (design.usual)(&mut placed),
        Some(given) if given.len() == placed.len() => placed.copy_from_slice(given),
        Some(given) => {
            return Err(refused(format!(
                "{} poles do not fit the {} of order {}, which has {}",
                given.len(),
                law.title,
                sizes.n,
                placed.len()
            )));
        }
    }
    let counts: Vec<usize> = law.coefficients.iter().map(|list| (list.len)(sizes)).collect();
    let mut values = vec![0.0; counts.iter().sum()];
    (design.place)(sizes, &placed, &mut values)?;
    let mut rest = values.into_iter();
    Ok(counts.iter().map(|count| rest.by_ref().take(*count).collect()).collect())
}

/// k₁ … kₙ of the standard law, from n poles by their real and imaginary parts.
pub fn coefficients_from_poles(poles: &[(f64, f64)]) -> Result<Vec<f64>> {
    if !(1..=MAX_ORDER).contains(&poles.len()) {
        return Err(order_refused(poles.len()));
    }
    let mut k = vec![0.0; poles.len()];
    polynomial::write_coefficients(poles, &mut k)?;
    Ok(k)
}

/// α (n) and β (n − 1) of a low-power law.
pub type AlphaBeta = (Vec<f64>, Vec<f64>);

/// α and β from the trailing coefficients of a Hurwitz polynomial of degree 2n − 1.
pub fn low_power_coefficients(coefficients: &[f64]) -> Result<AlphaBeta> {
    let order = coefficients.len().div_ceil(2);
    dispatch_order!(order, N => {
        let (alpha, beta) = polynomial::low_power_coefficients::<f64, N>(coefficients)?;
        Ok((alpha.to_vec(), beta.split_last().map_or_else(Vec::new, |(_, rest)| rest.to_vec())))
    }, else Err(order_refused(order)))
}

/// α and β from 2n − 1 poles by their real and imaginary parts.
pub fn low_power_coefficients_from_poles(poles: &[(f64, f64)]) -> Result<AlphaBeta> {
    let n = poles.len().div_ceil(2);
    if poles.len().is_multiple_of(2) || n > MAX_ORDER {
        return Err(refused(format!(
            "{} poles are not allowed: the low-power observer of order n needs 2n - 1 poles, \
             n = 1 to {MAX_ORDER}",
            poles.len()
        )));
    }
    let (mut alpha, mut beta) = (vec![0.0; n], vec![0.0; n]);
    polynomial::write_low_power_coefficients(poles, &mut alpha, &mut beta)?;
    beta.pop();
    Ok((alpha, beta))
}

/// Lower triangles, row by row, of the intensity Q and the first covariance P(0) of a Kalman filter of one
/// chain.
pub struct Covariances {
    /// Q.
    pub q: Vec<f64>,
    /// P(0).
    pub p0: Vec<f64>,
}

/// Q and P(0) of the high-gain EKF of order n with the gain θ. Each is given by its lower triangle, by its
/// diagonal, or, Q, by its last entry alone. r is the variance of a sample where the filter is `sampled`, else
/// an intensity.
///
/// Without P(0): a hundred times R in the first state, which is ten standard deviations of a sample, and in
/// the others what goes with it at the rate λ at which Q and R are of one size, λ = max (Qᵢᵢ/R)^(1/(2i − 1)),
/// or ^(1/2i): P(0)ᵢᵢ = 100 R (θλ)²⁽ⁱ⁻¹⁾, times λ where R is an intensity.
pub fn covariances(
    n: usize,
    sampled: bool,
    q: &[f64],
    r: f64,
    p0: Option<&[f64]>,
    theta: f64,
) -> Result<Covariances> {
    let q = lower("Q", n, q)?;
    let p0 = match p0 {
        Some([_]) if n > 1 => {
            return Err(refused(
                "P0 is not allowed: one number given; give its diagonal of n entries",
            ));
        }
        Some(p0) => lower("P0", n, p0)?,
        None => {
            let r = hgo_rs::error::positive("R", r)?;
            let rate = |i: usize| {
                let power = if sampled { 2 * i + 1 } else { 2 * i + 2 };
                let of = q.get(i * (i + 3) / 2).copied().unwrap_or(0.0) / r;
                of.powf(1.0 / power as f64)
            };
            let rate = (0..n).map(rate).fold(0.0, f64::max);
            if !(rate > 0.0 && rate.is_finite()) {
                return Err(refused(
                    "Q is not allowed: its diagonal must have a positive entry, or P0 be given",
                ));
            }
            let first = 100.0 * if sampled { r } else { r * rate };
            let power = |i: usize| (theta * rate).powf(2.0 * i as f64);
            let diagonal: Vec<f64> = (0..n).map(|i| first * power(i)).collect();
            lower("P0", n, &diagonal)?
        }
    };
    Ok(Covariances { q, p0 })
}

/// A lower triangle from itself, a diagonal, or a last entry.
fn lower(name: &str, n: usize, given: &[f64]) -> Result<Vec<f64>> {
    let packed = n * (n + 1) / 2;
    if given.len() == packed {
        return Ok(given.to_vec());
    }
    let first = match given.len() {
        1 => n.saturating_sub(1),
        count if count == n => 0,
        count => {
            return Err(refused(format!(
                "{name} is not allowed: {count} numbers given; give n = {n} numbers, its diagonal, or \
                 {packed}, its lower triangle row by row"
            )));
        }
    };
    let mut made = vec![0.0; packed];
    for (i, value) in (first..).zip(given) {
        if let Some(slot) = made.get_mut(i * (i + 3) / 2) {
            *slot = *value;
        }
    }
    Ok(made)
}
