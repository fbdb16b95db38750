//! Floor 1. Blocks of lines as columns.

use crate::cells::{Sign, daytime, is_missing, moment, number};
use memchr::{memchr, memchr_iter};

/// Whole numbers from here on are not all numbers of f64.
const EXACT: f64 = 9_007_199_254_740_992.0;

/// Bytes of the longest line that is read: a log has a line for each sample.
pub const LINE: usize = 1 << 20;

/// What the cells of a column hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Numbers.
    Number,
    /// Dates.
    Moment,
    /// Times of day, or durations.
    Daytime,
}

/// How lines are made of cells, and which of these are wanted.
#[derive(Clone, Debug)]
pub struct Layout {
    /// What parts the cells; `None`: blanks.
    pub delimiter: Option<u8>,
    /// Cells of a line.
    pub width: usize,
    /// The wanted cells: place in the line, and what they hold.
    pub columns: Vec<(usize, Kind)>,
    /// Whether every line ends with a delimiter behind its last cell.
    pub trailing: bool,
}

/// Values of a column.
#[derive(Clone, Debug, PartialEq)]
pub enum Values {
    /// Numbers, NaN where missing.
    Numbers(Vec<f64>),
    /// Nanoseconds, [`MISSING`](crate::MISSING) where missing.
    Nanoseconds(Vec<i64>),
}

/// A column of a block, and the whole numbers in it that f64 would round: row and value.
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// A value for each row.
    pub values: Values,
    /// Rows of large whole numbers.
    pub large_rows: Vec<u64>,
    /// Large whole numbers, exactly.
    pub large: Vec<i64>,
}

/// The wanted columns of some lines.
#[derive(Clone, Debug, PartialEq)]
pub struct Rows {
    /// In the layout's order.
    pub columns: Vec<Column>,
    /// The line on which each row begins.
    pub lines: Vec<u64>,
    /// Bytes that were read; the rest belongs to a line that does not end in the block.
    pub read: usize,
}

/// A line that cannot be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// Counted from 1.
    pub line: u64,
    /// What is wrong.
    pub what: What,
    /// The line itself.
    pub text: Vec<u8>,
}

/// What is wrong with a line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum What {
    /// It has so many cells.
    Cells(usize),
    /// The cell of this wanted column holds something else.
    Cell(usize, Vec<u8>),
    /// A date of this wanted column names a zone and others do not, or the other way round.
    Zone(usize, Vec<u8>),
    /// It has more than [`LINE`] bytes.
    Long,
    /// A quoted cell has no end.
    Open,
    /// A quote stands inside a cell.
    Quote,
}

/// Reads blocks one after the other.
#[derive(Clone, Debug)]
pub struct Reader {
    layout: Layout,
    sign: Sign,
    zoned: Vec<Option<bool>>,
    line: u64,
}

impl Reader {
    /// The first line read has this number.
    pub fn new(layout: Layout, line: u64) -> Self {
        let zoned = vec![None; layout.columns.len()];
        Self { layout, sign: Sign::Unseen, zoned, line }
    }

    /// The decimal sign so far.
    pub fn sign(&self) -> Sign {
        self.sign
    }

    /// The number of the next line.
    pub fn line(&self) -> u64 {
        self.line
    }

