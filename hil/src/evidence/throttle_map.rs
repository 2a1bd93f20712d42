//! The throttle map: what the lit, steady engine does with every thrust that can be asked of it, as a table
//! and as a picture.
//!
//! A demand is turned into a valve angle and that into flow, pressures and thrust, the way the plant's engine
//! controller and the plant do it. Nothing is extrapolated: a demand beyond the greatest oxidiser flow or the
//! fully open valve gives the point at that limit, marked; a mixture ratio outside the propulsion map has the
//! map's end, marked.

use anyhow::Result;
use hopbench::propulsion::{EngineCondition, FeedMap, Inverse, NozzleFlow, OperatingPoint, WarmStart};
use hopbench::vehicle::Vehicle;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use serde::Serialize;

use crate::evidence::drawing::{
    AT_LIMIT, Area, DrawResult, LINE, MUTED, SCALE, TEXT, chart_style, px, svg, text_style,
};

/// One steady point, keys as in the manual.
#[derive(Clone, Debug, Serialize)]
pub struct Point {
    /// Valve angle (deg).
    pub valve_deg: f64,
    /// Open area of the valve (m²).
    pub valve_area_m2: f64,
    /// Oxidiser flow (kg/s).
    pub oxidizer_kg_s: f64,
    /// Fuel flow (kg/s).
    pub fuel_kg_s: f64,
    /// Oxidiser over fuel; `None`, null in JSON, of a flow without fuel.
    pub of_ratio: Option<f64>,
    /// Chamber pressure (Pa).
    pub chamber_pa: f64,
    /// Pressure between valve and injector (Pa).
    pub injector_inlet_pa: f64,
    /// Vapour mass fraction there.
    pub quality: f64,
    /// Thrust (N).
    pub thrust_n: f64,
    /// Specific impulse (s).
    pub isp_s: f64,
    /// The demand lies beyond the greatest oxidiser flow or the fully open valve: this is the point there.
    pub saturated: bool,
}

impl Point {
    /// A point of the engine at a valve angle.
    pub fn new(vehicle: &Vehicle, valve_rad: f64, point: &OperatingPoint, saturated: bool) -> Self {
        Self {
            valve_deg: valve_rad.to_degrees(),
            valve_area_m2: vehicle.engine.valve_area().area_m2(valve_rad),
            oxidizer_kg_s: point.oxidizer_kg_s,
            fuel_kg_s: point.fuel_kg_s,
            of_ratio: (point.fuel_kg_s > 0.0 || point.oxidizer_kg_s == 0.0).then_some(point.of_ratio),
            chamber_pa: point.chamber_pa,
            injector_inlet_pa: point.injector_inlet_pa,
            quality: point.quality,
            thrust_n: point.thrust_n,
            isp_s: point.isp_s,
            saturated,
        }
    }
}

/// A point of the map: the demand, the engine's answer, and which limits it touches.
#[derive(Clone, Debug, Serialize)]
pub struct ThrottlePoint {
    /// Demand as a share of the rated thrust (%).
    pub throttle_percent: f64,
    /// Demand (N).
    pub thrust_command_n: f64,
    /// The answer.
    #[serde(flatten)]
    pub point: Point,
    /// In flight a lit engine is held at the least thrust command instead.
    pub below_minimum_command: bool,
    /// The mixture ratio lies outside the propulsion map, whose end holds; always so without fuel.
    pub of_clamped: bool,
    /// State of the nozzle: "full", "separated", "unchoked" or "off".
    pub nozzle: &'static str,
}

/// The whole map of one vehicle at one condition.
#[derive(Clone, Debug, Serialize)]
pub struct ThrottleMap {
    /// Name of the vehicle.
    pub vehicle: String,
    /// Port radius (mm).
    pub port_radius_mm: f64,
    /// Throat radius (mm).
    pub throat_radius_mm: f64,
    /// Tank temperature (K).
    pub tank_k: f64,
    /// Tank pressure (bar).
    pub tank_bar: f64,
    /// Thrust at full throttle (N).
    pub thrust_rated_n: f64,
    /// Least thrust command in flight (N).
    pub thrust_command_min_n: f64,
    /// Greatest thrust that a demand can get (N).
    pub thrust_greatest_n: f64,
    /// What sets that: "oxidizer_flow" (the clamp of demands) or "valve_open".
    pub limited_by: &'static str,
    /// Greatest oxidiser flow of a demand (kg/s).
    pub oxidizer_flow_max_kg_s: f64,
    /// The points, throttle rising.
    pub points: Vec<ThrottlePoint>,
}

