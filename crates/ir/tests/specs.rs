//! Specs as plain data: what TOML says, what is read of it, and what is refused.

use hgo_ir::observer::build;
use hgo_ir::recursion::AnyObserver;
use hgo_ir::table::Table;
use hgo_ir::{Error, Function, Numbers, Spec, Value};
use hgo_rs::gain::ConstantGain;
use hgo_rs::injection::{Placed, Placement};
use hgo_rs::model::Unknown;
use hgo_rs::observer::{Current, Observer};
use hgo_rs::observers::StandardObserver;
use std::sync::Arc;

fn toml(text: &str) -> Value {
    Value::from_toml(text).unwrap()
}

fn refusal<T>(result: hgo_ir::Result<T>) -> String {
    match result {
        Err(Error::Refused(message)) => message,
        Err(other) => panic!("another error: {other}"),
        Ok(_) => panic!("nothing was refused"),
    }
}

/// φ = −sin x₁ as a table of the user's own.
const PENDULUM: &str = r#"
[model]
kind = "own"
form = "phase"
n = 2
n_u = 0
parameters = []

[model.table]
inputs = ["t", "x[0]", "x[1]"]
ops = [["sin", 1], ["neg", 3]]
outputs = [4]
output_names = ["phi"]
"#;

fn observer(manner: &str, model: &str) -> Box<dyn AnyObserver> {
    let gain = "[gain]\nlaw = \"constant\"\nell = 20.0\n";
    let head = "kind = \"standard\"\nn = 2\nk = [2.0, 1.0]\n";
    let value = toml(&[head, manner, gain, model].concat());
    build(&Spec::new(&value, "observer").unwrap()).unwrap()
}

#[test]
fn an_observer_from_toml_has_the_bits_of_the_cores_law() {
    let law: StandardObserver<f64, _, _, 2> =
        StandardObserver::new([2.0, 1.0], ConstantGain::new(20.0).unwrap(), Unknown).unwrap();
    let core = Current { law, scheme: Placed::new(&law, Placement::Exact).unwrap() };
    let made = observer("method = \"zoh\"\ntiming = \"current\"\n", "");
    assert_eq!((made.n(), made.n_y(), made.n_u(), made.is_current()), (2, 1, 0, true));
    let (mut z, mut memory) = (core.initial(), made.initial());
    for k in 0..200 {
        let (t, y) = (0.01 * f64::from(k), f64::from(k % 17) - 8.0);
        core.correct(&mut z, &y, t);
        core.advance(&mut z, &y, &nalgebra::SVector::zeros(), t, 0.01);
        made.recursion().correct(&mut memory, &[y], t).unwrap();
        made.recursion().advance(&mut memory, &[y], &[], t, 0.01).unwrap();
        assert_eq!(core.estimate(&z), &memory[..2], "sample {k}");
    }
}

#[test]
fn a_model_from_toml_is_stepped_over() {
    let made = observer("", PENDULUM); // euler, predictor
    let mut memory = vec![0.5, -0.25];
    made.recursion().advance(&mut memory, &[1.0], &[], 0.0, 0.001).unwrap();
    let (x, v, e) = (0.5_f64, -0.25, 0.5);
    let by_hand = [x + 0.001 * (v + 40.0 * e), v + 0.001 * (-x.sin() + 400.0 * e)];
    for (made, by_hand) in memory.iter().zip(by_hand) {
        assert!((made - by_hand).abs() < 1e-14, "{made} {by_hand}");
    }
}

