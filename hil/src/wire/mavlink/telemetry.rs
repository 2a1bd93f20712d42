//! The true vehicle as telemetry: for people and scripts that watch a run, never for a flight controller to
//! fly by.

use ::mavlink::dialects::common as dialect;
use ::mavlink::dialects::common::MavMessage;
use hopbench::environment::geodesy::Datum;
use hopbench::frame::heading_rad;
use hopbench::plant::Snapshot;
use hopbench::plant::column::ARRAY;

use super::frame::{MODE_ARMED, MODE_HIL};
use super::measurement::{centi_i16, deg_e7};
use super::message::milliseconds;

/// `name` and `array_id` of the one that holds the plant.
pub const PLANT_ARRAY: (&str, u16) = ("plant", 1);

/// DEBUG_FLOAT_ARRAY of the plant: [`ARRAY`] at a time on the wire (us).
pub fn plant_array(now: &Snapshot, time_us: u64) -> MavMessage {
    let (name, array_id) = PLANT_ARRAY;
    MavMessage::DEBUG_FLOAT_ARRAY(dialect::DEBUG_FLOAT_ARRAY_DATA {
        time_usec: time_us,
        array_id,
        name: name.into(),
        data: ARRAY.map(|column| column.of(now) as f32),
    })
}

/// HEARTBEAT of the true vehicle: a rocket in simulation whose component is no autopilot, so that nobody
/// takes it for the flight controller.
pub fn vehicle_heartbeat(is_armed: bool) -> MavMessage {
    let armed = if is_armed { MODE_ARMED } else { 0 };
    MavMessage::HEARTBEAT(dialect::HEARTBEAT_DATA {
        custom_mode: 0,
        mavtype: dialect::MavType::MAV_TYPE_ROCKET,
        autopilot: dialect::MavAutopilot::MAV_AUTOPILOT_INVALID,
        base_mode: dialect::MavModeFlag::from_bits_retain(MODE_HIL | armed),
        system_status: if is_armed {
            dialect::MavState::MAV_STATE_ACTIVE
        } else {
            dialect::MavState::MAV_STATE_STANDBY
        },
        mavlink_version: 3,
    })
}

/// ATTITUDE_QUATERNION
pub fn attitude(now: &Snapshot, time_us: u64) -> MavMessage {
    let (q, rate) = (now.q_ned_from_body, now.rate_body_rad_s);
    MavMessage::ATTITUDE_QUATERNION(dialect::ATTITUDE_QUATERNION_DATA {
        time_boot_ms: milliseconds(time_us),
        q1: q.w as f32,
        q2: q.i as f32,
        q3: q.j as f32,
        q4: q.k as f32,
        rollspeed: rate.x as f32,
        pitchspeed: rate.y as f32,
        yawspeed: rate.z as f32,
        ..Default::default()
    })
}

/// LOCAL_POSITION_NED of the gimbal pivot, from the pad surface.
pub fn local_position(now: &Snapshot, time_us: u64) -> MavMessage {
    let (p, v) = (now.position_ned_m, now.velocity_ned_m_s);
    MavMessage::LOCAL_POSITION_NED(dialect::LOCAL_POSITION_NED_DATA {
        time_boot_ms: milliseconds(time_us),
        x: p.x as f32,
        y: p.y as f32,
        z: p.z as f32,
        vx: v.x as f32,
        vy: v.y as f32,
        vz: v.z as f32,
    })
}

/// GLOBAL_POSITION_INT of the gimbal pivot; relative height above its rest height. The heading is about z.
pub fn global_position(now: &Snapshot, datum: &Datum, time_us: u64) -> MavMessage {
    let place = datum.geodetic(&now.position_ned_m);
    let v = now.velocity_ned_m_s;
    let heading_cdeg = (heading_rad(&now.q_ned_from_body).to_degrees().rem_euclid(360.0) * 100.0).round(); // rad -> cdeg
    MavMessage::GLOBAL_POSITION_INT(dialect::GLOBAL_POSITION_INT_DATA {
        time_boot_ms: milliseconds(time_us),
        lat: deg_e7(place.latitude_rad),
        lon: deg_e7(place.longitude_rad),
        alt: (place.altitude_m * 1e3).round() as i32, // m -> mm
        relative_alt: (now.height_m * 1e3).round() as i32, // m -> mm
        vx: centi_i16(v.x),
        vy: centi_i16(v.y),
        vz: centi_i16(v.z),
        hdg: (heading_cdeg as u16) % 36_000,
    })
}

/// Sensors of the vehicle as SYS_STATUS names them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sensor {
    /// Angular rate.
    Gyroscope,
    /// Specific force.
    Accelerometer,
    /// Magnetic field.
    Magnetometer,
    /// Static pressure.
    Barometer,
    /// Satellite navigation.
    Gnss,
    /// Range to the ground.
    Altimeter,
}

impl Sensor {
    const ALL: [Self; 6] = [
        Self::Gyroscope,
        Self::Accelerometer,
        Self::Magnetometer,
        Self::Barometer,
        Self::Gnss,
        Self::Altimeter,
    ];

    fn flag(self) -> dialect::MavSysStatusSensor {
        use dialect::MavSysStatusSensor as Flag;
        match self {
            Self::Gyroscope => Flag::MAV_SYS_STATUS_SENSOR_3D_GYRO,
            Self::Accelerometer => Flag::MAV_SYS_STATUS_SENSOR_3D_ACCEL,
            Self::Magnetometer => Flag::MAV_SYS_STATUS_SENSOR_3D_MAG,
            Self::Barometer => Flag::MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE,
            Self::Gnss => Flag::MAV_SYS_STATUS_SENSOR_GPS,
            Self::Altimeter => Flag::MAV_SYS_STATUS_SENSOR_LASER_POSITION,
        }
    }
}

/// SYS_STATUS: every sensor is there, and those in `faulty` are not healthy. The vehicle has no battery.
pub fn system_status(faulty: &[Sensor]) -> MavMessage {
    let union = |sensors: &[Sensor]| {
        let none = dialect::MavSysStatusSensor::empty();
        sensors.iter().fold(none, |flags, sensor| flags | sensor.flag())
    };
    let all = union(&Sensor::ALL);
    MavMessage::SYS_STATUS(dialect::SYS_STATUS_DATA {
        onboard_control_sensors_present: all,
        onboard_control_sensors_enabled: all,
        onboard_control_sensors_health: all - union(faulty),
        voltage_battery: u16::MAX,
        current_battery: -1,
        battery_remaining: -1,
        ..Default::default()
    })
}

/// EXTENDED_SYS_STATE: on the ground while a pad touches it.
pub fn extended_state(now: &Snapshot) -> MavMessage {
    MavMessage::EXTENDED_SYS_STATE(dialect::EXTENDED_SYS_STATE_DATA {
        vtol_state: dialect::MavVtolState::MAV_VTOL_STATE_UNDEFINED,
        landed_state: if now.pads_down > 0 {
            dialect::MavLandedState::MAV_LANDED_STATE_ON_GROUND
        } else {
            dialect::MavLandedState::MAV_LANDED_STATE_IN_AIR
        },
    })
}
