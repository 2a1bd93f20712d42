//! Measurement <-> HIL messages: SI on one side, the wire's units on the other.
//!
//! Units as flight controllers read them: pressure in hPa, magnetic field in gauss, `eph`/`epv` of HIL_GPS
//! as accuracy in cm although the message's text says dilution, accelerations of HIL_STATE_QUATERNION in mg.

use ::mavlink::dialects::common as dialect;
use ::mavlink::dialects::common::MavMessage;
use hopbench::environment::atmosphere::STANDARD_GRAVITY_M_S2;
use hopbench::environment::geodesy::Datum;
use hopbench::frame::Vec3;
use hopbench::plant::Snapshot;
use hopbench::signal::{
    AltimeterSample, BarometerSample, BrokenImu, GnssFix, ImuSample, Measurement, Pressures, TrackingSample,
};
use hopbench::time::SimTime;
use nalgebra::{Quaternion, UnitQuaternion};

use super::message::milliseconds;

const UPDATED_ACCELEROMETER: u32 = 0x7;
const UPDATED_GYROSCOPE: u32 = 0x38;
const UPDATED_MAGNETOMETER: u32 = 0x1C0;
/// Absolute pressure, altitude and temperature; PX4 ignores the barometer unless all three are set.
const UPDATED_BAROMETER: u32 = 0x1A00;
/// HIL_SENSOR_UPDATED_RESET
const RESET: u32 = 1 << 31;
const CELSIUS_ZERO_K: f64 = 273.15;
const TESLA_PER_GAUSS: f64 = 1e-4;
/// DISTANCE_SENSOR: valid, and invalid though sent.
const QUALITY_GOOD: u8 = 100;
const QUALITY_INVALID: u8 = 1;

/// HIL_SENSOR at the beat of the inertial unit, which paces a flight controller: `None` between its samples.
/// The beat goes on when the unit has nothing to tell; then the mask says so.
pub fn hil_sensor(measurement: &Measurement) -> Option<MavMessage> {
    let (force, rate, temperature_k) = match (&measurement.imu, &measurement.broken_imu) {
        (Some(imu), _) => (Some(imu.specific_force_body_m_s2), Some(imu.rate_body_rad_s), imu.temperature_k),
        (None, Some(unit)) => (unit.specific_force_body_m_s2, unit.rate_body_rad_s, unit.temperature_k),
        (None, None) => return None,
    };
    let mut data = dialect::HIL_SENSOR_DATA {
        time_usec: measurement.time.us(),
        temperature: (temperature_k - CELSIUS_ZERO_K) as f32,
        ..Default::default()
    };
    let mut updated = 0;
    if let Some(f) = force {
        (data.xacc, data.yacc, data.zacc) = (f.x as f32, f.y as f32, f.z as f32);
        updated |= UPDATED_ACCELEROMETER;
    }
    if let Some(w) = rate {
        (data.xgyro, data.ygyro, data.zgyro) = (w.x as f32, w.y as f32, w.z as f32);
        updated |= UPDATED_GYROSCOPE;
    }
    if let Some(field_t) = measurement.magnetic_field_body_t {
        let gauss = field_t / TESLA_PER_GAUSS; // T -> gauss
        (data.xmag, data.ymag, data.zmag) = (gauss.x as f32, gauss.y as f32, gauss.z as f32);
        updated |= UPDATED_MAGNETOMETER;
    }
    if let Some(barometer) = &measurement.barometer {
        data.abs_pressure = (barometer.pressure_pa / 100.0) as f32; // Pa -> hPa
        data.pressure_alt = barometer.pressure_altitude_m as f32;
        data.temperature = (barometer.temperature_k - CELSIUS_ZERO_K) as f32; // K -> °C
        updated |= UPDATED_BAROMETER;
    }
    data.fields_updated = dialect::HilSensorUpdatedFlags::from_bits_retain(updated);
    Some(MavMessage::HIL_SENSOR(data))
}

