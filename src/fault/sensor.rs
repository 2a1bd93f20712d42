//! Faults of sensors: what becomes of a finished measurement.
//!
//! A fault acts on samples, at the rate of its sensor: where there is no new sample there is nothing to
//! spoil. Only a late one comes when it is due, with the next measurement. Positions are shifted on a sphere
//! of the Earth's mean radius, which is good to 0.6 % of the shift.

use std::collections::VecDeque;

use super::{Acting, Axis, Component, Mode};
use crate::environment::atmosphere::pressure_altitude_m;
use crate::frame::Vec3;
use crate::noise::Stream;
use crate::signal::{
    AltimeterSample, BarometerSample, BrokenImu, GnssFix, ImuSample, Measurement, TrackingSample,
};
use crate::time::SimTime;

/// Mean radius of the Earth (m), IUGG.
const EARTH_RADIUS_M: f64 = 6_371_008.8;
/// Height in which the plume's push on the barometer falls by e (m): a chosen shape; jets at a plate decay
/// within some ten nozzle diameters.
const PLUME_REACH_M: f64 = 1.0;

/// What the plume depends on.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Scene {
    /// Pivot above its rest height (m).
    pub(super) height_m: f64,
    /// The engine burns.
    pub(super) lit: bool,
    /// Thrust (N).
    pub(super) thrust_n: f64,
}

/// What one fault keeps while it acts.
#[derive(Clone, Debug)]
pub(super) struct Memory {
    stream: Stream,
    /// The sample at which a stuck sensor stays.
    held: Option<Sample>,
    /// Samples on their way, and when they are due; no more than the longest delay holds.
    late: VecDeque<(SimTime, Sample)>,
}

/// One sample of one sensor.
#[derive(Clone, Copy, Debug)]
enum Sample {
    Vector(Vec3),
    Barometer(BarometerSample),
    Gnss(GnssFix),
    Altimeter(AltimeterSample),
    Tracking(TrackingSample),
    Pressure(f64),
}

/// Lets faults, in order, act on a measurement.
pub(super) fn spoil<'a>(
    faults: impl Iterator<Item = (&'a Acting, &'a mut Memory)>,
    scene: &Scene,
    measurement: &mut Measurement,
) {
    // Halves of the inertial unit break apart, and come together again if both are left.
    if let Some(imu) = measurement.imu.take() {
        measurement.broken_imu = Some(BrokenImu {
            specific_force_body_m_s2: Some(imu.specific_force_body_m_s2),
            rate_body_rad_s: Some(imu.rate_body_rad_s),
            interval_s: imu.interval_s,
            temperature_k: imu.temperature_k,
        });
    }
    for (acting, memory) in faults {
        let sample = get(acting.component, measurement);
        let spoilt = memory.spoil(acting, scene, measurement.time, sample);
        set(acting.component, measurement, spoilt);
    }
    if let Some(unit) = measurement.broken_imu
        && let (Some(specific_force_body_m_s2), Some(rate_body_rad_s)) =
            (unit.specific_force_body_m_s2, unit.rate_body_rad_s)
    {
        let BrokenImu { interval_s, temperature_k, .. } = unit;
        measurement.imu =
            Some(ImuSample { specific_force_body_m_s2, rate_body_rad_s, interval_s, temperature_k });
        measurement.broken_imu = None;
    }
}

impl Memory {
    pub(super) fn new(stream: Stream) -> Self {
        Self { stream, held: None, late: VecDeque::new() }
    }

