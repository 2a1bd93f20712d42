//! Closed forms.

mod px4;