/// HIL_SENSOR that says nothing but that the vehicle was put elsewhere: a new flight begins.
pub fn reset_mark(time_us: u64) -> MavMessage {
    MavMessage::HIL_SENSOR(dialect::HIL_SENSOR_DATA {
        time_usec: time_us,
        fields_updated: dialect::HilSensorUpdatedFlags::from_bits_retain(RESET),
        ..Default::default()
    })
}

/// Whether a message is such a mark.
pub fn is_reset(message: &MavMessage) -> bool {
    matches!(message, MavMessage::HIL_SENSOR(data) if data.fields_updated.bits() & RESET != 0)
}

/// HIL_GPS, when there is a new fix.
pub fn hil_gps(measurement: &Measurement) -> Option<MavMessage> {
    let fix = measurement.gnss.as_ref()?;
    let v = fix.velocity_ned_m_s;
    let ground_speed_m_s = libm::hypot(v.x, v.y);
    let course_deg = libm::atan2(v.y, v.x).to_degrees().rem_euclid(360.0);
    Some(MavMessage::HIL_GPS(dialect::HIL_GPS_DATA {
        time_usec: measurement.time.us(),
        lat: deg_e7(fix.latitude_rad),
        lon: deg_e7(fix.longitude_rad),
        alt: (fix.altitude_m * 1e3).round() as i32, // m -> mm
        eph: centi_u16(fix.horizontal_accuracy_m),  // m -> cm
        epv: centi_u16(fix.vertical_accuracy_m),    // m -> cm
        vel: centi_u16(ground_speed_m_s),           // m/s -> cm/s
        vn: centi_i16(v.x),
        ve: centi_i16(v.y),
        vd: centi_i16(v.z),
        // Below walking pace the course is noise: unknown.
        cog: if ground_speed_m_s < 0.3 {
            u16::MAX
        } else {
            ((course_deg * 100.0).round() as u16).min(35_999)
        },
        fix_type: fix.fix_type,
        satellites_visible: fix.satellites,
        ..Default::default()
    }))
}

/// DISTANCE_SENSOR, looking down the body's z axis, when there is a new reading.
pub fn distance_sensor(measurement: &Measurement) -> Option<MavMessage> {
    let altimeter = measurement.altimeter.as_ref()?;
    let maximum_cm = centi_u16(altimeter.maximum_m);
    Some(MavMessage::DISTANCE_SENSOR(dialect::DISTANCE_SENSOR_DATA {
        time_boot_ms: milliseconds(measurement.time.us()),
        min_distance: centi_u16(altimeter.minimum_m), // m -> cm
        max_distance: maximum_cm,
        current_distance: altimeter.range_m.map_or(maximum_cm.saturating_add(1), centi_u16),
        mavtype: dialect::MavDistanceSensor::MAV_DISTANCE_SENSOR_LASER,
        id: 0,
        orientation: dialect::MavSensorOrientation::MAV_SENSOR_ROTATION_PITCH_270,
        covariance: u8::MAX,
        signal_quality: if altimeter.range_m.is_some() { QUALITY_GOOD } else { QUALITY_INVALID },
        ..Default::default()
    }))
}

/// ODOMETRY from the rig's tracking: pose in local NED, twist in body FRD.
pub fn odometry(measurement: &Measurement) -> Option<MavMessage> {
    let tracking = measurement.tracking.as_ref()?;
    let [w, x, y, z] = tracking.q_ned_from_body;
    let attitude = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
    let velocity_body_m_s = attitude.inverse() * tracking.velocity_ned_m_s;
    let (p, rate) = (tracking.position_ned_m, tracking.rate_body_rad_s);
    let mut unknown = [0.0; 21];
    unknown[0] = f32::NAN;
    Some(MavMessage::ODOMETRY(dialect::ODOMETRY_DATA {
        time_usec: measurement.time.us(),
        x: p.x as f32,
        y: p.y as f32,
        z: p.z as f32,
        q: tracking.q_ned_from_body.map(|c| c as f32),
        vx: velocity_body_m_s.x as f32,
        vy: velocity_body_m_s.y as f32,
        vz: velocity_body_m_s.z as f32,
        rollspeed: rate.x as f32,
        pitchspeed: rate.y as f32,
        yawspeed: rate.z as f32,
        pose_covariance: unknown,
        velocity_covariance: unknown,
        frame_id: dialect::MavFrame::MAV_FRAME_LOCAL_NED,
        child_frame_id: dialect::MavFrame::MAV_FRAME_BODY_FRD,
        reset_counter: 0,
        estimator_type: dialect::MavEstimatorType::MAV_ESTIMATOR_TYPE_MOCAP,
        quality: 100,
    }))
}