/// Throttle steps of a map go this far beyond the greatest thrust.
const BEYOND: f64 = 1.08;

impl ThrottleMap {
    /// Sweeps the demand from 1 % of rated thrust to beyond what the engine can give, in steps of 1 %.
    pub fn new(vehicle: &Vehicle, feed: &FeedMap, condition: &EngineCondition) -> Self {
        let engine = &vehicle.engine;
        let rating = &vehicle.rating;
        let (least_of, most_of) = engine.mapped_of_ratios();
        let (_, most_kg_s) = engine.demand_kg_s();
        let ask = |thrust_n: f64| engine.inverse(feed, thrust_n, condition, WarmStart::default());
        let greatest = ask(f64::MAX);
        let top_n = BEYOND * greatest.point.thrust_n.max(rating.thrust_command_max_n);
        let steps = (100.0 * top_n / rating.thrust_rated_n).ceil() as u32;
        let points = (1..=steps)
            .map(|percent| {
                let throttle_percent = f64::from(percent);
                let thrust_command_n = 0.01 * throttle_percent * rating.thrust_rated_n;
                let Inverse { valve_rad, point, saturated, .. } = ask(thrust_command_n);
                ThrottlePoint {
                    throttle_percent,
                    thrust_command_n,
                    below_minimum_command: thrust_command_n < rating.thrust_command_min_n,
                    of_clamped: point.fuel_kg_s <= 0.0 || !(least_of..=most_of).contains(&point.of_ratio),
                    nozzle: match point.nozzle_flow {
                        NozzleFlow::Full => "full",
                        NozzleFlow::Separated => "separated",
                        NozzleFlow::Unchoked => "unchoked",
                        NozzleFlow::Off => "off",
                    },
                    point: Point::new(vehicle, valve_rad, &point, saturated),
                }
            })
            .collect();
        let by_flow = greatest.point.oxidizer_kg_s >= (1.0 - 1e-6) * most_kg_s;
        Self {
            vehicle: vehicle.name.clone(),
            port_radius_mm: condition.port_radius_m * 1e3,
            throat_radius_mm: condition.throat_radius_m * 1e3,
            tank_k: feed.tank_temperature_k(),
            tank_bar: feed.tank().pressure_pa * 1e-5,
            thrust_rated_n: rating.thrust_rated_n,
            thrust_command_min_n: rating.thrust_command_min_n,
            thrust_greatest_n: greatest.point.thrust_n,
            limited_by: if by_flow { "oxidizer_flow" } else { "valve_open" },
            oxidizer_flow_max_kg_s: most_kg_s,
            points,
        }
    }

    /// The table as comma-separated values, columns as the keys of a point; a field is empty where a key is
    /// null.
    pub fn csv(&self) -> String {
        let mut text = "throttle_percent,thrust_command_n,valve_deg,valve_area_m2,oxidizer_kg_s,fuel_kg_s,\
             of_ratio,chamber_pa,injector_inlet_pa,quality,thrust_n,isp_s,saturated,\
             below_minimum_command,of_clamped,nozzle\n"
            .to_owned();
        for row in &self.points {
            let p = &row.point;
            text += &format!(
                "{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{}\n",
                row.throttle_percent,
                row.thrust_command_n,
                p.valve_deg,
                p.valve_area_m2,
                p.oxidizer_kg_s,
                p.fuel_kg_s,
                p.of_ratio.map_or(String::new(), |of_ratio| of_ratio.to_string()),
                p.chamber_pa,
                p.injector_inlet_pa,
                p.quality,
                p.thrust_n,
                p.isp_s,
                p.saturated,
                row.below_minimum_command,
                row.of_clamped,
                row.nozzle
            );
        }
        text
    }

    /// The picture, as SVG text: six panels over the throttle.
    pub fn svg(&self) -> Result<String> {
        svg(SIZE, |root| self.draw(root))
    }

