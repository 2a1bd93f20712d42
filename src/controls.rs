//! `controls[16]`: what the sixteen numbers of a flight controller mean, the `[controls]` table of a
//! vehicle file, and both directions of that map.
//!
//! A channel maps its `range` linearly onto 0..1 (throttle, one-sided thrusters) or -1..1 (gimbal, roll);
//! values beyond the range are clamped to it, `polarity = -1` reverses what moves both ways. So a
//! controller that speaks radians or newtons only states its range. A switch is on above its threshold.
//! With the channels of the reference vehicle, sixteen zeros are safe.

use crate::input::Invalid;
use crate::signal::{ActuatorCommand, Discrete, Throttle};
use crate::time::SimTime;

/// Number of channels in one command of the flight controller.
pub const CHANNEL_COUNT: usize = 16;

/// The `[controls]` table of a vehicle file.
#[derive(Clone, Debug, PartialEq, serde::Deserialize, serde::Serialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Controls {
    /// What the throttle channel commands; absent: the profile of the flight controller decides.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub throttle: Option<ThrottleKind>,
    /// Which channel moves what.
    pub channels: Channels,
}

/// What a throttle of 1 stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize, serde::Serialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ThrottleKind {
    /// The vehicle's `thrust_rated_n`; the plant's engine controller finds the valve angle.
    Thrust,
    /// The valve's `open_angle_rad`.
    Valve,
}

/// The `[controls.channels]` table.
#[derive(Clone, Debug, PartialEq, serde::Deserialize, serde::Serialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Channels {
    /// Engine, range onto 0..1.
    pub throttle: Channel,
    /// Gimbal moment about FRD x, range onto -1..1 of the gimbal limit.
    pub gimbal_x: Channel,
    /// Gimbal moment about FRD y, range onto -1..1 of the gimbal limit.
    pub gimbal_y: Channel,
    /// Roll thrusters about FRD z, range onto -1..1; onto 0..1 when `rcs_roll_negative` is there.
    pub rcs_roll: Channel,
    /// Thrusters against `rcs_roll` on a channel of their own, range onto 0..1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rcs_roll_negative: Option<Channel>,
    /// Igniter; absent: always off.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub igniter: Option<Switch>,
    /// Oxidiser isolation valve, on = open; absent: always shut.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub oxidizer_isolation: Option<Switch>,
    /// Run-tank vent, on = shut, since it is open without power; absent: always open.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub vent: Option<Switch>,
    /// Hold-down release; absent: always held.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hold_down_release: Option<Switch>,
    /// Echo of the last sample seen, by which the bench measures the round trip whatever clock the flight controller
    /// has: the milliseconds of its time within the second, 0..999, in thousandths of the range. Moves nothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub echo: Option<Channel>,
}

/// One continuous channel.
#[derive(Clone, Copy, Debug, PartialEq, serde::Deserialize, serde::Serialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Channel {
    /// Place in `controls[16]`, from 0.
    #[schemars(range(min = 0, max = 15))]
    pub index: usize,
    /// Least and greatest value that the flight controller sends, in its own unit.
    #[schemars(inner(range(min = -1e6, max = 1e6)))]
    pub range: [f64; 2],
    /// 1, or -1 to reverse the direction; -1 only for channels that move both ways.
    #[serde(default = "forward")]
    #[schemars(range(min = -1, max = 1))]
    pub polarity: i8,
}

/// One on-off channel.
#[derive(Clone, Copy, Debug, PartialEq, serde::Deserialize, serde::Serialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Switch {
    /// Place in `controls[16]`, from 0.
    #[schemars(range(min = 0, max = 15))]
    pub index: usize,
    /// Off and on value that the flight controller sends.
    #[serde(default = "unit_range")]
    #[schemars(inner(range(min = -1e6, max = 1e6)))]
    pub range: [f64; 2],
    /// On above this value.
    #[schemars(range(min = -1e6, max = 1e6))]
    pub on_above: f64,
}

