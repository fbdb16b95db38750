//! Floor 0. What one cell says.

/// A date or a time that is missing, as NumPy's NaT.
pub const MISSING: i64 = i64::MIN;

/// Words for a missing sample, in small letters.
const NONE: [&[u8]; 14] = [
    b"",
    b"nan",
    b"na",
    b"n/a",
    b"null",
    b"none",
    b"<na>",
    b"nat",
    b"#n/a",
    b"#na",
    b"#nv",
    b"1.#qnan",
    b"1.#ind",
    b"#n/a n/a",
];

/// The decimal sign of a log: the first one seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Sign {
    /// No number had one so far.
    #[default]
    Unseen,
    /// 1.5
    Point,
    /// 1,5: not where commas part the cells.
    Comma,
}

/// The number of a cell without blanks around it, NaN for a missing one; `None`: it holds none.
///
/// `sign` is what the cells before had; `commas` tells whether a comma may be a decimal sign.
pub fn number(cell: &[u8], sign: &mut Sign, commas: bool) -> Option<f64> {
    if let Some(value) = parsed(cell).filter(|_| *sign != Sign::Comma) {
        if *sign == Sign::Unseen && cell.contains(&b'.') {
            *sign = Sign::Point;
        }
        return Some(value);
    }
    if is_missing(cell) {
        return Some(f64::NAN);
    }
    if *sign == Sign::Point || !commas || cell.contains(&b'.') {
        return None;
    }
    let Some(at) = memchr::memchr(b',', cell) else { return parsed(cell) };
    let mut pointed = cell.to_vec();
    pointed[at] = b'.';
    let value = parsed(&pointed)?;
    *sign = Sign::Comma;
    Some(value)
}

/// A plain number, rounded correctly.
fn parsed(cell: &[u8]) -> Option<f64> {
    fast_float2::parse(cell).ok()
}

/// Whether a cell is empty or says that nothing was measured.
pub fn is_missing(cell: &[u8]) -> bool {
    if cell.len() > 12 {
        return false;
    }
    let word = cell.to_ascii_lowercase();
    let unsigned = word.strip_prefix(b"-").unwrap_or(&word);
    let is_nan = unsigned.starts_with(b"nan(") && unsigned.ends_with(b")");
    NONE.contains(&word.as_slice()) || (unsigned.len() > 3 && NONE.contains(&unsigned)) || is_nan
}

/// Nanoseconds from 1970 of a date, and whether it names its zone; [`MISSING`] for a missing one.
///
/// `2024-03-05T09:07:03.25+01:00`, `2024/03/05 09:07`, `05.03.2024 09:07:03,25`, `2024-03-05`.
pub fn moment(cell: &[u8]) -> Option<(i64, Option<bool>)> {
    if is_missing(cell) {
        return Some((MISSING, None));
    }
    let mut rest = Text(cell);
    let first = rest.digits()?;
    let by = rest.one_of(b"-/.")?;
    let month = rest.digits()?;
    rest.one_of(&[by])?;
    let last = rest.digits()?;
    let (year, day) = match (first.1, last.1, by) {
        (4, 1..=2, b'-' | b'/') => (first.0, last.0),
        (1..=2, 4, b'.') => (last.0, first.0),
        _ => return None,
    };
    let days = days_from_1970(year, month.0, day)?;
    let mut zoned = false;
    let mut seconds = 0;
    let mut nanoseconds = 0;
    if !rest.0.is_empty() {
        rest.one_of(b"T ")?;
        (seconds, nanoseconds) = rest.clock()?;
        if seconds >= 86_400 {
            return None;
        }
        if let Some(offset) = rest.zone() {
            zoned = true;
            seconds -= offset;
        }
    }
    let whole = days.checked_mul(86_400)?.checked_add(seconds)?;
    let stamp = whole.checked_mul(1_000_000_000)?.checked_add(nanoseconds)?;
    rest.0.is_empty().then_some((stamp, Some(zoned)))
}