    fn draw(&self, root: &Area<'_>) -> DrawResult {
        let (head, rest) = root.split_vertically(px(TITLE_HEIGHT));
        let (panels, foot) = rest.split_vertically(px(SIZE.1 - TITLE_HEIGHT - LEGEND_HEIGHT));
        self.draw_title(&head)?;
        let areas = panels.margin(0, 0, px(10), px(20)).split_evenly((3, 2));
        for (i, (area, panel)) in areas.iter().zip(PANELS).enumerate() {
            self.draw_panel(area, &panel, i >= 4)?;
        }
        self.draw_legend(&foot)
    }

    fn draw_title(&self, area: &Area<'_>) -> DrawResult {
        let title = format!("Throttle map of {}", self.vehicle);
        area.draw(&Text::new(title, (px(24), px(18)), text_style(26, &TEXT)))?;
        let condition = format!(
            "steady, lit; port radius {:.1} mm, throat radius {:.2} mm, N2O at {:.1} bar and {:.1} K; \
             100 % = {:.0} N",
            self.port_radius_mm, self.throat_radius_mm, self.tank_bar, self.tank_k, self.thrust_rated_n
        );
        area.draw(&Text::new(condition, (px(24), px(52)), text_style(15, &MUTED)))?;
        Ok(())
    }

    /// What the shades and colours mean.
    fn draw_legend(&self, area: &Area<'_>) -> DrawResult {
        let limit = if self.limited_by == "oxidizer_flow" {
            format!(
                "oxidiser flow clamped at {:.3} kg/s: the point at the limit",
                self.oxidizer_flow_max_kg_s
            )
        } else {
            "valve fully open: the point at the limit".to_owned()
        };
        let least = format!(
            "below the least thrust command, {:.0} N: held there in flight",
            self.thrust_command_min_n
        );
        let mut entries = vec![(BELOW, least), (ABOVE, limit)];
        if self.points.iter().any(|p| p.of_clamped) {
            entries.push((CLAMPED, "O/F outside the propulsion map: its end holds".to_owned()));
        }
        let mut x = 24;
        for (color, text) in entries {
            // The backend has no font to measure by: half an em is the mean width of a letter.
            let width = 7 * text.chars().count() as i32;
            area.draw(&Rectangle::new([(px(x), px(12)), (px(x + 18), px(24))], color.filled()))?;
            area.draw(&Text::new(text, (px(x + 26), px(12)), text_style(14, &TEXT)))?;
            x += 26 + width + 24;
        }
        Ok(())
    }

    fn draw_panel(&self, area: &Area<'_>, panel: &Panel, labelled: bool) -> DrawResult {
        let last = self.points.last().map_or(1.0, |p| p.throttle_percent);
        let high = self.points.iter().map(|p| (panel.value)(&p.point)).fold(0.0, f64::max);
        let top = if high > 0.0 && high.is_finite() { 1.08 * high } else { 1.0 };
        let mut chart = ChartBuilder::on(area)
            .margin(px(8))
            .margin_right(px(22))
            .set_label_area_size(LabelAreaPosition::Left, px(72))
            .set_label_area_size(LabelAreaPosition::Bottom, px(if labelled { 48 } else { 28 }))
            .build_cartesian_2d(0.0..last, 0.0..top)?;

        let least = (100.0 * self.thrust_command_min_n / self.thrust_rated_n).min(last);
        let most = (100.0 * self.thrust_greatest_n / self.thrust_rated_n).min(last);
        for (from, to, color) in [(0.0, least, BELOW), (most, last, ABOVE)] {
            chart.draw_series([Rectangle::new([(from, 0.0), (to, top)], color.filled())])?;
        }
        let whole = |x: &f64| format!("{x:.0}");
        let label = |y: &f64| panel.text(*y, 0);
        let mut mesh = chart.configure_mesh();
        chart_style(&mut mesh);
        mesh.x_labels(8).y_labels(5).x_label_formatter(&whole).y_label_formatter(&label).y_desc(panel.name);
        if labelled {
            mesh.x_desc("throttle (% of rated thrust)");
        }
        mesh.draw()?;
        if !high.is_finite() {
            let text = Text::new("no fuel is left to burn", (0.06 * last, 0.5 * top), text_style(15, &TEXT));
            chart.draw_series([text])?;
            return Ok(());
        }

        for (line, color) in self.curve(panel, most) {
            chart.draw_series(LineSeries::new(line, color.stroke_width(3 * SCALE as u32)))?;
        }
        let value = |p: &ThrottlePoint| (panel.value)(&p.point);
        let rated = self.points.iter().find(|p| p.throttle_percent >= 100.0 && !p.point.saturated);
        if let Some(rated) = rated {
            let at = (rated.throttle_percent, value(rated));
            chart.draw_series([Circle::new(at, px(5), LINE.filled())])?;
            // Above the curve: left of a rising one, right of a falling one.
            let falls = self.points.first().is_some_and(|first| value(first) > at.1);
            let (side, dx) = if falls { (HPos::Left, 8) } else { (HPos::Right, -8) };
            let style = text_style(14, &LINE).pos(Pos::new(side, VPos::Bottom));
            let text = Text::new(panel.text(at.1, 1), (px(dx), px(-6)), style);
            chart.draw_series([EmptyElement::at(at) + text])?;
        }
        Ok(())
    }

