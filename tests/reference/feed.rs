//! Two-phase flux through valve and injector, and the nitrogen's whereabouts, against CoolProp called
//! directly (tools/reference/make_feed_points.py; version in the data files): Eqs 13 to 16 and the states of
//! the oxidiser.

// The test prints its figures for the record.
#![allow(clippy::disallowed_macros)]

use crate::fixture::bare_engine;
use std::collections::BTreeMap;

use hopbench::propulsion::{FeedMap, NitrogenInventory, PressurantGas};

const FEED: &str = include_str!("feed_points.csv");
const PRESSURANT: &str = include_str!("pressurant_points.csv");

/// Rows of a file by the names of its columns.
fn rows(text: &'static str) -> Vec<BTreeMap<&'static str, f64>> {
    let mut lines = text.lines().filter(|line| !line.starts_with('#'));
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    lines
        .map(|line| names.iter().copied().zip(line.split(',').map(|x| x.parse().unwrap())).collect())
        .collect()
}

/// Greatest deviation seen of each quantity.
#[derive(Default)]
struct Worst(BTreeMap<&'static str, (f64, String)>);

impl Worst {
    fn see(&mut self, what: &'static str, error: f64, place: impl Fn() -> String) {
        let worst = self.0.entry(what).or_default();
        if error.is_nan() || error.abs() > worst.0 {
            *worst = (error.abs(), place());
        }
    }

    fn stay_below(&self, limits: &[(&str, f64)]) {
        for (what, (error, place)) in &self.0 {
            println!("{what}: {error:.1e} at {place}");
        }
        for (what, limit) in limits {
            let (error, place) = &self.0[what];
            assert!(error < limit, "{what}: {error:e}, allowed {limit:e}, at {place}");
        }
        assert_eq!(self.0.len(), limits.len(), "every quantity has a limit");
    }
}

#[test]
fn dyer_flux_of_valve_and_injector() {
    let rows = rows(FEED);
    assert!(rows.len() > 700);
    let mut worst = Worst::default();
    let mut feed = FeedMap::new(65e5, 290.0);
    for row in &rows {
        let place = || {
            format!(
                "{:.0} Pa {} K, P2 {:.0}, Pc {:.0}",
                row["tank_pa"], row["tank_k"], row["inlet_pa"], row["chamber_pa"]
            )
        };
        feed.rebuild(row["tank_pa"], row["tank_k"]);
        let inlet = feed.inlet(row["inlet_pa"]);
        let mut relative =
            |what: &'static str, own: f64, key: &str| worst.see(what, own / row[key] - 1.0, place);
        relative("tank density", feed.tank().density_kg_m3, "tank_density");
        relative("tank vapour pressure", feed.tank().vapor_pressure_pa, "tank_vapor_pa");
        relative("flash pressure", feed.flash_pa(), "flash_pa");
        relative("valve critical pressure", feed.valve_critical_pa(), "valve_critical_pa");
        relative("density of state 2", inlet.state.density_kg_m3, "inlet_density");
        relative("vapour pressure of state 2", inlet.state.vapor_pressure_pa, "inlet_vapor_pa");
        relative("valve flux", inlet.valve_flux_kg_m2_s, "valve_flux");
        relative("injector critical pressure", inlet.critical_pa, "injector_critical_pa");
        let flux = feed.injector_flux_kg_m2_s(&inlet, row["chamber_pa"]);
        relative("injector flux", flux, "injector_flux");
        worst.see("quality", inlet.quality - row["quality"], place);
    }
    worst.stay_below(&LIMITS);
}

/// What the tables' error is worth in flight: flows of the reference tank, liquid and flashing, away from Pv.
#[test]
fn flux_of_the_reference_tank() {
    let feed = FeedMap::new(65e5, 290.0);
    let mut worst = Worst::default();
    for row in rows(FEED).iter().filter(|row| (row["tank_pa"], row["tank_k"]) == (65e5, 290.0)) {
        let place = || format!("P2 {:.0}, Pc {:.0}", row["inlet_pa"], row["chamber_pa"]);
        let inlet = feed.inlet(row["inlet_pa"]);
        worst.see("valve", inlet.valve_flux_kg_m2_s / row["valve_flux"] - 1.0, place);
        let injector = feed.injector_flux_kg_m2_s(&inlet, row["chamber_pa"]);
        worst.see("injector", injector / row["injector_flux"] - 1.0, place);
        worst.see("tank density", feed.tank().density_kg_m3 / row["tank_density"] - 1.0, place);
        if row["inlet_pa"] < row["valve_critical_pa"] {
            // The kappa of this pressure weighs them; SPI is the tank's density, HEM the choked flux.
            worst.see("valve, choked", inlet.valve_flux_kg_m2_s / row["valve_flux"] - 1.0, place);
        }
    }
    // Tables of the fluids: 1e-8 of the tank's liquid and of the saturation line (tests/reference/fluid.rs,
    // and there in units of the latent heat), some of it twice; the map between valve and injector adds as
    // much.
    worst.stay_below(&[("tank density", 2e-8), ("valve", 2e-8), ("valve, choked", 2e-8), ("injector", 5e-8)]);
}

const LIMITS: [(&str, f64); 10] = [
    ("tank density", 1e-6),
    ("tank vapour pressure", 1e-6),
    ("flash pressure", 1e-6),
    ("valve critical pressure", 1e-3),
    ("density of state 2", 1e-6),
    ("vapour pressure of state 2", 1e-6),
    ("valve flux", 1e-6),
    ("injector critical pressure", 1e-3),
    ("injector flux", 1e-6),
    ("quality", 1e-6),
];

#[test]
fn nitrogen_in_bottle_and_tank() {
    let rows = rows(PRESSURANT);
    assert_eq!(rows.len(), 40);
    assert!(rows.iter().any(|r| r["regulated"] == 1.0) && rows.iter().any(|r| r["regulated"] == 0.0));
    let pressurant = bare_engine::vehicle().pressurant;
    let gas = PressurantGas::new(&pressurant, 290.0);
    let mut worst = Worst::default();
    for row in &rows {
        let place = || format!("{} kg in all, {} m3", row["total_kg"], row["ullage_m3"]);
        let inventory = NitrogenInventory {
            total_kg: row["total_kg"],
            ullage_m3: row["ullage_m3"],
            ambient_pa: 101_325.0,
            regulator_sag_pa: 0.0,
        };
        let now = pressurant.distribute(&gas, &inventory);
        assert_eq!(now.regulated, row["regulated"] == 1.0, "{}", place());
        worst.see("tank pressure", now.tank_pa / row["tank_pa"] - 1.0, place);
        worst.see("bottle pressure", now.bottle_pa / row["bottle_pa"] - 1.0, place);
        worst.see("tank mass", now.tank_kg / row["tank_kg"] - 1.0, place);
        worst.see("bottle mass", now.bottle_kg / row["bottle_kg"] - 1.0, place);
    }
    let limits =
        [("tank pressure", 1e-7), ("bottle pressure", 1e-7), ("tank mass", 1e-7), ("bottle mass", 1e-7)];
    worst.stay_below(&limits);
}
