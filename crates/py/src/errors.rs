//! Floor 0. Errors at the Python border: `hgo_rs.errors.DesignError`, a `ValueError`, or what a user's function
//! raised.

use hgo_rs::DesignError;
use numpy::AsSliceError;
use pyo3::CastIntoError;
use pyo3::prelude::*;
use pyo3::pycell::{PyBorrowError, PyBorrowMutError};

/// What Python is told. Everything that can go wrong below becomes one by `?`.
#[derive(Debug)]
pub struct Error(PyErr);

pub type Result<T> = std::result::Result<T, Error>;

/// A `hgo_rs.errors.DesignError` with this message.
pub fn refused(message: &str) -> Error {
    Python::attach(|py| {
        let made = py
            .import("hgo_rs.errors")
            .and_then(|module| module.getattr("DesignError"))
            .and_then(|class| class.call1((message,)));
        match made {
            Ok(value) => Error(PyErr::from_value(value)),
            Err(error) => Error(error),
        }
    })
}

impl From<Error> for PyErr {
    fn from(Error(error): Error) -> Self {
        error
    }
}

impl From<hgo_ir::Error> for Error {
    fn from(error: hgo_ir::Error) -> Self {
        match &error {
            hgo_ir::Error::Refused(message) => refused(message),
            // what a Python function raised, as it was
            hgo_ir::Error::Called(raised) => match raised.downcast_ref::<PyErr>() {
                Some(raised) => Self(Python::attach(|py| raised.clone_ref(py))),
                None => refused(&error.to_string()),
            },
        }
    }
}

impl From<DesignError> for Error {
    fn from(error: DesignError) -> Self {
        refused(&error.to_string())
    }
}

impl From<PyErr> for Error {
    fn from(error: PyErr) -> Self {
        Self(error)
    }
}

impl From<PyBorrowError> for Error {
    fn from(error: PyBorrowError) -> Self {
        Self(error.into())
    }
}

impl From<PyBorrowMutError> for Error {
    fn from(error: PyBorrowMutError) -> Self {
        Self(error.into())
    }
}

impl From<AsSliceError> for Error {
    fn from(error: AsSliceError) -> Self {
        Self(error.into())
    }
}

impl From<CastIntoError<'_>> for Error {
    fn from(error: CastIntoError<'_>) -> Self {
        Self(error.into())
    }
}
