//! Couplings held still, so that a flight with and without one shows what it is worth.
//!
//! Mass itself always evolves. What is held is what the rest of the vehicle sees of it: see [`Coupling`].

use super::Evaluation;
use crate::dynamics::mass::{MassProperties, MassRate, MassState};
use crate::frame::{Mat3, Vec3, point_inertia};
use crate::propulsion::NitrogenState;
use crate::scenario::Coupling;

/// What is held, at the values of step 0.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Frozen {
    com_body_m: Option<Vec3>,
    inertia_kg_m2: Option<Mat3>,
    /// Port radius that internal ballistics see (m).
    pub(super) port_radius_m: Option<f64>,
    run_tank_kg: Option<f64>,
    /// The throat does not wear.
    pub(super) throat: bool,
}

impl Frozen {
    /// From the vehicle at step 0.
    pub(super) fn new(couplings: &[Coupling], start: &Evaluation, port_radius_m: f64) -> Self {
        let has = |coupling: Coupling| couplings.contains(&coupling);
        Self {
            com_body_m: has(Coupling::Com).then(|| start.mass.centre_of_mass_body_m()),
            inertia_kg_m2: has(Coupling::Inertia).then(|| start.mass.inertia_about_com_kg_m2()),
            port_radius_m: has(Coupling::Port).then_some(port_radius_m),
            run_tank_kg: has(Coupling::Nitrogen)
                .then_some(start.pressurant.tank_kg + start.pressurant.vapor_kg),
            throat: has(Coupling::Throat),
        }
    }

    /// Nitrogen in run tank and bottle as the mass model sees it (kg), and its flow into the tank (kg/s).
    pub(super) fn nitrogen(&self, real: &NitrogenState, transfer_kg_s: f64) -> (f64, f64, f64) {
        let real_kg = real.tank_kg + real.vapor_kg;
        match self.run_tank_kg {
            None => (real_kg, real.bottle_kg, transfer_kg_s),
            Some(held_kg) => {
                let total_kg = real_kg + real.bottle_kg;
                let tank_kg = held_kg.min(total_kg);
                (tank_kg, total_kg - tank_kg, 0.0)
            }
        }
    }

    /// Puts the held centre of mass and inertia in place of the real ones, and their rates with them.
    pub(super) fn hold(&self, mass: &mut MassState) {
        if self.com_body_m.is_none() && self.inertia_kg_m2.is_none() {
            return;
        }
        let (real, rate) = (mass.vehicle, mass.rate);
        let m = real.mass_kg;
        let com = self.com_body_m.unwrap_or_else(|| real.centre_of_mass_body_m());
        let own = self.inertia_kg_m2.unwrap_or_else(|| real.inertia_about_com_kg_m2());
        let own_rate = match self.inertia_kg_m2 {
            Some(_) => Vec3::zeros(),
            None => rate.inertia_diagonal_kg_m2_s - transfer_rate(&real, &rate),
        };
        mass.vehicle = MassProperties {
            mass_kg: m,
            first_moment_kg_m: com * m,
            inertia_kg_m2: own + point_inertia(com) * m,
        };
        let moment_rate = match self.com_body_m {
            Some(com) => com.z * rate.mass_kg_s,
            None => rate.first_moment_z_kg_m_s,
        };
        let held_rate = MassRate { first_moment_z_kg_m_s: moment_rate, ..rate };
        let carried = match self.com_body_m {
            // A fixed place carries a mass that falls.
            Some(com) => point_inertia(com).diagonal() * rate.mass_kg_s,
            None => transfer_rate(&real, &held_rate),
        };
        mass.rate = MassRate { inertia_diagonal_kg_m2_s: own_rate + carried, ..held_rate };
    }
}

