//! Closed forms of motion and mass properties.

use crate::fixture::motion::{FULL, State, balance, full_mode, mode_of, reference_vehicle};
use hopbench::dynamics::mass::*;
use hopbench::dynamics::rigid_body::*;
use hopbench::dynamics::slosh::{Coupling, HardeningLaw, Mode, SloshModel, SloshState};
use hopbench::dynamics::{Load, aerodynamics::Aerodynamics, landing_gear::HoldDown};
use hopbench::frame::{Mat3, Vec3, structural_from_frd};
use hopbench::integrator::{Integrable, rk4_step};
use nalgebra::Vector2;

const G_M_S2: f64 = 9.80665;

#[test]
fn mass_table_of_the_reference_vehicle() {
    let reference = reference_vehicle();
    let masses = reference.model.evaluate(&FULL, &ContentsRate::default());
    let lift_off = &masses.vehicle;
    // Last printed digit of the vehicle's data sheet.
    assert!((lift_off.mass_kg - 73.40).abs() < 0.005, "{}", lift_off.mass_kg);
    let com = structural_from_frd(lift_off.centre_of_mass_body_m());
    assert!((com - Vec3::new(0.0, -0.0001, 0.4015)).amax() < 6e-5, "{com}");
    let i = lift_off.inertia_about_com_kg_m2();
    for (found, printed) in [
        (i[(0, 0)], 22.294),
        (i[(1, 1)], 22.294),
        (i[(2, 2)], 2.418),
        (-i[(0, 2)], 0.026), // structural Ixz changes sign in FRD
        (i[(1, 2)], 0.014),
    ] {
        assert!((found - printed).abs() < 6e-4, "{found} against {printed}");
    }
    // The end of the hop: fuel 0.868 kg fixes the port radius.
    let grain = 0.868 / (940.0 * 0.25 * core::f64::consts::PI);
    let end = Contents {
        nitrous_kg: 2.89,
        port_radius_m: (0.068 * 0.068 - grain).sqrt(),
        nitrogen_run_tank_kg: 1.181,
        nitrogen_bottle_kg: 2.972 - 1.181,
        ..FULL
    };
    let burnt_out = Contents { port_radius_m: 0.068, ..end };
    let burnt_out = reference.model.evaluate(&burnt_out, &ContentsRate::default()).vehicle;
    let end = reference.model.evaluate(&end, &ContentsRate::default()).vehicle;
    let i = end.inertia_about_com_kg_m2();
    assert!((end.mass_kg - burnt_out.mass_kg - 0.868).abs() < 1e-12);
    assert!((end.mass_kg - 60.73).abs() < 6e-3 && (end.centre_of_mass_body_m().z + 0.3878).abs() < 1e-4);
    assert!((i[(0, 0)] - 20.73).abs() < 6e-3 && (i[(2, 2)] - 2.367).abs() < 6e-4, "{i}");
    let dry = reference.model.dry();
    assert!((dry.mass_kg - 54.0).abs() < 1e-12);
    let i = dry.inertia_about_com_kg_m2();
    assert!((i[(0, 0)] - 19.413).abs() < 6e-4 && (i[(2, 2)] - 2.337).abs() < 6e-4, "{i}");
}

#[test]
fn swinging_part_of_the_reference_vehicle() {
    let reference = reference_vehicle();
    // Port radius, mass, centre below the pivot, transverse and axial inertia about the pivot.
    for (port_radius_m, mass, centre, transverse, axial) in [
        (0.025, 13.452, 0.20732, 0.76027, 0.03775),
        (0.045, 12.419, 0.20959, 0.72071, 0.03638),
        (0.068, 10.500, 0.21500, 0.64536, 0.03000),
    ] {
        let contents = Contents { port_radius_m, ..FULL };
        let part = reference.model.evaluate(&contents, &ContentsRate::default()).swinging;
        assert!((part.mass_kg - mass).abs() < 6e-4, "{}", part.mass_kg);
        assert!((part.centre_of_mass_body_m().z - centre).abs() < 6e-6);
        assert!((part.inertia_kg_m2[(0, 0)] - transverse).abs() < 6e-6);
        assert!((part.inertia_kg_m2[(2, 2)] - axial).abs() < 6e-6);
    }
}

