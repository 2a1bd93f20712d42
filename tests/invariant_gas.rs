//! Gas as a state, over whole flights.

mod files;

use files::scenario;
use hopbench::simulation::{self, Report};

fn fly(name: &str, overrides: &[(&str, &str)]) -> Report {
    let mut n = 0;
    let mut last = None;
    let start = std::time::Instant::now();
    let report = simulation::fly(&scenario(name, overrides), 1, |s| {
        n += 1;
        if n % 2000 == 1 && std::env::var("SHOW").is_ok() {
            println!("{:6.2} T {:7.1} ptank {:7.3} pbot {:7.2} Tb {:6.2} Tu {:6.2} Tl {:7.3} mv {:.4} mn {:.4} mb {:.4} mox {:.4} dens", s.time.s(), s.thrust_n, s.tank_pa*1e-5, s.bottle_pa*1e-5, s.gas_k[0], s.gas_k[1], s.liquid_k, s.nitrous_vapor_kg, s.nitrogen_ullage_kg, s.nitrogen_bottle_kg, s.nitrous_kg);
        }
        last = Some(*s);
    }).unwrap().report(false);
    let s = last.unwrap();
    println!("{overrides:?}\n {:?} {:.2}s wall {:.2}: ptank {:.3} pbot {:.2} Tb {:.2} Tu {:.2} Tl {:.3} mv {:.4} mn {:.4} mb {:.4} mox {:.4} closure {:.1e} expelled {:?}", report.outcome, s.time.s(), start.elapsed().as_secs_f64(), s.tank_pa*1e-5, s.bottle_pa*1e-5, s.gas_k[0], s.gas_k[1], s.liquid_k, s.nitrous_vapor_kg, s.nitrogen_ullage_kg, s.nitrogen_bottle_kg, s.nitrous_kg, report.mass.closure_error_kg, s.expelled_kg);
    report
}

const ON: (&str, &str) = ("vehicle.feed.tank.ullage.model", "\"energy_balance\"");
const BOTTLE: (&str, &str) = ("vehicle.pressurant.bottle.model", "\"energy_balance\"");

#[test]
fn explore() {
    fly("hop_50m", &[]);
    fly("hop_50m", &[("vehicle.engine.depletion.model", "\"two_phase\"")]);
    fly("hop_50m", &[BOTTLE]);
    fly("hop_50m", &[BOTTLE, ("vehicle.pressurant.bottle.wall_conductance_w_k", "0.0")]);
    fly("hop_50m", &[ON]);
    fly("hop_50m", &[ON, ("vehicle.feed.tank.ullage.vapor_conductance_kg_s_pa", "1e-8")]);
    fly("hop_50m", &[ON, ("vehicle.feed.tank.ullage.vapor_conductance_kg_s_pa", "1.0")]);
    fly("hop_50m", &[ON, ("vehicle.feed.tank.ullage.vapor_conductance_kg_s_pa", "1.0"), ("vehicle.feed.tank.ullage.vapor_saturation", "1.0")]);
    fly("hop_50m", &[("vehicle.pressurant.regulator.droop_pa_s_kg", "3.3e6")]);
    fly("hop_50m", &[("vehicle.pressurant.regulator.lockup_pa", "2e5")]);
    fly("hop_50m", &[("vehicle.pressurant.regulator.set_pressure_pa", "60e5")]);
    fly("hop_50m", &[ON, BOTTLE, ("vehicle.pressurant.regulator.droop_pa_s_kg", "3.3e6"), ("vehicle.pressurant.regulator.lockup_pa", "2e5"), ("vehicle.engine.depletion.model", "\"two_phase\""), ("vehicle.feed.tank.ullage.vapor_conductance_kg_s_pa", "1e-8")]);
}
