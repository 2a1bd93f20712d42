//! Wind: a mean that may grow with height, turbulence, and discrete gusts of the 1-cos shape.
//!
//! The mean is the same at all heights, or follows the logarithmic law of a neutral surface layer,
//! `ln(h/z0)/ln(h_ref/z0)`, or a power law `(h/h_ref)^p` (Stull, An Introduction to Boundary Layer
//! Meteorology, 1988, chapter 9). Open grass has a roughness length of 0.03 m and an exponent of 1/7. Valid
//! over level uniform ground, from some roughness lengths up to about a hundred metres; below one roughness
//! length there is no wind.
//!
//! A gust rises as U/2 (1 - cos(π t/t_rise)), may hold its peak, and falls by the mirrored law. Source:
//! MIL-F-8785C section 3.7.1.3 for the rising half, 14 CFR 25.341 for the whole bump. A lander hangs in
//! one place, so gusts are functions of time, not of distance flown.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::turbulence::{INTENSITY_HEIGHT_M, Turbulence, TurbulenceParameters};
use crate::frame::Vec3;
use crate::input::Invalid;

/// How the mean wind grows with height.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum WindProfile {
    /// The same at all heights.
    #[default]
    Uniform,
    /// ln(h/z0), as over uniform rough ground in neutral air.
    Logarithmic,
    /// A power of the height.
    Power,
}

/// Wind of a flight: the `[wind]` table of a scenario.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct WindParameters {
    /// Mean speed, level, at the reference height (m/s).
    #[schemars(range(min = 0.0, max = 60.0))]
    pub mean_speed_m_s: f64,
    /// Direction the wind comes from, clockwise from north (deg): 270 is a westerly, blowing east.
    #[schemars(range(min = -360.0, max = 360.0))]
    pub from_deg: f64,
    /// How the mean grows with height.
    pub profile: WindProfile,
    /// Height above the ground at which the mean speed holds (m); a uniform profile has none.
    #[schemars(range(min = 1.0, max = 200.0))]
    pub reference_height_m: f64,
    /// Roughness length of the ground, for the logarithmic profile (m): 0.0002 sea, 0.005 concrete, 0.03 grass, 0.5 trees.
    #[schemars(range(min = 1e-5, max = 0.9))]
    pub roughness_length_m: f64,
    /// Exponent of the power profile.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub power_exponent: f64,
    /// Dryden turbulence on top of the mean; absent: smooth air.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub turbulence: Option<TurbulenceParameters>,
    /// Gusts on top of the mean; they add where they overlap.
    pub gust: Vec<Gust>,
}

impl Default for WindParameters {
    fn default() -> Self {
        Self {
            mean_speed_m_s: 0.0,
            from_deg: 0.0,
            profile: WindProfile::Uniform,
            reference_height_m: 10.0,
            roughness_length_m: 0.03,
            power_exponent: 1.0 / 7.0,
            turbulence: None,
            gust: Vec::new(),
        }
    }
}

impl WindParameters {
    /// Mean speed at a height over that at the reference height.
    fn share(&self, height_m: f64) -> f64 {
        let (h, z0) = (height_m, self.roughness_length_m);
        match self.profile {
            WindProfile::Uniform => 1.0,
            WindProfile::Logarithmic => libm::log(h.max(z0) / z0) / libm::log(self.reference_height_m / z0),
            WindProfile::Power => libm::pow(h.max(0.0) / self.reference_height_m, self.power_exponent),
        }
    }

    /// Wind at 20 ft, which sets the intensity of turbulence (m/s).
    fn at_20_ft_m_s(&self, turbulence: &TurbulenceParameters) -> f64 {
        let mean_m_s = || self.mean_speed_m_s * self.share(INTENSITY_HEIGHT_M);
        turbulence.wind_at_20_ft_m_s.unwrap_or_else(mean_m_s)
    }

    /// # Errors
    /// When a gust ends before it starts, or turbulence has nothing to take its strength from.
    pub fn validate(&self) -> Result<(), Invalid> {
        if let Some(turbulence) = &self.turbulence
            && self.at_20_ft_m_s(turbulence) <= 0.0
        {
            let message = "no wind at 20 ft gives no turbulence: give it here or a mean_speed_m_s, or leave the table out";
            return Err(Invalid::new("turbulence.wind_at_20_ft_m_s", message));
        }
        for (index, gust) in self.gust.iter().enumerate() {
            let duration_s = gust.rise_s + gust.hold_s + gust.fall_s();
            if !duration_s.is_finite() || gust.rise_s < 0.0 || gust.hold_s < 0.0 || gust.fall_s() < 0.0 {
                let message = format!(
                    "rise_s {}, hold_s {} and fall_s {} must be finite and not negative",
                    gust.rise_s,
                    gust.hold_s,
                    gust.fall_s()
                );
                return Err(Invalid::new(format!("gust.{index}"), message));
            }
        }
        Ok(())
    }
}

