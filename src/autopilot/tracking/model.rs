//! The model of predictive control: thirteen states, the deviation from a reference motion.
//!
//! | states | deviation of | unit |
//! |---|---|---|
//! | 0-2 | position of the centre of mass, heading frame | m |
//! | 3-5 | its velocity | m/s |
//! | 6-8 | attitude: small rotation from the reference attitude, body axes, less the recoil of the gimbal | 0.1 rad |
//! | 9-11 | body rate, less the recoil | 0.1 rad/s |
//! | 12 | thrust, which lags its command | kN |
//!
//! Inputs: thrust commanded (kN), gimbal angles about x and y (0.1 rad), roll torque (10 N m), all absolute.
//! The heading frame is NED rotated by the reference heading about the vertical.
//!
//! Recoil of the swinging engine: a gimbal that turns by δ turns the body the same way by κ δ at once, with κ
//! = (I_e + s_e l)/I, I_e and s_e the engine's inertia and first moment about the pivot and l the lever arm.
//! It is the cause of the zeros of torque over gimbal angle. The total angular momentum does not change with
//! it: attitude and rate of the model are θ - κ δ and ω - κ δ', whose second derivative is thrust times lever
//! arm times angle over inertia.
//!
//! The reference is a motion of the model itself (thrust along the demanded specific force, trim angles that
//! balance the disturbance), so the deviation is linear; its only constant term is the change of the
//! reference's body rate. The matrices are exact for coefficients held over a stage, with the rotation of the
//! reference to third order. Source: exact integration of the chain torque, rate, attitude, velocity,
//! position; thrust is a first-order lag.

use crate::autopilot::mpc::{INPUTS, Linear, STATES};
use crate::frame::{Mat3, Vec3, skew};

/// Radians in one unit of angle and of rate.
pub(crate) const ANGLE_RAD: f64 = 0.1;
/// Newtons in one unit of thrust.
pub const THRUST_N: f64 = 1000.0;
/// Newton metres in one unit of roll torque.
pub(crate) const TORQUE_N_M: f64 = 10.0;

/// The vehicle at one mass, as the model needs it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Airframe {
    /// Mass (kg).
    pub mass_kg: f64,
    /// Principal moments about the centre of mass, FRD x, y, z (kg m²).
    pub inertia_kg_m2: [f64; 3],
    /// From the centre of mass down to the gimbal pivot (m), plus the shift of the centre that the swinging
    /// engine causes.
    pub lever_arm_m: f64,
    /// Rotation of the body per gimbal angle, at once, axes x and y.
    pub recoil: [f64; 2],
    /// Lag of thrust behind its command (s).
    pub thrust_lag_s: f64,
}

/// Inputs of the model in SI units.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Control {
    /// Thrust (N).
    pub thrust_n: f64,
    /// Gimbal angles about x and y (rad).
    pub gimbal_rad: [f64; 2],
    /// Roll torque (N m).
    pub roll_torque_n_m: f64,
}

impl Control {
    /// In the units of the model.
    pub fn scaled(&self) -> [f64; INPUTS] {
        [
            self.thrust_n / THRUST_N,
            self.gimbal_rad[0] / ANGLE_RAD,
            self.gimbal_rad[1] / ANGLE_RAD,
            self.roll_torque_n_m / TORQUE_N_M,
        ]
    }

    /// From the units of the model.
    pub(crate) fn from_scaled(u: &[f64; INPUTS]) -> Self {
        Self {
            thrust_n: u[0] * THRUST_N,
            gimbal_rad: [u[1] * ANGLE_RAD, u[2] * ANGLE_RAD],
            roll_torque_n_m: u[3] * TORQUE_N_M,
        }
    }

    /// Every component is finite.
    pub fn is_finite(&self) -> bool {
        self.thrust_n.is_finite()
            && self.gimbal_rad.iter().all(|x| x.is_finite())
            && self.roll_torque_n_m.is_finite()
    }
}

/// Thrust, and the attitude that points it, for a reference acceleration; heading frame.
#[derive(Clone, Copy, Debug)]
pub struct ThrustAttitude {
    /// Thrust (N).
    pub thrust_n: f64,
    /// Body axes in the heading frame.
    pub heading_from_body: Mat3,
    /// Tilt about the heading frame's x and y (rad).
    pub tilt_rad: [f64; 2],
}