/// NAMED_VALUE_FLOAT of one pressure (Pa), sent in bar.
pub fn pressure(name: &str, pressure_pa: f64, time_us: u64) -> MavMessage {
    MavMessage::NAMED_VALUE_FLOAT(dialect::NAMED_VALUE_FLOAT_DATA {
        time_boot_ms: milliseconds(time_us),
        value: (pressure_pa / 1e5) as f32, // Pa -> bar
        name: name.into(),
    })
}

/// HIL_STATE_QUATERNION: the true state of the gimbal pivot.
pub fn hil_state_quaternion(now: &Snapshot, datum: &Datum, time_us: u64) -> MavMessage {
    let (q, place) = (now.q_ned_from_body, datum.geodetic(&now.position_ned_m));
    let (rate, v) = (now.rate_body_rad_s, now.velocity_ned_m_s);
    let airspeed_m_s = (now.velocity_ned_m_s - now.wind_ned_m_s).norm();
    let acceleration_mg = now.specific_force_body_m_s2 / STANDARD_GRAVITY_M_S2 * 1e3; // m/s² -> mg
    MavMessage::HIL_STATE_QUATERNION(dialect::HIL_STATE_QUATERNION_DATA {
        time_usec: time_us,
        attitude_quaternion: [q.w, q.i, q.j, q.k].map(|c| c as f32),
        rollspeed: rate.x as f32,
        pitchspeed: rate.y as f32,
        yawspeed: rate.z as f32,
        lat: deg_e7(place.latitude_rad),
        lon: deg_e7(place.longitude_rad),
        alt: (place.altitude_m * 1e3).round() as i32, // m -> mm
        vx: centi_i16(v.x),
        vy: centi_i16(v.y),
        vz: centi_i16(v.z),
        ind_airspeed: centi_u16(airspeed_m_s),
        true_airspeed: centi_u16(airspeed_m_s),
        xacc: acceleration_mg.x.round() as i16,
        yacc: acceleration_mg.y.round() as i16,
        zacc: acceleration_mg.z.round() as i16,
    })
}

/// The other side: gathers HIL messages until a HIL_SENSOR completes a measurement.
#[derive(Debug, Default)]
pub struct MeasurementReader {
    pending: Measurement,
    last_time: Option<SimTime>,
}