/// One 1-cos gust: an entry `[[wind.gust]]` of a scenario.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Gust {
    /// Mission time at which it begins, that is since ignition (s).
    #[schemars(range(min = 0.0, max = 3600.0))]
    pub start_s: f64,
    /// From nothing to the peak (s); 0 is a step.
    #[schemars(range(min = 0.0, max = 600.0))]
    pub rise_s: f64,
    /// Time at the peak (s).
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 3600.0))]
    pub hold_s: f64,
    /// From the peak to nothing (s); as long as the rise if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 600.0))]
    pub fall_s: Option<f64>,
    /// Velocity of the air that the gust adds at its peak, NED (m/s).
    #[schemars(inner(range(min = -60.0, max = 60.0)))]
    pub peak_ned_m_s: [f64; 3],
}

impl Gust {
    fn fall_s(&self) -> f64 {
        self.fall_s.unwrap_or(self.rise_s)
    }

    /// Share of the peak at a mission time, 0..1.
    pub fn share(&self, mission_time_s: f64) -> f64 {
        let since_start_s = mission_time_s - self.start_s;
        let until_end_s = self.rise_s + self.hold_s + self.fall_s() - since_start_s;
        one_minus_cos(since_start_s, self.rise_s).min(one_minus_cos(until_end_s, self.fall_s()))
    }
}

/// 0 before zero, 1 after `rise_s`, a half cosine between.
fn one_minus_cos(time_s: f64, rise_s: f64) -> f64 {
    if time_s <= 0.0 {
        0.0
    } else if time_s >= rise_s {
        1.0
    } else {
        0.5 * (1.0 - libm::cos(core::f64::consts::PI * time_s / rise_s))
    }
}

/// Velocity of the air over the pad.
#[derive(Clone, Debug)]
pub struct Wind {
    parameters: WindParameters,
    /// At the reference height.
    mean_ned_m_s: Vec3,
    turbulence: Option<Turbulence>,
    /// On top of all else, at every height.
    added_ned_m_s: Option<Vec3>,
}

impl Wind {
    /// From the parameters of a scenario; turbulence follows from the seed.
    pub fn new(parameters: &WindParameters, seed: u64) -> Self {
        let (sin_from, cos_from) = libm::sincos(parameters.from_deg.to_radians());
        // It blows away from where it comes from.
        let toward_ned = Vec3::new(-cos_from, -sin_from, 0.0);
        Self {
            mean_ned_m_s: -parameters.mean_speed_m_s * Vec3::new(cos_from, sin_from, 0.0),
            turbulence: parameters
                .turbulence
                .as_ref()
                .map(|t| Turbulence::new(parameters.at_20_ft_m_s(t), toward_ned, seed)),
            added_ned_m_s: None,
            parameters: parameters.clone(),
        }
    }

    /// Velocity of the air in NED at a mission time, the time since ignition, and a height above the ground
    /// (m/s). Before ignition the time is negative and there are no gusts.
    pub fn velocity_ned_m_s(&self, mission_time_s: f64, height_m: f64) -> Vec3 {
        let mut velocity = self.mean_ned_m_s(height_m);
        if let Some(turbulence) = &self.turbulence {
            velocity += turbulence.velocity_ned_m_s();
        }
        if let Some(added) = self.added_ned_m_s {
            velocity += added;
        }
        for gust in &self.parameters.gust {
            velocity += Vec3::from(gust.peak_ned_m_s) * gust.share(mission_time_s);
        }
        velocity
    }

    /// From now on this wind blows on top of the scenario's (m/s).
    pub(crate) fn add_ned_m_s(&mut self, velocity_ned_m_s: Option<Vec3>) {
        self.added_ned_m_s = velocity_ned_m_s;
    }

    /// Lets turbulence move on by a time (s), as a vehicle meets it at a height and a velocity. Between steps.
    pub fn advance(&mut self, dt_s: f64, height_m: f64, velocity_ned_m_s: Vec3) {
        let mean_ned_m_s = self.mean_ned_m_s(height_m);
        if let Some(turbulence) = &mut self.turbulence {
            turbulence.advance(dt_s, height_m, (velocity_ned_m_s - mean_ned_m_s).norm());
        }
    }

