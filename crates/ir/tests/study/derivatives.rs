//! Derivatives of tables, operation by operation, against central differences.

use hgo_ir::table::{Call, Table, operands};
use hgo_ir::{Error, Function};
use hgo_rs::program::Operation;
use std::sync::Arc;

/// Every operation of a table, with points at which it is smooth.
const SMOOTH: [(Operation, &[[f64; 3]]); 25] = [
    (Operation::Negate, &[[0.7, 0.0, 0.0]]),
    (Operation::Abs, &[[0.7, 0.0, 0.0], [-0.7, 0.0, 0.0]]),
    (Operation::Sign, &[[0.7, 0.0, 0.0], [-0.7, 0.0, 0.0]]),
    (Operation::Sqrt, &[[0.7, 0.0, 0.0]]),
    (Operation::Sin, &[[0.7, 0.0, 0.0], [-2.0, 0.0, 0.0]]),
    (Operation::Cos, &[[0.7, 0.0, 0.0], [-2.0, 0.0, 0.0]]),
    (Operation::Tan, &[[0.7, 0.0, 0.0], [2.0, 0.0, 0.0]]),
    (Operation::Atan, &[[0.7, 0.0, 0.0], [-2.0, 0.0, 0.0]]),
    (Operation::Exp, &[[0.7, 0.0, 0.0], [-2.0, 0.0, 0.0]]),
    (Operation::Ln, &[[0.7, 0.0, 0.0]]),
    (Operation::Tanh, &[[0.7, 0.0, 0.0], [-2.0, 0.0, 0.0]]),
    (Operation::Add, &[[0.7, -0.3, 0.0]]),
    (Operation::Subtract, &[[0.7, -0.3, 0.0]]),
    (Operation::Multiply, &[[0.7, -0.3, 0.0]]),
    (Operation::Divide, &[[0.7, -0.3, 0.0]]),
    (Operation::Min, &[[0.7, -0.3, 0.0], [-0.7, 0.3, 0.0]]),
    (Operation::Max, &[[0.7, -0.3, 0.0], [-0.7, 0.3, 0.0]]),
    (Operation::Power, &[[0.7, -0.3, 0.0], [2.0, 3.0, 0.0]]),
    (Operation::Atan2, &[[0.7, -0.3, 0.0], [-0.7, 0.3, 0.0], [-0.7, -0.3, 0.0]]),
    (Operation::CopySign, &[[0.7, -0.3, 0.0], [-0.7, 0.3, 0.0], [-0.7, -0.3, 0.0]]),
    (Operation::Less, &[[0.7, -0.3, 0.0], [-0.7, 0.3, 0.0]]),
    (Operation::LessEqual, &[[0.7, -0.3, 0.0], [-0.7, 0.3, 0.0]]),
    (Operation::Equal, &[[0.7, -0.3, 0.0]]),
    (Operation::Innovation, &[[0.7, -0.3, 0.0]]),
    (Operation::Select, &[[1.0, -0.3, 0.4], [0.7, 0.4, -0.3]]),
];

const DIRECTIONS: [[f64; 3]; 4] =
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.3, -0.8, 1.1]];

/// One operation of a, b and c, of which it takes as many as it needs; inside others, so that the slopes
/// of its operands are no numbers that are known.
fn table(operation: Operation) -> Table {
    let names = ["a", "b", "c"].map(str::to_owned).to_vec();
    // e^(a/2), then the operation of a, b and c, and the product of both
    let half = (Operation::Multiply, [0, 3, 0]);
    let exp = (Operation::Exp, [4, 0, 0]);
    let product = (Operation::Multiply, [5, 6, 0]);
    Table {
        inputs: names,
        constants: vec![0.5],
        operations: vec![half, exp, (operation, [0, 1, 2]), product],
        outputs: vec![6, 7],
        output_names: ["plain", "product"].map(str::to_owned).to_vec(),
        ..Table::default()
    }
}

fn along(at: &[f64], direction: &[f64], h: f64) -> Vec<f64> {
    at.iter().zip(direction).map(|(at, direction)| at + h * direction).collect()
}

/// The derivative of a table along a direction by central differences, of error O(h²).
fn by_differences(table: &Table, at: &[f64], direction: &[f64]) -> Vec<f64> {
    let h = 1e-5;
    let [after, before] = [h, -h].map(|h| table.evaluate(&along(at, direction, h)).unwrap());
    after.iter().zip(before).map(|(after, before)| (after - before) / (2.0 * h)).collect()
}

fn check(table: &Table, at: &[f64], direction: &[f64], what: &str) {
    let made = table.derivative().unwrap().evaluate(&[at, direction].concat()).unwrap();
    let expected = by_differences(table, at, direction);
    assert_eq!(made.len(), expected.len());
    for (made, expected) in made.iter().zip(&expected) {
        let close = (made - expected).abs() < 1e-8 * (1.0 + expected.abs());
        assert!(close, "{what} at {at:?} along {direction:?}: {made} and {expected}");
    }
}

#[test]
fn every_operation() {
    for (operation, points) in SMOOTH {
        let table = table(operation);
        for (at, direction) in points.iter().flat_map(|at| DIRECTIONS.map(|to| (at, to))) {
            // Select decides by its first operand: along it nothing changes
            let direction = if operation == Operation::Select && at[0] == 1.0 {
                [0.0, direction[1], direction[2]]
            } else {
                direction
            };
            check(&table, at, &direction, &format!("{operation:?}"));
        }
    }
    // where an operand of Select is 0, its third is chosen
    check(&table(Operation::Select), &[0.0, 0.4, -0.3], &[0.0, 0.3, 1.1], "Select");
}

#[test]
fn every_operation_twice() {
    for (operation, points) in SMOOTH {
        let first = table(operation).derivative().unwrap();
        for at in points {
            let point = [at.as_slice(), &[0.3, -0.8, 1.1]].concat();
            // (a, b, c) and their direction are the inputs of the first derivative
            let direction = [0.5, 0.2, -0.4, 0.1, 0.6, 0.3];
            let direction: Vec<f64> = if operation == Operation::Select {
                direction.iter().enumerate().map(|(i, d)| if i == 0 { 0.0 } else { *d }).collect()
            } else {
                direction.to_vec()
            };
            check(&first, &point, &direction, &format!("{operation:?}, twice"));
        }
    }
}

#[test]
fn all_operations_have_a_case() {
    let named: Vec<Operation> = SMOOTH.iter().map(|(operation, _)| *operation).collect();
    for operation in &named {
        assert_eq!(named.iter().filter(|other| *other == operation).count(), 1);
        assert!((1..=3).contains(&operands(*operation)));
        let one = Table { outputs: vec![6], ..table(*operation) };
        assert!(one.rows().is_ok(), "{operation:?} is no operation of a table");
    }
}

struct Twice;

impl Function for Twice {
    fn call(&self, arguments: &[f64]) -> hgo_ir::Result<Vec<f64>> {
        Ok(arguments.iter().map(|x| 2.0 * x).collect())
    }
}

#[test]
fn a_function_has_no_derivative() {
    let call = Call { function: Arc::new(Twice), arguments: vec![0], results: 1 };
    let table = Table {
        inputs: vec!["x".to_owned()],
        calls: vec![call],
        outputs: vec![1],
        output_names: vec!["y".to_owned()],
        ..Table::default()
    };
    let Err(Error::Refused(message)) = table.derivative() else { panic!("no refusal") };
    assert!(message.contains("choose euler-maruyama"), "{message}");
}
