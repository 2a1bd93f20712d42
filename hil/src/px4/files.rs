//! The files of an airframe: two start scripts, two parameter files.

use super::airframe::Airframe;
use super::budget::{Budget, RESERVE_FRACTION};
use super::parameters::{Parameter, Target};

/// A file to be written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct File {
    /// Its name.
    pub name: &'static str,
    /// What it is for, in words.
    pub purpose: &'static str,
    /// What stands in it.
    pub text: String,
}

/// Every file of an airframe. PX4 keeps the numbers 22000 to 22999 for others' own airframes.
pub fn files(airframe: &Airframe) -> [File; 4] {
    [
        File {
            name: "22001_hopbench",
            purpose: "airframe for SITL: into etc/init.d-posix/airframes of the build",
            text: script(airframe, Target::Sitl),
        },
        File {
            name: "22002_hopbench.hil",
            purpose: "airframe for HITL: into ROMFS/px4fmu_common/init.d/airframes, for who builds firmware",
            text: script(airframe, Target::Hitl),
        },
        File {
            name: "hopbench_sitl.params",
            purpose: "the same for SITL, to be loaded by a ground station",
            text: parameter_file(airframe, Target::Sitl),
        },
        File {
            name: "hopbench_hitl.params",
            purpose: "the same for HITL, over any airframe of the board",
            text: parameter_file(airframe, Target::Hitl),
        },
    ]
}

fn parameters(airframe: &Airframe, target: Target) -> &[Parameter] {
    match target {
        Target::Sitl => &airframe.sitl,
        Target::Hitl => &airframe.hitl,
    }
}

/// A start script. Each reason stands on a line of its own: not every shell of PX4 takes it behind a command.
fn script(airframe: &Airframe, target: Target) -> String {
    let kind = match target {
        Target::Sitl => "SITL",
        Target::Hitl => "HITL",
    };
    let mut text = format!(
        "#!/bin/sh\n#\n# @name Hopbench {} {kind}\n#\n# @type Rocket\n# @class Copter\n#\n",
        airframe.vehicle
    );
    text += &heading(airframe);
    text += "\n. ${R}etc/init.d/rc.mc_defaults\n\n";
    let mut last = "";
    for parameter in parameters(airframe, target) {
        if parameter.why != last {
            text += &format!("# {}\n", parameter.why);
        }
        last = &parameter.why;
        // HITL is looked at before defaults count.
        let set = if parameter.name == "SYS_HITL" { "set" } else { "set-default" };
        text += &format!("param {set} {} {}\n", parameter.name, parameter.value.text());
    }
    text
}

/// A parameter file as QGroundControl reads it: vehicle, component, name, value and type between tabs.
fn parameter_file(airframe: &Airframe, target: Target) -> String {
    let mut text =
        "# Onboard parameters for Vehicle 1\n#\n# Stack: PX4 Pro\n# Vehicle: Multi-Rotor\n#\n".to_owned();
    text += &heading(airframe);
    text += "#\n# Vehicle-Id Component-Id Name Value Type\n";
    let mut last = "";
    for parameter in parameters(airframe, target) {
        if parameter.why != last {
            text += &format!("# {}\n", parameter.why);
        }
        last = &parameter.why;
        let (value, kind) = (parameter.value.text(), parameter.value.mavlink_type());
        text += &format!("1\t1\t{}\t{value}\t{kind}\n", parameter.name);
    }
    text
}

/// What all files begin with.
fn heading(airframe: &Airframe) -> String {
    let mut text = format!(
        "# Written by `hopbench px4-params` for {}; names and meanings of PX4 v1.16.1. \
         Not yet flown on PX4 itself.\n",
        airframe.vehicle
    );
    for line in budget_table(&airframe.budget).lines() {
        text += &format!("# {line}\n");
    }
    text
}

/// The budget as a table.
pub fn budget_table(budget: &Budget) -> String {
    let mut text = format!(
        "Hop to {} m, {} s of hover, up {} m/s, down {} m/s, landing {} m/s.\n{:<18} {:>8} {:>8} {:>8}\n",
        budget.height_m,
        budget.hold_s,
        budget.pace.climb_m_s,
        budget.pace.sink_m_s,
        budget.pace.land_m_s,
        "leg",
        "s",
        "N2O kg",
        "fuel kg"
    );
    for leg in &budget.legs {
        text += &format!(
            "{:<18} {:>8.1} {:>8.2} {:>8.3}\n",
            leg.name, leg.duration_s, leg.nitrous_kg, leg.fuel_kg
        );
    }
    text + &format!(
        "{:<18} {:>8.1} {:>8.2} {:>8.3}\n{:<18} {:>8} {:>6.0} % {:>6.0} %\n\
         Longest hover that leaves {:.0} % of both: {:.1} s.\n",
        "all",
        budget.burn_s,
        budget.legs.iter().map(|leg| leg.nitrous_kg).sum::<f64>(),
        budget.legs.iter().map(|leg| leg.fuel_kg).sum::<f64>(),
        "left",
        "",
        100.0 * budget.nitrous_left_fraction,
        100.0 * budget.fuel_left_fraction,
        100.0 * RESERVE_FRACTION,
        budget.longest_hold_s
    )
}