impl ThrustAttitude {
    /// For a specific force of the engine (m/s², heading frame) on this mass, by the shortest rotation of the
    /// long axis.
    pub fn of(specific_force_m_s2: Vec3, mass_kg: f64) -> Self {
        let size = specific_force_m_s2.norm();
        let down = if size > 1e-3 { -specific_force_m_s2 / size } else { Vec3::z() };
        // A reference upside down is not valid: keep the axis in the upper half.
        let down = if down.z > 0.1 { down } else { Vec3::z() };
        let turn = skew(Vec3::new(-down.y, down.x, 0.0));
        Self {
            thrust_n: mass_kg * size,
            heading_from_body: Mat3::identity() + turn + turn * turn / (1.0 + down.z),
            tilt_rad: [libm::atan2(-down.y, down.z), libm::atan2(down.x, down.z)],
        }
    }

    /// Long axis, downward.
    fn down(&self) -> Vec3 {
        self.heading_from_body.column(2).into_owned()
    }

    /// Mean body rate from this attitude to the `next` in `dt_s` (rad/s).
    pub fn rate_body_rad_s(&self, next: &Self, dt_s: f64) -> Vec3 {
        let across = self.down().cross(&next.down());
        let sine = across.norm();
        let angle = libm::atan2(sine, self.down().dot(&next.down()));
        let turn = if sine > 1e-12 { across * (angle / sine) } else { Vec3::zeros() };
        self.heading_from_body.transpose() * turn / dt_s
    }
}

/// `x⁺ = A x + B (u - u_trim) + c` over one stage, in the units of the model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StageModel {
    /// A and B.
    pub linear: Linear,
    /// The constant c.
    pub constant: [f64; STATES],
}

