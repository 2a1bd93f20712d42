//! The summary of a run's report, for people.

use std::collections::BTreeMap;

use hopbench::simulation::{Report, Source};

use crate::evidence::certificate;

/// The report as the terminal shows it.
pub fn text(report: &Report) -> String {
    let mut text = Lines::default();
    events(&mut text, report);
    flight(&mut text, report);
    handovers(&mut text, report);
    autopilot(&mut text, report);
    propellant(&mut text, report);
    timing(&mut text, report);
    link(&mut text, report);
    verdict(&mut text, report);
    text.0
}

#[derive(Default)]
struct Lines(String);

impl Lines {
    fn line(&mut self, line: impl AsRef<str>) {
        self.0 += line.as_ref();
        self.0.push('\n');
    }
}

/// How the flight ended, as the report spells it.
fn outcome(report: &Report) -> String {
    let outcome = serde_json::to_value(report.outcome).ok();
    outcome.as_ref().and_then(|o| o.as_str()).unwrap_or("?").to_owned()
}

fn events(text: &mut Lines, report: &Report) {
    text.line(format!("{} (seed {}): {}", report.scenario, report.seed, outcome(report)));
    for change in &report.modified {
        text.line(format!("MODIFIED       {change}"));
    }
    if !report.faults_idle.is_empty() {
        text.line(format!("never began    {}", report.faults_idle.join(", ")));
    }
    for event in &report.events {
        text.line(format!("  {:>8.3} s  {:<18} {}", event.time_s, event.kind, event.detail));
    }
}

/// Touchdown, greatest height, hover.
fn flight(text: &mut Lines, report: &Report) {
    if let Some(t) = &report.touchdown {
        text.line(format!(
            "touchdown      {:.2} m/s down, {:.2} m/s across, tilt {:.2} deg, {:.2} m from the target",
            t.vertical_speed_m_s, t.lateral_speed_m_s, t.tilt_deg, t.position_error_m
        ));
        if let (Some(control), Some(navigation)) = (t.control_error_m, t.navigation_error_m) {
            text.line(format!(
                "               control error {control:.2} m, navigation error {navigation:.2} m"
            ));
        }
    }
    text.line(format!("highest        {:.2} m", report.max_altitude_m));
    if let Some(h) = &report.hover {
        text.line(format!(
            "hover          {:.1} s, height {:.3} m RMS, sideways {:.3} m RMS",
            h.duration_s, h.altitude_rms_m, h.lateral_rms_m
        ));
        if let (Some(altitude), Some(lateral)) = (h.altitude_control_rms_m, h.lateral_control_rms_m) {
            text.line(format!(
                "               control error: height {altitude:.3} m RMS, sideways {lateral:.3} m RMS"
            ));
        }
    }
}

fn handovers(text: &mut Lines, report: &Report) {
    for h in &report.handovers {
        text.line(format!(
            "hand-over      to {}, {:.0} ms after the last good controls ({:.0} ms by the clock); \
             first command {:+.0} N, {:.2} deg of gimbal",
            h.to.map_or("nobody", |to| match to {
                Source::Fc => "the FC",
                Source::Autopilot => "the autopilot",
                Source::Commands => "the schedule",
            }),
            h.silence_ms,
            h.silence_wall_ms,
            h.thrust_step_n,
            h.gimbal_step_deg
        ));
        text.line(format!(
            "               tilt {:.2} deg before, {:.2} after; rate {:.2} and {:.2} deg/s; \
             velocity changed by {:.2} m/s in 2 s",
            h.before.tilt_deg, h.after.tilt_deg, h.before.rate_deg_s, h.after.rate_deg_s, h.speed_change_m_s
        ));
    }
}

fn autopilot(text: &mut Lines, report: &Report) {
    if let Some(ladders) = &report.autopilot {
        let counts = |rungs: &BTreeMap<String, u64>| {
            let all: Vec<_> = rungs.iter().map(|(rung, count)| format!("{count} {rung}")).collect();
            if all.is_empty() { "none".to_owned() } else { all.join(", ") }
        };
        text.line(format!(
            "autopilot      control {}; plans {}, {} late",
            counts(&ladders.control),
            counts(&ladders.guidance),
            ladders.plans_late
        ));
    }
}

/// What was used, and how well the mass closes.
fn propellant(text: &mut Lines, report: &Report) {
    let p = &report.propellant;
    let vapor = match p.nitrous_vapor_kg {
        kg if kg >= 5e-4 => format!(", {kg:.3} as vapour"),
        _ => String::new(),
    };
    let through = match p.nitrogen_nozzle_kg {
        kg if kg >= 5e-4 => format!(", {kg:.3} through the engine"),
        _ => String::new(),
    };
    text.line(format!(
        "used           N2O {:.3} kg ({:.3} left{vapor}), fuel {:.3} kg ({:.3} left), nitrogen \
         {:.3} kg by thrusters, {:.3} vented{through}",
        p.nitrous_used_kg,
        p.nitrous_left_kg,
        p.fuel_used_kg,
        p.fuel_left_kg,
        p.nitrogen_rcs_kg,
        p.nitrogen_vented_kg
    ));
    let m = &report.mass;
    text.line(format!(
        "mass           {:.3} kg to {:.3} kg, closure error {:.1e} kg",
        m.initial_kg, m.final_kg, m.closure_error_kg
    ));
}

fn timing(text: &mut Lines, report: &Report) {
    let t = &report.timing;
    text.line(format!(
        "time           {:.3} s in {:.3} s, {:.0} x real time, {} steps, {} overruns",
        t.simulated_s, t.wall_s, t.realtime_factor, t.steps, t.overruns
    ));
    if t.slips > 0 {
        text.line(format!("               slipped {} times, {:.3} s altogether", t.slips, t.slipped_s));
    }
    for (name, of) in
        [("step cost", &t.step_us), ("lateness", &t.lateness_us), ("round trip", &t.round_trip_us)]
    {
        if let Some(of) = of {
            text.line(format!(
                "{name:<14} p50 {:.1} us, p99 {:.1} us, p99.9 {:.1} us, max {:.1} us",
                of.p50, of.p99, of.p999, of.max
            ));
        }
    }
}

fn link(text: &mut Lines, report: &Report) {
    if let Some(link) = &report.link {
        let load = link.wire_load_percent.map_or(String::new(), |load| format!(", wire {load:.0} % loaded"));
        text.line(format!(
            "link           {} frames sent, {} dropped, {} received, {} CRC errors, {} lost, {} stalls{load}",
            link.sent, link.dropped, link.received, link.crc_errors, link.lost, link.stalls
        ));
        if link.skipped_bytes + link.refused > 0 {
            text.line(format!(
                "               {} bytes in no frame, {} times somebody else refused",
                link.skipped_bytes, link.refused
            ));
        }
    }
}

/// What was expected, the verdict, and what to open.
fn verdict(text: &mut Lines, report: &Report) {
    for item in &report.expect.items {
        let mark = if item.passed { "ok    " } else { "FAILED" };
        text.line(format!("expect {mark}  {:<36} {} (limit {})", item.name, item.value, item.limit));
    }
    text.line(format!("state hash     {}", report.state_hash));
    let verdict = if report.expect.passed { "as expected" } else { "NOT as expected" };
    text.line(format!("verdict        {}, {verdict}", outcome(report)));
    if let Some(run) = &report.run {
        text.line(format!("to open        {run}/report.json"));
        if report.link.is_some() {
            text.line(format!("to sign        {run}/{}", certificate::FILE));
        }
    }
}
