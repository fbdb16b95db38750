//! The cases on this computer: one line each, `row <case>|<observer>|<n>|<scalar>|<digest>|<samples>`.

use cases::{Case, Digest, Plain, Visitor, run, visit_all};
use hgo_rs::Scalar;
use std::process::ExitCode;

struct Rows {
    refused: bool,
}

impl Visitor for Rows {
    fn visit<T: Scalar, C: Case<T>>(&mut self, scalar: &'static str) {
        match run::<T, C, Plain>() {
            Ok(Digest { hash, samples }) => {
                let (symbol, name, n) = (C::SYMBOL, C::NAME, C::N);
                println!("row {symbol}|{name}|{n}|{scalar}|{hash:016x}|{samples}");
            }
            Err(error) => {
                eprintln!("{}, {scalar}: {error}", C::NAME);
                self.refused = true;
            }
        }
    }
}

fn main() -> ExitCode {
    let mut rows = Rows { refused: false };
    visit_all(&mut rows);
    if rows.refused { ExitCode::FAILURE } else { ExitCode::SUCCESS }
}
