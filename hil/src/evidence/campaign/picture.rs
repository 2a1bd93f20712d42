//! Pictures of a campaign: how the touchdown figures spread against their limits, and where the feet came
//! down.

use anyhow::Result;
use hopbench::scenario::Success;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::statistics::quantile;
use super::table::Row;
use crate::evidence::drawing::{
    AT_LIMIT, Area, DrawResult, LINE, MUTED, SCALE, TEXT, chart_style, px, svg, text_style,
};

const SIZE: (i32, i32) = (1200, 860);
const SIZE_OF_POSITIONS: (i32, i32) = (1200, 680);
const TITLE_HEIGHT: i32 = 80;
/// Bars of a histogram from zero to the limit.
const BARS_TO_LIMIT: f64 = 25.0;
/// A picture ends at so many limits; what lies beyond is in its last bar.
const LIMITS_SHOWN: f64 = 2.0;
const BAR: RGBColor = RGBColor(120, 168, 205);
const BEYOND: RGBColor = RGBColor(226, 140, 130);

/// Histograms of what a touchdown is judged by.
///
/// # Errors
/// When it cannot be drawn.
pub fn touchdown(title: &str, rows: &[&Row], success: &Success) -> Result<String> {
    let panels = [
        ("touchdown_vertical_speed_m_s", "vertical speed (m/s)", success.touchdown_vertical_speed_max_m_s),
        ("touchdown_lateral_speed_m_s", "lateral speed (m/s)", success.touchdown_lateral_speed_max_m_s),
        ("touchdown_tilt_deg", "tilt (deg)", success.touchdown_tilt_max_deg),
        ("control_error_m", "control error: estimate from target (m)", success.control_error_max_m),
    ];
    let touched = rows.iter().filter(|row| row.figure("touchdown_time_s").is_some()).count();
    let note = format!(
        "at first pad contact: {touched} of {} flights touched down; red: over the limit, \
         the last bar all that lies beyond",
        rows.len()
    );
    svg(SIZE, |root| {
        let rest = head(root, &format!("Touchdown of {title}"), &note)?;
        for (area, (figure, words, limit)) in
            rest.margin(0, px(10), px(10), px(20)).split_evenly((2, 2)).iter().zip(panels)
        {
            let values: Vec<f64> = rows.iter().filter_map(|row| row.figure(figure)).collect();
            histogram(area, words, values, limit)?;
        }
        Ok(())
    })
}

/// Title and note, and what remains below.
fn head<'a>(
    root: &Area<'a>,
    title: &str,
    note: &str,
) -> std::result::Result<Area<'a>, Box<dyn std::error::Error>> {
    let (head, rest) = root.split_vertically(px(TITLE_HEIGHT));
    head.draw(&Text::new(title.to_owned(), (px(24), px(18)), text_style(26, &TEXT)))?;
    head.draw(&Text::new(note.to_owned(), (px(24), px(52)), text_style(15, &MUTED)))?;
    Ok(rest)
}

fn histogram(area: &Area<'_>, words: &str, mut values: Vec<f64>, limit: f64) -> DrawResult {
    values.sort_by(f64::total_cmp);
    // A limit of zero has no scale of its own.
    let scale = if limit > 0.0 { limit } else { values.last().copied().unwrap_or(1.0).max(1e-3) };
    let width = scale / BARS_TO_LIMIT;
    let greatest = values.last().copied().unwrap_or(0.0);
    let end = (1.2 * scale).max(greatest + width).min(LIMITS_SHOWN * scale);
    let bars = (end / width).round() as usize;
    let mut counts = vec![0_u32; bars];
    for value in &values {
        counts[((value / width).max(0.0) as usize).min(bars - 1)] += 1;
    }
    let most = counts.iter().copied().max().unwrap_or(0).max(1);
    let top = 1.12 * f64::from(most);
    let end = bars as f64 * width;
    let mut chart = ChartBuilder::on(area)
        .margin(px(8))
        .margin_right(px(22))
        .set_label_area_size(LabelAreaPosition::Left, px(64))
        .set_label_area_size(LabelAreaPosition::Bottom, px(48))
        .build_cartesian_2d(0.0..end, 0.0..top)?;
    let mut mesh = chart.configure_mesh();
    chart_style(&mut mesh);
    mesh.x_labels(7)
        // Flights are counted: with no more labels than whole numbers they fall on those.
        .y_labels((most as usize + 1).min(6))
        .x_label_formatter(&|x| format!("{x:.*}", if end < 3.0 { 2 } else { 1 }))
        .y_label_formatter(&|y| format!("{y:.0}"))
        .x_desc(words)
        .y_desc("flights")
        .draw()?;
    chart.draw_series(counts.iter().enumerate().filter(|(_, count)| **count > 0).map(|(bar, &count)| {
        let from = bar as f64 * width;
        let beyond = from + 0.5 * width > limit;
        let corners = [(from, 0.0), (from + width, f64::from(count))];
        Rectangle::new(corners, if beyond { BEYOND } else { BAR }.filled())
    }))?;
    let stroke = AT_LIMIT.stroke_width(2 * SCALE as u32);
    chart.draw_series(LineSeries::new([(limit, 0.0), (limit, top)], stroke))?;
    let label = text_style(14, &AT_LIMIT).pos(Pos::new(HPos::Right, VPos::Top));
    chart.draw_series([
        EmptyElement::at((limit, top)) + Text::new(format!("limit {limit}"), (px(-8), px(6)), label)
    ])?;
    // One below the other, where they are close.
    for (share, name, height) in [(0.5, "median", 0.94), (0.99, "99 %", 0.88)] {
        let Some(x) = quantile(&values, share).filter(|x| *x < end) else { continue };
        let stroke = LINE.stroke_width(SCALE as u32);
        chart.draw_series(LineSeries::new([(x, 0.0), (x, height * top)], stroke))?;
        // Inside the panel.
        let (side, dx) = if x > 0.75 * end { (HPos::Right, px(-6)) } else { (HPos::Left, px(6)) };
        let label = text_style(14, &LINE).pos(Pos::new(side, VPos::Top));
        chart.draw_series([
            EmptyElement::at((x, height * top)) + Text::new(format!("{name} {x:.3}"), (dx, px(2)), label)
        ])?;
    }
    Ok(())
}

