//! `observer.toml` read in Rust: what it says, what it leaves open, and what is refused.

#[path = "../examples/observer_toml.rs"]
mod observer_toml;

use hgo_ir::config::Config;
use hgo_ir::{Error, Spec};
use hgo_rs::laws::{Gain, Sizes};
use hgo_rs::observers::LAWS;
use hgo_rs::polynomial::{coefficients_from_poles, low_power_coefficients_from_poles};

fn config(text: &str) -> Config {
    Config::from_toml(text).unwrap_or_else(|error| panic!("{error}\n{text}"))
}

fn refusal(text: &str) -> String {
    let made = Config::from_toml(text).and_then(|config| {
        config.observer()?;
        config.memory()
    });
    match made {
        Err(Error::Refused(message)) => message,
        Err(other) => panic!("another error: {other}"),
        Ok(_) => panic!("nothing was refused: {text}"),
    }
}

fn numbers(config: &Config, key: &str) -> Vec<f64> {
    Spec::new(config.spec(), "observer").unwrap().numbers(key).unwrap().values.clone()
}

fn word(config: &Config, key: &str) -> String {
    Spec::new(config.spec(), "observer").unwrap().text(key).unwrap()
}

#[test]
fn the_example_reads_a_model_steps_it_and_studies_it() {
    let text = "format = 1\nobserver = 'standard'\ngain = 20.0\n[model]\nstates = ['q', 'v']\n\
                parameters = { s = 9.81, d = 0.4 }\n[model.table]\ninputs = ['t', 'q', 'v', 's', 'd']\n\
                ops = [['sin', 1], ['mul', 3, 5], ['mul', 4, 2], ['add', 6, 7], ['neg', 8]]\n\
                outputs = [9]";
    let (estimates, errors) = observer_toml::run(text).unwrap();
    // position and velocity of the movement
    let t = 399.0 * 0.005 * std::f64::consts::PI;
    let [q, v] = [t.cos(), -std::f64::consts::PI * t.sin()];
    assert!((estimates[399][0] - q).abs() < 0.02, "{:?}", estimates[399]);
    assert!((estimates[399][1] - v).abs() < 0.4, "{:?}", estimates[399]);
    assert_eq!((errors.len(), errors[0].len()), (100, 2));
    // with the plant's own model the errors are due to the noise of 0.01 alone
    assert!(errors.iter().all(|run| run[0] < 0.01 && run[1] < 0.1), "{:?}", errors[0]);
    let unknown = text.split("[model]").next().unwrap().to_owned() + "order = 2";
    let (_, without) = observer_toml::run(&unknown).unwrap();
    assert!(without.iter().zip(&errors).all(|(without, with)| without[1] > 1.2 * with[1]));
}

/// Order and gain are enough for any law of one chain that is designed by poles, and Q and R for one whose gains
/// come from a covariance; its memory is the row's.
#[test]
fn a_file_names_any_law_of_the_list() {
    for law in LAWS.iter().filter(|law| law.gain == Gain::Any) {
        let filters = law.design.is_none();
        let also = match (law.saturated, filters) {
            (true, _) => "saturation = 2.0\n",
            (_, true) => "Q = 5.0\nR = 1e-4\n",
            _ => "",
        };
        let text = format!("observer = '{}'\norder = 3\ngain = 2.0\n{also}", law.kind);
        let config = config(&format!("format = 1\n{text}"));
        let m = law.size.map_or(0, |(_, values)| values[0]);
        let sizes = Sizes { n: 3, m, ..Sizes::default() };
        assert_eq!(config.memory().unwrap().len(), law.memory_len(&sizes) + 1, "{text}");
        for list in law.coefficients {
            assert_eq!(numbers(&config, list.name).len(), (list.len)(&sizes), "{text}");
        }
        let usual = if filters {
            "sampled"
        } else if law.placed() {
            "zoh"
        } else {
            "rk4"
        };
        assert_eq!(word(&config, "method"), usual, "{text}");
    }
}

