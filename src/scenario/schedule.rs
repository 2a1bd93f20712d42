//! An open-loop command schedule: a CSV table whose rows each hold until the next.

use crate::signal::{ActuatorCommand, Discrete, Throttle};
use crate::time::SimTime;

/// Commands over time, for `fly --commands`.
#[derive(Clone, Debug, PartialEq)]
pub struct Schedule {
    rows: Vec<(SimTime, ActuatorCommand)>,
}

/// What is wrong with a schedule.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{line}: {message}")]
pub struct ScheduleError {
    /// Line of the file, from 1.
    pub line: usize,
    /// What is wrong, with column and value.
    pub message: String,
}

const COLUMNS: [&str; 10] = [
    "time_s",
    "valve_deg",
    "thrust_n",
    "gimbal_x_deg",
    "gimbal_y_deg",
    "rcs_roll",
    "igniter",
    "oxidizer_isolation",
    "vent",
    "hold_down_release",
];

/// Least and greatest value of each column.
const RANGES: [(f64, f64); 10] = [
    (0.0, 86_400.0),
    (0.0, 90.0),
    (0.0, 1.0e5),
    (-30.0, 30.0),
    (-30.0, 30.0),
    (-1.0, 1.0),
    (0.0, 1.0),
    (0.0, 1.0),
    (0.0, 1.0),
    (0.0, 1.0),
];

impl Schedule {
    /// One command for ever.
    pub fn constant(command: ActuatorCommand) -> Self {
        Self { rows: vec![(SimTime::ZERO, command)] }
    }

    /// Parses the text of a CSV file. Lines that start with `#` are comments. Columns that are absent
    /// mean: no deflection, igniter on, isolation open, vent shut, hold-down released.
    pub fn parse(text: &str) -> Result<Self, ScheduleError> {
        let error = |line: usize, message: String| ScheduleError { line, message };
        let mut lines = text
            .lines()
            .enumerate()
            .map(|(i, line)| (i + 1, line.trim()))
            .filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
        let Some((header_line, header)) = lines.next() else {
            return Err(error(1, "no header; expected time_s and command columns".to_owned()));
        };
        let mut columns = Vec::new();
        for name in header.split(',').map(str::trim) {
            let Some(column) = COLUMNS.iter().position(|c| *c == name) else {
                let known = COLUMNS.join(", ");
                return Err(error(header_line, format!("unknown column '{name}'; known: {known}")));
            };
            if columns.contains(&column) {
                return Err(error(header_line, format!("column '{name}' stands twice")));
            }
            columns.push(column);
        }
        if !columns.contains(&0) {
            return Err(error(header_line, "no column time_s".to_owned()));
        }
        if columns.contains(&1) == columns.contains(&2) {
            return Err(error(header_line, "expected one of valve_deg and thrust_n".to_owned()));
        }
        let mut rows: Vec<(SimTime, ActuatorCommand)> = Vec::new();
        for (line, row) in lines {
            let fields: Vec<&str> = row.split(',').map(str::trim).collect();
            if fields.len() != columns.len() {
                return Err(error(line, format!("expected {} fields, got {}", columns.len(), fields.len())));
            }
            // Absent columns: everything as in flight, nothing deflected.
            let mut value = [0.0, 0.0, f64::NAN, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0];
            for (field, &column) in fields.iter().zip(&columns) {
                let (least, most) = RANGES[column];
                let x: f64 = field
                    .parse()
                    .map_err(|_| error(line, format!("{}: '{field}' is not a number", COLUMNS[column])))?;
                if !(least..=most).contains(&x) {
                    return Err(error(
                        line,
                        format!("{}: {x} is out of range; allowed {least} to {most}", COLUMNS[column]),
                    ));
                }
                value[column] = x;
            }
            let time = SimTime::from_s(value[0]);
            if rows.last().is_some_and(|(previous, _)| *previous >= time) {
                return Err(error(line, format!("time_s: {} does not come after the row above", value[0])));
            }
            let on = |column: usize| value[column] > 0.5;
            rows.push((
                time,
                ActuatorCommand {
                    armed: true,
                    throttle: if value[2].is_nan() {
                        Throttle::ValveRad(value[1].to_radians())
                    } else {
                        Throttle::ThrustN(value[2])
                    },
                    gimbal_x_rad: value[3].to_radians(),
                    gimbal_y_rad: value[4].to_radians(),
                    rcs_roll: value[5],
                    discrete: Discrete {
                        igniter: on(6),
                        isolation_open: on(7),
                        vent_shut: on(8),
                        hold_down_released: on(9),
                    },
                },
            ));
        }
        if rows.is_empty() {
            return Err(error(header_line, "no rows below the header".to_owned()));
        }
        Ok(Self { rows })
    }

    /// The command in force at `time`: the last row that is not later, before the first row its values.
    pub fn at(&self, time: SimTime) -> &ActuatorCommand {
        let next = self.rows.partition_point(|(start, _)| *start <= time);
        &self.rows[next.saturating_sub(1)].1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_holds_from_its_instant_until_the_next() {
        let s = Schedule::parse("# comment\ntime_s,valve_deg,rcs_roll\n0.5, 25, 0\n0.75, 20, -1\n").unwrap();
        let valve = |t: f64| s.at(SimTime::from_s(t)).throttle;
        assert_eq!(valve(0.0), Throttle::ValveRad(25f64.to_radians()));
        assert_eq!(valve(0.749999), Throttle::ValveRad(25f64.to_radians()));
        assert_eq!(valve(0.75), Throttle::ValveRad(20f64.to_radians()));
        let c = s.at(SimTime::from_s(9.0));
        assert_eq!((c.rcs_roll, c.gimbal_x_rad, c.discrete), (-1.0, 0.0, Discrete::FLIGHT));
    }

    #[test]
    fn messages_name_line_column_and_range() {
        let message = |text: &str| Schedule::parse(text).unwrap_err().to_string();
        assert_eq!(message("time_s,valve_deg\n0,95\n"), "2: valve_deg: 95 is out of range; allowed 0 to 90");
        assert_eq!(
            message("time_s,valve_deg\n0,nan\n"),
            "2: valve_deg: NaN is out of range; allowed 0 to 90"
        );
        assert_eq!(message("time_s,valve_deg\n0,1,2\n"), "2: expected 2 fields, got 3");
        assert_eq!(message("time_s,valve_deg\n1,1\n1,2\n"), "3: time_s: 1 does not come after the row above");
        assert!(message("time_s,valve\n").starts_with("1: unknown column 'valve'"));
        assert_eq!(message("time_s,valve_deg,thrust_n\n"), "1: expected one of valve_deg and thrust_n");
        assert_eq!(message(""), "1: no header; expected time_s and command columns");
    }
}
