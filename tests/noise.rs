//! Laws of heavy tails.

use hgo_rs::noise::{Channel, Law, Stream};

/// Heavy tails: shares below quantiles that have a closed form, and as many numbers a draw.
#[test]
fn laws_of_heavy_tails() {
    const COUNT: usize = 200_000;
    let share = |law: Law, below: f64| {
        let mut stream = Stream::new(3, 1, Channel::Measurement);
        let count = (0..COUNT).filter(|_| law.draw(&mut stream) < below).count();
        count as f64 / COUNT as f64
    };
    // t of 1 degree is Cauchy's law, of 2: 1/2 + t/(2√(2 + t²))
    let cauchy = |t: f64| 0.5 + t.atan() / std::f64::consts::PI;
    let two = |t: f64| 0.5 + t / (2.0 * (2.0 + t * t).sqrt());
    let laplace = |t: f64| if t < 0.0 { 0.5 * t.exp() } else { 1.0 - 0.5 * (-t).exp() };
    for t in [-20.0, -3.0, -0.7, 0.0, 0.2, 1.5, 8.0] {
        let deviation = 4.0 * (0.25 / COUNT as f64).sqrt();
        assert!((share(Law::StudentT { nu: 1.0 }, t) - cauchy(t)).abs() < deviation, "{t}");
        assert!((share(Law::StudentT { nu: 2.0 }, t) - two(t)).abs() < deviation, "{t}");
        assert!((share(Law::Laplace, t) - laplace(t)).abs() < deviation, "{t}");
    }
    let impulsive = Law::Impulsive { probability: 0.25, ratio: 50.0 };
    let mut stream = Stream::new(3, 2, Channel::Measurement);
    let square = (0..COUNT).map(|_| impulsive.draw(&mut stream).powi(2)).sum::<f64>();
    assert!((square / COUNT as f64 / (1.0 + 0.25 * 2499.0) - 1.0).abs() < 0.03);
    // the farthest draw of the fewest degrees is a number: u = 0
    let farthest = Law::StudentT { nu: 0.5 }.draw(&mut Stream::from_state([0, 1 << 40, 0, 0]));
    assert!(farthest.is_finite() && farthest.abs() > 1e30, "{farthest}");
    for refused in [
        Law::StudentT { nu: 0.4 },
        Law::StudentT { nu: f64::NAN },
        Law::Impulsive { probability: 1.1, ratio: 1.0 },
        Law::Impulsive { probability: 0.1, ratio: -1.0 },
    ] {
        assert!(refused.checked().is_err(), "{refused:?}");
    }
}
