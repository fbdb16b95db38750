//! Errors at the Python border: `hgo_rs.errors.DesignError`, a `ValueError`.

use crate::DesignError;
use pyo3::prelude::*;

/// A `hgo_rs.errors.DesignError` with this message.
pub fn refused(message: &str) -> PyErr {
    Python::attach(|py| {
        let made = py
            .import("hgo_rs.errors")
            .and_then(|module| module.getattr("DesignError"))
            .and_then(|class| class.call1((message,)));
        match made {
            Ok(value) => PyErr::from_value(value),
            Err(error) => error,
        }
    })
}

impl From<DesignError> for PyErr {
    fn from(error: DesignError) -> Self {
        refused(&error.to_string())
    }
}