#[test]
fn lists_are_read_as_arrays() {
    let value =
        toml("a = [1, 2.5]\nb = [[1, 2], [3, 4]]\nc = [[1], [2, 3]]\nd = []\ne = 7\nf = [1, [2]]");
    let spec = Spec::new(&value, "spec").unwrap();
    let read = |key: &str| spec.numbers(key).map(|numbers| (*numbers).clone());
    let array = |values: &[f64], shape: &[usize]| Numbers {
        values: values.to_vec(),
        shape: shape.to_vec(),
    };
    assert_eq!(read("a").unwrap(), array(&[1.0, 2.5], &[2]));
    assert_eq!(read("b").unwrap(), array(&[1.0, 2.0, 3.0, 4.0], &[2, 2]));
    assert_eq!(read("d").unwrap(), array(&[], &[0]));
    assert_eq!(read("e").unwrap(), array(&[7.0], &[1]));
    for (key, shown) in [("c", "[[1], [2, 3]]"), ("f", "[1, [2]]")] {
        let message = format!("spec[{key:?}] = {shown} is not an array of numbers");
        assert_eq!(refusal(read(key)), message);
    }
    // arrays within lists, and what is missing there
    let row = |values: &[f64]| Value::Numbers(Arc::new(array(values, &[values.len()])));
    let rows = Value::List(vec![row(&[1.0, 2.0]), row(&[3.0, 4.0])]);
    assert_eq!(*rows.as_numbers().unwrap(), array(&[1.0, 2.0, 3.0, 4.0], &[2, 2]));
    assert!(Value::List(vec![row(&[1.0, 2.0]), row(&[3.0])]).as_numbers().is_none());
    let gap = Value::List(vec![Value::Number(1.0), Value::Nothing]).as_numbers().unwrap();
    assert!(gap.values[1].is_nan() && gap.shape == [2]);
    assert_eq!(row(&[0.0, 3.0]).as_wholes(), Some(vec![0, 3]));
    assert_eq!(row(&[0.5]).as_wholes(), None);
}

