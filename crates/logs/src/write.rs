//! Floor 0. Columns as lines.

use std::io::Write;

/// A column to be written.
#[derive(Clone, Copy, Debug)]
pub enum Cells<'a> {
    /// Numbers: the shortest digits that read back as the same bits; NaN is an empty cell.
    Numbers(&'a [f64]),
    /// Whole numbers.
    Integers(&'a [i64]),
}

impl Cells<'_> {
    fn len(&self) -> usize {
        match self {
            Self::Numbers(values) => values.len(),
            Self::Integers(values) => values.len(),
        }
    }
}

/// Append a line for each row, cells between commas; as many rows as the shortest column has.
pub fn append(columns: &[Cells<'_>], out: &mut Vec<u8>) {
    let rows = columns.iter().map(Cells::len).min().unwrap_or(0);
    out.reserve(rows * columns.len() * 12);
    let mut buffer = zmij::Buffer::new();
    for row in 0..rows {
        for (i, column) in columns.iter().enumerate() {
            if i > 0 {
                out.push(b',');
            }
            match column {
                Cells::Numbers(values) if values[row].is_finite() => {
                    out.extend_from_slice(buffer.format_finite(values[row]).as_bytes());
                }
                Cells::Numbers(values) if values[row].is_nan() => {}
                Cells::Numbers(values) => {
                    out.extend_from_slice(if values[row] > 0.0 { b"inf" } else { b"-inf" });
                }
                // into a Vec nothing can fail
                Cells::Integers(values) => drop(write!(out, "{}", values[row])),
            }
        }
        out.push(b'\n');
    }
}