    fn mean_ned_m_s(&self, height_m: f64) -> Vec3 {
        match self.parameters.profile {
            WindProfile::Uniform => self.mean_ned_m_s,
            _ => self.mean_ned_m_s * self.parameters.share(height_m),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gust(rise_s: f64, hold_s: f64, fall_s: Option<f64>) -> Gust {
        Gust { start_s: 10.0, rise_s, hold_s, fall_s, peak_ned_m_s: [2.0, -4.0, 1.0] }
    }

    /// U/2 (1 - cos(2 pi t / duration)) over a whole bump; equal to rounding.
    #[test]
    fn a_gust_without_hold_is_one_whole_cosine() {
        let wind = Wind::new(&WindParameters { gust: vec![gust(1.5, 0.0, None)], ..Default::default() }, 1);
        for k in -10..50 {
            let t = 0.1 * f64::from(k); // [s] since the start
            let phase = core::f64::consts::TAU * t / 3.0;
            let share = if (0.0..3.0).contains(&t) { 0.5 * (1.0 - libm::cos(phase)) } else { 0.0 };
            let expected = Vec3::new(2.0, -4.0, 1.0) * share;
            assert!((wind.velocity_ned_m_s(10.0 + t, 5.0) - expected).amax() < 1e-13, "{t}");
        }
    }

    #[test]
    fn a_gust_holds_its_peak_and_falls_by_its_own_time() {
        let gust = gust(1.0, 2.0, Some(4.0));
        let shares = [0.0, 0.5, 1.0, 1.0, 0.5, 0.0];
        for (t, share) in [0.0, 0.5, 1.0, 3.0, 5.0, 7.0].into_iter().zip(shares) {
            assert!((gust.share(10.0 + t) - share).abs() < 1e-15, "{t}");
        }
        assert_eq!(gust.share(-1.0), 0.0);
    }

    #[test]
    fn a_rise_of_zero_is_a_step() {
        let gust = gust(0.0, 1.0, None);
        assert_eq!([9.999, 10.001, 10.999, 11.001].map(|t| gust.share(t)), [0.0, 1.0, 1.0, 0.0]);
    }

    #[test]
    fn a_westerly_blows_east() {
        let wind =
            Wind::new(&WindParameters { mean_speed_m_s: 5.0, from_deg: 270.0, ..Default::default() }, 1);
        assert!((wind.velocity_ned_m_s(0.0, 3.0) - Vec3::new(0.0, 5.0, 0.0)).amax() < 1e-14);
    }

    /// The mean holds at the reference height. A logarithmic wind gains the same over each doubling of the height,
    /// a power law grows by the same factor; both are still on the ground.
    #[test]
    fn the_mean_grows_with_height_by_its_law() {
        let speed = |profile, height_m: f64| {
            let parameters =
                WindParameters { mean_speed_m_s: 6.0, profile, power_exponent: 0.25, ..Default::default() };
            Wind::new(&parameters, 1).velocity_ned_m_s(0.0, height_m).norm()
        };
        for profile in [WindProfile::Uniform, WindProfile::Logarithmic, WindProfile::Power] {
            assert!((speed(profile, 10.0) - 6.0).abs() < 1e-14);
        }
        assert_eq!(speed(WindProfile::Uniform, 0.0), speed(WindProfile::Uniform, 80.0));
        let log = |height_m| speed(WindProfile::Logarithmic, height_m);
        let gain = 6.0 * libm::log(2.0) / libm::log(10.0 / 0.03);
        assert!((log(8.0) - log(4.0) - gain).abs() < 1e-13 && (log(64.0) - log(32.0) - gain).abs() < 1e-13);
        assert_eq!(log(0.03), 0.0);
        assert_eq!(log(-1.0), 0.0);
        assert!((speed(WindProfile::Power, 160.0) - 12.0).abs() < 1e-13);
        assert_eq!(speed(WindProfile::Power, -1.0), 0.0);
    }

    #[test]
    fn a_negative_rise_is_named() {
        let wind =
            WindParameters { gust: vec![gust(1.0, 0.0, None), gust(-1.0, 0.0, None)], ..Default::default() };
        assert_eq!(wind.validate().unwrap_err().key, "gust.1");
    }

    #[test]
    fn turbulence_without_wind_is_named() {
        let wind = |mean_speed_m_s, wind_at_20_ft_m_s| WindParameters {
            mean_speed_m_s,
            turbulence: Some(TurbulenceParameters { wind_at_20_ft_m_s }),
            ..Default::default()
        };
        for calm in [wind(0.0, None), wind(4.0, Some(0.0))] {
            assert_eq!(calm.validate().unwrap_err().key, "turbulence.wind_at_20_ft_m_s");
        }
        assert!(wind(4.0, None).validate().is_ok() && wind(0.0, Some(6.0)).validate().is_ok());
    }
}
