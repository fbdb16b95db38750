//! Floor 1. Sizes: orders, known at run time, as constants, and how many inputs and outputs there may be.

use crate::error::{Error, refused};
use hgo_rs::observers::MAX_ORDER;

/// Known inputs that a model may have.
pub const MAX_INPUTS: usize = 8;

/// Outputs that a model of chains may have.
pub const CHAINS: usize = 12;

/// Call `$body` with the constant `$n` equal to the run-time order, 1 to 12.
#[macro_export]
#[doc(hidden)]
macro_rules! dispatch_order {
    ($order:expr, $n:ident => $body:expr, else $other:expr) => {
        match $order {
            1 => {
                const $n: usize = 1;
                $body
            }
            2 => {
                const $n: usize = 2;
                $body
            }
            3 => {
                const $n: usize = 3;
                $body
            }
            4 => {
                const $n: usize = 4;
                $body
            }
            5 => {
                const $n: usize = 5;
                $body
            }
            6 => {
                const $n: usize = 6;
                $body
            }
            7 => {
                const $n: usize = 7;
                $body
            }
            8 => {
                const $n: usize = 8;
                $body
            }
            9 => {
                const $n: usize = 9;
                $body
            }
            10 => {
                const $n: usize = 10;
                $body
            }
            11 => {
                const $n: usize = 11;
                $body
            }
            12 => {
                const $n: usize = 12;
                $body
            }
            _ => $other,
        }
    };
}

/// Refusal of an order outside 1 to 12.
pub fn order_refused(order: usize) -> Error {
    refused(format!("n = {order} is not allowed: the order must be 1 to {MAX_ORDER}"))
}
