//! Decoders of others that panic on damaged files, run so that nobody sees it.
use std::cell::Cell;
use std::panic::{self, AssertUnwindSafe};
use std::sync::Once;

thread_local! {
    /// Whether this thread is in a decoder whose panics are ours to tell.
    static DECODING: Cell<bool> = const { Cell::new(false) };
}

/// Runs a decoder of others, which may panic on a damaged file; `None` if it did, and nothing is printed.
pub(crate) fn quietly<T>(decode: impl FnOnce() -> T) -> Option<T> {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let others = panic::take_hook();
        panic::set_hook(Box::new(move |info| {
            if !DECODING.get() {
                others(info);
            }
        }));
    });
    DECODING.set(true);
    let result = panic::catch_unwind(AssertUnwindSafe(decode));
    DECODING.set(false);
    result.ok()
}

#[cfg(test)]
mod tests {
    use super::quietly;

    #[test]
    fn a_panic_is_none_and_others_are_not_touched() {
        assert_eq!(quietly(|| 3), Some(3));
        assert_eq!(quietly(|| -> u8 { panic!("damaged") }), None);
        assert!(std::thread::spawn(|| panic!("ours")).join().is_err());
    }
}