/// What one unit of a normalised command is worth on this vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    /// Thrust at throttle 1 (N).
    pub thrust_rated_n: f64,
    /// Valve angle at throttle 1 (rad).
    pub valve_open_rad: f64,
    /// Gimbal angle at 1 (rad).
    pub gimbal_limit_rad: f64,
}

/// A channel that carried no number.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("controls[{index}] is {value}")]
pub struct NotFinite {
    /// Place in `controls[16]`.
    pub index: usize,
    /// NaN or an infinity.
    pub value: f64,
}

impl Controls {
    /// The command in `controls`, or the first mapped channel that holds no finite number.
    ///
    /// `default_throttle` is the profile's, used when the vehicle file does not choose.
    pub fn command(
        &self,
        controls: &[f64; CHANNEL_COUNT],
        armed: bool,
        default_throttle: ThrottleKind,
        scale: &Scale,
    ) -> Result<ActuatorCommand, NotFinite> {
        let c = &self.channels;
        let throttle = c.throttle.fraction(controls)?;
        let roll = match &c.rcs_roll_negative {
            None => c.rcs_roll.deflection(controls)?,
            Some(negative) => c.rcs_roll.fraction(controls)? - negative.fraction(controls)?,
        };
        Ok(ActuatorCommand {
            armed,
            throttle: match self.throttle.unwrap_or(default_throttle) {
                ThrottleKind::Thrust => Throttle::ThrustN(throttle * scale.thrust_rated_n),
                ThrottleKind::Valve => Throttle::ValveRad(throttle * scale.valve_open_rad),
            },
            gimbal_x_rad: c.gimbal_x.deflection(controls)? * scale.gimbal_limit_rad,
            gimbal_y_rad: c.gimbal_y.deflection(controls)? * scale.gimbal_limit_rad,
            rcs_roll: roll,
            discrete: Discrete {
                igniter: is_on(&c.igniter, controls)?,
                isolation_open: is_on(&c.oxidizer_isolation, controls)?,
                vent_shut: is_on(&c.vent, controls)?,
                hold_down_released: is_on(&c.hold_down_release, controls)?,
            },
        })
    }

    /// The sixteen numbers that mean `command`; disarmed they are all zero. The throttle is written in the
    /// language of the command itself: see [`Controls::speaks`] for whether the other side will read it so.
    pub fn encode(&self, command: &ActuatorCommand, scale: &Scale) -> [f64; CHANNEL_COUNT] {
        let mut controls = [0.0; CHANNEL_COUNT];
        if !command.armed {
            return controls;
        }
        let c = &self.channels;
        let throttle = match command.throttle {
            Throttle::ThrustN(thrust_n) => thrust_n / scale.thrust_rated_n,
            Throttle::ValveRad(valve_rad) => valve_rad / scale.valve_open_rad,
        };
        c.throttle.set_fraction(&mut controls, throttle);
        c.gimbal_x.set_deflection(&mut controls, command.gimbal_x_rad / scale.gimbal_limit_rad);
        c.gimbal_y.set_deflection(&mut controls, command.gimbal_y_rad / scale.gimbal_limit_rad);
        match &c.rcs_roll_negative {
            None => c.rcs_roll.set_deflection(&mut controls, command.rcs_roll),
            Some(negative) => {
                c.rcs_roll.set_fraction(&mut controls, command.rcs_roll);
                negative.set_fraction(&mut controls, -command.rcs_roll);
            }
        }
        let discrete = &command.discrete;
        for (switch, on) in [
            (&c.igniter, discrete.igniter),
            (&c.oxidizer_isolation, discrete.isolation_open),
            (&c.vent, discrete.vent_shut),
            (&c.hold_down_release, discrete.hold_down_released),
        ] {
            if let Some(switch) = switch {
                controls[switch.index] = switch.range[usize::from(on)];
            }
        }
        controls
    }

