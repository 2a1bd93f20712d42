//! Legs on the ground: energy only falls, a foot stays in its friction cone, the clamps carry the lift.

use crate::fixture::motion::{FULL, State, balance, reference_vehicle};
use hopbench::dynamics::landing_gear::*;
use hopbench::dynamics::mass::{FlowTerms, MassProperties};
use hopbench::dynamics::rigid_body::accelerations;
use hopbench::dynamics::{Kinematics, Load};
use hopbench::frame::{Vec3, tilt_rad};
use hopbench::integrator::rk4_step;
use nalgebra::{Quaternion, UnitQuaternion};

const G_M_S2: f64 = 9.80665;
const STEP_S: f64 = 1e-3;

/// The reference vehicle at lift-off mass, everything frozen, on its legs.
struct Stand {
    gear: LandingGear,
    pads: [Vec3; MAX_LEGS],
    vehicle: MassProperties,
    anchors: Anchors,
    state: State,
    grip: Grip,
}

impl Stand {
    /// Upright with the pivot at a height [m] above the ground.
    fn at_height(height_m: f64) -> Self {
        let reference = reference_vehicle();
        let gear: LandingGear = reference.section("landing_gear");
        let mut state = State::at_rest();
        state.position_ned_m.z = -height_m;
        Self {
            pads: gear.pads_body_m(),
            gear,
            vehicle: reference.model.evaluate(&FULL, &Default::default()).vehicle,
            anchors: Anchors::default(),
            state,
            grip: Grip::Free,
        }
    }

    fn motion(s: &State) -> Kinematics {
        Kinematics {
            position_ned_m: s.position_ned_m,
            velocity_ned_m_s: s.velocity_ned_m_s,
            ned_from_body: s.ned_from_body(),
            rate_body_rad_s: s.rate_body_rad_s,
        }
    }

    fn contact(&self, s: &State) -> Contact {
        self.gear.contact(&self.pads, &Self::motion(s), 0.0, &self.anchors, self.grip)
    }

    /// At rest on its legs, and too inert to turn: a block that can only slide.
    fn block(static_friction_ratio: f64) -> Self {
        let mut stand = Self::at_height(1.0);
        stand.gear.static_friction_ratio = static_friction_ratio;
        stand.gear.stick_stiffness_n_m = 1e6;
        stand.vehicle.first_moment_kg_m = Vec3::zeros();
        stand.vehicle.inertia_kg_m2 = hopbench::frame::Mat3::identity() * 1e15;
        stand.state.position_ned_m.z = -stand.gear.rest_height_m(stand.weight_n());
        stand.settle();
        stand
    }

    /// One step under a thrust [N] along the body axis.
    fn step(&mut self, thrust_n: f64) {
        self.step_under(|_, _| Vec3::new(0.0, 0.0, -thrust_n));
    }

    /// One step under a force [N] on the pivot, body axes.
    fn step_under(&mut self, force_body_n: impl Fn(&State, f64) -> Vec3) {
        let flow = FlowTerms::none();
        let mut next = rk4_step(&self.state, STEP_S, |s, fraction| {
            let mut balance = balance(&self.vehicle, &flow, s.rate_body_rad_s);
            balance.load = self.contact(s).load + Load::at(Vec3::zeros(), force_body_n(s, fraction));
            s.rate(&accelerations(&balance), G_M_S2)
        });
        next.q_ned_from_body = next.q_ned_from_body.normalize();
        self.state = next;
        self.settle();
    }

    fn settle(&mut self) {
        let motion = Self::motion(&self.state);
        self.anchors = self.gear.anchors_after(&self.pads, &motion, 0.0, &self.anchors, self.grip);
    }

    fn energy_j(&self) -> f64 {
        let s = &self.state;
        let v = s.ned_from_body().transpose() * s.velocity_ned_m_s;
        let (w, body) = (s.rate_body_rad_s, &self.vehicle);
        let com = Self::motion(s).point_ned_m(body.centre_of_mass_body_m());
        0.5 * body.mass_kg * v.dot(&v)
            + v.dot(&w.cross(&body.first_moment_kg_m))
            + 0.5 * w.dot(&(body.inertia_kg_m2 * w))
            - body.mass_kg * G_M_S2 * com.z
            + self.gear.spring_energy_j(&self.pads, &Self::motion(s), 0.0, &self.anchors)
    }

    fn weight_n(&self) -> f64 {
        self.vehicle.mass_kg * G_M_S2
    }
}