/// Q by its last entry, its diagonal or its triangle; P(0) left out or given; theta.
#[test]
fn noises_of_a_filter() {
    let of = |more: &str| {
        config(&format!("format = 1\nobserver = 'high-gain-ekf'\norder = 2\nR = 1e-2\n{more}"))
    };
    for q in ["Q = 8e-5", "Q = [0.0, 8e-5]", "Q = [0.0, 0.0, 8e-5]"] {
        let open = of(q);
        assert_eq!(numbers(&open, "Q"), [0.0, 0.0, 8e-5], "{q}");
        // (8e-5/1e-2)^(1/3) = 0.2
        let p0 = numbers(&open, "P0");
        assert!((p0[0] - 1.0).abs() < 1e-12 && (p0[2] - 0.04).abs() < 1e-12, "{p0:?}");
    }
    let given = of("Q = 1.0\ntheta = 3.0\nP0 = [1.0, 2.0]\nmethod = 'rk4'");
    assert_eq!(numbers(&given, "P0"), [1.0, 0.0, 2.0]);
    assert_eq!(given.observer().unwrap().n(), 2);
    for (wrong, why) in [
        ("Q = [1.0, 2.0, 3.0, 4.0]", "4 numbers given"),
        ("Q = 0.0", "must have a positive entry"),
        ("Q = 1.0\nP0 = 1.0", "one number given"),
        ("Q = [1.0, 2.0, 1.0]", "positive semidefinite"),
        ("Q = 1.0\nP0 = [1.0, 0.0]", "P0"),
        ("Q = 1.0\ntheta = 0.5", "at least 1"),
        ("Q = 1.0\ntiming = 'predictor'", "at its own time"),
    ] {
        let text = format!("format = 1\nobserver = 'high-gain-ekf'\norder = 2\nR = 1e-2\n{wrong}");
        let message = refusal(&text);
        assert!(message.contains(why), "{wrong}: {message}");
    }
}

#[test]
fn what_a_file_leaves_open() {
    let standard = config("format = 1\nobserver = 'standard'\norder = 3\nepsilon = 0.125");
    let poles = [(-1.0, 0.0), (-1.5, 0.0), (-2.0, 0.0)];
    assert_eq!(numbers(&standard, "k"), coefficients_from_poles::<f64, 3>(poles).unwrap());
    assert_eq!(word(&standard, "method") + &word(&standard, "timing"), "zohcurrent");
    let gain = Spec::new(standard.spec(), "observer").unwrap().sub("gain").unwrap();
    assert_eq!(gain.f64("ell").unwrap().to_bits(), 8.0_f64.to_bits());
    assert_eq!(standard.memory().unwrap(), [0.0; 4]);
    assert_eq!(standard.time().unwrap(), None);

    let low = config("format = 1\nobserver = 'low-power'\norder = 2\ngain = 9.0");
    let poles = [(-1.0, 0.0), (-2.0, 0.0), (-2.0, 0.0)];
    let (alpha, beta) = low_power_coefficients_from_poles::<f64, 2, 3>(poles).unwrap();
    assert_eq!((numbers(&low, "alpha"), numbers(&low, "beta")), (alpha.to_vec(), vec![beta[0]]));
    assert_eq!(word(&low, "method"), "zoh");
    let law = "gain = { law = 'adaptive', p1 = 1.0, p2 = 1e-4, b = 0.2 }";
    let moving = config(&format!("format = 1\nobserver = 'low-power'\norder = 2\n{law}"));
    assert_eq!(word(&moving, "method"), "rk4");

    let clipped = "format = 1\nobserver = 'peaking-free'\norder = 4\ngain = 9.0\nsaturation = 2.5";
    assert_eq!(numbers(&config(clipped), "saturation"), [2.5; 3]);
    let copies = config(&format!(
        "format = 1\nobserver = 'modified'\nk = [2.0, 2.0]\nk_bar = [0.05, 0.03]\n{law}"
    ));
    assert_eq!(copies.observer().unwrap().n(), 2);
    assert_eq!(config("format = 1\nobserver = 'sampled-data'").observer().unwrap().n(), 2);
    let ship = config("format = 1\nobserver = 'reduced-order'\nepsilon = 0.1");
    assert_eq!(numbers(&ship, "h_bar"), [0.1, 0.2, 0.2]);
    assert_eq!(ship.observer().unwrap().n_y(), 3);
}

