//! Numbers have their bits, however blocks are cut; dates are counted by another calendar.

use hgo_logs::{Cells, Kind, Layout, Reader, Sign, Values, append, daytime, moment, number};
use proptest::prelude::*;

fn reader() -> Reader {
    let columns = vec![(0, Kind::Number), (1, Kind::Number)];
    Reader::new(Layout { delimiter: Some(b','), width: 2, columns, trailing: false }, 1)
}

fn bits(values: &Values) -> Vec<u64> {
    match values {
        Values::Numbers(values) => values.iter().map(|value| value.to_bits()).collect(),
        Values::Nanoseconds(_) => Vec::new(),
    }
}

proptest! {
    #[test]
    fn what_is_written_is_read_with_its_bits(
        a in prop::collection::vec(prop::num::f64::NORMAL | prop::num::f64::SUBNORMAL | prop::num::f64::ZERO, 1..40),
        cut in 1_usize..60,
        most in 1_usize..50,
    ) {
        let b: Vec<f64> = a.iter().rev().copied().collect();
        let mut text = Vec::new();
        append(&[Cells::Numbers(&a), Cells::Numbers(&b)], &mut text);
        let mut reader = reader();
        let (mut from, mut to) = (0, 0);
        let (mut first, mut second) = (Vec::new(), Vec::new());
        while from < text.len() || to < text.len() {
            let last = to == text.len();
            let rows = reader.read(&text[from..to], most, last).unwrap();
            first.extend(bits(&rows.columns[0].values));
            second.extend(bits(&rows.columns[1].values));
            from += rows.read;
            if rows.lines.is_empty() {
                prop_assert!(!last);
                to = (to + cut).min(text.len());
            }
        }
        prop_assert_eq!(first, a.iter().map(|v| v.to_bits()).collect::<Vec<_>>());
        prop_assert_eq!(second, b.iter().map(|v| v.to_bits()).collect::<Vec<_>>());
        prop_assert_eq!(reader.line(), a.len() as u64 + 1);
    }

    #[test]
    fn no_bytes_break_it(text in prop::collection::vec(prop::sample::select(b"01.,-e\"#N/A \n\r\0\xff".to_vec()), 0..80)) {
        let _ = reader().read(&text, usize::MAX, true);
        let _ = (moment(&text), daytime(&text), number(&text, &mut Sign::Unseen, true));
    }

    #[test]
    fn dates_are_days_apart(day in 0_i64..80_000) {
        // one day after the other, from 1970 on
        let (mut year, mut month, mut left) = (1970, 1, day);
        loop {
            let leap = year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
            let length = [31, if leap { 29 } else { 28 }, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31][month - 1];
            if left < length {
                break;
            }
            left -= length;
            (year, month) = if month == 12 { (year + 1, 1) } else { (year, month + 1) };
        }
        let text = format!("{year}-{month:02}-{:02}T00:00:01Z", left + 1);
        let stamp = moment(text.as_bytes()).unwrap();
        prop_assert_eq!(stamp, ((day * 86_400 + 1) * 1_000_000_000, Some(true)));
    }
}

#[test]
fn what_is_a_number_is_what_std_says() {
    for text in [
        "+1",
        "-.5",
        "1.",
        ".",
        "",
        "1e",
        "e5",
        "1e5",
        "+-1",
        "1e+5",
        "1E-400",
        "1e400",
        "inf",
        "-Infinity",
        "nan",
        "0x10",
        "1_0",
        " 1",
        "1 ",
        "1f",
        "1d5",
        "--1",
        "infin",
        "00012",
        "1e5.0",
        "4.9e-324",
        "9007199254740993",
        "179769313486231580793e289",
        "0.1000000000000000055511151231257827",
        "-0",
    ] {
        let found = number(text.as_bytes(), &mut Sign::Point, false).map(f64::to_bits);
        let wanted = if text.is_empty() { Some(f64::NAN) } else { text.parse().ok() };
        assert_eq!(found, wanted.map(f64::to_bits), "{text}");
    }
}

#[test]
fn a_decimal_sign_is_that_of_the_first_number() {
    let mut sign = Sign::Unseen;
    assert_eq!(number(b"7", &mut sign, true), Some(7.0));
    assert_eq!(number(b"2,5", &mut sign, true), Some(2.5));
    assert_eq!(number(b"2.5", &mut sign, true), None);
    assert_eq!(number(b"3", &mut sign, true), Some(3.0));
    assert_eq!(number(b"2,5", &mut Sign::Unseen, false), None);
}
