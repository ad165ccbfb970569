//! Doing the same for three corners or sides.

/// `[T; 3]::map` that is inlined wherever it is used: a call would leave the processor features the caller is compiled for.
#[inline(always)]
pub(crate) fn each<T, U>([a, b, c]: [T; 3], f: impl Fn(T) -> U) -> [U; 3] {
    [f(a), f(b), f(c)]
}