/// Where the pivot was at first contact, against the target: in truth, and by the autopilot's estimate.
///
/// # Errors
/// When it cannot be drawn.
pub fn position(title: &str, rows: &[&Row]) -> Result<String> {
    let panels = [
        ("in truth", "touchdown_east_m", "touchdown_north_m"),
        ("by the autopilot's estimate", "estimated_east_m", "estimated_north_m"),
    ];
    let points = |east: &str, north: &str| -> Vec<(f64, f64, bool)> {
        let point = |row: &&Row| Some((row.figure(east)?, row.figure(north)?, row.success));
        rows.iter().filter_map(point).collect()
    };
    let note = "pivot at first pad contact from the target; red: flights that failed; the ring is 1 m, \
        the cross the target";
    svg(SIZE_OF_POSITIONS, |root| {
        let rest = head(root, &format!("Touchdown position of {title}"), note)?;
        let areas = rest.margin(0, px(10), px(10), px(20)).split_evenly((1, 2));
        for (area, (words, east, north)) in areas.iter().zip(panels) {
            scatter(area, words, &points(east, north))?;
        }
        Ok(())
    })
}

fn scatter(area: &Area<'_>, words: &str, points: &[(f64, f64, bool)]) -> DrawResult {
    let reach = points.iter().map(|(x, y, _)| x.abs().max(y.abs())).fold(1.1, f64::max) * 1.08;
    // A flight that went astray would make dots of all others.
    let reach = reach.min(20.0);
    let mut chart = ChartBuilder::on(area)
        .margin(px(8))
        .margin_right(px(22))
        .caption(words, text_style(17, &TEXT))
        .set_label_area_size(LabelAreaPosition::Left, px(64))
        .set_label_area_size(LabelAreaPosition::Bottom, px(48))
        .build_cartesian_2d(-reach..reach, -reach..reach)?;
    let label = |x: &f64| format!("{x:.1}");
    let mut mesh = chart.configure_mesh();
    chart_style(&mut mesh);
    mesh.x_labels(7)
        .y_labels(7)
        .x_label_formatter(&label)
        .y_label_formatter(&label)
        .x_desc("east (m)")
        .y_desc("north (m)")
        .draw()?;
    let ring = (0..=180).map(|i| {
        let (sin, cos) = libm::sincos(std::f64::consts::TAU * f64::from(i) / 180.0);
        (cos, sin)
    });
    chart.draw_series(LineSeries::new(ring, MUTED.stroke_width(SCALE as u32)))?;
    chart.draw_series([Cross::new((0.0, 0.0), px(7), TEXT.stroke_width(2 * SCALE as u32))])?;
    for (good, color) in [(true, LINE), (false, AT_LIMIT)] {
        let of_kind =
            points.iter().filter(|(x, y, success)| *success == good && x.abs() <= reach && y.abs() <= reach);
        chart.draw_series(of_kind.map(|(x, y, _)| Circle::new((*x, *y), px(3), color.mix(0.6).filled())))?;
    }
    Ok(())
}