    /// What the throttle channel commands when the profile's choice is `default_throttle`.
    pub fn speaks(&self, default_throttle: ThrottleKind) -> ThrottleKind {
        self.throttle.unwrap_or(default_throttle)
    }

    /// Writes the echo of the sample of `time`, where there is such a channel.
    pub fn set_echo(&self, controls: &mut [f64; CHANNEL_COUNT], time: SimTime) {
        if let Some(channel) = &self.channels.echo {
            channel.set_fraction(controls, (time.us() / 1000 % 1000) as f64 * 1e-3);
        }
    }

    /// Milliseconds within the second of the sample that `controls` echo; `None` without such a channel, or when it
    /// holds anything but thousandths of its range.
    pub fn echo_ms(&self, controls: &[f64; CHANNEL_COUNT]) -> Option<u64> {
        let channel = self.channels.echo?;
        let [low, high] = channel.range;
        let thousandths = (controls[channel.index] - low) / (high - low) * 1000.0;
        let nearest = thousandths.round();
        // A channel is a 32-bit number on the wire: 6e-5 of a thousandth.
        let whole = (thousandths - nearest).abs() < 0.01 && (0.0..1000.0).contains(&nearest);
        whole.then_some(nearest as u64)
    }

    /// Two channels on one index, an empty range, a polarity of 0, a threshold that cannot be passed.
    pub fn validate(&self) -> Result<(), Invalid> {
        let mut owner: [Option<&str>; CHANNEL_COUNT] = [None; CHANNEL_COUNT];
        let c = &self.channels;
        let both_ways = c.rcs_roll_negative.is_none();
        let channels = [
            ("throttle", Some(&c.throttle), false),
            ("gimbal_x", Some(&c.gimbal_x), true),
            ("gimbal_y", Some(&c.gimbal_y), true),
            ("rcs_roll", Some(&c.rcs_roll), both_ways),
            ("rcs_roll_negative", c.rcs_roll_negative.as_ref(), false),
            ("echo", c.echo.as_ref(), false),
        ];
        for (name, channel, reversible) in channels {
            let Some(channel) = channel else { continue };
            claim(&mut owner, name, channel.index)?;
            let [low, high] = channel.range;
            if low >= high {
                return Err(Invalid::new(
                    format!("channels.{name}.range"),
                    format!("{low} is not below {high}"),
                ));
            }
            if !(channel.polarity == 1 || reversible && channel.polarity == -1) {
                let allowed = if reversible { "1 or -1" } else { "1" };
                return Err(Invalid::new(
                    format!("channels.{name}.polarity"),
                    format!("{} is not {allowed}", channel.polarity),
                ));
            }
        }
        let switches = [
            ("igniter", &c.igniter),
            ("oxidizer_isolation", &c.oxidizer_isolation),
            ("vent", &c.vent),
            ("hold_down_release", &c.hold_down_release),
        ];
        for (name, switch) in switches {
            let Some(switch) = switch else { continue };
            claim(&mut owner, name, switch.index)?;
            let [off, on] = switch.range;
            if !(off <= switch.on_above && switch.on_above < on) {
                return Err(Invalid::new(
                    format!("channels.{name}.on_above"),
                    format!("{} is not in {off}..{on}", switch.on_above),
                ));
            }
        }
        Ok(())
    }
}

impl Channel {
    /// Place within the range, 0..1.
    fn fraction(&self, controls: &[f64; CHANNEL_COUNT]) -> Result<f64, NotFinite> {
        let [low, high] = self.range;
        Ok(((finite(controls, self.index)? - low) / (high - low)).clamp(0.0, 1.0))
    }

    /// Place within the range, -1..1, with the polarity.
    fn deflection(&self, controls: &[f64; CHANNEL_COUNT]) -> Result<f64, NotFinite> {
        Ok((2.0 * self.fraction(controls)? - 1.0) * f64::from(self.polarity))
    }

