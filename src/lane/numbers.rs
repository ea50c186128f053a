//! Structs of numbers, declared once: [`numbers!`] writes the change of the number type and the visit of all numbers.

/// Visits numbers in runs: adjacent numbers of one quantity. (No closure: it would not inherit the caller's instruction set.)
pub trait RunVisitor<P> {
    /// Visits the next run.
    fn visit(&mut self, run: &mut [P]);
}

/// Numbers of type P: one, or arrays, options, lists and structs of them. `Kind` tells these cases apart for the compiler, which
/// infers it.
pub trait Numbers<P, Kind>: Sized {
    /// The same with numbers of type Q.
    type With<Q>;

    /// The same with `change` applied to each number. `()` for each number leaves the structure: which terms are there, in which form.
    fn map<Q>(&self, change: &impl Fn(P) -> Q) -> Self::With<Q>;

    /// Visits all numbers in the order of their declaration.
    fn visit(&mut self, visitor: &mut impl RunVisitor<P>);

    /// Visits the numbers of a list.
    #[inline(always)]
    fn visit_all(list: &mut [Self], visitor: &mut impl RunVisitor<P>) {
        for item in list {
            item.visit(visitor);
        }
    }
}

/// Kind of a single number.
pub struct One;
/// Kind of a struct of numbers, or of an entry without any.
pub struct Struct;
/// Kind of an array, option, list or box of entries of kind K.
pub struct Many<K>(std::marker::PhantomData<K>);

impl<P: Copy> Numbers<P, One> for P {
    type With<Q> = Q;

    fn map<Q>(&self, change: &impl Fn(P) -> Q) -> Q {
        change(*self)
    }

    #[inline(always)]
    fn visit(&mut self, visitor: &mut impl RunVisitor<P>) {
        visitor.visit(std::slice::from_mut(self));
    }

    #[inline(always)]
    fn visit_all(run: &mut [P], visitor: &mut impl RunVisitor<P>) {
        visitor.visit(run);
    }
}

/// Types of a structure without numbers.
macro_rules! no_numbers {
    ($($name:ty),*) => {
        $(impl<P> $crate::lane::Numbers<P, $crate::lane::Struct> for $name {
            type With<Q> = Self;

            fn map<Q>(&self, _: &impl Fn(P) -> Q) -> Self {
                *self
            }

            #[inline(always)]
            fn visit(&mut self, _: &mut impl $crate::lane::RunVisitor<P>) {}
        })*
    };
}
pub(crate) use no_numbers;
no_numbers!(bool, usize);

impl<P, K, N: Numbers<P, K>, const SIZE: usize> Numbers<P, Many<K>> for [N; SIZE] {
    type With<Q> = [N::With<Q>; SIZE];

    fn map<Q>(&self, change: &impl Fn(P) -> Q) -> Self::With<Q> {
        self.each_ref().map(|entry| entry.map(change))
    }

    #[inline(always)]
    fn visit(&mut self, visitor: &mut impl RunVisitor<P>) {
        N::visit_all(self, visitor);
    }
}

impl<P, K, N: Numbers<P, K>> Numbers<P, Many<K>> for Option<N> {
    type With<Q> = Option<N::With<Q>>;

    fn map<Q>(&self, change: &impl Fn(P) -> Q) -> Self::With<Q> {
        self.as_ref().map(|entry| entry.map(change))
    }

    #[inline(always)]
    fn visit(&mut self, visitor: &mut impl RunVisitor<P>) {
        if let Some(entry) = self {
            entry.visit(visitor);
        }
    }
}

impl<P, K, N: Numbers<P, K>> Numbers<P, Many<K>> for Vec<N> {
    type With<Q> = Vec<N::With<Q>>;

    fn map<Q>(&self, change: &impl Fn(P) -> Q) -> Self::With<Q> {
        self.iter().map(|entry| entry.map(change)).collect()
    }

    #[inline(always)]
    fn visit(&mut self, visitor: &mut impl RunVisitor<P>) {
        N::visit_all(self, visitor);
    }
}