/// Nanoseconds of a time of day or a duration; [`MISSING`] for a missing one.
///
/// `09:07:03.25`, `27:15`, `2 days 00:00:00.005`.
pub fn daytime(cell: &[u8]) -> Option<i64> {
    if is_missing(cell) {
        return Some(MISSING);
    }
    let mut rest = Text(cell);
    let back = rest.one_of(b"-").is_some();
    let mut days = 0;
    let mut ahead = Text(rest.0);
    if let Some((count, _)) = ahead.digits() {
        let word: &[u8] = if count == 1 { b" day " } else { b" days " };
        let found = ahead.0.strip_prefix(word).or_else(|| ahead.0.strip_prefix(b" days "));
        if let Some(after) = found {
            (days, rest) = (count, Text(after));
        }
    }
    let (seconds, nanoseconds) = rest.clock()?;
    let whole = days.checked_mul(86_400)?.checked_add(seconds)?;
    let span = whole.checked_mul(1_000_000_000)?.checked_add(nanoseconds)?;
    rest.0.is_empty().then_some(if back { -span } else { span })
}

/// Days from 1970-01-01 of a date of the Gregorian calendar; `None`: there is no such day.
fn days_from_1970(year: i64, month: i64, day: i64) -> Option<i64> {
    let leap = year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
    let length = match month {
        2 => 28 + i64::from(leap),
        4 | 6 | 9 | 11 => 30,
        1 | 3 | 5 | 7 | 8 | 10 | 12 => 31,
        _ => return None,
    };
    if !(1..=length).contains(&day) {
        return None;
    }
    // years begin in March, so that the day that may be missing is their last
    let from_march = (month + 9) % 12;
    let year = year - i64::from(month <= 2);
    let (era, of_era) = (year.div_euclid(400), year.rem_euclid(400));
    let of_year = (153 * from_march + 2) / 5 + day - 1;
    Some(era * 146_097 + of_era * 365 + of_era / 4 - of_era / 100 + of_year - 719_468)
}

/// What of a cell is still to be read.
struct Text<'a>(&'a [u8]);

impl Text<'_> {
    /// A whole number of at most nine digits, and how many it has.
    fn digits(&mut self) -> Option<(i64, usize)> {
        let count = self.0.iter().take_while(|c| c.is_ascii_digit()).count();
        if !(1..=9).contains(&count) {
            return None;
        }
        let (digits, rest) = self.0.split_at(count);
        self.0 = rest;
        Some((digits.iter().fold(0, |sum, c| 10 * sum + i64::from(c - b'0')), count))
    }

    fn one_of(&mut self, signs: &[u8]) -> Option<u8> {
        let (first, rest) = self.0.split_first()?;
        signs.contains(first).then(|| {
            self.0 = rest;
            *first
        })
    }

    /// Seconds and nanoseconds of `H:MM`, `H:MM:SS` or `H:MM:SS.f`.
    fn clock(&mut self) -> Option<(i64, i64)> {
        let (hours, _) = self.digits()?;
        self.one_of(b":")?;
        let minutes = self.sixtieth()?;
        let mut seconds = 0;
        let mut nanoseconds = 0;
        if self.one_of(b":").is_some() {
            seconds = self.sixtieth()?;
            if self.one_of(b".,").is_some() {
                let count = self.0.iter().take_while(|c| c.is_ascii_digit()).count();
                let (digits, rest) = self.0.split_at(count);
                self.0 = rest;
                let (held, beyond) = digits.split_at(count.min(9));
                if count == 0 || beyond.iter().any(|c| *c != b'0') {
                    return None;
                }
                let value = held.iter().fold(0, |sum, c| 10 * sum + i64::from(c - b'0'));
                nanoseconds = (held.len()..9).fold(value, |value, _| 10 * value);
            }
        }
        Some((hours * 3600 + minutes * 60 + seconds, nanoseconds))
    }

    /// Two digits below 60.
    fn sixtieth(&mut self) -> Option<i64> {
        self.digits().filter(|(value, count)| *count == 2 && *value < 60).map(|(value, _)| value)
    }

    /// Seconds of an offset from UTC; `None`: none is there.
    fn zone(&mut self) -> Option<i64> {
        let named = self.0.trim_ascii_start();
        if [b"Z".as_slice(), b"z", b"UTC", b"GMT"].contains(&named) {
            self.0 = b"";
            return Some(0);
        }
        let mut rest = Text(named);
        let back = rest.one_of(b"+-")? == b'-';
        let (value, count) = rest.digits()?;
        let offset = match (count, rest.one_of(b":")) {
            (2, None) => value * 3600,
            (4, None) if value % 100 < 60 => value / 100 * 3600 + value % 100 * 60,
            (2, Some(_)) => value * 3600 + rest.sixtieth()? * 60,
            _ => return None,
        };
        self.0 = rest.0;
        Some(if back { -offset } else { offset })
    }
}