    /// At most `most` rows of a block. `last`: nothing follows it, its last line may lack its end.
    ///
    /// # Errors
    ///
    /// The first line that cannot be read.
    pub fn read(&mut self, block: &[u8], most: usize, last: bool) -> Result<Rows, Fault> {
        let count = most.min(block.len() / (2 * self.layout.width.max(1)));
        let kinds = self.layout.columns.iter().map(|(_, kind)| *kind);
        let mut columns: Vec<Column> = kinds.map(|kind| empty(kind, count)).collect();
        let mut lines = Vec::with_capacity(count);
        let mut cells = Vec::with_capacity(self.layout.width);
        let mut unquoted = Vec::new();
        let mut at = 0;
        let quotes = memchr(b'"', block).is_some();
        while at < block.len() && lines.len() < most {
            let end = match memchr(b'\n', &block[at..]) {
                Some(length) => at + length,
                None if last || block.len() - at > LINE => block.len(),
                None => break,
            };
            if end - at > LINE {
                return Err(Fault { line: self.line, what: What::Long, text: Vec::new() });
            }
            let text = &block[at..end];
            let first = self.line;
            if !begins_sample(text) && is_idle(text) {
                (at, self.line) = (end + 1, first + 1);
                continue;
            }
            cells.clear();
            let mut next = end + 1;
            let held: &[u8] = match (self.layout.delimiter, quotes && memchr(b'"', text).is_some())
            {
                (None, _) => {
                    split_blanks(text, &mut cells);
                    text
                }
                (Some(delimiter), false) => {
                    split(text, delimiter, &mut cells);
                    text
                }
                (Some(delimiter), true) => {
                    unquoted.clear();
                    let read = quoted(&block[at..], delimiter, &mut unquoted, &mut cells);
                    let fault = |what| Fault { line: first, what, text: text.to_vec() };
                    match read {
                        Ok(Some(length)) => next = at + length,
                        Ok(None) if last => next = block.len() + 1,
                        Ok(None) => break,
                        Err(What::Open) if !last => break,
                        Err(what) => return Err(fault(what)),
                    }
                    let inside = &block[at..(next - 1).min(block.len())];
                    self.line += memchr_iter(b'\n', inside).count() as u64;
                    &unquoted
                }
            };
            self.line += 1;
            let fault = |what| Fault { line: first, what, text: text.to_vec() };
            let mut count = cells.len();
            if self.layout.trailing && count == self.layout.width + 1 {
                let (a, b) = cells[count - 1];
                count -= usize::from(held[a..b].is_empty());
            }
            if count != self.layout.width {
                return Err(fault(What::Cells(count)));
            }
            let row = lines.len() as u64;
            for (i, (place, kind)) in self.layout.columns.iter().enumerate() {
                let (a, b) = cells[*place];
                let cell = held[a..b].trim_ascii();
                let commas = self.layout.delimiter != Some(b',');
                let (sign, zoned) = (&mut self.sign, &mut self.zoned[i]);
                take(&mut columns[i], *kind, cell, row, sign, zoned, commas).map_err(|zone| {
                    let shown = cell.to_vec();
                    fault(if zone { What::Zone(i, shown) } else { What::Cell(i, shown) })
                })?;
            }
            lines.push(first);
            at = next;
        }
        Ok(Rows { columns, lines, read: at.min(block.len()) })
    }
}

fn empty(kind: Kind, count: usize) -> Column {
    let values = match kind {
        Kind::Number => Values::Numbers(Vec::with_capacity(count)),
        Kind::Moment | Kind::Daytime => Values::Nanoseconds(Vec::with_capacity(count)),
    };
    Column { values, large_rows: Vec::new(), large: Vec::new() }
}

/// One more value of a column; false: the cell holds something else, true: it lies in another zone.
fn take(
    column: &mut Column,
    kind: Kind,
    cell: &[u8],
    row: u64,
    sign: &mut Sign,
    zoned: &mut Option<bool>,
    commas: bool,
) -> Result<(), bool> {
    match &mut column.values {
        Values::Numbers(values) => {
            let value = number(cell, sign, commas).ok_or(false)?;
            if value.abs() >= EXACT {
                let text = std::str::from_utf8(cell).unwrap_or_default();
                if let Ok(whole) = text.parse() {
                    column.large_rows.push(row);
                    column.large.push(whole);
                }
            }
            values.push(value);
        }
        Values::Nanoseconds(values) => values.push(if kind == Kind::Moment {
            let (stamp, zone) = moment(cell).ok_or(false)?;
            if zone.is_some() && zoned.is_some() && zone != *zoned {
                return Err(true);
            }
            *zoned = zone.or(*zoned);
            stamp
        } else {
            daytime(cell).ok_or(false)?
        }),
    }
    Ok(())
}

