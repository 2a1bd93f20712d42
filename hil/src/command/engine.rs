//! `hopbench engine`: steady points of the lit engine.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use hopbench::fluid::Nitrous;
use hopbench::input::InputError;
use hopbench::propulsion::{EngineCondition, FeedMap, WarmStart};
use hopbench::vehicle::Vehicle;

use super::{Common, DONE, in_range, print_json, print_text, refuse_out};
use crate::evidence::run_folder::RunFolder;
use crate::evidence::throttle_map::{Point, ThrottleMap};
use crate::evidence::valve_map;
use crate::load;

/// Steady points of the lit engine
#[derive(Debug, clap::Args)]
#[command(group = clap::ArgGroup::new("what").required(true).args(["thrust_n", "valve_deg", "sweep"]))]
pub struct Args {
    /// Vehicle file
    pub vehicle: PathBuf,
    /// The point that gives this thrust (N)
    #[arg(long, value_name = "T", allow_negative_numbers = true)]
    pub thrust_n: Option<f64>,
    /// The point at this valve angle (deg)
    #[arg(long, value_name = "A", allow_negative_numbers = true)]
    pub valve_deg: Option<f64>,
    /// Points over every thrust that can be asked for; with --out DIR also throttle_map.svg, sweep.csv and
    /// sweep.json there
    #[arg(long)]
    pub sweep: bool,
    /// Port radius (mm); the vehicle file's start value if absent
    #[arg(long, value_name = "R", allow_negative_numbers = true)]
    pub port_radius_mm: Option<f64>,
    /// Throat radius (mm); the vehicle file's start value if absent
    #[arg(long, value_name = "R", allow_negative_numbers = true)]
    pub throat_radius_mm: Option<f64>,
    /// Tank temperature (K); the vehicle file's if absent
    #[arg(long, value_name = "T", allow_negative_numbers = true)]
    pub tank_k: Option<f64>,
    /// Tank pressure (bar); the vehicle file's if absent
    #[arg(long, value_name = "P", allow_negative_numbers = true)]
    pub tank_bar: Option<f64>,
}

/// Runs the command.
pub fn run(args: &Args, common: &Common) -> Result<ExitCode> {
    if !args.sweep {
        refuse_out(common, "add --sweep, or redirect what it prints")?;
    }
    let vehicle = load::vehicle(&args.vehicle, &common.set)?;
    let setup = Setup::new(args, &vehicle)?;
    if args.sweep {
        sweep(common, &vehicle, &setup)?
    } else {
        point(args, common, &vehicle, &setup)?
    };
    Ok(ExitCode::from(DONE))
}

/// The engine at the condition that the options ask for.
struct Setup {
    condition: EngineCondition,
    feed: FeedMap,
    /// The condition in words, a line of its own.
    title: String,
}

impl Setup {
    fn new(args: &Args, vehicle: &Vehicle) -> Result<Self, InputError> {
        let engine = &vehicle.engine;
        let grain = engine.grain();
        let port_mm = args.port_radius_mm.unwrap_or(grain.port_radius_m * 1e3);
        let throat_mm = args.throat_radius_mm.unwrap_or(engine.nozzle().throat_radius_m() * 1e3);
        let tank_k = args.tank_k.unwrap_or(vehicle.tank.temperature_k);
        let tank_bar = args.tank_bar.unwrap_or(vehicle.tank.pressure_pa * 1e-5);
        let widest_throat_mm = engine.nozzle().greatest_throat_radius_m() * 1e3;
        let condition = EngineCondition::burning(
            in_range("--port-radius-mm", port_mm, 1.0, grain.outer_radius_m * 1e3)? * 1e-3,
            in_range("--throat-radius-mm", throat_mm, 1.0, widest_throat_mm)? * 1e-3,
            vehicle.site.pressure_pa,
        );
        // The range of the tables; liquid stays liquid above its own vapour pressure only.
        in_range("--tank-k", tank_k, 240.0, 306.0)?;
        let least_bar = Nitrous::tables().vapor_pressure_pa(tank_k) * 1e-5;
        in_range("--tank-bar", tank_bar, least_bar, 80.0)?;
        let title = format!(
            "{}: port radius {:.2} mm, throat radius {:.2} mm, tank {:.1} K, {:.1} bar\n",
            vehicle.name, port_mm, throat_mm, tank_k, tank_bar
        );
        Ok(Self { condition, feed: engine.feed_map(tank_bar * 1e5, tank_k), title })
    }
}