    /// What a fault makes of a sample, or of none, at the time of a measurement.
    fn spoil(
        &mut self,
        acting: &Acting,
        scene: &Scene,
        time: SimTime,
        sample: Option<Sample>,
    ) -> Option<Sample> {
        if acting.mode == Mode::Delay {
            self.late.extend(sample.map(|sample| (time + SimTime::from_s(acting.value), sample)));
            let mut newest = None;
            while self.late.front().is_some_and(|(due, _)| *due <= time) {
                newest = self.late.pop_front();
            }
            return newest.map(|(_, sample)| sample);
        }
        let (sample, value) = (sample?, acting.value);
        match acting.mode {
            Mode::Stuck => Some(*self.held.get_or_insert(sample)),
            Mode::Intermittent => (self.stream.uniform() > value).then_some(sample),
            Mode::Scale => Some(sample.changed(acting.axis, |reading| reading * value)),
            Mode::Bias | Mode::Jump => Some(sample.shifted(acting.axis, || value)),
            Mode::Drift => {
                let error = value * time.since(acting.since).s();
                Some(sample.shifted(acting.axis, || error))
            }
            Mode::Noise => Some(sample.shifted(acting.axis, || value * self.stream.normal())),
            Mode::Garbage => Some(self.garbage(acting, sample)),
            Mode::Plume => Some(self.plume(value, scene, sample)),
            _ => None, // off: the catalogue has nothing else for a sensor
        }
    }

    fn garbage(&mut self, acting: &Acting, sample: Sample) -> Sample {
        let value = acting.value;
        let mut either_way = || value * (2.0 * self.stream.uniform() - 1.0);
        match sample {
            Sample::Vector(_) => sample.changed(acting.axis, |_| either_way()),
            Sample::Gnss(_) | Sample::Tracking(_) => sample.shifted(acting.axis, either_way),
            Sample::Barometer(_) | Sample::Pressure(_) => sample.changed(None, |_| either_way().abs()),
            Sample::Altimeter(altimeter) => {
                let any = AltimeterSample { range_m: Some(altimeter.minimum_m), ..altimeter };
                Sample::Altimeter(any).changed(None, |_| either_way().abs())
            }
        }
    }

    fn plume(&mut self, value: f64, scene: &Scene, sample: Sample) -> Sample {
        match sample {
            Sample::Altimeter(altimeter) if scene.lit && scene.height_m < value => {
                let (missing, share) = (self.stream.uniform() > 0.5, self.stream.uniform());
                let least_m = altimeter.minimum_m;
                let range_m =
                    altimeter.range_m.filter(|_| !missing).map(|true_m| least_m + share * (true_m - least_m));
                Sample::Altimeter(AltimeterSample { range_m, ..altimeter })
            }
            Sample::Barometer(_) => {
                let near = libm::exp(-scene.height_m.max(0.0) / PLUME_REACH_M);
                sample.shifted(None, || value * scene.thrust_n / 1e3 * near) // Pa per kN
            }
            _ => sample,
        }
    }
}

impl Sample {
    /// With an error added along an axis or along each.
    fn shifted(self, axis: Option<Axis>, mut error: impl FnMut() -> f64) -> Self {
        match self {
            Self::Gnss(mut fix) => {
                let mut off = Vec3::zeros();
                each(axis, |i| off[i] = error());
                let parallel_m = EARTH_RADIUS_M * libm::cos(fix.latitude_rad).max(1e-6);
                fix.latitude_rad += off.x / EARTH_RADIUS_M;
                fix.longitude_rad += off.y / parallel_m;
                fix.altitude_m -= off.z;
                Self::Gnss(fix)
            }
            _ => self.changed(axis, |reading| reading + error()),
        }
    }