#[test]
fn mass_rates_are_the_derivatives_of_mass_properties() {
    let tank = TankGeometry { radius_m: 0.095, length_m: 0.67, floor_z_m: 0.2 };
    let bottle = BottleGeometry { radius_m: 0.09, volume_m3: 9e-3, centre_z_m: 1.08 };
    for (port_count, circle) in [(1, 0.0), (2, 0.03), (3, 0.035), (7, 0.04)] {
        let grain = GrainGeometry {
            port_count,
            port_circle_radius_m: circle,
            outer_radius_m: 0.068,
            length_m: 0.25,
            top_z_m: -0.055,
            fuel_density_kg_m3: 940.0,
        };
        let model = MassModel::new(&[], tank, bottle, grain, 0.3);
        let rate = ContentsRate {
            nitrous_kg_s: -0.4,
            port_radius_m_s: 1.2e-3,
            nitrogen_run_tank_kg_s: 0.03,
            nitrogen_bottle_kg_s: -0.05,
        };
        let at = |t: f64| Contents {
            nitrous_kg: 8.0 + rate.nitrous_kg_s * t,
            nitrous_density_kg_m3: 834.3,
            port_radius_m: 0.012 + rate.port_radius_m_s * t,
            nitrogen_run_tank_kg: 0.6 + rate.nitrogen_run_tank_kg_s * t,
            nitrogen_bottle_kg: 2.2 + rate.nitrogen_bottle_kg_s * t,
        };
        let h = 1e-3; // s; central difference: truncation h² of 1e-6 of third derivatives below 1e-3
        let (before, after) = (model.evaluate(&at(-h), &rate).vehicle, model.evaluate(&at(h), &rate).vehicle);
        let found = model.evaluate(&at(0.0), &rate).rate;
        let difference = |a: f64, b: f64| (a - b) / (2.0 * h);
        assert!((difference(after.mass_kg, before.mass_kg) - found.mass_kg_s).abs() < 1e-9);
        let moment = difference(after.first_moment_kg_m.z, before.first_moment_kg_m.z);
        assert!((moment - found.first_moment_z_kg_m_s).abs() < 1e-9);
        for axis in 0..3 {
            let inertia = difference(after.inertia_kg_m2[(axis, axis)], before.inertia_kg_m2[(axis, axis)]);
            assert!((inertia - found.inertia_diagonal_kg_m2_s[axis]).abs() < 1e-9);
        }
        let expected =
            -(0.4 + 0.02) - 940.0 * 0.25 * core::f64::consts::TAU * f64::from(port_count) * 0.012 * 1.2e-3;
        assert!((found.mass_kg_s - expected).abs() < 1e-12);
    }
}

#[test]
fn slosh_mass_fraction_grows_as_the_tank_empties() {
    // Shares of the liquid: 7.6 % full, 20 % at 5 kg, 47 % at 2 kg; frequency 13.8 rad/s under 1 g.
    let reference = reference_vehicle();
    for (nitrous_kg, share) in [(FULL.nitrous_kg, 0.076), (5.0, 0.20), (2.0, 0.47)] {
        let mode = mode_of(&reference, nitrous_kg, G_M_S2);
        assert!((mode.mass_kg / nitrous_kg - share).abs() < 0.006, "{}", mode.mass_kg / nitrous_kg);
    }
    assert!((full_mode(&reference, G_M_S2).stiffness_1_s2.sqrt() - 13.8).abs() < 0.05);
    assert_eq!(full_mode(&reference, -3.0).stiffness_1_s2, 0.0);
    assert_eq!(full_mode(&reference, 0.0).damping_rate_1_s, 0.2);
    // An empty tank: the liquid's last film follows 2/(ξ² - 1) of nothing, and nothing is not NaN.
    let empty = mode_of(&reference, 0.0, G_M_S2);
    assert_eq!(empty.mass_kg, 0.0);
    assert!((empty.station_z_body_m + 0.2).abs() < 1e-15);
}

