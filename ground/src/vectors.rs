//! Plain loops, compiled for the machine's widest vectors.

use pulp::{Arch, Simd, WithSimd};

struct Work<F>(F);

impl<R, F: FnMut() -> R> WithSimd for Work<F> {
    type Output = R;

    #[expect(clippy::inline_always, reason = "inlined into the dispatch, else it is compiled without its vectors")]
    #[inline(always)]
    fn with_simd<S: Simd>(mut self, _: S) -> R {
        (self.0)()
    }
}

/// Runs `work`, a closure marked `#[inline(always)]` as must be all that it calls.
///
/// [`Arch::dispatch`] itself takes closures too, but calls them through a shim that is not inlined, and the loops within are
/// compiled for the least machine.
#[expect(clippy::inline_always, reason = "the closure's only caller")]
#[inline(always)]
pub(crate) fn vectorised<R>(work: impl FnMut() -> R) -> R {
    Arch::new().dispatch(Work(work))
}
