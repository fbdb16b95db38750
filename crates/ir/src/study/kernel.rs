//! Floor 9. Blocks of [`LANES`] runs: the interpreter for the processor's instructions, and studies as kernels, the
//! same tables, compiled by LLVM for vectors of runs.

use super::LANES;
use super::block::{Block, Engine, Layout, Span};
use super::interpreter::Interpreter;
use crate::error::{Result, refused};
use crate::vectors::{Task, Vectors};

/// A compiled study, for blocks of [`LANES`] runs.
pub trait Kernel: Sync {
    /// Move the runs of a block over a span all samples of which have a next one. What happened in it is
    /// told by [`Block::worst`] alone: a span that went out of bounds is done again by the interpreter.
    /// `false`: it has no form for this span, and nothing was moved.
    fn span(&self, layout: &Layout, block: &mut Block<LANES>, span: &Span<'_, LANES>) -> bool;
}

/// A kernel where there is one, and the interpreter for what it does not do: the last sample of a run, and
/// each sample of a span that went out of bounds.
pub struct Vectored<'a> {
    pub kernel: Option<&'a dyn Kernel>,
    pub layout: &'a Layout,
    pub interpreter: Interpreter<'a, LANES>,
    /// What the interpreter is compiled for.
    pub vectors: Vectors,
}

impl Engine<LANES> for Vectored<'_> {
    fn span(&mut self, block: &mut Block<LANES>, span: &Span<'_, LANES>) -> Result<()> {
        let Self { layout, interpreter, vectors, .. } = self;
        let moves = span.instants.last().is_some_and(|last| last.more > 0.0);
        if let Some(kernel) = self.kernel.filter(|_| moves && !span.careful) {
            block.begin(span);
            if kernel.span(layout, block, span) {
                return Ok(());
            }
        }
        let task = Interpreted { interpreter, block, span };
        vectors.run(task).unwrap_or_else(|| Err(refused("this processor lacks the instructions")))
    }

    fn is_compiled(&self) -> bool {
        self.kernel.is_some()
    }
}

/// A span by the interpreter. All else that a study does is compiled once.
struct Interpreted<'a, 'b> {
    interpreter: &'a mut Interpreter<'b, LANES>,
    block: &'a mut Block<LANES>,
    span: &'a Span<'a, LANES>,
}

impl Task for Interpreted<'_, '_> {
    type Output = Result<()>;
    #[inline(always)]
    fn run(self) -> Result<()> {
        self.interpreter.span(self.block, self.span)
    }
}