    fn set_fraction(&self, controls: &mut [f64; CHANNEL_COUNT], fraction: f64) {
        let [low, high] = self.range;
        controls[self.index] = low + fraction.clamp(0.0, 1.0) * (high - low);
    }

    fn set_deflection(&self, controls: &mut [f64; CHANNEL_COUNT], deflection: f64) {
        self.set_fraction(controls, 0.5 * (deflection * f64::from(self.polarity) + 1.0));
    }
}

fn is_on(switch: &Option<Switch>, controls: &[f64; CHANNEL_COUNT]) -> Result<bool, NotFinite> {
    match switch {
        None => Ok(false),
        Some(switch) => Ok(finite(controls, switch.index)? > switch.on_above),
    }
}

fn finite(controls: &[f64; CHANNEL_COUNT], index: usize) -> Result<f64, NotFinite> {
    let value = controls[index];
    if value.is_finite() { Ok(value) } else { Err(NotFinite { index, value }) }
}

fn claim<'a>(
    owner: &mut [Option<&'a str>; CHANNEL_COUNT],
    name: &'a str,
    index: usize,
) -> Result<(), Invalid> {
    let key = || format!("channels.{name}.index");
    let Some(place) = owner.get_mut(index) else {
        return Err(Invalid::new(key(), format!("{index} is not in 0..{}", CHANNEL_COUNT - 1)));
    };
    if let Some(other) = place.replace(name) {
        return Err(Invalid::new(key(), format!("{index} is taken by {other}")));
    }
    Ok(())
}

fn forward() -> i8 {
    1
}

