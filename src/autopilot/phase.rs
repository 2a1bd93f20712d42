//! The phases of a flight, from alignment on the pad to disarmed on the pad.

pub use crate::event::Phase;

impl Phase {
    /// The vehicle flies under feedback control.
    pub const fn is_flight(self) -> bool {
        matches!(self, Self::Ascent | Self::Hover | Self::Descent | Self::Terminal | Self::AbortLand)
    }

    /// The vehicle descends to the ground under feedback control.
    pub const fn is_descent(self) -> bool {
        matches!(self, Self::Descent | Self::Terminal | Self::AbortLand)
    }

    /// The engine has not been commanded to lift yet: the vehicle certainly stands on the pad.
    pub const fn is_before_lift_off(self) -> bool {
        matches!(self, Self::Align | Self::Ready | Self::Ignition)
    }
}