#[test]
fn full_tanks_press_the_legs_by_nine_millimetres() {
    let stand = Stand::at_height(1.0);
    let height_m = stand.gear.rest_height_m(stand.weight_n());
    assert!((height_m - 0.741).abs() < 5e-5, "{height_m}");
    assert!((-stand.gear.pad_z_m - height_m - 9.0e-3).abs() < 5e-6);
    // And there the vehicle stays: what moves is the 0.1 mm that the centre of mass is off the axis.
    let mut stand = Stand::at_height(height_m);
    stand.settle();
    assert_eq!(stand.anchors.count(), 4);
    for _ in 0..3_000 {
        stand.step(0.0);
    }
    assert!((stand.state.position_ned_m.z + height_m).abs() < 1e-6);
    assert!(stand.state.velocity_ned_m_s.norm() < 1e-6 && stand.state.rate_body_rad_s.norm() < 1e-6);
    let up_n: f64 = stand.contact(&stand.state).pad_force_ned_n.iter().map(|f| -f.z).sum();
    assert!((up_n / stand.weight_n() - 1.0).abs() < 1e-6);
}

#[test]
fn bottomed_legs_carry_the_rest_on_their_stops() {
    let gear = Stand::at_height(1.0).gear;
    let deflection = |weight_n: f64| -gear.pad_z_m - gear.rest_height_m(weight_n);
    let at_stroke_n = 4.0 * gear.stiffness_n_m * gear.stroke_m;
    assert!((deflection(at_stroke_n) - gear.stroke_m).abs() < 1e-12);
    let beyond = deflection(at_stroke_n + 4.0 * 1020.0) - gear.stroke_m;
    assert!((beyond - 1020.0 / (gear.stiffness_n_m + gear.bottom_stiffness_n_m)).abs() < 1e-12);
}

#[test]
fn a_tilted_drop_only_loses_energy_and_comes_to_rest() {
    let mut stand = Stand::at_height(1.0);
    stand.state.velocity_ned_m_s = Vec3::new(0.4, -0.2, 0.3);
    stand.state.q_ned_from_body = *UnitQuaternion::from_euler_angles(0.04, -0.06, 0.3).quaternion();
    stand.state.rate_body_rad_s = Vec3::new(0.05, 0.1, -0.2);
    let (start_j, mut before_j) = (stand.energy_j(), stand.energy_j());
    for step in 0..10_000 {
        stand.step(0.0);
        let now_j = stand.energy_j();
        // A slip inside a step is seen at its end, with the dragged anchor; a touchdown only adds force that
        // opposes the motion. So no step may gain more than truncation: 1e-9 of 700 J.
        assert!(now_j - before_j < 1e-6, "step {step}: {before_j} J to {now_j} J");
        before_j = now_j;
    }
    assert!(before_j < start_j - 100.0);
    assert_eq!(stand.anchors.count(), 4);
    let s = &stand.state;
    assert!(s.velocity_ned_m_s.norm() < 1e-3 && s.rate_body_rad_s.norm() < 1e-3);
    assert!(tilt_rad(&UnitQuaternion::new_normalize(s.q_ned_from_body)) < 2e-3);
    assert!((s.position_ned_m.z + stand.gear.rest_height_m(stand.weight_n())).abs() < 1e-4);
}

#[test]
fn a_sliding_vehicle_stops_after_v_squared_over_2_mu_g() {
    let mut stand = Stand::at_height(1.0);
    stand.state.position_ned_m.z = -stand.gear.rest_height_m(stand.weight_n());
    stand.settle();
    // Slow enough not to tip: the feet stay down, so the whole weight rubs.
    stand.state.velocity_ned_m_s.x = 1.0;
    stand.gear.friction_coefficient = 0.2;
    for _ in 0..4_000 {
        stand.step(0.0);
    }
    // The centre of mass goes v²/(2 μ g). While it rubs the vehicle leans forward on its legs by
    // μ W h / (2 k r²), h = 1.15 m; when the feet stick it comes back over them, so they end that lean
    // times h short: 8.4 mm. The friction springs' stretch μ W / (4 k_t), 0.4 mm, at both ends, and the
    // rocking as rubbing begins, are left.
    let gear = &stand.gear;
    let h = -gear.pad_z_m - stand.vehicle.centre_of_mass_body_m().z;
    let lean =
        0.2 * stand.weight_n() * h / (2.0 * gear.stiffness_n_m * gear.pad_radius_m * gear.pad_radius_m);
    let expected_m = 1.0 / (2.0 * 0.2 * G_M_S2) - lean * h;
    let slid_m = stand.state.position_ned_m.x;
    assert!((slid_m - expected_m).abs() < 2e-3, "{slid_m} against {expected_m}");
    assert!(stand.state.velocity_ned_m_s.norm() < 1e-3);
}