impl MeasurementReader {
    /// Takes one message; a HIL_SENSOR gives the measurement with all that came before it.
    pub fn take(&mut self, message: &MavMessage) -> Option<Measurement> {
        if is_reset(message) {
            *self = Self::default();
            return None;
        }
        match message {
            MavMessage::HIL_SENSOR(data) => return Some(self.complete(data)),
            MavMessage::HIL_GPS(data) => {
                let velocity_cm_s = Vec3::new(data.vn.into(), data.ve.into(), data.vd.into());
                self.pending.gnss = Some(GnssFix {
                    latitude_rad: (f64::from(data.lat) * 1e-7).to_radians(), // degE7 -> rad
                    longitude_rad: (f64::from(data.lon) * 1e-7).to_radians(),
                    altitude_m: f64::from(data.alt) * 1e-3, // mm -> m
                    velocity_ned_m_s: velocity_cm_s * 0.01, // cm/s -> m/s
                    horizontal_accuracy_m: f64::from(data.eph) * 0.01, // cm -> m
                    vertical_accuracy_m: f64::from(data.epv) * 0.01,
                    fix_type: data.fix_type,
                    satellites: data.satellites_visible,
                });
            }
            MavMessage::DISTANCE_SENSOR(data) => {
                let (least, greatest) = (data.min_distance, data.max_distance);
                let valid = data.signal_quality != QUALITY_INVALID
                    && (least..=greatest).contains(&data.current_distance);
                self.pending.altimeter = Some(AltimeterSample {
                    range_m: valid.then(|| f64::from(data.current_distance) * 0.01), // cm -> m
                    minimum_m: f64::from(least) * 0.01,
                    maximum_m: f64::from(greatest) * 0.01,
                });
            }
            MavMessage::ODOMETRY(data) => {
                let [w, x, y, z] = data.q.map(f64::from);
                let attitude = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
                let velocity_body_m_s = Vec3::new(data.vx.into(), data.vy.into(), data.vz.into());
                self.pending.tracking = Some(TrackingSample {
                    position_ned_m: Vec3::new(data.x.into(), data.y.into(), data.z.into()),
                    velocity_ned_m_s: attitude * velocity_body_m_s,
                    q_ned_from_body: [w, x, y, z],
                    rate_body_rad_s: Vec3::new(
                        data.rollspeed.into(),
                        data.pitchspeed.into(),
                        data.yawspeed.into(),
                    ),
                });
            }
            MavMessage::NAMED_VALUE_FLOAT(data) => {
                let pressure_pa = Some(f64::from(data.value) * 1e5); // bar -> Pa
                match data.name.to_str() {
                    Ok("tank_bar") => self.pending.pressures.tank_pa = pressure_pa,
                    Ok("bottle_bar") => self.pending.pressures.bottle_pa = pressure_pa,
                    Ok("chamb_bar") => self.pending.pressures.chamber_pa = pressure_pa,
                    _ => {}
                }
            }
            _ => {}
        }
        None
    }

    fn complete(&mut self, data: &dialect::HIL_SENSOR_DATA) -> Measurement {
        let mut measurement = std::mem::take(&mut self.pending);
        measurement.time = SimTime::from_us(data.time_usec);
        let updated = data.fields_updated.bits();
        let has = |mask: u32| updated & mask == mask;
        let temperature_k = f64::from(data.temperature) + CELSIUS_ZERO_K; // °C -> K
        // The first sample has no predecessor; it is stamped one period after step 0.
        let interval_s = measurement.time.since(self.last_time.unwrap_or(SimTime::ZERO)).s();
        self.last_time = Some(measurement.time);
        let force = has(UPDATED_ACCELEROMETER)
            .then(|| Vec3::new(data.xacc.into(), data.yacc.into(), data.zacc.into()));
        let rate = has(UPDATED_GYROSCOPE)
            .then(|| Vec3::new(data.xgyro.into(), data.ygyro.into(), data.zgyro.into()));
        if let (Some(specific_force_body_m_s2), Some(rate_body_rad_s)) = (force, rate) {
            measurement.imu =
                Some(ImuSample { specific_force_body_m_s2, rate_body_rad_s, interval_s, temperature_k });
        } else {
            measurement.broken_imu = Some(BrokenImu {
                specific_force_body_m_s2: force,
                rate_body_rad_s: rate,
                interval_s,
                temperature_k,
            });
        }
        if has(UPDATED_MAGNETOMETER) {
            let gauss = Vec3::new(data.xmag.into(), data.ymag.into(), data.zmag.into());
            measurement.magnetic_field_body_t = Some(gauss * TESLA_PER_GAUSS); // gauss -> T
        }
        if has(UPDATED_BAROMETER) {
            measurement.barometer = Some(BarometerSample {
                pressure_pa: f64::from(data.abs_pressure) * 100.0, // hPa -> Pa
                pressure_altitude_m: data.pressure_alt.into(),
                temperature_k,
            });
        }
        measurement
    }
}