/// One stage of `dt_s` about a reference attitude that turns at `rate_body_rad_s` and whose body rate changes
/// by `rate_change_rad_s` during the stage.
pub(crate) fn stage_model(
    airframe: &Airframe,
    reference: &ThrustAttitude,
    rate_body_rad_s: Vec3,
    rate_change_rad_s: Vec3,
    dt_s: f64,
) -> StageModel {
    let h = dt_s;
    let (mass, thrust_n) = (airframe.mass_kg, reference.thrust_n);
    let r = reference.heading_from_body;

    // Integrals of exp(-W s), W the cross product with the reference's rate: attitude is relative to a
    // turning frame.
    let w = skew(rate_body_rad_s);
    let (w2, one) = (w * w, Mat3::identity());
    let e0 = one - w * h + w2 * (0.5 * h * h) - w2 * w * (h * h * h / 6.0);
    let e1 = (one - w * (h / 2.0) + w2 * (h * h / 6.0)) * h;
    let e2 = (one * 0.5 - w * (h / 6.0) + w2 * (h * h / 24.0)) * (h * h);
    let e3 = (one / 6.0 - w * (h / 24.0) + w2 * (h * h / 120.0)) * (h * h * h);
    let e4 = (one / 24.0 - w * (h / 120.0) + w2 * (h * h / 720.0)) * (h * h * h * h);

    // Specific force from attitude (m/s² per rad) and from gimbal angle, heading frame.
    let push = thrust_n / mass;
    let tilt = r * Mat3::new(0.0, -push, 0.0, push, 0.0, 0.0, 0.0, 0.0, 0.0);
    let [recoil_x, recoil_y] = airframe.recoil;
    let side =
        r * Mat3::new(0.0, (1.0 - recoil_y) * push, 0.0, -(1.0 - recoil_x) * push, 0.0, 0.0, 0.0, 0.0, 0.0);
    // Angular acceleration (rad/s²) from gimbal x, gimbal y (rad) and roll torque (N m).
    let [ix, iy, iz] = airframe.inertia_kg_m2;
    let moment = thrust_n * airframe.lever_arm_m;
    let turn = Mat3::from_diagonal(&Vec3::new(moment / ix, moment / iy, 1.0 / iz));

    // Thrust behind a first-order lag, and its integrals.
    let tau = airframe.thrust_lag_s.max(1e-4);
    let decay = libm::exp(-h / tau);
    let (f1, f2) = (tau * (1.0 - decay), tau * (h - tau * (1.0 - decay)));
    let (g1, g2) = (h - f1, 0.5 * h * h - f2);
    let along = -reference.down() / mass; // m/s² per N

    let mut s = Linear::default();
    let mut constant = [0.0; STATES];
    let angle = ANGLE_RAD;
    let (tilt_e1, tilt_e2, tilt_e3) = (tilt * e1, tilt * e2, tilt * e3);
    let (speed_from, place_from) = (tilt * e3 * turn, tilt * e4 * turn);
    let attitude_from = e2 * turn;
    let input_unit = [ANGLE_RAD, ANGLE_RAD, TORQUE_N_M];
    for i in 0..3 {
        for j in 0..3 {
            s.a[3 + i][6 + j] = tilt_e1[(i, j)] * angle;
            s.a[3 + i][9 + j] = tilt_e2[(i, j)] * angle;
            s.a[i][6 + j] = tilt_e2[(i, j)] * angle;
            s.a[i][9 + j] = tilt_e3[(i, j)] * angle;
            s.a[6 + i][6 + j] = e0[(i, j)];
            s.a[6 + i][9 + j] = e1[(i, j)];
            let unit = input_unit[j];
            s.b[i][1 + j] = (side[(i, j)] * 0.5 * h * h + place_from[(i, j)]) * unit;
            s.b[3 + i][1 + j] = (side[(i, j)] * h + speed_from[(i, j)]) * unit;
            s.b[6 + i][1 + j] = attitude_from[(i, j)] * unit / angle;
            s.b[9 + i][1 + j] = turn[(i, j)] * h * unit / angle;
        }
        s.a[i][i] = 1.0;
        s.a[i][3 + i] = h;
        s.a[3 + i][3 + i] = 1.0;
        s.a[9 + i][9 + i] = 1.0;
        s.a[i][12] = along[i] * f2 * THRUST_N;
        s.a[3 + i][12] = along[i] * f1 * THRUST_N;
        s.b[i][0] = along[i] * g2 * THRUST_N;
        s.b[3 + i][0] = along[i] * g1 * THRUST_N;
        constant[9 + i] = -rate_change_rad_s[i] / angle;
    }
    s.a[12][12] = decay;
    s.b[12][0] = 1.0 - decay;
    StageModel { linear: s, constant }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Rotation3, SVector};

    const AIRFRAME: Airframe = Airframe {
        mass_kg: 75.0,
        inertia_kg_m2: [21.0, 22.0, 3.9],
        lever_arm_m: 0.45,
        recoil: [0.09, 0.08],
        thrust_lag_s: 0.05,
    };
    const GRAVITY: Vec3 = Vec3::new(0.0, 0.0, 9.81);

    type Point = SVector<f64, STATES>;

    /// The model before any linearisation, rates of [p v R ω T] in SI, attitude as rotation matrix; inputs
    /// SI.
    struct Motion {
        p: Vec3,
        v: Vec3,
        r: Mat3,
        w: Vec3,
        thrust_n: f64,
    }

    fn rates(m: &Motion, u: &[f64; 4]) -> (Vec3, Vec3, f64) {
        let a = &AIRFRAME;
        let [kx, ky] = a.recoil;
        // Body turned by the recoil, thrust deflected in it.
        let push = m.r
            * (Rotation3::new(Vec3::new(kx * u[1], ky * u[2], 0.0)).matrix()
                * Vec3::new(libm::sin(u[2]), -libm::sin(u[1]), -1.0));
        let force = push * (m.thrust_n / a.mass_kg) + GRAVITY;
        let moment = m.thrust_n * a.lever_arm_m;
        let [ix, iy, iz] = a.inertia_kg_m2;
        let turn = Vec3::new(moment * libm::sin(u[1]) / ix, moment * libm::sin(u[2]) / iy, u[3] / iz);
        (force, turn, (u[0] - m.thrust_n) / a.thrust_lag_s)
    }

    /// Deviation after a stage from one before it: the full motion by fine steps, less the reference's. The
    /// reference turns steadily at its rate, carried by thrust along its axis.
    fn fly(deviation: &Point, input: &[f64; 4], attitude: &ThrustAttitude, rate: Vec3, h: f64) -> Point {
        let d = |i: usize| Vec3::new(deviation[i], deviation[i + 1], deviation[i + 2]);
        let mut m = Motion {
            p: d(0),
            v: d(3),
            r: attitude.heading_from_body * Rotation3::new(d(6) * ANGLE_RAD).matrix(),
            w: rate + d(9) * ANGLE_RAD,
            thrust_n: attitude.thrust_n + deviation[12] * THRUST_N,
        };
        let (mut reference_v, mut reference_p, mut reference_r) =
            (Vec3::zeros(), Vec3::zeros(), attitude.heading_from_body);
        let u = [
            attitude.thrust_n + input[0] * THRUST_N,
            input[1] * ANGLE_RAD,
            input[2] * ANGLE_RAD,
            input[3] * TORQUE_N_M,
        ];
        let steps = 4000;
        let dt = h / f64::from(steps);
        for _ in 0..steps {
            // Midpoint rule: second order, 1e-10 here.
            let (a, t, dn) = rates(&m, &u);
            let middle = Motion {
                p: m.p,
                v: m.v,
                r: m.r * Rotation3::new(m.w * (0.5 * dt)).matrix(),
                w: m.w + t * (0.5 * dt),
                thrust_n: m.thrust_n + dn * 0.5 * dt,
            };
            let (a_middle, t_middle, dn_middle) = rates(&middle, &u);
            m.p += (m.v + a * (0.5 * dt)) * dt;
            m.v += a_middle * dt;
            m.r *= Rotation3::new(middle.w * dt).matrix();
            m.w += t_middle * dt;
            m.thrust_n += dn_middle * dt;
            let half = reference_r * Rotation3::new(rate * (0.5 * dt)).matrix();
            // The linearisation holds the reference's axis over the stage.
            let wanted = -attitude.heading_from_body.column(2).into_owned()
                * (attitude.thrust_n / AIRFRAME.mass_kg)
                + GRAVITY;
            reference_p += (reference_v + wanted * (0.5 * dt)) * dt;
            reference_v += wanted * dt;
            reference_r = half * Rotation3::new(rate * (0.5 * dt)).matrix();
        }
        // Micro-radians: the antisymmetric part is the rotation vector, without the cosine's loss of digits.
        let off = reference_r.transpose() * m.r;
        let small =
            Vec3::new(off[(2, 1)] - off[(1, 2)], off[(0, 2)] - off[(2, 0)], off[(1, 0)] - off[(0, 1)]) * 0.5;
        let mut out = Point::zeros();
        for i in 0..3 {
            out[i] = m.p[i] - reference_p[i];
            out[3 + i] = m.v[i] - reference_v[i];
            out[6 + i] = small[i] / ANGLE_RAD;
            out[9 + i] = (m.w[i] - rate[i]) / ANGLE_RAD;
        }
        out[12] = (m.thrust_n - attitude.thrust_n) / THRUST_N;
        out
    }

    #[test]
    fn stage_matrices_are_the_derivatives_of_the_full_motion() {
        let attitude = ThrustAttitude::of(Vec3::new(0.8, -1.1, -9.0), AIRFRAME.mass_kg);
        for rate in [Vec3::zeros(), Vec3::new(0.08, -0.05, 0.0)] {
            let s = stage_model(&AIRFRAME, &attitude, rate, Vec3::zeros(), 0.05);
            let step = 1e-4;
            // The thrust turns with the body while the linearisation holds the reference's axis: half the
            // turn of a stage, of the 13.3 m/s² that a kilonewton gives 75 kg, over a stage.
            let slack = 1e-6 + 0.5 * rate.norm() * 0.05 * 13.3 * 0.05;
            for column in 0..STATES + INPUTS {
                let at = |sign: f64| {
                    let (mut x, mut u) = (Point::zeros(), [0.0; INPUTS]);
                    if column < STATES {
                        x[column] = sign * step
                    } else {
                        u[column - STATES] = sign * step
                    }
                    fly(&x, &u, &attitude, rate, 0.05)
                };
                let derivative = (at(1.0) - at(-1.0)) / (2.0 * step);
                for row in 0..STATES {
                    let own = if column < STATES {
                        s.linear.a[row][column]
                    } else {
                        s.linear.b[row][column - STATES]
                    };
                    assert!(
                        (own - derivative[row]).abs() < slack,
                        "row {row} column {column}: {own} against {}",
                        derivative[row]
                    );
                }
            }
        }
    }

    #[test]
    fn the_attitude_carries_the_specific_force() {
        let f = Vec3::new(0.9, -0.4, -9.3);
        let attitude = ThrustAttitude::of(f, 70.0);
        assert!(
            (attitude.heading_from_body * Vec3::new(0.0, 0.0, -attitude.thrust_n / 70.0) - f).norm() < 1e-12
        );
        assert!((attitude.heading_from_body.determinant() - 1.0).abs() < 1e-12);
        // Leaning forward is a negative turn about y.
        assert!(attitude.tilt_rad[1] < 0.0 && attitude.tilt_rad[0] < 0.0);
    }
}
