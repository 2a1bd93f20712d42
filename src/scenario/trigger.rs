//! Events that a fault may wait for: a name that nothing ever has would be a fault that never comes.

use crate::autopilot::Phase;
use crate::autopilot::abort::AbortReason;
use crate::fault::Fault;
use crate::input::Invalid;

/// Events without a reason or name in theirs.
const PLAIN: [&str; 14] = [
    "armed",
    "ignition",
    "liftoff",
    "touchdown",
    "shutdown",
    "saturated",
    "bottle_low",
    "tank_high",
    "nitrous_depleted",
    "fuel_burn_through",
    "fc_first",
    "fc_lost",
    "handover",
    "handback",
];

/// # Errors
/// When an entry waits for an event that cannot come.
pub(super) fn validate(entries: &[Fault]) -> Result<(), Invalid> {
    for (index, entry) in entries.iter().enumerate() {
        let Some(event) = entry.at_event.as_deref() else { continue };
        let known = match event.split_once(':') {
            None => PLAIN.contains(&event),
            Some(("phase", name)) => Phase::ALL.iter().any(|phase| phase.name() == name),
            Some(("abort", name)) => AbortReason::ALL.iter().any(|reason| reason.name() == name),
            Some(("fault" | "fault_over", name)) => {
                entries.iter().enumerate().any(|(other, entry)| other != index && entry.name() == name)
            }
            Some(_) => false,
        };
        if !known {
            return Err(Invalid::new(
                format!("{index}.at_event"),
                format!(
                    "{event:?} never happens; allowed {}, phase:PHASE, abort:REASON, fault:NAME and fault_over:NAME of another entry",
                    PLAIN.join(", ")
                ),
            ));
        }
    }
    Ok(())
}