#[test]
fn gimbal_torque_vanishes_at_the_zero_of_the_swinging_engine() {
    // About the centre of mass, at height l, thrust has the moment T (l + m_e l_e/m) per angle: its own
    // tilt, and the centre's shift by the engine's mass. The engine's reaction is (I_g + m_e l_e l) per
    // angular acceleration. At rest and swinging at the root of their ratio the two cancel: 12.8 rad/s at
    // 700 N; 12.2 without the shift.
    let reference = reference_vehicle();
    let masses = reference.model.evaluate(&FULL, &ContentsRate::default());
    let (thrust_n, part) = (700.0, &masses.swinging);
    let l = -masses.vehicle.centre_of_mass_body_m().z;
    let arm = l + part.first_moment_kg_m.z / masses.vehicle.mass_kg;
    let reaction = part.inertia_kg_m2[(0, 0)] + part.first_moment_kg_m.z * l;
    assert!(((thrust_n * l / reaction).sqrt() - 12.3).abs() < 0.1);
    let zero_squared = thrust_n * arm / reaction;
    assert!((zero_squared.sqrt() - 12.8).abs() < 0.05, "{}", zero_squared.sqrt());

    let flow = FlowTerms::none();
    let response = |frequency_squared: f64| {
        let angle = 1e-5;
        let gimbal = GimbalMotion {
            angle_rad: Vector2::new(angle, angle),
            rate_rad_s: Vector2::zeros(),
            acceleration_rad_s2: Vector2::new(angle, angle) * -frequency_squared,
        };
        let mut balance = balance(&masses.vehicle, &flow, Vec3::zeros());
        // Level thrust about a centre of mass 0.1 mm off the axis gives a steady part: subtract it.
        let mut at = |gimbal: GimbalMotion| {
            balance.load = Load::at(Vec3::zeros(), thrust_direction_body(gimbal.angle_rad) * thrust_n);
            balance.swing = Some(Swing { part, gimbal });
            accelerations(&balance).angular_body_rad_s2
        };
        (at(gimbal) - at(GimbalMotion::default())) / angle
    };
    let still = response(0.0);
    // Moment over I about the centre of mass, both axes positive as commanded; cross-coupling by Ixz, Iyz is
    // 1 %.
    let expected = thrust_n * arm / masses.vehicle.inertia_about_com_kg_m2()[(0, 0)];
    assert!((still.x / expected - 1.0).abs() < 0.01 && (still.y / expected - 1.0).abs() < 0.01, "{still}");
    let zero = response(zero_squared);
    assert!(zero.xy().amax() < 2e-3 * expected, "{zero}");
    assert!(response(0.9 * zero_squared).x > 0.0 && response(1.1 * zero_squared).x < 0.0);
    // Above the zero the body turns the wrong way.
    assert!(response(4.0 * zero_squared).x < -2.0 * expected);
}

#[test]
fn thrust_direction_and_engine_axes_agree() {
    for (x, y) in [(0.0, 0.0), (0.1, 0.0), (0.0, 0.1), (-0.12, 0.07)] {
        let gimbal = Vector2::new(x, y);
        let turned = body_from_engine(gimbal) * Vec3::new(0.0, 0.0, -1.0);
        assert!((turned - thrust_direction_body(gimbal)).norm() < 1e-15);
    }
    let com = Vec3::new(0.0, 0.0, -0.4);
    for (gimbal, axis) in [(Vector2::new(0.05, 0.0), 0), (Vector2::new(0.0, 0.05), 1)] {
        let moment = (-com).cross(&thrust_direction_body(gimbal));
        assert!(moment[axis] > 0.0, "a positive command gives a positive moment");
    }
}

