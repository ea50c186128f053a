//! Numbers in memory that begin on a cache line.

use uvms_gym::batch::insides::{Aligned, LINE};

fn on_a_line<T>(numbers: &[T]) -> bool {
    numbers.as_ptr().addr().is_multiple_of(LINE)
}

#[test]
fn numbers_and_copies_of_them_begin_on_a_line() {
    for count in [1, 8, 1000, 100_000] {
        let (single, mut double) = (Aligned::filled(count, 0.5f32).unwrap(), Aligned::filled(count, 0.5).unwrap());
        double[count - 1] = 2.0;
        let copy = double.clone();
        assert!(on_a_line(&single) && on_a_line(&double) && on_a_line(&copy));
        assert_eq!((single.len(), double.len()), (count, count));
        assert_eq!(*copy, *double);
    }
}

#[test]
fn none_are_none_and_too_many_are_refused() {
    assert!(Aligned::filled(0, 0.0).unwrap().clone().is_empty());
    assert!(Aligned::filled(usize::MAX, 0.0).is_err());
}
