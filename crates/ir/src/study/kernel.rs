//! Studies as kernels: the same tables, compiled by LLVM for vectors of runs.

use super::LANES;
use super::block::{Block, Engine, Layout, Span};
use super::interpreter::Interpreter;
use crate::error::Result;

/// A compiled study, for blocks of [`LANES`] runs.
pub trait Kernel: Sync {
    /// Move the runs of a block over a span all samples of which have a next one. What happened in it is
    /// told by [`Block::worst`] alone: a span that went out of bounds is done again by the interpreter.
    /// `false`: it has no form for this span, and nothing was moved.
    fn span(&self, layout: &Layout, block: &mut Block<LANES>, span: &Span<'_, LANES>) -> bool;
}

/// A kernel, and the interpreter for what it does not do: the last sample of a run, and each sample of a
/// span that went out of bounds.
pub struct Compiled<'a> {
    pub kernel: &'a dyn Kernel,
    pub layout: &'a Layout,
    pub interpreter: Interpreter<'a, LANES>,
}

impl Engine<LANES> for Compiled<'_> {
    #[inline(always)]
    fn span(&mut self, block: &mut Block<LANES>, span: &Span<'_, LANES>) -> Result<()> {
        let moves = span.instants.last().is_some_and(|last| last.more > 0.0);
        if span.careful || !moves {
            return self.interpreter.span(block, span);
        }
        block.begin(span);
        if self.kernel.span(self.layout, block, span) { Ok(()) } else { self.interpreter.span(block, span) }
    }

    fn is_compiled(&self) -> bool {
        true
    }
}