#[test]
fn a_torque_free_top_precesses_as_euler_says() {
    // Symmetric about z: the lateral rate turns at (Izz - Ixx)/Ixx times the spin. O is not the centre.
    let (mass_kg, transverse, axial, spin, z) = (70.0, 20.0, 2.5, 3.0, -0.4);
    let centre = Vec3::new(0.0, 0.0, z);
    let vehicle = MassProperties {
        mass_kg,
        first_moment_kg_m: centre * mass_kg,
        inertia_kg_m2: Mat3::from_diagonal(&Vec3::new(transverse, transverse, axial))
            + hopbench::frame::point_inertia(centre) * mass_kg,
    };
    let flow = FlowTerms::none();
    let mut state = State::at_rest();
    state.rate_body_rad_s = Vec3::new(0.2, 0.0, spin);
    for _ in 0..2_000 {
        state = rk4_step(&state, 1e-3, |s, _| {
            s.rate(&accelerations(&balance(&vehicle, &flow, s.rate_body_rad_s)), 0.0)
        });
    }
    let (sine, cosine) = libm::sincos((axial - transverse) / transverse * spin * 2.0);
    let expected = Vec3::new(0.2 * cosine, 0.2 * sine, spin);
    // (ω dt)⁴/120 per radian over 5 rad: 1e-12 of 0.2 rad/s.
    assert!((state.rate_body_rad_s - expected).norm() < 1e-12, "{}", state.rate_body_rad_s);
}

#[test]
fn jet_damping_follows_its_power_law() {
    // Mass leaves symmetrically at ±r on z, I falls by k a second: I w' = -(2 ṁ r² - k) w, so
    // w = w0 (1 - k t/I0)^((2 ṁ r² - k)/k).
    let (inertia, k, flow_kg_s, r, w0) = (20.0, 0.5, 0.4, 0.9, 0.3);
    let rate = MassRate {
        mass_kg_s: -2.0 * flow_kg_s,
        first_moment_z_kg_m_s: 0.0,
        inertia_diagonal_kg_m2_s: Vec3::new(-k, -k, 0.0),
    };
    let out = |z| Outflow { position_body_m: Vec3::new(0.0, 0.0, z), mass_flow_kg_s: flow_kg_s };
    let flow = FlowTerms::new(&rate, &[out(r), out(-r)]);
    assert_eq!(flow.momentum_body_kg_m_s, Vec3::zeros());
    let mut state = State::at_rest();
    state.rate_body_rad_s.y = w0;
    for step in 0..5_000 {
        state = rk4_step(&state, 1e-3, |s, fraction| {
            let now = inertia - k * (f64::from(step) + fraction) * 1e-3;
            let vehicle = MassProperties {
                mass_kg: 70.0,
                first_moment_kg_m: Vec3::zeros(),
                inertia_kg_m2: Mat3::from_diagonal(&Vec3::new(now, now, 2.0)),
            };
            s.rate(&accelerations(&balance(&vehicle, &flow, s.rate_body_rad_s)), 0.0)
        });
    }
    let exponent = (2.0 * flow_kg_s * r * r - k) / k;
    let expected = w0 * libm::pow(1.0 - k * 5.0 / inertia, exponent);
    assert!((state.rate_body_rad_s.y / expected - 1.0).abs() < 1e-13);
}

/// Displacement and velocity of a mass on a mode's spring, driven along x by an acceleration.
#[derive(Clone, Copy)]
struct Driven(SloshState);

