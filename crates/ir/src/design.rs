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
