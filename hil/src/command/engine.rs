//! `hopbench engine`: steady points of the lit engine.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use hopbench::fluid::Nitrous;
use hopbench::input::{Fault, InputError};
use hopbench::propulsion::{EngineCondition, FeedMap, Guess, OperatingPoint};
use hopbench::vehicle::Vehicle;
use serde::Serialize;
use serde_json::json;

use super::{Common, DONE, print_json, print_text};
use crate::load;

/// Steady points of the lit engine
#[derive(Debug, clap::Args)]
#[command(group = clap::ArgGroup::new("what").required(true).args(["thrust_n", "valve_deg", "sweep"]))]
pub struct Args {
    /// Vehicle file
    pub vehicle: PathBuf,
    /// The point that gives this thrust (N)
    #[arg(long, value_name = "T")]
    pub thrust_n: Option<f64>,
    /// The point at this valve angle (deg)
    #[arg(long, value_name = "A")]
    pub valve_deg: Option<f64>,
    /// Points over the whole travel of the valve
    #[arg(long)]
    pub sweep: bool,
    /// Port radius (mm); the vehicle file's start value if absent
    #[arg(long, value_name = "R")]
    pub port_radius_mm: Option<f64>,
    /// Throat radius (mm); the vehicle file's start value if absent
    #[arg(long, value_name = "R")]
    pub throat_radius_mm: Option<f64>,
    /// Tank temperature (K); the vehicle file's if absent
    #[arg(long, value_name = "T")]
    pub tank_k: Option<f64>,
    /// Tank pressure (bar); the vehicle file's if absent
    #[arg(long, value_name = "P")]
    pub tank_bar: Option<f64>,
}

/// Points of a sweep.
const SWEEP_POINTS: u32 = 64;

/// One steady point, keys as in the manual.
#[derive(Debug, Serialize)]
struct Point {
    valve_deg: f64,
    valve_area_m2: f64,
    oxidizer_kg_s: f64,
    fuel_kg_s: f64,
    of_ratio: f64,
    chamber_pa: f64,
    injector_inlet_pa: f64,
    quality: f64,
    thrust_n: f64,
    isp_s: f64,
    saturated: bool,
}

impl Point {
    fn new(vehicle: &Vehicle, valve_rad: f64, point: &OperatingPoint, saturated: bool) -> Self {
        Self {
            valve_deg: valve_rad.to_degrees(),
            valve_area_m2: vehicle.engine.valve_area().area_m2(valve_rad),
            oxidizer_kg_s: point.oxidizer_kg_s,
            fuel_kg_s: point.fuel_kg_s,
            of_ratio: point.of_ratio,
            chamber_pa: point.chamber_pa,
            injector_inlet_pa: point.injector_inlet_pa,
            quality: point.quality,
            thrust_n: point.thrust_n,
            isp_s: point.isp_s,
            saturated,
        }
    }
}

/// A number of the command line within its allowed range.
fn within(name: &str, value: f64, least: f64, most: f64) -> Result<f64, InputError> {
    if (least..=most).contains(&value) {
        return Ok(value);
    }
    Err(InputError {
        file: "command line".to_owned(),
        faults: vec![Fault {
            line: None,
            key: name.to_owned(),
            message: format!("{value} is out of range; allowed {least} to {most}"),
        }],
    })
}