#[test]
fn poles_models_and_starts() {
    let of =
        |more: &str| config(&format!("format = 1\nobserver = 'standard'\ngain = 20.0\n{more}"));
    let poles = [(-1.0, 0.0), (-2.0, 1.0), (-2.0, -1.0)];
    let placed = of("order = 3\npoles = [-1, [-2.0, 1.0], [-2.0, -1.0]]");
    assert_eq!(numbers(&placed, "k"), coefficients_from_poles::<f64, 3>(poles).unwrap());
    // the order is the model's
    assert_eq!(of("[model]\nkind = 'crackle'\nphi_max = 2.0").observer().unwrap().n(), 5);
    assert_eq!(of("[model]\nkind = 'lee'").observer().unwrap().n(), 2);
    let driven = of("order = 3\n[model]\nkind = 'input'\nb0 = 2.0").observer().unwrap();
    assert_eq!((driven.n(), driven.n_u()), (3, 1));
    assert_eq!(of("order = 3\n[model]\nkind = 'unknown'").observer().unwrap().n_u(), 0);

    let adaptive = "format = 1\nobserver = 'low-power'\norder = 2\ntiming = 'predictor'\n\
                    gain = { law = 'dead-zone', p1 = 1.0, p2 = 1e-4, b = 0.2 }";
    let started = config(&format!("{adaptive}\n[start]\nx_hat = [1.0, 2.0]\nr = 3.0\nt = 0.5"));
    assert_eq!(started.memory().unwrap(), [1.0, 2.0, 0.0, 3.0]);
    assert_eq!(started.time().unwrap(), Some(0.5));
    let whole = config(&format!("{adaptive}\n[start]\nmemory = [1.0, 2.0, 0.5, 3.0]"));
    assert_eq!(whole.memory().unwrap(), [1.0, 2.0, 0.5, 3.0]);
    let log = of("order = 2\n[log]\ntime = 't'\noutput = 'q'");
    assert_eq!(Spec::new(log.log().unwrap(), "log").unwrap().text("output").unwrap(), "q");
}

#[test]
fn several_outputs_of_one_model() {
    let text = "format = 1\nobserver = 'chains'\n\
                [[observers]]\nobserver = 'standard'\norder = 2\ngain = 20.0\n\
                [[observers]]\nobserver = 'low-power'\norder = 2\ngain = 9.0\n\
                [model]\nstates = ['a', 'b', 'c', 'd']\norders = [2, 2]\n\
                table = { inputs = ['t', 'a', 'b', 'c', 'd'], ops = [['sub', 3, 1], ['neg', 5]], \
                outputs = [5, 6] }";
    let observer = config(text).observer().unwrap();
    assert_eq!((observer.n(), observer.n_y(), observer.n_u()), (4, 2, 0));
}

/// An unknown is a state more, the last of its chain; the table's last outputs are the slopes.
#[test]
fn an_unknown_is_a_state_of_the_observer() {
    let text = "format = 1\nobserver = 'standard'\ngain = 20.0\n[model]\nstates = ['q', 'v']\n\
                unknown = 'd'\nunits = { d = 'N m' }\ntable = { inputs = ['t', 'q', 'v', 'd'], \
                constants = [-1.0], ops = [['neg', 3]], outputs = [5, 4] }";
    assert_eq!(config(text).observer().unwrap().n(), 3);
    let two = text.replace("'d'\nunits", "['c', 'd']\nunits");
    assert!(refusal(&two).starts_with("model[\"unknown\"] has 2 names; it must have 1"));
    let form = text.replace("[model]", "[model]\nform = 'sampled'");
    assert!(refusal(&form).starts_with("unknown = [true] is not allowed"), "{}", refusal(&form));
    let chains = "format = 1\nobserver = 'chains'\n\
                  [[observers]]\nobserver = 'standard'\norder = 3\ngain = 20.0\n\
                  [[observers]]\nobserver = 'low-power'\norder = 3\ngain = 9.0\n\
                  [model]\nstates = ['a', 'b', 'c', 'd']\norders = [2, 2]\nunknown = ['e', 'f']\n\
                  table = { inputs = ['t', 'a', 'b', 'e', 'c', 'd', 'f'], constants = [1.0], \
                  ops = [['add', 3, 1], ['add', 6, 1]], outputs = [8, 9, 7, 7] }";
    assert_eq!(config(chains).observer().unwrap().n(), 6);
}