/// Rate of the diagonal of m (c·c E - c cᵀ), what the parallel-axis theorem adds, with m c changing along z
/// only: it is (S·S E - S Sᵀ)/m.
fn transfer_rate(mass: &MassProperties, rate: &MassRate) -> Vec3 {
    let (m, s) = (mass.mass_kg, mass.first_moment_kg_m);
    if m <= 0.0 {
        return Vec3::zeros();
    }
    let along = 2.0 * s.z * rate.first_moment_z_kg_m_s / m;
    Vec3::new(along, along, 0.0) - point_inertia(s).diagonal() * (rate.mass_kg_s / (m * m))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dynamics::mass::{
        BottleGeometry, Component, Contents, ContentsRate, GrainGeometry, MassModel, TankGeometry,
    };

    fn model() -> MassModel {
        let part = Component {
            name: "dry".into(),
            mass_kg: 54.0,
            position_m: [0.002, 0.001, 0.5],
            inertia_kg_m2: [[9.0, -0.1, 0.0], [-0.1, 8.0, 0.0], [0.0, 0.0, 2.0]],
            swings: false,
        };
        MassModel::new(
            &[part],
            TankGeometry { radius_m: 0.095, length_m: 0.67, floor_z_m: 0.2 },
            BottleGeometry { radius_m: 0.09, volume_m3: 9e-3, centre_z_m: 1.08 },
            GrainGeometry {
                port_count: 1,
                port_circle_radius_m: 0.0,
                outer_radius_m: 0.068,
                length_m: 0.25,
                top_z_m: -0.055,
                fuel_density_kg_m3: 940.0,
            },
            1.0,
        )
    }

    fn at(model: &MassModel, time_s: f64) -> MassState {
        let rate = ContentsRate {
            nitrous_kg_s: -0.4,
            port_radius_m_s: 1.5e-3,
            nitrogen_run_tank_kg_s: 0.03,
            nitrogen_bottle_kg_s: -0.04,
        };
        let contents = Contents {
            nitrous_kg: 9.0 + rate.nitrous_kg_s * time_s,
            nitrous_density_kg_m3: 834.0,
            port_radius_m: 0.03 + rate.port_radius_m_s * time_s,
            nitrogen_run_tank_kg: 0.4 + rate.nitrogen_run_tank_kg_s * time_s,
            nitrogen_bottle_kg: 2.4 + rate.nitrogen_bottle_kg_s * time_s,
        };
        model.evaluate(&contents, &rate)
    }

    #[test]
    fn what_is_held_stays_and_the_rates_are_those_of_what_is_held() {
        let model = model();
        let start = at(&model, -3.0).vehicle;
        let (com, own) = (start.centre_of_mass_body_m(), start.inertia_about_com_kg_m2());
        for (freeze_com, freeze_inertia) in [(true, false), (false, true), (true, true)] {
            let frozen = Frozen {
                com_body_m: freeze_com.then_some(com),
                inertia_kg_m2: freeze_inertia.then_some(own),
                ..Frozen::default()
            };
            let held = |time_s| {
                let mut mass = at(&model, time_s);
                frozen.hold(&mut mass);
                mass
            };
            let (real, now) = (at(&model, 0.0).vehicle, held(0.0));
            assert_eq!(now.vehicle.mass_kg, real.mass_kg);
            let moved = (now.vehicle.centre_of_mass_body_m() - com).norm();
            let turned = (now.vehicle.inertia_about_com_kg_m2() - own).norm();
            // Round-off of 20 kg m²; what is free has moved by millimetres and a tenth.
            assert_eq!(freeze_com, moved < 1e-15, "{moved}");
            assert_eq!(freeze_inertia, turned < 1e-13, "{turned}");
            if !freeze_com {
                assert_eq!(now.vehicle.first_moment_kg_m.z, real.centre_of_mass_body_m().z * real.mass_kg);
            }
            if !freeze_inertia {
                let difference = now.vehicle.inertia_about_com_kg_m2() - real.inertia_about_com_kg_m2();
                assert!(difference.norm() < 1e-13);
            }
            // Central difference over 2 h: h² of third derivatives, below 1e-8; round-off 1e-14/1e-3.
            let h = 1e-3;
            let (before, after) = (held(-h).vehicle, held(h).vehicle);
            let moment = (after.first_moment_kg_m - before.first_moment_kg_m) / (2.0 * h);
            let inertia = (after.inertia_kg_m2 - before.inertia_kg_m2).diagonal() / (2.0 * h);
            assert!((moment.z - now.rate.first_moment_z_kg_m_s).abs() < 1e-8, "{moment}");
            let difference = inertia - now.rate.inertia_diagonal_kg_m2_s;
            assert!(difference.norm() < 1e-7, "{freeze_com} {freeze_inertia}: {difference}");
        }
    }
}
