//! Floor 1. Plain data that specs are read from: what a Python object or a TOML file says.

use crate::error::Result;
use std::fmt;
use std::sync::Arc;

/// A function of the user's, called where a table has a call.
pub trait Function: Send + Sync {
    /// Its results for these arguments.
    ///
    /// # Errors
    /// Whatever the function raises, as [`Error::Called`](crate::Error::Called).
    fn call(&self, arguments: &[f64]) -> Result<Vec<f64>>;
}

impl fmt::Debug for dyn Function {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a function")
    }
}

/// Numbers with their shape, in C order.
#[derive(Clone, Debug, PartialEq)]
pub struct Numbers {
    /// All entries.
    pub values: Vec<f64>,
    /// Entries along each axis.
    pub shape: Vec<usize>,
}

/// A value of a spec. It is shown as Python shows it, since most specs come from there.
#[derive(Clone, Debug)]
pub enum Value {
    /// None: as if it were not there; a missing entry among numbers.
    Nothing,
    /// A string.
    Text(String),
    /// True or False.
    Flag(bool),
    /// A whole number.
    Whole(i128),
    /// A number.
    Number(f64),
    /// An array of numbers, shared: to read it copies nothing.
    Numbers(Arc<Numbers>),
    /// A list. One of numbers, or of such lists of one length, can be read as an array.
    List(Vec<Value>),
    /// A dict, its keys in their order.
    Map(Vec<(String, Value)>),
    /// A function. The same one is told by [`Arc::ptr_eq`].
    Function(Arc<dyn Function>),
    /// Something that no spec reads.
    Other {
        /// Name of its type.
        kind: String,
        /// What it looks like.
        shown: String,
    },
}

#[cfg(feature = "toml")]
impl Value {
    /// The tables, arrays and values of a TOML document.
    ///
    /// # Errors
    /// A text that is not TOML: where, and why.
    pub fn from_toml(text: &str) -> Result<Self> {
        let refuse = |error: toml::de::Error| crate::error::refused(error.to_string());
        let table: toml::Table = text.parse().map_err(refuse)?;
        Ok(Self::of_table(table))
    }

    fn of_table(table: toml::Table) -> Self {
        Self::Map(table.into_iter().map(|(key, value)| (key, Self::of_toml(value))).collect())
    }

    fn of_toml(value: toml::Value) -> Self {
        match value {
            toml::Value::String(text) => Self::Text(text),
            toml::Value::Integer(whole) => Self::Whole(whole.into()),
            toml::Value::Float(number) => Self::Number(number),
            toml::Value::Boolean(flag) => Self::Flag(flag),
            toml::Value::Datetime(time) => {
                Self::Other { kind: "datetime".to_owned(), shown: time.to_string() }
            }
            toml::Value::Array(rows) => Self::List(rows.into_iter().map(Self::of_toml).collect()),
            toml::Value::Table(table) => Self::of_table(table),
        }
    }
}

impl Value {
    /// Name of its type, as Python names it.
    pub fn kind(&self) -> &str {
        match self {
            Self::Nothing => "NoneType",
            Self::Text(_) => "str",
            Self::Flag(_) => "bool",
            Self::Whole(_) => "int",
            Self::Number(_) => "float",
            Self::Numbers(_) => "ndarray",
            Self::List(_) => "list",
            Self::Map(_) => "dict",
            Self::Function(_) => "function",
            Self::Other { kind, .. } => kind,
        }
    }

    /// A string.
    pub fn as_text(&self) -> Option<&str> {
        match self {
            Self::Text(text) => Some(text),
            _ => None,
        }
    }

    /// True or False.
    pub fn as_flag(&self) -> Option<bool> {
        match self {
            Self::Flag(flag) => Some(*flag),
            _ => None,
        }
    }

    /// A number. (True and False are 1 and 0, as in Python.)
    #[allow(clippy::cast_precision_loss)]
    pub fn as_f64(&self) -> Option<f64> {
        match self {
            Self::Number(number) => Some(*number),
            Self::Whole(whole) => Some(*whole as f64),
            Self::Flag(flag) => Some(f64::from(u8::from(*flag))),
            _ => None,
        }
    }

    /// A whole number that `N` holds.
    pub fn as_whole<N: TryFrom<i128>>(&self) -> Option<N> {
        match self {
            Self::Whole(whole) => N::try_from(*whole).ok(),
            Self::Flag(flag) => N::try_from(i128::from(*flag)).ok(),
            _ => None,
        }
    }

    /// A list.
    pub fn as_list(&self) -> Option<&[Value]> {
        match self {
            Self::List(list) => Some(list),
            _ => None,
        }
    }

    /// A list of strings.
    pub fn as_texts(&self) -> Option<Vec<String>> {
        self.as_list()?.iter().map(|row| row.as_text().map(str::to_owned)).collect()
    }