fn unit_range() -> [f64; 2] {
    [0.0, 1.0]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SCALE: Scale = Scale { thrust_rated_n: 1000.0, valve_open_rad: 1.376, gimbal_limit_rad: 0.122 };
    const REFERENCE: &str = "
        [channels]
        throttle            = { index = 0, range = [0.0, 1.0] }
        gimbal_x            = { index = 1, range = [-1.0, 1.0], polarity = 1 }
        gimbal_y            = { index = 2, range = [-1.0, 1.0], polarity = 1 }
        rcs_roll            = { index = 3, range = [-1.0, 1.0], polarity = 1 }
        igniter             = { index = 4, range = [0.0, 1.0], on_above = 0.5 }
        oxidizer_isolation  = { index = 5, range = [0.0, 1.0], on_above = 0.5 }
        vent                = { index = 6, range = [0.0, 1.0], on_above = 0.5 }
        hold_down_release   = { index = 7, range = [0.0, 1.0], on_above = 0.5 }
        echo                = { index = 15, range = [0.0, 1.0] }";

    fn reference() -> Controls {
        toml::from_str(REFERENCE).unwrap()
    }

    #[test]
    fn an_echo_comes_back_from_any_range_and_nothing_else_is_one() {
        for range in [[0.0, 1.0], [-1.0, 1.0], [1000.0, 2000.0]] {
            let mut map = reference();
            map.channels.echo = Some(Channel { index: 15, range, polarity: 1 });
            for ms in [0, 4, 500, 999, 1000, 61_996] {
                let mut controls = [0.0; 16];
                map.set_echo(&mut controls, SimTime::from_us(1000 * ms));
                // As it comes from the wire.
                controls[15] = f64::from(controls[15] as f32);
                assert_eq!(map.echo_ms(&controls), Some(ms % 1000), "{range:?}");
            }
            for other in
                [range[0] - 0.5, range[1] + 0.5, f64::NAN, range[0] + 0.000_25 * (range[1] - range[0])]
            {
                let mut controls = [0.0; 16];
                controls[15] = other;
                assert_eq!(map.echo_ms(&controls), None, "{other}");
            }
        }
    }

    #[test]
    fn sixteen_zeros_are_safe() {
        let command = reference().command(&[0.0; 16], false, ThrottleKind::Valve, &SCALE).unwrap();
        assert_eq!(command, ActuatorCommand::SAFE);
    }

    #[test]
    fn a_controller_may_speak_newtons_radians_and_two_roll_channels() {
        let text = "
            throttle = \"thrust\"
            [channels]
            throttle = { index = 3, range = [0.0, 1000.0] }
            gimbal_x = { index = 0, range = [-0.122, 0.122], polarity = -1 }
            gimbal_y = { index = 1, range = [-0.122, 0.122] }
            rcs_roll = { index = 4, range = [0.0, 1.0] }
            rcs_roll_negative = { index = 5, range = [0.0, 1.0] }";
        let map: Controls = toml::from_str(text).unwrap();
        map.validate().unwrap();
        let mut controls = [0.0; 16];
        (controls[0], controls[3], controls[5]) = (0.05, 640.0, 0.25);
        let command = map.command(&controls, true, ThrottleKind::Valve, &SCALE).unwrap();
        assert_eq!(command.throttle, Throttle::ThrustN(640.0));
        assert!((command.gimbal_x_rad + 0.05).abs() < 1e-15, "{}", command.gimbal_x_rad);
        assert_eq!(command.rcs_roll, -0.25);
        assert_eq!(command.discrete, Discrete::SAFE);
    }

    #[test]
    fn what_is_no_number_is_refused_with_its_place() {
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let mut controls = [0.0; 16];
            controls[9] = value; // moves nothing
            assert!(reference().command(&controls, true, ThrottleKind::Thrust, &SCALE).is_ok());
            controls[2] = value;
            let refused = reference().command(&controls, true, ThrottleKind::Thrust, &SCALE).unwrap_err();
            assert_eq!(refused.index, 2);
        }
    }

    #[test]
    fn contradictions_are_named() {
        let mut shared = reference();
        shared.channels.gimbal_y.index = 1;
        assert_eq!(
            shared.validate().unwrap_err().to_string(),
            "channels.gimbal_y.index: 1 is taken by gimbal_x"
        );
        let mut empty = reference();
        empty.channels.throttle.range = [1.0, 1.0];
        assert_eq!(empty.validate().unwrap_err().key, "channels.throttle.range");
        let mut deaf = reference();
        deaf.channels.vent.as_mut().unwrap().on_above = 1.0;
        assert_eq!(deaf.validate().unwrap_err().key, "channels.vent.on_above");
        let mut still = reference();
        still.channels.rcs_roll.polarity = 0;
        assert_eq!(still.validate().unwrap_err().key, "channels.rcs_roll.polarity");
    }

    proptest! {
        // Tolerance: a few roundings of a 53-bit number of order 1.
        #[test]
        fn decoding_undoes_encoding(
            thrust_n in 0.0..1000.0f64, x in -0.122..0.122f64, y in -0.122..0.122f64, roll in -1.0..1.0f64,
        ) {
            let command = ActuatorCommand {
                armed: true, throttle: Throttle::ThrustN(thrust_n), gimbal_x_rad: x, gimbal_y_rad: y,
                rcs_roll: roll, discrete: Discrete::FLIGHT,
            };
            let map = reference();
            let back = map.command(&map.encode(&command, &SCALE), true, ThrottleKind::Thrust, &SCALE).unwrap();
            let Throttle::ThrustN(thrust_back_n) = back.throttle else { panic!("language changed") };
            prop_assert!((thrust_back_n - thrust_n).abs() < 1e-12 * 1000.0);
            prop_assert!((back.gimbal_x_rad - x).abs() < 1e-15);
            prop_assert!((back.gimbal_y_rad - y).abs() < 1e-15);
            prop_assert!((back.rcs_roll - roll).abs() < 1e-15);
            prop_assert_eq!(back.discrete, command.discrete);
        }
    }
}