#[test]
fn what_is_refused() {
    let of = |more: &str| refusal(&format!("format = 1\nobserver = 'standard'\n{more}"));
    let starts = |message: String, start: &str| {
        assert!(message.starts_with(start), "{message}");
    };
    starts(refusal("format = 2\nobserver = 'standard'"), "format = 2 is not allowed");
    starts(refusal("observer = 'standard'"), "observer.toml needs \"format\"");
    starts(refusal("format = 1\nobserver = 'kalman'"), "observer.toml[\"observer\"] = \"kalman\"");
    starts(of("order = 2\ngian = 1.0"), "observer.toml has an unknown key \"gian\"");
    starts(of("order = 2\ngain = 1.0\ncopies = 3"), "observer.toml has an unknown key \"copies\"");
    starts(of("order = 2"), "gain: give either");
    starts(of("order = 2\ngain = 1.0\nepsilon = 1.0"), "gain: give either");
    starts(of("gain = 1.0"), "observer.toml needs \"order\"");
    starts(of("order = 2\ngain = -1.0"), "ell = -1");
    starts(
        of("order = 2\ngain = 1.0\nk = [1.0, 1.0]\npoles = [-1, -1]"),
        "k is not allowed beside",
    );
    starts(of("order = 2\ngain = 1.0\npoles = [-1]"), "1 poles do not fit");
    starts(of("order = 2\ngain = 1.0\npoles = [-1, 'a']"), "poles are not allowed");
    starts(of("order = 2\ngain = 1.0\nmethod = 'heun'"), "observer[\"method\"] = \"heun\"");
    starts(of("order = 2\ngain = 1.0\n[start]\nr = 2.0"), "start[\"r\"] is not allowed");
    starts(of("order = 2\ngain = 1.0\n[start]\nx = [2.0]"), "start has an unknown key \"x\"");
    starts(of("order = 2\ngain = 1.0\n[start]\nx_hat = [2.0]"), "start[\"x_hat\"] has 1 entries");
    starts(of("order = 2\ngain = 1.0\n[log]\ncolumn = 'a'"), "log has an unknown key \"column\"");
    let expression = "gain = 1.0\n[model]\nstates = ['q', 'v']\nphi = '-q'";
    starts(of(expression), "model[\"phi\"] is not read here: expressions are compiled in Python");
    starts(of("gain = 1.0\n[model]\nstate = ['q']"), "model has an unknown key \"state\"");
}

/// An output that wraps: a turn for the one output, in each of several observers, or one for each of
/// several outputs, of which nan does not wrap. The record has the bits of one in any other turn.
#[test]
fn a_file_says_how_an_output_wraps() {
    let head = "format = 1\nobserver = 'standard'\norder = 2\ngain = 20.0\n";
    let observer = config(&format!("{head}wrap = 64.0")).observer().unwrap();
    let plain = config(head).observer().unwrap();
    let (mut ours, mut whole) = (observer.initial(), plain.initial());
    for k in 0_u8..200 {
        let y = 3.0 * f64::from(k); // of whole numbers, so that no turn costs a digit
        observer.recursion().correct(&mut ours, &[y.rem_euclid(64.0)], 0.0).unwrap();
        plain.recursion().correct(&mut whole, &[y], 0.0).unwrap();
        assert!(ours[0].abs() <= 32.0, "{ours:?}");
        assert!(((whole[0] - ours[0]).rem_euclid(64.0) - 32.0).abs() > 31.9, "{ours:?} {whole:?}");
        assert!((whole[1] - ours[1]).abs() < 1e-9, "{ours:?} {whole:?}");
        observer.recursion().advance(&mut ours, &[f64::NAN], &[], 0.0, 0.01).unwrap();
        plain.recursion().advance(&mut whole, &[f64::NAN], &[], 0.0, 0.01).unwrap();
    }
    assert!(whole[0] > 9.0 * 64.0);
    let ship = "format = 1\nobserver = 'reduced-order'\nepsilon = 1.0\n";
    config(&format!("{ship}wrap = [nan, nan, 6.28]")).observer().unwrap();
    assert!(refusal(&format!("{ship}wrap = 6.28")).contains("it must have 3"));
    assert!(refusal(&format!("{head}wrap = 0.0")).contains("wrap = 0 is not allowed"));
    assert!(refusal(&format!("{head}wrap = inf")).contains("wrap = inf is not allowed"));
}