impl Integrable for Driven {
    type Rate = Driven;
    fn advanced(&self, k: &Self, dt_s: f64) -> Self {
        Self(SloshState {
            displacement_body_m: self.0.displacement_body_m + k.0.displacement_body_m * dt_s,
            velocity_body_m_s: self.0.velocity_body_m_s + k.0.velocity_body_m_s * dt_s,
        })
    }
    fn rk4_mean(k1: &Self, k2: &Self, k3: &Self, k4: &Self) -> Self {
        let sum = k1.advanced(k2, 2.0).advanced(k3, 2.0).advanced(k4, 1.0);
        sum.advanced(&sum, -5.0 / 6.0)
    }
}

/// One step on the spring of a mode in a tank that accelerates by `drive` of the time [s].
fn spring_step(mode: &Mode, state: Driven, t: f64, dt_s: f64, drive: impl Fn(f64) -> f64) -> Driven {
    rk4_step(&state, dt_s, |s, fraction| {
        Driven(SloshState {
            displacement_body_m: s.0.velocity_body_m_s,
            velocity_body_m_s: mode.restoring_m_s2(&s.0) - Vector2::new(drive(t + fraction * dt_s), 0.0),
        })
    })
}

fn undamped(law: HardeningLaw) -> Mode {
    let mut mode = full_mode(&reference_vehicle(), G_M_S2);
    (mode.damping_rate_1_s, mode.hardening_law, mode.stop_radius_m) = (0.0, law, 1.0);
    mode
}

#[test]
fn duffing_frequency_rises_with_amplitude_as_the_elliptic_integral_says() {
    // x'' + k x + α x³ = 0 from rest at A has the frequency sqrt(k + α A²) agm(1, sqrt(1 - m)), m = α A²/(2
    // (k + α A²)): after whole periods it is back where it began.
    for law in [HardeningLaw::PerAxis, HardeningLaw::Radial] {
        let mut mode = undamped(law);
        mode.hardening_1_m2_s2 = 2e4;
        for amplitude_m in [0.001, 0.03, 0.085] {
            let stiff = mode.stiffness_1_s2 + mode.hardening_1_m2_s2 * amplitude_m * amplitude_m;
            let m = 0.5 * (stiff - mode.stiffness_1_s2) / stiff;
            let (mut a, mut g) = (1.0, (1.0_f64 - m).sqrt());
            for _ in 0..6 {
                (a, g) = (0.5 * (a + g), (a * g).sqrt());
            }
            let frequency = stiff.sqrt() * a;
            let steps = 10_000_u32;
            let dt_s = 5.0 * core::f64::consts::TAU / frequency / f64::from(steps);
            let mut state = Driven(SloshState {
                displacement_body_m: Vector2::new(amplitude_m, 0.0),
                velocity_body_m_s: Vector2::zeros(),
            });
            for step in 0..steps {
                state = spring_step(&mode, state, f64::from(step) * dt_s, dt_s, |_| 0.0);
            }
            // (ω dt)⁴/120 a radian over 31 rad, with ω dt = 3.1e-3 and some third harmonic, ten times that:
            // 1e-10.
            let late = state.0.velocity_body_m_s.x / (amplitude_m * frequency);
            assert!(late.abs() < 1e-9, "phase {late:e} at {amplitude_m} m");
            assert!((state.0.displacement_body_m.x / amplitude_m - 1.0).abs() < 1e-9);
        }
    }
    // By how much, with the reference vehicle's hardening: 3/8 γ (A/R)² to first order; 1.0 % at 2 cm.
    let mode = undamped(HardeningLaw::PerAxis);
    let shift = 0.375 * mode.hardening_1_m2_s2 * 0.02 * 0.02 / mode.stiffness_1_s2;
    assert!((shift - 0.375 * 0.5 * (0.02_f64 / 0.095).powi(2)).abs() < 1e-12);
}

