//! The phases of a flight, from alignment on the pad to disarmed on the pad.

/// One phase of a flight.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// At rest on the pad: attitude, biases and the local origin are being estimated.
    Align,
    /// Aligned and armed; the isolation valve opens.
    Ready,
    /// Throttle at idle until the chamber burns.
    Ignition,
    /// Thrust rises, lift-off, climb to the hover height.
    Ascent,
    /// Hover, and the horizontal transfer to the landing point.
    Hover,
    /// Descent from the hover to the terminal height.
    Descent,
    /// Last metres at constant speed, to contact.
    Terminal,
    /// Contact detected, engine commanded off.
    Touchdown,
    /// On the ground, engine off, still armed.
    Shutdown,
    /// Disarmed.
    Done,
    /// Mission given up: descent from where the vehicle is, to the terminal height.
    AbortLand,
    /// Vehicle given up: engine off.
    AbortCut,
}

impl Phase {
    /// All of them, in the order of a flight; the aborts last.
    pub const ALL: [Self; 12] = [
        Self::Align,
        Self::Ready,
        Self::Ignition,
        Self::Ascent,
        Self::Hover,
        Self::Descent,
        Self::Terminal,
        Self::Touchdown,
        Self::Shutdown,
        Self::Done,
        Self::AbortLand,
        Self::AbortCut,
    ];

    /// Name in events: `phase:NAME`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Align => "align",
            Self::Ready => "ready",
            Self::Ignition => "ignition",
            Self::Ascent => "ascent",
            Self::Hover => "hover",
            Self::Descent => "descent",
            Self::Terminal => "terminal",
            Self::Touchdown => "touchdown",
            Self::Shutdown => "shutdown",
            Self::Done => "done",
            Self::AbortLand => "abort_land",
            Self::AbortCut => "abort_cut",
        }
    }

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