/// Every thrust that can be asked for: prints the throttle map, and leaves it where `--out` says.
fn sweep(common: &Common, vehicle: &Vehicle, setup: &Setup) -> Result<()> {
    let map = ThrottleMap::new(vehicle, &setup.feed, &setup.condition);
    if let Some(out) = &common.out {
        let folder = RunFolder::create(out)?;
        folder.write_file("throttle_map.svg", &map.svg()?)?;
        folder.write_file("sweep.csv", &map.csv())?;
        folder.write_file("sweep.json", &(serde_json::to_string_pretty(&map)? + "\n"))?;
    }
    if common.json { print_json(&map) } else { print_text(&sweep_text(&setup.title, &map, vehicle)) }
}

/// One point, by its valve angle or its thrust.
fn point(args: &Args, common: &Common, vehicle: &Vehicle, setup: &Setup) -> Result<()> {
    let (engine, Setup { condition, feed, title }) = (&vehicle.engine, setup);
    let point = if let Some(valve_deg) = args.valve_deg {
        // Beyond fully open is the fully open valve, flagged; the encoder's last digit is forgiven.
        let asked_deg = in_range("--valve-deg", valve_deg, 0.0, 360.0)?;
        let open_deg = vehicle.valve_servo.upper_rad.to_degrees();
        let valve_rad = asked_deg.min(open_deg).to_radians();
        let area_m2 = engine.valve_area().area_m2(valve_rad);
        let operating_point = engine.operating_point(feed, area_m2, condition, WarmStart::default());
        Point::new(vehicle, valve_rad, &operating_point, asked_deg > open_deg + 1e-6)
    } else {
        let thrust_n = in_range("--thrust-n", args.thrust_n.unwrap_or_default(), 0.0, 1e6)?;
        let inverse = engine.inverse(feed, thrust_n, condition, WarmStart::default());
        Point::new(vehicle, inverse.valve_rad, &inverse.point, inverse.saturated)
    };
    if common.json {
        return print_json(&point);
    }
    let saturated = if point.saturated { "  saturated" } else { "" };
    let no_fuel = if point.of_ratio.is_none() { "  no fuel left" } else { "" };
    print_text(&format!("{title}{HEADING}\n{}{saturated}{no_fuel}\n", row(&point)))
}

/// Names of the columns of [`row`].
const HEADING: &str =
    "valve deg   area mm2  N2O kg/s fuel kg/s     O/F   Pc bar   P2 bar  quality  thrust N   Isp s";

fn row(p: &Point) -> String {
    format!(
        "{:>9.3} {:>10.4} {:>9.5} {:>9.5} {:>7.3} {:>8.3} {:>8.3} {:>8.4} {:>9.2} {:>7.2}",
        p.valve_deg,
        p.valve_area_m2 * 1e6,
        p.oxidizer_kg_s,
        p.fuel_kg_s,
        p.of_ratio.unwrap_or(f64::INFINITY),
        p.chamber_pa * 1e-5,
        p.injector_inlet_pa * 1e-5,
        p.quality,
        p.thrust_n,
        p.isp_s
    )
}

/// The throttle map as a table.
fn sweep_text(title: &str, map: &ThrottleMap, vehicle: &Vehicle) -> String {
    let mut text = format!("{title}throttle {HEADING}\n");
    for demanded in &map.points {
        let mut marks = String::new();
        for (holds, mark) in [
            (demanded.below_minimum_command, "below minimum"),
            (demanded.point.saturated, "saturated"),
            (demanded.point.of_ratio.is_none(), "no fuel left"),
            (demanded.of_clamped, "O/F outside the map"),
            (demanded.nozzle != "full", demanded.nozzle),
        ] {
            if holds {
                marks += if marks.is_empty() { "  " } else { ", " };
                marks += mark;
            }
        }
        text += &format!("{:>6.0} % {}{marks}\n", demanded.throttle_percent, row(&demanded.point));
    }
    text += &format!(
        "\nGreatest thrust {:.1} N, limited by {}; least thrust command {:.0} N. {}\n",
        map.thrust_greatest_n,
        if map.limited_by == "oxidizer_flow" {
            format!("the oxidiser flow, {} kg/s", map.oxidizer_flow_max_kg_s)
        } else {
            "the fully open valve".to_owned()
        },
        map.thrust_command_min_n,
        valve_map::text(&vehicle.engine.valve_area().check())
    );
    text
}