/// The pressures that have a name on the wire.
pub fn named_pressures(pressures: &Pressures) -> [(&'static str, Option<f64>); 3] {
    [
        ("tank_bar", pressures.tank_pa),
        ("bottle_bar", pressures.bottle_pa),
        ("chamb_bar", pressures.chamber_pa),
    ]
}

/// rad -> 1e-7 deg
pub(super) fn deg_e7(angle_rad: f64) -> i32 {
    (angle_rad.to_degrees() * 1e7).round() as i32
}

/// Hundredths in 16 bits; what does not fit saturates, 65535 stays free for "unknown".
fn centi_u16(value: f64) -> u16 {
    ((value * 100.0).round() as u16).min(u16::MAX - 1)
}

pub(super) fn centi_i16(value: f64) -> i16 {
    (value * 100.0).round() as i16
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::mavlink::{Decoder, Encoder};

    fn full() -> Measurement {
        Measurement {
            time: SimTime::from_us(4000),
            imu: Some(ImuSample {
                specific_force_body_m_s2: Vec3::new(0.01, -0.02, -9.81),
                rate_body_rad_s: Vec3::new(0.001, 0.002, -0.003),
                interval_s: 0.004,
                temperature_k: 293.15,
            }),
            broken_imu: None,
            gnss: Some(GnssFix {
                latitude_rad: 0.82,
                longitude_rad: -0.15,
                altitude_m: 432.123,
                velocity_ned_m_s: Vec3::new(1.0, -2.0, 0.5),
                horizontal_accuracy_m: 0.85,
                vertical_accuracy_m: 1.2,
                fix_type: 3,
                satellites: 17,
            }),
            barometer: Some(BarometerSample {
                pressure_pa: 96_123.0,
                pressure_altitude_m: 442.0,
                temperature_k: 293.15,
            }),
            magnetic_field_body_t: Some(Vec3::new(21e-6, 1e-6, 43e-6)),
            altimeter: Some(AltimeterSample { range_m: Some(1.23), minimum_m: 0.2, maximum_m: 40.0 }),
            pressures: Pressures { tank_pa: Some(65e5), chamber_pa: Some(20e5), ..Default::default() },
            tracking: Some(TrackingSample {
                position_ned_m: Vec3::new(1.0, 2.0, -3.0),
                velocity_ned_m_s: Vec3::new(0.1, 0.2, -0.3),
                q_ned_from_body: [0.8, 0.0, 0.6, 0.0],
                rate_body_rad_s: Vec3::new(0.1, 0.0, 0.2),
            }),
        }
    }

    #[test]
    fn a_measurement_survives_the_wire_within_its_units() {
        let m = full();
        let mut messages: Vec<MavMessage> =
            [hil_gps(&m), distance_sensor(&m), odometry(&m)].into_iter().flatten().collect();
        for (name, value) in named_pressures(&m.pressures) {
            messages.extend(value.map(|v| pressure(name, v, m.time.us())));
        }
        messages.extend(hil_sensor(&m));
        let (mut encoder, mut decoder, mut bytes) = (Encoder::new(1, 200), Decoder::default(), Vec::new());
        messages.iter().for_each(|message| encoder.encode(message, &mut bytes));
        decoder.push(&bytes);
        let mut reader = MeasurementReader::default();
        let got: Vec<Measurement> = std::iter::from_fn(|| decoder.next_frame())
            .filter_map(|frame| reader.take(&frame.message().unwrap()))
            .collect();
        let [got] = &got[..] else { panic!("{got:?}") };
        assert_eq!(got.time, m.time);
        // f32 keeps 24 bits.
        let close = |a: f64, b: f64| (a - b).abs() <= 6e-8 * b.abs();
        let (imu, gnss) = (got.imu.unwrap(), got.gnss.unwrap());
        assert!(close(imu.specific_force_body_m_s2.z, -9.81) && close(imu.rate_body_rad_s.z, -0.003));
        assert_eq!(imu.interval_s, 0.004);
        assert!((imu.temperature_k - 293.15).abs() < 1e-5);
        // Half a unit of 1e-7 deg, 1 mm, 1 cm.
        assert!((gnss.latitude_rad - 0.82).abs() < 0.51e-7_f64.to_radians());
        assert!((gnss.altitude_m - 432.123).abs() < 0.51e-3);
        assert!((gnss.horizontal_accuracy_m - 0.85).abs() < 0.51e-2);
        assert!((gnss.velocity_ned_m_s - Vec3::new(1.0, -2.0, 0.5)).norm() < 1e-12);
        assert_eq!((gnss.fix_type, gnss.satellites), (3, 17));
        assert!(close(got.barometer.unwrap().pressure_pa, 96_123.0));
        assert!((got.magnetic_field_body_t.unwrap() - Vec3::new(21e-6, 1e-6, 43e-6)).norm() < 1e-11);
        assert!((got.altimeter.unwrap().range_m.unwrap() - 1.23).abs() < 0.51e-2);
        assert!(close(got.pressures.tank_pa.unwrap(), 65e5) && got.pressures.bottle_pa.is_none());
        let tracking = got.tracking.unwrap();
        assert!((tracking.velocity_ned_m_s - Vec3::new(0.1, 0.2, -0.3)).norm() < 1e-6);
    }

    #[test]
    fn fields_on_the_wire_carry_the_units_flight_controllers_read() {
        let m = full();
        let Some(MavMessage::HIL_SENSOR(sensor)) = hil_sensor(&m) else { panic!() };
        assert_eq!(sensor.fields_updated.bits(), 0x1BFF);
        assert_eq!(sensor.abs_pressure, 961.23_f32); // hPa
        assert!((sensor.zmag - 0.43).abs() < 1e-6); // gauss
        assert!((sensor.temperature - 20.0).abs() < 1e-5);
        let Some(MavMessage::HIL_GPS(gps)) = hil_gps(&m) else { panic!() };
        assert_eq!((gps.eph, gps.epv, gps.alt), (85, 120, 432_123));
        assert_eq!((gps.vn, gps.ve, gps.vd, gps.vel), (100, -200, 50, 224));
        assert_eq!(gps.cog, 29_657); // atan2(-2, 1) = 296.57 deg
        let Some(MavMessage::DISTANCE_SENSOR(distance)) = distance_sensor(&m) else { panic!() };
        assert_eq!(
            (distance.min_distance, distance.current_distance, distance.max_distance),
            (20, 123, 4000)
        );
        assert_eq!(distance.orientation as u8, 25);
    }

    #[test]
    fn the_update_mask_names_what_is_there() {
        let mut m = full();
        let mask = |m: &Measurement| match hil_sensor(m) {
            Some(MavMessage::HIL_SENSOR(data)) => data.fields_updated.bits(),
            _ => 0,
        };
        m.barometer = None;
        assert_eq!(mask(&m), 0x3F | 0x1C0);
        m.magnetic_field_body_t = None;
        assert_eq!(mask(&m), 0x3F);
        // A unit whose half is dead keeps the beat, and the mask says which half is left.
        let imu = m.imu.take().unwrap();
        assert!(hil_sensor(&m).is_none());
        let mut unit = BrokenImu {
            specific_force_body_m_s2: None,
            rate_body_rad_s: Some(imu.rate_body_rad_s),
            interval_s: imu.interval_s,
            temperature_k: imu.temperature_k,
        };
        for expected in [0x38, 0] {
            m.broken_imu = Some(unit);
            assert_eq!(mask(&m), expected);
            let got = MeasurementReader::default().take(&hil_sensor(&m).unwrap()).unwrap();
            let left = got.broken_imu.unwrap();
            assert!(got.imu.is_none() && left.specific_force_body_m_s2.is_none());
            assert_eq!(left.rate_body_rad_s.is_some(), expected != 0);
            unit.rate_body_rad_s = None;
        }
    }

    #[test]
    fn no_reading_is_sent_as_invalid_and_read_as_none() {
        let mut m = full();
        m.altimeter = Some(AltimeterSample { range_m: None, minimum_m: 0.2, maximum_m: 40.0 });
        let mut reader = MeasurementReader::default();
        assert!(reader.take(&distance_sensor(&m).unwrap()).is_none());
        let got = reader.take(&hil_sensor(&m).unwrap()).unwrap();
        assert_eq!(got.altimeter.unwrap().range_m, None);
    }
}