    /// With readings changed along an axis or along each; a fix of satellite navigation has no readings of
    /// that kind.
    fn changed(self, axis: Option<Axis>, mut change: impl FnMut(f64) -> f64) -> Self {
        match self {
            Self::Vector(mut vector) => {
                each(axis, |i| vector[i] = change(vector[i]));
                Self::Vector(vector)
            }
            Self::Tracking(mut tracking) => {
                let position = &mut tracking.position_ned_m;
                each(axis, |i| position[i] = change(position[i]));
                Self::Tracking(tracking)
            }
            Self::Barometer(barometer) => {
                let pressure_pa = change(barometer.pressure_pa).max(0.0);
                let pressure_altitude_m = pressure_altitude_m(pressure_pa);
                Self::Barometer(BarometerSample { pressure_pa, pressure_altitude_m, ..barometer })
            }
            Self::Altimeter(altimeter) => {
                // Beyond its limits the instrument reports no range.
                let limits = altimeter.minimum_m..=altimeter.maximum_m;
                let range_m = altimeter.range_m.map(change).filter(|range_m| limits.contains(range_m));
                Self::Altimeter(AltimeterSample { range_m, ..altimeter })
            }
            Self::Pressure(pressure_pa) => Self::Pressure(change(pressure_pa)),
            Self::Gnss(_) => self,
        }
    }
}

fn each(axis: Option<Axis>, mut act: impl FnMut(usize)) {
    match axis {
        Some(axis) => act(axis as usize),
        None => (0..3).for_each(act),
    }
}

fn get(component: Component, m: &Measurement) -> Option<Sample> {
    match component {
        Component::Accelerometer => m.broken_imu?.specific_force_body_m_s2.map(Sample::Vector),
        Component::Gyroscope => m.broken_imu?.rate_body_rad_s.map(Sample::Vector),
        Component::Magnetometer => m.magnetic_field_body_t.map(Sample::Vector),
        Component::Barometer => m.barometer.map(Sample::Barometer),
        Component::Gnss => m.gnss.map(Sample::Gnss),
        Component::Altimeter => m.altimeter.map(Sample::Altimeter),
        Component::Tracking => m.tracking.map(Sample::Tracking),
        Component::PressureTank => m.pressures.tank_pa.map(Sample::Pressure),
        Component::PressureBottle => m.pressures.bottle_pa.map(Sample::Pressure),
        Component::PressureInjectorInlet => m.pressures.injector_inlet_pa.map(Sample::Pressure),
        Component::PressureChamber => m.pressures.chamber_pa.map(Sample::Pressure),
        _ => None,
    }
}

fn set(component: Component, m: &mut Measurement, sample: Option<Sample>) {
    let vector = match sample {
        Some(Sample::Vector(vector)) => Some(vector),
        _ => None,
    };
    let pressure_pa = match sample {
        Some(Sample::Pressure(pressure_pa)) => Some(pressure_pa),
        _ => None,
    };
    match (component, sample) {
        (Component::Accelerometer, _) => {
            if let Some(unit) = &mut m.broken_imu {
                unit.specific_force_body_m_s2 = vector;
            }
        }
        (Component::Gyroscope, _) => {
            if let Some(unit) = &mut m.broken_imu {
                unit.rate_body_rad_s = vector;
            }
        }
        (Component::Magnetometer, _) => m.magnetic_field_body_t = vector,
        (Component::Barometer, Some(Sample::Barometer(barometer))) => m.barometer = Some(barometer),
        (Component::Barometer, _) => m.barometer = None,
        (Component::Gnss, Some(Sample::Gnss(fix))) => m.gnss = Some(fix),
        (Component::Gnss, _) => m.gnss = None,
        (Component::Altimeter, Some(Sample::Altimeter(altimeter))) => m.altimeter = Some(altimeter),
        (Component::Altimeter, _) => m.altimeter = None,
        (Component::Tracking, Some(Sample::Tracking(tracking))) => m.tracking = Some(tracking),
        (Component::Tracking, _) => m.tracking = None,
        (Component::PressureTank, _) => m.pressures.tank_pa = pressure_pa,
        (Component::PressureBottle, _) => m.pressures.bottle_pa = pressure_pa,
        (Component::PressureInjectorInlet, _) => m.pressures.injector_inlet_pa = pressure_pa,
        (Component::PressureChamber, _) => m.pressures.chamber_pa = pressure_pa,
        _ => {}
    }
}
