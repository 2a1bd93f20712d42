//! The vehicle as PX4 must know it: masses, levers and limits at one moment of the flight.

use hopbench::dynamics::mass::{Contents, ContentsRate};
use hopbench::input::Invalid;
use hopbench::vehicle::Vehicle;
use serde::Serialize;

/// What PX4 must know of a vehicle, at one mass.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Lander {
    /// Mass (kg).
    pub mass_kg: f64,
    /// Local gravity (m/s²).
    pub gravity_m_s2: f64,
    /// Thrust at throttle 1 (N).
    pub thrust_rated_n: f64,
    /// Least thrust of the lit engine (N).
    pub thrust_min_n: f64,
    /// Greatest thrust (N).
    pub thrust_max_n: f64,
    /// Centre of mass above the gimbal pivot (m).
    pub lever_m: f64,
    /// Centre of mass beside the long axis, body FRD x and y (m).
    pub offset_m: [f64; 2],
    /// Moments of inertia about the centre of mass, FRD x, y, z (kg m²).
    pub inertia_kg_m2: [f64; 3],
    /// Greatest gimbal angle of an axis (rad).
    pub gimbal_limit_rad: f64,
    /// From a command to the gimbal's motion (s).
    pub gimbal_dead_time_s: f64,
    /// Natural frequency of its servo (rad/s).
    pub gimbal_servo_rad_s: f64,
    /// Damping ratio of its servo.
    pub gimbal_servo_damping: f64,
    /// What turns with the gimbal and reacts on the vehicle.
    pub swinging: SwingingEngine,
    /// Moment of a thruster pair about z (N m).
    pub roll_moment_n_m: f64,
}

/// The engine that turns about the gimbal pivot; nothing where the vehicle file lets it not react.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct SwingingEngine {
    /// Mass times distance below the pivot (kg m).
    pub moment_kg_m: f64,
    /// Inertia about a lateral axis through the pivot (kg m²).
    pub inertia_kg_m2: f64,
}

impl Lander {
    /// A vehicle with these contents.
    pub fn of(vehicle: &Vehicle, contents: &Contents) -> Self {
        let state = vehicle.mass.evaluate(contents, &ContentsRate::default());
        let mass = &state.vehicle;
        let (com, inertia) = (mass.centre_of_mass_body_m(), mass.inertia_about_com_kg_m2());
        let (servo, rating) = (&vehicle.gimbal_servo, &vehicle.rating);
        Self {
            mass_kg: mass.mass_kg,
            gravity_m_s2: vehicle.site.gravity_m_s2,
            thrust_rated_n: rating.thrust_rated_n,
            thrust_min_n: rating.thrust_command_min_n,
            thrust_max_n: rating.thrust_command_max_n.min(rating.thrust_rated_n),
            lever_m: -com.z,
            offset_m: [com.x, com.y],
            inertia_kg_m2: [inertia[(0, 0)], inertia[(1, 1)], inertia[(2, 2)]],
            gimbal_limit_rad: vehicle.gimbal.limit_rad,
            gimbal_dead_time_s: vehicle.gimbal.delay_s,
            gimbal_servo_rad_s: servo.natural_frequency_rad_s,
            gimbal_servo_damping: servo.damping_ratio,
            swinging: if vehicle.gimbal.engine_inertia {
                SwingingEngine {
                    moment_kg_m: state.swinging.first_moment_kg_m.z,
                    inertia_kg_m2: state.swinging.inertia_kg_m2[(0, 0)],
                }
            } else {
                SwingingEngine::default()
            },
            roll_moment_n_m: vehicle.roll_moment_n_m(),
        }
    }

    /// Weight (N).
    pub fn weight_n(&self) -> f64 {
        self.mass_kg * self.gravity_m_s2
    }

    /// Throttle that carries the weight.
    pub(super) fn hover_throttle(&self) -> f64 {
        self.weight_n() / self.thrust_rated_n
    }

    /// What one unit of each torque servo does at hover, about FRD x, y, z (rad/s²): thrust times lever times
    /// the sine of the gimbal's limit over the inertia, and the thruster pair's moment over the inertia.
    pub fn unit_effect_rad_s2(&self) -> [f64; 3] {
        let moment_n_m = self.weight_n() * self.lever_m * libm::sin(self.gimbal_limit_rad);
        let [xx, yy, zz] = self.inertia_kg_m2;
        [moment_n_m / xx, moment_n_m / yy, self.roll_moment_n_m / zz]
    }

    /// Refuses a vehicle that PX4 cannot steer or carry.
    pub(super) fn check_flyable(&self) -> Result<(), Invalid> {
        let weight_n = self.weight_n();
        if self.lever_m < LEAST_LEVER_M {
            let message = format!(
                "the centre of mass is {:.3} m above the gimbal pivot; \
                 a gimbal steers from {LEAST_LEVER_M} m",
                self.lever_m
            );
            return Err(Invalid::new("component", message));
        }
        if weight_n > MOST_HOVER_SHARE * self.thrust_max_n {
            let message = format!(
                "{:.0} N carries {weight_n:.0} N of weight at less than {MOST_HOVER_SHARE} of it; \
                 allowed from {:.0} N",
                self.thrust_max_n,
                weight_n / MOST_HOVER_SHARE
            );
            return Err(Invalid::new("vehicle.thrust_command_max_n", message));
        }
        if self.thrust_min_n > MOST_IDLE_SHARE * weight_n {
            let message = format!(
                "{:.0} N under {weight_n:.0} N of weight leaves nothing to descend with; \
                 allowed up to {:.0} N",
                self.thrust_min_n,
                MOST_IDLE_SHARE * weight_n
            );
            return Err(Invalid::new("vehicle.thrust_command_min_n", message));
        }
        let effect = self.unit_effect_rad_s2();
        for (axis, key) in [(0, "gimbal.limit_rad"), (1, "gimbal.limit_rad"), (2, "rcs.thrust_n")] {
            if effect[axis] < LEAST_EFFECT_RAD_S2 {
                let message = format!(
                    "full command turns the vehicle at {:.3} rad/s² about FRD {}; \
                     PX4 needs {LEAST_EFFECT_RAD_S2}",
                    effect[axis],
                    ["x", "y", "z"][axis]
                );
                return Err(Invalid::new(key, message));
            }
        }
        Ok(())
    }
}

/// Less lever than this is within what the centre of mass moves during a flight (m).
const LEAST_LEVER_M: f64 = 0.05;
/// Share of the greatest thrust that hover may take: beyond, nothing is left to climb and steer with.
const MOST_HOVER_SHARE: f64 = 0.87;
/// Share of the weight that the least thrust may carry.
const MOST_IDLE_SHARE: f64 = 0.8;
/// Least angular acceleration of a full command (rad/s²): under it the gains leave what PX4 documents by far.
const LEAST_EFFECT_RAD_S2: f64 = 0.25;
