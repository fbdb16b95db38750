//! Floor 0. Errors: what is refused, and what a user's function raised.

use hgo_rs::DesignError;
use std::fmt;
use std::sync::Arc;

/// Why something was not done.
#[derive(Clone, Debug)]
pub enum Error {
    /// A spec or a request that is not allowed: the message, shown as it is.
    Refused(String),
    /// A function of the user's failed: its own error, which is handed on unchanged.
    Called(Arc<dyn std::error::Error + Send + Sync>),
}

/// A result whose error says what is not allowed, or what a user's function raised.
pub type Result<T> = std::result::Result<T, Error>;

/// A refusal with this message.
pub fn refused(message: impl Into<String>) -> Error {
    Error::Refused(message.into())
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Refused(message) => f.write_str(message),
            Self::Called(error) => error.fmt(f),
        }
    }
}

impl std::error::Error for Error {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Refused(_) => None,
            Self::Called(error) => Some(&**error),
        }
    }
}

impl From<DesignError> for Error {
    fn from(error: DesignError) -> Self {
        refused(error.to_string())
    }
}