#[test]
fn driven_planar_motion_goes_over_into_rotary_motion_beyond_its_amplitude() {
    // Planar motion in phase with its drive, Ω² = k + 3/4 α A² - f/A. A small y obeys Mathieu's equation
    // y'' + (k + α x²) y = 0, whose first instability is |k + α A²/2 - Ω²| < α A²/4: that is A³ > 2 f/α.
    let mut mode = undamped(HardeningLaw::Radial);
    mode.hardening_1_m2_s2 = 1.05e4;
    let (k, cubic, drive_m_s2, aside_m) = (mode.stiffness_1_s2, mode.hardening_1_m2_s2, 0.6, 1e-6);
    let critical_m = libm::cbrt(2.0 * drive_m_s2 / cubic);
    let greatest_y = |mode: &Mode, amplitude_m: f64| {
        let frequency = (k + 0.75 * cubic * amplitude_m * amplitude_m - drive_m_s2 / amplitude_m).sqrt();
        let mut state = Driven(SloshState {
            displacement_body_m: Vector2::new(-amplitude_m, aside_m),
            velocity_body_m_s: Vector2::zeros(),
        });
        let mut greatest = 0.0_f64;
        for step in 0..30_000 {
            let t = f64::from(step) * 1e-3;
            state = spring_step(mode, state, t, 1e-3, |t| drive_m_s2 * libm::cos(frequency * t));
            greatest = greatest.max(state.0.displacement_body_m.y.abs());
        }
        greatest / aside_m
    };
    // Below it y beats by the root of (8.7 + 5.0)/(8.7 - 5.0), 1.9; above it grows by e in 4.4 s, 900 times
    // in 30 s.
    let (below, above) = (greatest_y(&mode, 0.9 * critical_m), greatest_y(&mode, 1.1 * critical_m));
    assert!(below < 3.0 && above > 300.0, "{below} below, {above} above");
    // Where each axis hardens for itself the axes never meet.
    mode.hardening_law = HardeningLaw::PerAxis;
    assert!(greatest_y(&mode, 1.1 * critical_m) < 1.000_001);
}

#[test]
fn a_baffle_damps_by_the_root_of_the_amplitude() {
    // ζ = ζ_b (η/R)^(1/2) alone, η = 1.541 a in a deep tank: a' = -ω ζ a, hence a^(-1/2) grows by
    // 1.541^(1/2) ω ζ_b/(2 R^(1/2)) a second. The average over a period is good to ζ, 1 %, of the decay.
    let mut reference = reference_vehicle();
    reference.slosh.baffle_damping_ratio = 0.05;
    let mut mode = full_mode(&reference, G_M_S2);
    (mode.damping_rate_1_s, mode.hardening_1_m2_s2) = (0.0, 0.0);
    let (omega, radius, start) = (mode.stiffness_1_s2.sqrt(), reference.model.tank().radius_m, 0.01_f64);
    let mut state = Driven(SloshState {
        displacement_body_m: Vector2::new(start, 0.0),
        velocity_body_m_s: Vector2::zeros(),
    });
    for step in 0..10_000 {
        state = spring_step(&mode, state, f64::from(step) * 1e-3, 1e-3, |_| 0.0);
    }
    let speed = state.0.velocity_body_m_s.x / omega;
    let amplitude = libm::hypot(state.0.displacement_body_m.x, speed);
    let gained = (1.0 / amplitude).sqrt() - (1.0 / start).sqrt();
    let expected = 10.0 * omega * 0.05 * 1.5408_f64.sqrt() / (2.0 * radius.sqrt());
    assert!((gained / expected - 1.0).abs() < 0.01, "{gained} against {expected}");
}