    /// The curve of a panel as lines of one colour each; the limit is reached at `limit_percent`.
    fn curve(&self, panel: &Panel, limit_percent: f64) -> Vec<(Vec<(f64, f64)>, RGBColor)> {
        let value = |p: &ThrottlePoint| (panel.value)(&p.point);
        // The demand at which the limit is reached lies between two steps: both sides are drawn to it.
        let limit = self.points.iter().find(|p| p.point.saturated).map(|p| (limit_percent, value(p)));
        let kinds: [(PointFilter, RGBColor); 3] = [
            (|p| !p.point.saturated && !p.of_clamped, LINE),
            (|p| p.point.saturated && !p.of_clamped, AT_LIMIT),
            (|p| p.of_clamped, CLAMPED),
        ];
        let mut curve = Vec::new();
        for (belongs, color) in kinds {
            // Neighbouring points of one kind make one line.
            for run in self.points.chunk_by(|a, b| belongs(a) == belongs(b)).filter(|run| belongs(&run[0])) {
                let mut line: Vec<(f64, f64)> = run.iter().map(|p| (p.throttle_percent, value(p))).collect();
                let next = 1.0 + line[line.len() - 1].0;
                match limit {
                    Some(limit) if run[0].point.saturated => line.insert(0, limit),
                    Some(limit) if next > limit.0 => line.push(limit),
                    _ => {}
                }
                curve.push((line, color));
            }
        }
        curve
    }
}

type PointFilter = fn(&ThrottlePoint) -> bool;

/// Size of the picture and of its parts (pixels).
const SIZE: (i32, i32) = (1200, 1080);
const TITLE_HEIGHT: i32 = 84;
const LEGEND_HEIGHT: i32 = 40;
const CLAMPED: RGBColor = RGBColor(230, 145, 20);
const BELOW: RGBColor = RGBColor(240, 241, 243);
const ABOVE: RGBColor = RGBColor(251, 229, 225);

/// What one panel shows.
struct Panel {
    name: &'static str,
    value: fn(&Point) -> f64,
    decimals: usize,
}

const PANELS: [Panel; 6] = [
    Panel { name: "thrust (N)", value: |p| p.thrust_n, decimals: 0 },
    Panel { name: "valve angle (deg)", value: |p| p.valve_deg, decimals: 0 },
    Panel { name: "chamber pressure Pc (bar)", value: |p| p.chamber_pa * 1e-5, decimals: 0 },
    Panel { name: "injector inlet P2 (bar)", value: |p| p.injector_inlet_pa * 1e-5, decimals: 0 },
    Panel { name: "mixture ratio O/F", value: |p| p.of_ratio.unwrap_or(f64::INFINITY), decimals: 1 },
    Panel { name: "vapour fraction at P2", value: |p| p.quality, decimals: 2 },
];

impl Panel {
    fn text(&self, value: f64, more_digits: usize) -> String {
        format!("{value:.*}", self.decimals + more_digits)
    }
}