impl<P, K, N: Numbers<P, K>> Numbers<P, Many<K>> for Box<N> {
    type With<Q> = Box<N::With<Q>>;

    fn map<Q>(&self, change: &impl Fn(P) -> Q) -> Self::With<Q> {
        Box::new((**self).map(change))
    }

    #[inline(always)]
    fn visit(&mut self, visitor: &mut impl RunVisitor<P>) {
        (**self).visit(visitor);
    }
}

/// Declares a struct or an enum of numbers of the type in its first parameter, with `map` and [`Numbers`].
///
/// A field `name: Type = visit` is visited by that function in place of its own visit; `= unvisited` leaves it out: other numbers
/// determine it. Entries of tuple variants have names, which the declaration alone uses.
macro_rules! numbers {
    ($(#[$meta:meta])* $vis:vis struct $name:ident<$P:ident $(= $default:ty)? $(, $B:ident = $same:ident)?> {
        $($(#[$about:meta])* $access:vis $field:ident: $type:ty $(= $visit:ident)?,)*
    }) => {
        $(#[$meta])*
        $vis struct $name<$P $(= $default)? $(, $B = $same)?> {
            $($(#[$about])* $access $field: $type,)*
        }

        numbers!(@ $name $P change visitor this
            { $name { $($field: $crate::lane::Numbers::<$P, _>::map(&this.$field, change),)* } }
            { $(numbers!(@visit $P &mut this.$field, visitor $(, $visit)?);)* });
    };
    ($(#[$meta:meta])* $vis:vis enum $name:ident<$P:ident> {
        $($(#[$about:meta])* $variant:ident
            $(($($entry:ident: $type:ty),*))?
            $({ $($(#[$doc:meta])* $field:ident: $field_type:ty,)* })?,)*
    }) => {
        $(#[$meta])*
        $vis enum $name<$P> {
            $($(#[$about])* $variant $(($($type),*))? $({ $($(#[$doc])* $field: $field_type,)* })?,)*
        }

        numbers!(@ $name $P change visitor this
            { match this {
                $($name::$variant $(($($entry),*))? $({ $($field),* })? => $name::$variant
                    $(($($crate::lane::Numbers::<$P, _>::map($entry, change)),*))?
                    $({ $($field: $crate::lane::Numbers::<$P, _>::map($field, change)),* })?,)*
            } }
            { match this {
                $($name::$variant $(($($entry),*))? $({ $($field),* })? => {
                    $($(numbers!(@visit $P $entry, visitor);)*)?
                    $($(numbers!(@visit $P $field, visitor);)*)?
                })*
            } });
    };
    (@ $name:ident $P:ident $change:ident $visitor:ident $this:ident $map:block $visit:block) => {
        impl<$P: Copy> $name<$P> {
            /// The same with `change` applied to each number.
            #[allow(dead_code, reason = "entries of other structs are changed by the trait's method")]
            pub fn map<Other>(&self, change: impl Fn($P) -> Other) -> $name<Other> {
                $crate::lane::Numbers::<$P, _>::map(self, &change)
            }
        }

        impl<$P: Copy> $crate::lane::Numbers<$P, $crate::lane::Struct> for $name<$P> {
            type With<Other> = $name<Other>;

            fn map<Other>(&self, $change: &impl Fn($P) -> Other) -> $name<Other> {
                let $this = self;
                $map
            }

            #[inline(always)]
            fn visit(&mut self, $visitor: &mut impl $crate::lane::RunVisitor<$P>) {
                let $this = self;
                $visit
            }
        }
    };
    (@visit $P:ident $numbers:expr, $visitor:ident, unvisited) => {};
    (@visit $P:ident $numbers:expr, $visitor:ident, $visit:ident) => { $visit($numbers, $visitor) };
    (@visit $P:ident $numbers:expr, $visitor:ident) => {
        $crate::lane::Numbers::<$P, _>::visit($numbers, $visitor)
    };
}
pub(crate) use numbers;