#[test]
fn a_baffle_takes_the_wave_at_the_wall_that_gives_the_same_force() {
    // Pressure of the first mode's wave η cos θ on the wall, ρ g η cos θ cosh(kz)/cosh(kh), summed over the
    // wall by Simpson's rule, against the spring's force; then ζ = ζ_b (η/R)^(1/2), Miles.
    let mut reference = reference_vehicle();
    (reference.slosh.baffle_damping_ratio, reference.slosh.second_mode) = (0.05, true);
    let tank = *reference.model.tank();
    let (radius, rho, k) =
        (tank.radius_m, FULL.nitrous_density_kg_m3, 1.841_183_781_340_659_4 / tank.radius_m);
    for height in [0.2 * radius, radius, 3.0 * radius] {
        let mass = rho * core::f64::consts::PI * radius * radius * height;
        let [first, second] = reference.slosh.modes(&tank, mass, rho, G_M_S2);
        let (first, second) = (first.unwrap(), second.unwrap());
        let share = |z: f64| libm::cosh(k * z) / libm::cosh(k * height);
        let n = 200;
        let dz = height / f64::from(n);
        let column = (0..n).map(|i| {
            let z = f64::from(i) * dz;
            dz / 6.0 * (share(z) + 4.0 * share(z + 0.5 * dz) + share(z + dz))
        });
        // ∫ cos² θ over the circumference is π.
        let force_per_wave = rho * G_M_S2 * radius * core::f64::consts::PI * column.sum::<f64>();
        let wave = first.mass_kg * first.stiffness_1_s2 * 0.01 / force_per_wave;
        let omega = first.stiffness_1_s2.sqrt();
        let got = first.baffle_rate * (omega * 0.01).sqrt() / (2.0 * omega);
        // Simpson over 200 intervals: (k dz)⁴/2880, 1e-9.
        assert!((got / (0.05 * (wave / radius).sqrt()) - 1.0).abs() < 1e-8, "{got}");
        assert_eq!(second.baffle_rate, 0.0);
    }
}

#[test]
fn liquid_without_friction_stays_when_the_tank_spins_up() {
    // A moment about the long axis on an axisymmetric vehicle that cannot tilt: it turns as the tank and what
    // turns with it, and liquid that sloshes across keeps its plane in the world.
    let dry = Component {
        name: "dry".to_owned(),
        mass_kg: 50.0,
        position_m: [0.0; 3],
        inertia_kg_m2: [[1e9, 0.0, 0.0], [0.0, 1e9, 0.0], [0.0, 0.0, 2.0]],
        swings: false,
    };
    let tank = TankGeometry { radius_m: 0.095, length_m: 0.67, floor_z_m: 0.2 };
    let bottle = BottleGeometry { radius_m: 0.09, volume_m3: 9e-3, centre_z_m: 1.08 };
    let grain = GrainGeometry {
        port_count: 1,
        port_circle_radius_m: 0.0,
        outer_radius_m: 0.068,
        length_m: 0.25,
        top_z_m: -0.055,
        fuel_density_kg_m3: 940.0,
    };
    let turning = |factor| {
        MassModel::new(core::slice::from_ref(&dry), tank, bottle, grain, factor)
            .evaluate(&FULL, &ContentsRate::default())
            .vehicle
    };
    let column = 0.5 * FULL.nitrous_kg * 0.095 * 0.095; // kg m²
    for factor in [0.0, 0.1, 0.5, 1.0] {
        let vehicle = turning(factor);
        let without = turning(0.0).inertia_kg_m2[(2, 2)];
        assert!((vehicle.inertia_kg_m2[(2, 2)] - without - factor * column).abs() < 1e-14);
        assert_eq!(vehicle.inertia_kg_m2[(0, 0)], turning(0.0).inertia_kg_m2[(0, 0)]);

        let (mode, flow, moment_n_m) = (undamped(HardeningLaw::Radial), FlowTerms::none(), 2.0);
        let mut state = State::at_rest();
        state.slosh.displacement_body_m.x = 0.03;
        for _ in 0..3_000 {
            state = rk4_step(&state, 1e-3, |s, _| {
                let mut balance = balance(&vehicle, &flow, s.rate_body_rad_s);
                balance.load.moment_body_n_m.z = moment_n_m;
                balance.slosh[0] = Some((&mode, &s.slosh));
                s.rate(&accelerations(&balance), 0.0)
            });
        }
        let rate_rad_s = moment_n_m * 3.0 / vehicle.inertia_kg_m2[(2, 2)];
        assert!((state.rate_body_rad_s.z / rate_rad_s - 1.0).abs() < 1e-8, "{}", state.rate_body_rad_s.z);
        let d = state.slosh.displacement_body_m;
        let in_world = state.ned_from_body() * Vec3::new(d.x, d.y, 0.0);
        // (ω dt)⁴/120 a radian, 16 rad/s against the body at the end: 1e-8 of 30 mm after 45 rad.
        assert!(in_world.y.abs() < 1e-8, "{in_world}");
        assert!(state.ned_from_body()[(0, 0)] < 0.99, "it did turn");
    }
}