/// Whether a line begins as numbers do: then it is neither blank nor a comment.
fn begins_sample(line: &[u8]) -> bool {
    line.first().is_some_and(|c| c.is_ascii_digit() || *c == b'-' || *c == b'.')
}

/// Whether a line is blank, or a comment: it begins with #, % or //.
pub fn is_idle(line: &[u8]) -> bool {
    let text = line.trim_ascii();
    match text.first() {
        None | Some(b'%') => true,
        Some(b'/') => text.starts_with(b"//"),
        // #N/A is a missing cell
        Some(b'#') => {
            let cell = text.split(|c| b",;\t| ".contains(c)).next().unwrap_or_default();
            !is_missing(cell)
        }
        Some(_) => false,
    }
}

/// The cells of one line, for whoever looks at its head; `None`: a quote is out of place.
pub fn cells_of(line: &[u8], delimiter: Option<u8>) -> Option<Vec<Vec<u8>>> {
    let (mut held, mut cells) = (line.to_vec(), Vec::new());
    match delimiter {
        None => split_blanks(line, &mut cells),
        Some(delimiter) if memchr(b'"', line).is_none() => split(line, delimiter, &mut cells),
        Some(delimiter) => {
            held.clear();
            quoted(line, delimiter, &mut held, &mut cells).ok()?;
        }
    }
    Some(cells.iter().map(|(a, b)| held[*a..*b].trim_ascii().to_vec()).collect())
}

/// Places of the cells of a line without quotes.
fn split(text: &[u8], delimiter: u8, cells: &mut Vec<(usize, usize)>) {
    let mut begin = 0;
    for (end, c) in text.iter().enumerate() {
        if *c == delimiter {
            cells.push((begin, end));
            begin = end + 1;
        }
    }
    let end = text.len() - usize::from(text.ends_with(b"\r"));
    cells.push((begin, end.max(begin)));
}

/// Places of the cells of a line between blanks.
fn split_blanks(text: &[u8], cells: &mut Vec<(usize, usize)>) {
    let mut begin = None;
    for (i, c) in text.iter().enumerate() {
        match (c.is_ascii_whitespace(), begin) {
            (true, Some(a)) => {
                cells.push((a, i));
                begin = None;
            }
            (false, None) => begin = Some(i),
            _ => {}
        }
    }
    if let Some(a) = begin {
        cells.push((a, text.len()));
    }
}

/// The cells of a line with quotes, unquoted, one after the other in `held`, and the length of the line with its
/// end; `None`: the end is not there.
fn quoted(
    block: &[u8],
    delimiter: u8,
    held: &mut Vec<u8>,
    cells: &mut Vec<(usize, usize)>,
) -> Result<Option<usize>, What> {
    let blank = |c: &u8| *c != delimiter && (*c == b' ' || *c == b'\t' || *c == b'\r');
    let mut at = 0;
    loop {
        at += block[at..].iter().take_while(|c| blank(c)).count();
        let begin = held.len();
        if block.get(at) == Some(&b'"') {
            at += 1;
            loop {
                let length = memchr(b'"', &block[at..]).ok_or(What::Open)?;
                held.extend_from_slice(&block[at..at + length]);
                at += length + 1;
                if block.get(at) != Some(&b'"') {
                    break;
                }
                held.push(b'"');
                at += 1;
            }
            at += block[at..].iter().take_while(|c| blank(c)).count();
        } else {
            let cell = block[at..].iter().take_while(|c| **c != delimiter && **c != b'\n');
            let length = cell.count();
            held.extend_from_slice(&block[at..at + length]);
            at += length;
        }
        cells.push((begin, held.len()));
        match block.get(at) {
            None => return Ok(None),
            Some(b'\n') => return Ok(Some(at + 1)),
            Some(c) if *c == delimiter => at += 1,
            Some(_) => return Err(What::Quote),
        }
    }
}