#[test]
fn what_is_wrong_is_told_with_the_value_as_python_shows_it() {
    let value = toml(
        "text = \"it's\"\nsmall = 1e-05\nlarge = 1e16\nflag = true\nlist = [1, \"a\\n\", {b = 0.1}]",
    );
    let spec = Spec::new(&value, "observer").unwrap();
    for (key, shown) in [("text", r#""it's""#), ("list", r"[1, 'a\n', {'b': 0.1}]")] {
        let message = format!("observer[{key:?}] = {shown} is not a number");
        assert_eq!(refusal(spec.f64(key)), message);
    }
    for (key, shown) in [("small", "1e-05"), ("large", "1e+16"), ("flag", "True")] {
        let message = format!("observer[{key:?}] = {shown} is not a string");
        assert_eq!(refusal(spec.text(key)), message);
    }
    assert_eq!(refusal(spec.sub("text")), "text must be a dict, not str");
    assert_eq!(refusal(spec.f64("none")), "observer needs \"none\"");
    assert_eq!(refusal(spec.list("flag")), "observer[\"flag\"] = True is not a list of dicts");
    assert_eq!(
        refusal(spec.whole("small")),
        "observer[\"small\"] = 1e-05 is not a whole number >= 0"
    );
    let unknown = refusal(spec.only(&["text", "small", "large", "flag"]));
    assert_eq!(
        unknown,
        "observer has an unknown key \"list\"; known keys: text, small, large, flag"
    );
    let message = refusal(Value::from_toml("a = "));
    assert!(message.contains("line 1"), "{message}");
}

/// Gives its argument twice, or fails.
struct Twice;

impl Function for Twice {
    fn call(&self, arguments: &[f64]) -> hgo_ir::Result<Vec<f64>> {
        match arguments {
            [x] if *x > 0.0 => Ok(vec![*x, *x]),
            _ => Err(Error::Called(Arc::new(std::io::Error::other("no such argument")))),
        }
    }
}

#[test]
fn a_table_calls_functions_and_hands_their_errors_on() {
    let wholes = |of: &[i128]| Value::List(of.iter().map(|whole| Value::Whole(*whole)).collect());
    let text = |text: &str| Value::Text(text.to_owned());
    let call = vec![Value::Function(Arc::new(Twice)), wholes(&[0]), Value::Whole(2)];
    let sum = vec![text("add"), Value::Whole(1), Value::Whole(2)];
    let dict = |call: Vec<Value>, sum: Vec<Value>| {
        Value::Map(vec![
            ("inputs".to_owned(), Value::List(vec![text("x")])),
            ("calls".to_owned(), Value::List(vec![Value::List(call)])),
            ("ops".to_owned(), Value::List(vec![Value::List(sum)])),
            ("outputs".to_owned(), wholes(&[3])),
        ])
    };
    let value = dict(call.clone(), sum.clone());
    let table = Table::read(&Spec::new(&value, "table").unwrap()).unwrap();
    assert_eq!(table.evaluate(&[1.5]).unwrap(), [3.0]);
    let Err(Error::Called(error)) = table.evaluate(&[-1.0]) else { panic!("no error") };
    assert_eq!(error.downcast_ref::<std::io::Error>().unwrap().to_string(), "no such argument");
    // a function that gives another number of results, and rows that are none
    let three = vec![call[0].clone(), wholes(&[0]), Value::Whole(1)];
    let sum_of_one = vec![text("neg"), Value::Whole(1)];
    let mut value = dict(three, sum_of_one);
    if let Value::Map(entries) = &mut value {
        entries[3].1 = wholes(&[2]);
    }
    let table = Table::read(&Spec::new(&value, "table").unwrap()).unwrap();
    assert_eq!(refusal(table.evaluate(&[1.5])), "a function of the model gave 2 numbers");
    let late = vec![text("add"), Value::Whole(1), Value::Whole(3)];
    let message = refusal(Table::read(&Spec::new(&dict(call, late), "table").unwrap()));
    assert!(message.starts_with("table row ['add', 1, 3] is not allowed"), "{message}");
}

/// An observer of the core under [`Wrapped`] has the bits of the one that its spec describes, whose tables
/// are wrapped as a whole; so has its start from a first sample.
#[test]
fn a_wrapped_observer_of_the_core_has_the_bits_of_the_tables() {
    use hgo_rs::prelude::*;
    let text =
        "format = 1\nobserver = 'standard'\nk = [2.0, 1.0]\norder = 2\ngain = 20.0\nwrap = 7.25\n";
    let law: StandardObserver<f64, _, _, 2, 0> =
        StandardObserver::new([2.0, 1.0], ConstantGain::new(20.0).unwrap(), Unknown).unwrap();
    let (turn, dt) = (Turn::new(7.25).unwrap(), 0.01);
    let y = |k: i32| if k % 7 == 3 { f64::NAN } else { (0.31 * f64::from(k)).rem_euclid(7.25) };
    let bits = |z: &[f64]| z.iter().map(|z| z.to_bits()).collect::<Vec<u64>>();
    let current = Wrapped { observer: Current { law, scheme: Euler }, turn };
    let predictor = Wrapped { observer: Discretised { law, scheme: StaggeredEuler }, turn };
    let tabled = |manner: &str| {
        hgo_ir::config::Config::from_toml(&format!("{text}{manner}")).unwrap().observer().unwrap()
    };
    let (filter, table) =
        (tabled("method = 'euler'"), tabled("method = 'staggered-euler'\ntiming = 'predictor'"));
    let (mut z, mut ours) = (current.from_first(40.0), filter.initial());
    let (mut late, mut lates) = (predictor.from_first(40.0), table.initial());
    assert!(filter.begin(&mut ours, &[40.0]).unwrap() && table.begin(&mut lates, &[40.0]).unwrap());
    let mut turns = 0.0;
    for k in 0..400 {
        let mut flat = [0.0; 3];
        z.write(&mut flat);
        assert_eq!((bits(&flat), bits(&late.x_hat.as_slice()[..2])), (bits(&ours), bits(&lates)));
        let before = z.law.x_hat[0];
        current.correct(&mut z, &y(k), 0.0);
        filter.recursion().correct(&mut ours, &[y(k)], 0.0).unwrap();
        current.predict(&mut z, &no_input(), 0.0, dt);
        filter.recursion().advance(&mut ours, &[f64::NAN], &[], 0.0, dt).unwrap();
        predictor.step(&mut late, &y(k), &no_input(), 0.0, dt);
        table.recursion().advance(&mut lates, &[y(k)], &[], 0.0, dt).unwrap();
        turns += f64::from((before - z.law.x_hat[0]).abs() > 3.6);
    }
    assert!(turns > 15.0, "{turns}");
}
