//! The channels of a vehicle, as far as somebody who listens to its flight controller can judge them.

use hopbench::controls::Controls;
use hopbench::scenario::SequenceSource;

/// One channel of a vehicle's map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MappedChannel {
    /// Its key in `[controls.channels]`.
    pub name: &'static str,
    /// Place in `controls[16]`.
    pub index: usize,
    /// What the flight controller should send.
    pub range: [f64; 2],
    /// What is expected of it.
    pub role: ChannelUse,
}

/// What is expected of a channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChannelUse {
    /// A controller that flies moves it all the time.
    Steering,
    /// It is read, and may stand still.
    Auxiliary,
    /// Nobody reads it in this scenario.
    Unread,
}

/// The channels of a vehicle; the switches are read only when the sequence comes from the controls.
pub fn mapped_channels(controls: &Controls, source: SequenceSource) -> Vec<MappedChannel> {
    let c = &controls.channels;
    let steering = [
        ("throttle", Some(c.throttle), ChannelUse::Steering),
        ("gimbal_x", Some(c.gimbal_x), ChannelUse::Steering),
        ("gimbal_y", Some(c.gimbal_y), ChannelUse::Steering),
        ("rcs_roll", Some(c.rcs_roll), ChannelUse::Steering),
        ("rcs_roll_negative", c.rcs_roll_negative, ChannelUse::Steering),
        ("echo", c.echo, ChannelUse::Auxiliary),
    ];
    let role = if source == SequenceSource::Controls { ChannelUse::Auxiliary } else { ChannelUse::Unread };
    let switches = [
        ("igniter", c.igniter),
        ("oxidizer_isolation", c.oxidizer_isolation),
        ("vent", c.vent),
        ("hold_down_release", c.hold_down_release),
    ];
    let steering = steering.into_iter().filter_map(|(name, channel, role)| {
        channel.map(|c| MappedChannel { name, index: c.index, range: c.range, role })
    });
    let switches = switches.into_iter().filter_map(|(name, switch)| {
        switch.map(|s| MappedChannel { name, index: s.index, range: s.range, role })
    });
    steering.chain(switches).collect()
}
