//! What is wrong, in words: what is seen, why it happens, what to do.

/// How bad it is, in rising order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// As it should be.
    Ok,
    /// Works, but not as well as it could, or not for long.
    Warning,
    /// Does not work.
    Error,
}

/// One finding. Its fields are the keys of `hopbench doctor --json`.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Finding {
    /// How bad it is.
    pub severity: Severity,
    /// The cause, one word for scripts.
    pub name: &'static str,
    /// What is seen, with figures.
    pub seen: String,
    /// Why it happens.
    pub why: String,
    /// What to do.
    pub fix: String,
}

/// The same findings, worst first; equally bad ones stay in their order.
pub(super) fn worst_first(mut findings: Vec<Finding>) -> Vec<Finding> {
    findings.sort_by_key(|finding| std::cmp::Reverse(finding.severity));
    findings
}
