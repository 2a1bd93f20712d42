//! What a run leaves for people: the summary on the terminal and the folder of the run.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use hopbench::simulation::{Report, Source};

/// Folder of a run. It is made before the run, so that a full or forbidden disk is said before the flight.
pub struct RunFolder(PathBuf);

impl RunFolder {
    /// Makes the folder that was asked for.
    ///
    /// # Errors
    /// When it cannot be made or written.
    pub fn create(path: &Path) -> Result<Self> {
        std::fs::create_dir_all(path).with_context(|| format!("cannot make {}", path.display()))?;
        let probe = path.join(".writable");
        std::fs::write(&probe, "").with_context(|| format!("cannot write in {}", path.display()))?;
        let _ = std::fs::remove_file(probe);
        Ok(Self(path.to_owned()))
    }

    /// Makes a folder of its own for a run that nobody named one for, `runs/SCENARIO-SECONDS`.
    ///
    /// # Errors
    /// When it cannot be made or written.
    pub fn for_run_of(scenario: &str) -> Result<Self> {
        let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
        let seconds = since.map_or(0, |since| since.as_secs());
        Self::create(&Path::new("runs").join(format!("{scenario}-{seconds}-{}", std::process::id())))
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.0
    }

    /// Leaves a file in the folder.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn leave(&self, name: &str, text: &str) -> Result<()> {
        let path = self.0.join(name);
        std::fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))
    }

    /// Leaves the report in the folder and notes the folder in the report. The file is complete or not there.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write(&self, report: &mut Report) -> Result<()> {
        report.run = Some(self.0.display().to_string());
        let (path, half) = (self.0.join("report.json"), self.0.join("report.json.part"));
        std::fs::write(&half, serde_json::to_string_pretty(report)? + "\n")
            .and_then(|()| std::fs::rename(&half, &path))
            .with_context(|| format!("cannot write {}", path.display()))
    }
}

