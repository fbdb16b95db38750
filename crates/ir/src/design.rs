//! Floor 2. Coefficients of laws from poles, for orders that are known at run time.

use crate::dispatch_order;
use crate::error::{Result, refused};
use crate::order::order_refused;
use hgo_rs::observers::MAX_ORDER;
use hgo_rs::polynomial;

/// Poles by their real and imaginary parts, as many as an order has.
fn pairs<const N: usize>(poles: &[(f64, f64)]) -> [(f64, f64); N] {
    std::array::from_fn(|i| poles.get(i).copied().unwrap_or((0.0, 0.0)))
}

/// k₁ … kₙ of the standard law, from n poles by their real and imaginary parts.
pub fn coefficients_from_poles(poles: &[(f64, f64)]) -> Result<Vec<f64>> {
    dispatch_order!(poles.len(), N => {
        Ok(polynomial::coefficients_from_poles::<f64, N>(pairs(poles))?.to_vec())
    }, else Err(order_refused(poles.len())))
}

/// α (n) and β (n − 1) of a low-power law.
pub type AlphaBeta = (Vec<f64>, Vec<f64>);

fn without_last(alpha: &[f64], beta: &[f64]) -> AlphaBeta {
    (alpha.to_vec(), beta.split_last().map_or_else(Vec::new, |(_, rest)| rest.to_vec()))
}

/// α and β from the trailing coefficients of a Hurwitz polynomial of degree 2n − 1.
pub fn low_power_coefficients(coefficients: &[f64]) -> Result<AlphaBeta> {
    let order = coefficients.len().div_ceil(2);
    dispatch_order!(order, N => {
        let (alpha, beta) = polynomial::low_power_coefficients::<f64, N>(coefficients)?;
        Ok(without_last(&alpha, &beta))
    }, else Err(order_refused(order)))
}

/// α and β from 2n − 1 poles by their real and imaginary parts.
pub fn low_power_coefficients_from_poles(poles: &[(f64, f64)]) -> Result<AlphaBeta> {
    macro_rules! made {
        ($n:literal) => {{
            let made = polynomial::low_power_coefficients_from_poles::<f64, $n, { 2 * $n - 1 }>(
                pairs(poles),
            )?;
            Ok(without_last(&made.0, &made.1))
        }};
    }
    match poles.len() {
        1 => made!(1),
        3 => made!(2),
        5 => made!(3),
        7 => made!(4),
        9 => made!(5),
        11 => made!(6),
        13 => made!(7),
        15 => made!(8),
        17 => made!(9),
        19 => made!(10),
        21 => made!(11),
        23 => made!(12),
        other => Err(refused(format!(
            "{other} poles are not allowed: the low-power observer of order n needs 2n - 1 poles, \
             n = 1 to {MAX_ORDER}"
        ))),
    }
}