    /// A list of whole numbers >= 0.
    pub fn as_wholes(&self) -> Option<Vec<usize>> {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let whole = |value: &f64| {
            let fits = value.fract() == 0.0 && (0.0..2_f64.powi(53)).contains(value);
            fits.then_some(*value as usize)
        };
        match self {
            Self::List(list) => list.iter().map(Self::as_whole).collect(),
            Self::Numbers(numbers) if numbers.shape.len() == 1 => {
                numbers.values.iter().map(whole).collect()
            }
            _ => None,
        }
    }

    /// An array of numbers: one, a number, or a list of arrays of one shape. A number is an array of one
    /// entry; what is missing in a list is NaN.
    pub fn as_numbers(&self) -> Option<Arc<Numbers>> {
        match self {
            Self::Numbers(numbers) => Some(numbers.clone()),
            Self::List(_) => {
                let (mut values, mut shape) = (Vec::new(), Vec::new());
                self.gather(0, &mut values, &mut shape)?;
                Some(Arc::new(Numbers { values, shape }))
            }
            other => other
                .as_f64()
                .map(|value| Arc::new(Numbers { values: vec![value], shape: vec![1] })),
        }
    }

    /// Add the entries of a nested list; at `depth` and below the shape is found once and kept to.
    fn gather(&self, depth: usize, values: &mut Vec<f64>, shape: &mut Vec<usize>) -> Option<()> {
        let first = values.is_empty() && shape.len() == depth;
        let mut along = |lengths: &[usize]| {
            if first {
                shape.extend_from_slice(lengths);
            }
            shape[depth..].starts_with(lengths)
        };
        match self {
            Self::List(rows) => {
                let fits = along(&[rows.len()]);
                fits.then_some(())?;
                rows.iter().try_for_each(|row| row.gather(depth + 1, values, shape))
            }
            Self::Numbers(numbers) => {
                let fits = along(&numbers.shape) && shape.len() == depth + numbers.shape.len();
                fits.then(|| values.extend_from_slice(&numbers.values))
            }
            entry => {
                let value =
                    if matches!(entry, Self::Nothing) { f64::NAN } else { entry.as_f64()? };
                (shape.len() == depth).then(|| values.push(value))
            }
        }
    }
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Nothing => f.write_str("None"),
            Self::Text(text) => quoted(text, f),
            Self::Flag(true) => f.write_str("True"),
            Self::Flag(false) => f.write_str("False"),
            Self::Whole(whole) => write!(f, "{whole}"),
            Self::Number(number) => shown(*number, f),
            Self::Numbers(numbers) => array(&numbers.values, &numbers.shape, f),
            Self::List(rows) => {
                f.write_str("[")?;
                for (i, row) in rows.iter().enumerate() {
                    write!(f, "{}{row}", if i == 0 { "" } else { ", " })?;
                }
                f.write_str("]")
            }
            Self::Map(entries) => {
                f.write_str("{")?;
                for (i, (key, value)) in entries.iter().enumerate() {
                    f.write_str(if i == 0 { "" } else { ", " })?;
                    quoted(key, f)?;
                    write!(f, ": {value}")?;
                }
                f.write_str("}")
            }
            Self::Function(_) => f.write_str("a function"),
            Self::Other { shown, .. } => f.write_str(shown),
        }
    }
}

/// In quotes, double ones where only single ones would need to be escaped.
fn quoted(text: &str, f: &mut fmt::Formatter<'_>) -> fmt::Result {
    let quote = if text.contains('\'') && !text.contains('"') { '"' } else { '\'' };
    write!(f, "{quote}")?;
    for c in text.chars() {
        match c {
            '\n' => f.write_str("\\n")?,
            '\r' => f.write_str("\\r")?,
            '\t' => f.write_str("\\t")?,
            c if c == '\\' || c == quote => write!(f, "\\{c}")?,
            c if c.is_control() => write!(f, "\\x{:02x}", u32::from(c))?,
            c => write!(f, "{c}")?,
        }
    }
    write!(f, "{quote}")
}

/// The shortest digits that read back, with Python's exponents (1e-05, 1e+16).
fn shown(number: f64, f: &mut fmt::Formatter<'_>) -> fmt::Result {
    if number.is_nan() {
        return f.write_str("nan");
    }
    let digits = format!("{number:?}");
    match digits.split_once('e') {
        None => f.write_str(&digits),
        Some((digits, exponent)) => {
            let (sign, size) = match exponent.strip_prefix('-') {
                Some(size) => ('-', size),
                None => ('+', exponent),
            };
            write!(f, "{digits}e{sign}{size:0>2}")
        }
    }
}

fn array(values: &[f64], shape: &[usize], f: &mut fmt::Formatter<'_>) -> fmt::Result {
    let [rows, inner @ ..] = shape else {
        return values.first().map_or(Ok(()), |value| shown(*value, f));
    };
    let width: usize = inner.iter().product();
    f.write_str("[")?;
    for i in 0..*rows {
        f.write_str(if i == 0 { "" } else { ", " })?;
        array(values.get(i * width..(i + 1) * width).unwrap_or(&[]), inner, f)?;
    }
    f.write_str("]")
}