/// The report for people.
pub fn summary(report: &Report) -> String {
    use std::fmt::Write;
    let mut text = String::new();
    let mut line = |l: String| {
        let _ = writeln!(text, "{l}");
    };
    let outcome = serde_json::to_value(report.outcome).ok();
    let outcome = outcome.as_ref().and_then(|o| o.as_str()).unwrap_or("?");
    line(format!("{} (seed {}): {outcome}", report.scenario, report.seed));
    for change in &report.modified {
        line(format!("MODIFIED       {change}"));
    }
    if !report.faults_idle.is_empty() {
        line(format!("never began    {}", report.faults_idle.join(", ")));
    }
    for event in &report.events {
        line(format!("  {:>8.3} s  {:<18} {}", event.time_s, event.kind, event.detail));
    }
    if let Some(t) = &report.touchdown {
        line(format!(
            "touchdown      {:.2} m/s down, {:.2} m/s across, tilt {:.2} deg, {:.2} m from the target",
            t.vertical_speed_m_s, t.lateral_speed_m_s, t.tilt_deg, t.position_error_m
        ));
        if let (Some(control), Some(navigation)) = (t.control_error_m, t.navigation_error_m) {
            line(format!("               control error {control:.2} m, navigation error {navigation:.2} m"));
        }
    }
    line(format!("highest        {:.2} m", report.max_altitude_m));
    if let Some(h) = &report.hover {
        line(format!(
            "hover          {:.1} s, height {:.3} m RMS, sideways {:.3} m RMS",
            h.duration_s, h.altitude_rms_m, h.lateral_rms_m
        ));
        if let (Some(altitude), Some(lateral)) = (h.altitude_control_rms_m, h.lateral_control_rms_m) {
            line(format!(
                "               control error: height {altitude:.3} m RMS, sideways {lateral:.3} m RMS"
            ));
        }
    }
    for h in &report.handovers {
        line(format!(
            "hand-over      to {}, {:.0} ms after the last good controls ({:.0} ms by the clock); first command {:+.0} N, {:.2} deg of gimbal",
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
        line(format!(
            "               tilt {:.2} deg before, {:.2} after; rate {:.2} and {:.2} deg/s; velocity changed by {:.2} m/s in 2 s",
            h.before.tilt_deg, h.after.tilt_deg, h.before.rate_deg_s, h.after.rate_deg_s, h.speed_change_m_s
        ));
    }
    if let Some(ladders) = &report.autopilot {
        let counts = |rungs: &std::collections::BTreeMap<String, u64>| {
            let all: Vec<_> = rungs.iter().map(|(rung, count)| format!("{count} {rung}")).collect();
            if all.is_empty() { "none".to_owned() } else { all.join(", ") }
        };
        line(format!(
            "autopilot      control {}; plans {}, {} late",
            counts(&ladders.control),
            counts(&ladders.guidance),
            ladders.plans_late
        ));
    }
    let p = &report.propellant;
    let vapor = match p.nitrous_vapor_kg {
        kg if kg >= 5e-4 => format!(", {kg:.3} as vapour"),
        _ => String::new(),
    };
    let through = match p.nitrogen_nozzle_kg {
        kg if kg >= 5e-4 => format!(", {kg:.3} through the engine"),
        _ => String::new(),
    };
    line(format!(
        "used           N2O {:.3} kg ({:.3} left{vapor}), fuel {:.3} kg ({:.3} left), nitrogen {:.3} kg by thrusters, {:.3} vented{through}",
        p.nitrous_used_kg,
        p.nitrous_left_kg,
        p.fuel_used_kg,
        p.fuel_left_kg,
        p.nitrogen_rcs_kg,
        p.nitrogen_vented_kg
    ));
    let m = &report.mass;
    line(format!(
        "mass           {:.3} kg to {:.3} kg, closure error {:.1e} kg",
        m.initial_kg, m.final_kg, m.closure_error_kg
    ));
    let t = &report.timing;
    line(format!(
        "time           {:.3} s in {:.3} s, {:.0} x real time, {} steps, {} overruns",
        t.simulated_s, t.wall_s, t.realtime_factor, t.steps, t.overruns
    ));
    if t.slips > 0 {
        line(format!("               slipped {} times, {:.3} s altogether", t.slips, t.slipped_s));
    }
    for (name, of) in
        [("step cost", &t.step_us), ("lateness", &t.lateness_us), ("round trip", &t.round_trip_us)]
    {
        if let Some(of) = of {
            line(format!(
                "{name:<14} p50 {:.1} us, p99 {:.1} us, p99.9 {:.1} us, max {:.1} us",
                of.p50, of.p99, of.p999, of.max
            ));
        }
    }
    if let Some(link) = &report.link {
        let load = link.wire_load_percent.map_or(String::new(), |load| format!(", wire {load:.0} % loaded"));
        line(format!(
            "link           {} frames sent, {} dropped, {} received, {} CRC errors, {} lost, {} stalls{load}",
            link.sent, link.dropped, link.received, link.crc_errors, link.lost, link.stalls
        ));
        if link.skipped_bytes + link.refused > 0 {
            line(format!(
                "               {} bytes in no frame, {} times somebody else refused",
                link.skipped_bytes, link.refused
            ));
        }
    }
    for item in &report.expect.items {
        let mark = if item.passed { "ok    " } else { "FAILED" };
        line(format!("expect {mark}  {:<36} {} (limit {})", item.name, item.value, item.limit));
    }
    line(format!("state hash     {}", report.state_hash));
    let verdict = if report.expect.passed { "as expected" } else { "NOT as expected" };
    line(format!("verdict        {outcome}, {verdict}"));
    if let Some(run) = &report.run {
        line(format!("to open        {run}/report.json"));
        if report.link.is_some() {
            line(format!("to sign        {run}/{}", crate::evidence::certificate::FILE));
        }
    }
    text
}
