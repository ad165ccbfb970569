//! Asking for memory before it is needed: the one thing here that safe Rust has no words for.

/// Starts loading an element of a slice into the cache; an index beyond the end does nothing.
///
/// Triangles name vertices all over the array. Asked for some dozens of triangles ahead, those of a mesh too large for the
/// cache are there when they are needed.
#[inline(always)]
pub(crate) fn prefetch<T>(slice: &[T], index: usize) {
    #[cfg(target_arch = "x86_64")]
    if let Some(element) = slice.get(index) {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        // SAFETY: the instruction only hints at an address, here even one of a live element, and changes nothing else; it
        // is part of the architecture's baseline.
        #[allow(unsafe_code)]
        unsafe {
            _mm_prefetch::<_MM_HINT_T0>(std::ptr::from_ref(element).cast());
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (slice, index);
}