#[test]
fn one_way_slosh_counts_its_mass_twice() {
    // Push the vehicle slowly sideways: the oscillator lags until spring force = -m_s a. One-way, that
    // force comes on top of the whole mass: a (m + m_s) = F. Two-way, a m = F.
    let mut reference = reference_vehicle();
    let masses = reference.model.evaluate(&FULL, &ContentsRate::default());
    // A body that cannot turn: huge inertia, so that the closed form is one-dimensional.
    let mut vehicle = masses.vehicle;
    vehicle.inertia_kg_m2 = Mat3::identity() * 1e12;
    let flow = FlowTerms::none();
    for model in [SloshModel::TwoWay, SloshModel::OneWayPaper] {
        reference.slosh.model = model;
        let mut mode = full_mode(&reference, G_M_S2);
        mode.hardening_1_m2_s2 = 0.0;
        let m = vehicle.mass_kg;
        let acceleration = match mode.coupling {
            Coupling::TwoWay => 10.0 / m,
            Coupling::OneWay => 10.0 / (m + mode.mass_kg),
        };
        // One-way the oscillator is driven by the rigid solution without its own force: F/m.
        let driving = match mode.coupling {
            Coupling::TwoWay => acceleration,
            Coupling::OneWay => 10.0 / m,
        };
        let slosh = SloshState {
            displacement_body_m: Vector2::new(-driving / mode.stiffness_1_s2, 0.0),
            velocity_body_m_s: Vector2::zeros(),
        };
        let mut balance = balance(&vehicle, &flow, Vec3::zeros());
        balance.load.force_body_n.x = 10.0;
        balance.slosh[0] = Some((&mode, &slosh));
        let a = accelerations(&balance);
        assert!(a.slosh_body_m_s2[0].norm() < 1e-9, "the liquid rests in the accelerated tank");
        let expected = match mode.coupling {
            Coupling::TwoWay => acceleration,
            Coupling::OneWay => (10.0 - mode.mass_kg * driving) / m,
        };
        assert!((a.specific_force_body_m_s2.x - expected).abs() < 1e-9);
    }
}

#[test]
fn a_body_that_is_none_is_reported_not_nan() {
    let flow = FlowTerms::none();
    let good = reference_vehicle().model.evaluate(&FULL, &ContentsRate::default()).vehicle;
    for bad in [
        MassProperties::none(),
        MassProperties { mass_kg: f64::NAN, ..good },
        MassProperties { inertia_kg_m2: Mat3::zeros(), ..good },
    ] {
        let a = accelerations(&balance(&bad, &flow, Vec3::zeros()));
        assert_eq!(a.status, SolveStatus::Singular);
        assert_eq!(a.specific_force_body_m_s2, Vec3::zeros());
    }
    let mut loaded = balance(&good, &flow, Vec3::zeros());
    loaded.load.force_body_n.x = f64::NAN;
    assert_eq!(accelerations(&loaded).status, SolveStatus::Singular);
}

#[test]
fn parameter_tables_read_from_the_vehicle_file() {
    let reference = reference_vehicle();
    let gimbal: hopbench::actuator::Gimbal = reference.section("gimbal");
    assert!(gimbal.engine_inertia);
    let _: Aerodynamics = reference.section("aero");
    let _: HoldDown = reference.section("hold_down");
}