/// Runs the command.
pub fn run(args: &Args, common: &Common) -> Result<ExitCode> {
    let vehicle = load::vehicle(&args.vehicle, &common.set)?;
    let engine = &vehicle.engine;
    let grain = engine.grain();
    let port_mm = args.port_radius_mm.unwrap_or(grain.port_radius_m * 1e3);
    let throat_mm = args.throat_radius_mm.unwrap_or(engine.nozzle().throat_radius_m() * 1e3);
    let tank_k = args.tank_k.unwrap_or(vehicle.tank.temperature_k);
    let tank_bar = args.tank_bar.unwrap_or(vehicle.tank.pressure_pa * 1e-5);
    let widest_throat_mm = engine.nozzle().greatest_throat_radius_m() * 1e3;
    let condition = EngineCondition {
        port_radius_m: within("--port-radius-mm", port_mm, 1.0, grain.outer_radius_m * 1e3)? * 1e-3,
        throat_radius_m: within("--throat-radius-mm", throat_mm, 1.0, widest_throat_mm)? * 1e-3,
        burning_fraction: 1.0,
        ambient_pa: vehicle.site.pressure_pa,
        chamber_gas: None,
        oxidizer_flow_limit_kg_s: f64::INFINITY,
        outlet: None,
    };
    // The range of the tables; liquid stays liquid above its own vapour pressure only.
    within("--tank-k", tank_k, 240.0, 306.0)?;
    let least_bar = Nitrous::tables().vapor_pressure_pa(tank_k) * 1e-5;
    within("--tank-bar", tank_bar, least_bar, 80.0)?;
    let feed = FeedMap::new(tank_bar * 1e5, tank_k);
    let at_valve = |valve_rad: f64| {
        let area_m2 = engine.valve_area().area_m2(valve_rad);
        engine.operating_point(&feed, area_m2, &condition, Guess::default())
    };
    let open_deg = vehicle.valve_servo.upper_rad.to_degrees();

    let points: Vec<Point> = if args.sweep {
        (0..=SWEEP_POINTS)
            .map(|i| {
                let valve_rad = vehicle.valve_servo.upper_rad * f64::from(i) / f64::from(SWEEP_POINTS);
                Point::new(&vehicle, valve_rad, &at_valve(valve_rad), false)
            })
            .collect()
    } else if let Some(valve_deg) = args.valve_deg {
        // Beyond fully open is the fully open valve, flagged; the encoder's last digit is forgiven.
        let asked = within("--valve-deg", valve_deg, 0.0, 360.0)?;
        let valve_rad = asked.min(open_deg).to_radians();
        vec![Point::new(&vehicle, valve_rad, &at_valve(valve_rad), asked > open_deg + 1e-6)]
    } else {
        let thrust_n = within("--thrust-n", args.thrust_n.unwrap_or_default(), 0.0, 1e6)?;
        let inverse = engine.inverse(&feed, thrust_n, &condition, Guess::default());
        vec![Point::new(&vehicle, inverse.valve_rad, &inverse.point, inverse.saturated)]
    };

    if common.json {
        if args.sweep {
            print_json(&json!({ "points": points }))?;
        } else {
            print_json(&points[0])?;
        }
        return Ok(ExitCode::from(DONE));
    }
    let mut text = format!(
        "{}: port radius {:.2} mm, throat radius {:.2} mm, tank {:.1} K, {:.1} bar\n",
        vehicle.name, port_mm, throat_mm, tank_k, tank_bar
    );
    text += &format!(
        "{:>9} {:>10} {:>9} {:>9} {:>7} {:>8} {:>8} {:>8} {:>9} {:>7}\n",
        "valve deg",
        "area mm2",
        "N2O kg/s",
        "fuel kg/s",
        "O/F",
        "Pc bar",
        "P2 bar",
        "quality",
        "thrust N",
        "Isp s"
    );
    for p in &points {
        text += &format!(
            "{:>9.3} {:>10.4} {:>9.5} {:>9.5} {:>7.3} {:>8.3} {:>8.3} {:>8.4} {:>9.2} {:>7.2}{}\n",
            p.valve_deg,
            p.valve_area_m2 * 1e6,
            p.oxidizer_kg_s,
            p.fuel_kg_s,
            p.of_ratio,
            p.chamber_pa * 1e-5,
            p.injector_inlet_pa * 1e-5,
            p.quality,
            p.thrust_n,
            p.isp_s,
            if p.saturated { "  saturated" } else { "" }
        );
    }
    print_text(&text)?;
    Ok(ExitCode::from(DONE))
}
