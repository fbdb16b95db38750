//! Floor 2. Specs: dicts whose keys, types and shapes are checked one by one.

use crate::error::{Error, Result, refused};
use crate::value::{Numbers, Value};
use std::sync::Arc;

/// A dict with a name for messages.
#[derive(Clone, Debug)]
pub struct Spec<'a> {
    map: &'a [(String, Value)],
    name: String,
}

impl<'a> Spec<'a> {
    /// A value that must be a dict.
    pub fn new(value: &'a Value, name: &str) -> Result<Self> {
        match value {
            Value::Map(map) => Ok(Self { map, name: name.to_owned() }),
            other => Err(refused(format!("{name} must be a dict, not {}", other.kind()))),
        }
    }

    /// Refuse keys that nothing reads.
    pub fn only(&self, known: &[&str]) -> Result<()> {
        match self.map.iter().find(|(key, _)| !known.contains(&key.as_str())) {
            None => Ok(()),
            Some((key, _)) => Err(refused(format!(
                "{} has an unknown key {key:?}; known keys: {}",
                self.name,
                known.join(", ")
            ))),
        }
    }

    /// Its keys, in their order.
    pub fn keys(&self) -> impl Iterator<Item = &'a str> {
        self.map.iter().map(|(key, _)| key.as_str())
    }

    /// The value of a key, if it is there and not None.
    pub fn get(&self, key: &str) -> Option<&'a Value> {
        let (_, value) = self.map.iter().find(|(name, _)| name == key)?;
        if matches!(value, Value::Nothing) { None } else { Some(value) }
    }

    /// Whether the key is there and not None.
    pub fn has(&self, key: &str) -> bool {
        self.get(key).is_some()
    }

    fn need(&self, key: &str) -> Result<&'a Value> {
        self.get(key).ok_or_else(|| refused(format!("{} needs {key:?}", self.name)))
    }

    /// What `read` makes of the value of a key, which must be `wanted`.
    fn read<R>(
        &self,
        key: &str,
        wanted: &str,
        read: impl FnOnce(&'a Value) -> Option<R>,
    ) -> Result<R> {
        let value = self.need(key)?;
        read(value)
            .ok_or_else(|| refused(format!("{}[{key:?}] = {value} is not {wanted}", self.name)))
    }

    /// A dict in this one.
    pub fn sub(&self, key: &str) -> Result<Spec<'a>> {
        Spec::new(self.need(key)?, key)
    }

    /// A list of dicts.
    pub fn list(&self, key: &str) -> Result<Vec<Spec<'a>>> {
        let rows = self.read(key, "a list of dicts", Value::as_list)?;
        rows.iter().map(|row| Spec::new(row, key)).collect()
    }

    /// A string.
    pub fn text(&self, key: &str) -> Result<String> {
        self.read(key, "a string", Value::as_text).map(str::to_owned)
    }

    /// A string, if it is there.
    pub fn text_or(&self, key: &str, default: &str) -> Result<String> {
        if self.has(key) { self.text(key) } else { Ok(default.to_owned()) }
    }

    /// A list of strings, if it is there.
    pub fn texts(&self, key: &str) -> Result<Option<Vec<String>>> {
        if !self.has(key) {
            return Ok(None);
        }
        self.read(key, "a list of strings", Value::as_texts).map(Some)
    }

    /// A number.
    pub fn f64(&self, key: &str) -> Result<f64> {
        self.read(key, "a number", Value::as_f64)
    }

    /// A number, if it is there.
    pub fn f64_or(&self, key: &str, default: f64) -> Result<f64> {
        if self.has(key) { self.f64(key) } else { Ok(default) }
    }

    /// A whole number >= 0.
    pub fn whole(&self, key: &str) -> Result<u64> {
        self.read(key, "a whole number >= 0", Value::as_whole)
    }

    /// A whole number >= 0, if it is there.
    pub fn whole_or(&self, key: &str, default: u64) -> Result<u64> {
        if self.has(key) { self.whole(key) } else { Ok(default) }
    }

    /// A number of things.
    pub fn count(&self, key: &str) -> Result<usize> {
        self.read(key, "a whole number >= 0", Value::as_whole)
    }

    /// A list of whole numbers >= 0, if it is there.
    pub fn wholes(&self, key: &str) -> Result<Option<Vec<usize>>> {
        if !self.has(key) {
            return Ok(None);
        }
        self.read(key, "a list of whole numbers >= 0", Value::as_wholes).map(Some)
    }

    /// True or False, if it is there.
    pub fn flag_or(&self, key: &str, default: bool) -> Result<bool> {
        if !self.has(key) {
            return Ok(default);
        }
        self.read(key, "True or False", Value::as_flag)
    }

    /// An array of numbers.
    pub fn numbers(&self, key: &str) -> Result<Arc<Numbers>> {
        self.read(key, "an array of numbers", Value::as_numbers)
    }

    /// A list of `count` numbers.
    pub fn list_of(&self, key: &str, count: usize) -> Result<Vec<f64>> {
        let numbers = self.numbers(key)?;
        let Numbers { values, shape } = &*numbers;
        if shape.len() != 1 || values.len() != count {
            let message =
                format!("{}[{key:?}] has shape {shape:?}; it must have {count} entries", self.name);
            return Err(refused(message));
        }
        Ok(values.clone())
    }

    /// A vector of `N` numbers, the given ones first; `given` of them must be there.
    pub fn vector<const N: usize>(&self, key: &str, given: usize) -> Result<[f64; N]> {
        let values = self.list_of(key, given)?;
        Ok(std::array::from_fn(|i| values.get(i).copied().unwrap_or(0.0)))
    }

    /// Rows of `columns` finite numbers: one for all runs, or one a run.
    pub fn rows(&self, key: &str, columns: usize, runs: usize) -> Result<Vec<f64>> {
        let numbers = self.numbers(key)?;
        let Numbers { values, shape } = &*numbers;
        let fits = matches!(shape.as_slice(), [c] if *c == columns)
            || matches!(shape.as_slice(), [r, c] if *r == runs && *c == columns);
        if !fits {
            let message = format!(
                "{}[{key:?}] has shape {shape:?}; it must be ({columns},) or ({runs}, {columns})",
                self.name
            );
            return Err(refused(message));
        }
        if let Some(bad) = values.iter().find(|value| !value.is_finite()) {
            let message = format!("{}[{key:?}] holds {bad}; it must be finite", self.name);
            return Err(refused(message));
        }
        Ok(values.clone())
    }

    /// Refusal of a name that is none of those that are known.
    pub fn unknown(&self, key: &str, value: &str, known: &[&str]) -> Error {
        refused(format!(
            "{}[{key:?}] = {value:?} is not known; choose from {}",
            self.name,
            known.join(", ")
        ))
    }
}