/// What an incline of a slope (tangent) adds to level ground: the weight's part along it, less weight on it.
fn incline(stand: &Stand, slope: f64) -> (Vec3, f64) {
    let angle = libm::atan(slope);
    let (sine, cosine) = libm::sincos(angle);
    (Vec3::new(sine, 0.0, cosine - 1.0) * stand.weight_n(), cosine)
}

/// Velocity [m/s] after so many seconds on an incline, from a kick.
fn slid(stand: &mut Stand, slope: f64, kick_m_s: f64, seconds: u32) -> f64 {
    let (pull, cosine) = incline(stand, slope);
    // Legs at rest under what weight is left on them, so that the load does not swing.
    stand.state.position_ned_m.z = -stand.gear.rest_height_m(stand.weight_n() * cosine);
    stand.settle();
    // And sticking springs that already bear the pull: put on at once it would swing them to twice that.
    stand.state.position_ned_m.x = pull.x / (4.0 * stand.gear.stick_stiffness_n_m);
    stand.state.velocity_ned_m_s.x = kick_m_s;
    for _ in 0..seconds * 1000 {
        stand.step_under(|_, _| pull);
    }
    stand.state.velocity_ned_m_s.x
}

#[test]
fn a_block_on_an_incline_breaks_away_at_static_friction_and_slides_at_kinetic() {
    // Friction 0.5 sliding, 0.7 at rest.
    let ratio = 1.4;
    for slope in [0.3, 0.55, 0.69] {
        let mut stand = Stand::block(ratio);
        assert!(slid(&mut stand, slope, 0.0, 3).abs() < 1e-9, "it holds at {slope}");
        let (pull, _) = incline(&stand, slope);
        let stretch_m = pull.x / (4.0 * stand.gear.stick_stiffness_n_m);
        assert!((stand.state.position_ned_m.x - stretch_m).abs() < 1e-9, "it gives by its springs alone");
    }
    // It slides from rest above 0.7; once kicked loose from 0.5 on. Speed grows by g (sin - μ cos) a second:
    // sliding friction is the cone's edge itself, so to rounding.
    for (slope, kick_m_s) in [(0.71, 0.0), (1.2, 0.0), (0.55, 0.2), (0.69, 0.2)] {
        let mut stand = Stand::block(ratio);
        let before = slid(&mut stand, slope, kick_m_s, 1);
        let (pull, cosine) = incline(&stand, slope);
        for _ in 0..1000 {
            stand.step_under(|_, _| pull);
        }
        let gained = stand.state.velocity_ned_m_s.x - before;
        let expected = (slope - 0.5) * cosine * G_M_S2;
        assert!((gained - expected).abs() < 1e-9, "{slope}: {gained} against {expected}");
    }
    // With one coefficient the kick changes nothing: below it the block comes to rest.
    let mut stand = Stand::block(1.0);
    assert!(slid(&mut stand, 0.45, 0.2, 3).abs() < 1e-9);
}

/// Least and greatest pull [N] of a spring whose far end moves at a steady speed, from 15 s on.
fn pulled(ratio: f64, stiffness_n_m: f64, speed_m_s: f64) -> (f64, f64, u32) {
    let mut stand = Stand::block(ratio);
    let (mut least, mut greatest, mut breakaways, mut slid) = (f64::INFINITY, 0.0_f64, 0, false);
    for step in 0..60_000_u32 {
        let pull = |s: &State, fraction: f64| {
            let end_m = speed_m_s * (f64::from(step) + fraction) * STEP_S;
            Vec3::new(stiffness_n_m * (end_m - s.position_ned_m.x), 0.0, 0.0)
        };
        stand.step_under(pull);
        let now_n = pull(&stand.state, 1.0).x;
        if step > 15_000 {
            (least, greatest) = (least.min(now_n), greatest.max(now_n));
            breakaways += u32::from(stand.anchors.sliding[0] && !slid);
        }
        slid = stand.anchors.sliding[0];
    }
    (least, greatest, breakaways)
}

#[test]
fn a_pulled_block_sticks_and_slips() {
    // Sticking, the pull grows to μ_s W. Sliding, the block swings on the pulling spring about μ W, from (μ_s
    // - μ) W and the relative speed V, and sticks again when it stops: the pull is then μ W - sqrt(((μ_s - μ)
    // W)² + k m V²).
    let (k, v) = (2000.0, 0.02);
    let stand = Stand::block(1.4);
    let (w, m) = (stand.weight_n(), stand.vehicle.mass_kg);
    let (least, greatest, breakaways) = pulled(1.4, k, v);
    let swing = ((0.2 * w) * (0.2 * w) + k * m * v * v).sqrt();
    // The sticking springs, 2000 times stiffer, give a little: 1e-3 of the pull; k V dt = 0.04 N a step.
    assert!((greatest - 0.7 * w).abs() < 1e-3 * w, "{greatest} against {}", 0.7 * w);
    assert!((least - (0.5 * w - swing)).abs() < 2e-3 * w, "{least} against {}", 0.5 * w - swing);
    // A cycle is the stick, (μ_s W - least)/(k V), and the slip, about half a period of the swing.
    let cycle_s = (0.7 * w - least) / (k * v) + core::f64::consts::PI / (k / m).sqrt();
    assert!((45.0 / cycle_s - f64::from(breakaways)).abs() < 1.5, "{breakaways} cycles of {cycle_s} s");
    // With one coefficient the swing is V (k m)^(1/2) at most: it slides on.
    let (least, greatest, _) = pulled(1.0, k, v);
    let ripple = v * (k * m).sqrt() + 1e-3 * w;
    assert!(greatest < 0.5 * w + ripple && least > 0.5 * w - ripple, "{least} to {greatest}");
}

#[test]
fn feet_are_pushed_and_never_leave_the_friction_cone() {
    let mut stand = Stand::at_height(0.75);
    stand.anchors.pad_ned_m[..3].fill(Some(nalgebra::Vector2::new(0.3, -0.2)));
    let mut down = 0;
    for n in 0..500 {
        let x = |k: f64| libm::sin(k * f64::from(n) + k);
        let mut s = State::at_rest();
        s.position_ned_m = Vec3::new(0.1 * x(1.1), 0.1 * x(0.7), -0.75 + 0.1 * x(0.3));
        s.velocity_ned_m_s = Vec3::new(x(0.9), x(1.7), 3.0 * x(0.5));
        s.q_ned_from_body = Quaternion::new(1.0, 0.1 * x(0.4), 0.1 * x(1.3), 0.3 * x(0.2)).normalize();
        s.rate_body_rad_s = Vec3::new(x(2.1), x(0.8), x(1.9));
        let contact = stand.contact(&s);
        down += contact.pads_down;
        assert_eq!(contact.hold_down_n, 0.0);
        for force in contact.pad_force_ned_n {
            assert!(force.z <= 0.0);
            assert!(force.xy().norm() <= stand.gear.friction_coefficient * -force.z * (1.0 + 1e-14));
        }
    }
    assert!(down > 500, "the cases do touch the ground: {down}");
}

#[test]
fn clamps_carry_the_net_lift_until_released() {
    let mut stand = Stand::at_height(1.0);
    stand.state.position_ned_m.z = -stand.gear.rest_height_m(stand.weight_n());
    stand.settle();
    stand.grip = Grip::Held;
    let thrust_n = 1000.0;
    for _ in 0..3_000 {
        stand.step(thrust_n);
    }
    let lift_n = thrust_n - stand.weight_n();
    assert!((stand.contact(&stand.state).hold_down_n / lift_n - 1.0).abs() < 1e-6);
    // The legs stretch by the lift over their stiffness.
    let height_m = -stand.state.position_ned_m.z;
    let stretch_m = lift_n / (4.0 * stand.gear.stiffness_n_m);
    assert!((height_m + stand.gear.pad_z_m - stretch_m).abs() < 1e-6);
    // Released it leaves at once, at (T - W)/m.
    stand.grip = Grip::Free;
    stand.settle();
    assert_eq!(stand.anchors.count(), 0);
    let velocity_m_s = stand.state.velocity_ned_m_s.z;
    for _ in 0..500 {
        stand.step(thrust_n);
    }
    let gained_m_s = velocity_m_s - stand.state.velocity_ned_m_s.z;
    assert!((gained_m_s - 0.5 * lift_n / stand.vehicle.mass_kg).abs() < 1e-3, "{gained_m_s}");
}

#[test]
fn a_fallen_vehicle_shows_which_point_is_under_ground() {
    let points = [Vec3::new(0.0, 0.0, 0.43), Vec3::new(0.0, 0.0, -1.35)];
    let mut s = State::at_rest();
    s.position_ned_m.z = -0.741;
    assert_eq!(deepest_below_ground(&points, &Stand::motion(&s), 0.0), None);
    s.position_ned_m.z = -0.40;
    let (index, depth_m) = deepest_below_ground(&points, &Stand::motion(&s), 0.0).unwrap();
    assert!(index == 0 && (depth_m - 0.03).abs() < 1e-12);
    s.q_ned_from_body = *UnitQuaternion::from_axis_angle(&Vec3::x_axis(), 2.0).quaternion();
    assert_eq!(deepest_below_ground(&points, &Stand::motion(&s), 0.0).unwrap().0, 1);
}
