//! Trajectories: nodes in time, with the acceleration linear between them.
//!
//! The output of guidance and the input of tracking: optimal landing, closed-form ramps, hover. Position
//! is then cubic between nodes and follows exactly from position, velocity and acceleration of the nodes, so
//! that a plan made with first-order-hold thrust per mass is flown as it was solved.

use crate::frame::Vec3;
use crate::time::SimTime;

/// Reference motion of the pivot at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reference {
    /// Position of the pivot (m).
    pub position_ned_m: Vec3,
    /// Velocity (m/s).
    pub velocity_ned_m_s: Vec3,
    /// Acceleration to feed forward, gravity not in it (m/s²).
    pub acceleration_ned_m_s2: Vec3,
    /// Heading to hold (rad).
    pub heading_rad: f64,
}

impl Default for Reference {
    fn default() -> Self {
        Self {
            position_ned_m: Vec3::zeros(),
            velocity_ned_m_s: Vec3::zeros(),
            acceleration_ned_m_s2: Vec3::zeros(),
            heading_rad: 0.0,
        }
    }
}

/// One node. The acceleration runs straight to that of the next node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Node {
    /// Time from the start of the trajectory (s).
    pub time_s: f64,
    /// Position of the pivot (m).
    pub position_ned_m: Vec3,
    /// Velocity (m/s).
    pub velocity_ned_m_s: Vec3,
    /// Acceleration (m/s²).
    pub acceleration_ned_m_s2: Vec3,
}

/// A trajectory. Before the first node it stands still, after the last it coasts with the velocity there.
#[derive(Clone, Debug, PartialEq)]
pub struct Trajectory {
    start: SimTime,
    heading_rad: f64,
    nodes: Vec<Node>,
}

impl Trajectory {
    /// From nodes in rising order of time; the first, at zero, is at time `start`.
    ///
    /// # Panics
    /// Without a node.
    pub fn new(start: SimTime, heading_rad: f64, nodes: Vec<Node>) -> Self {
        assert!(!nodes.is_empty(), "a trajectory has at least one node");
        debug_assert!(nodes.windows(2).all(|w| w[0].time_s < w[1].time_s), "nodes rise in time");
        Self { start, heading_rad, nodes }
    }

    /// At rest at one position.
    pub fn hold(start: SimTime, position_ned_m: Vec3, heading_rad: f64) -> Self {
        let node = Node {
            time_s: 0.0,
            position_ned_m,
            velocity_ned_m_s: Vec3::zeros(),
            acceleration_ned_m_s2: Vec3::zeros(),
        };
        Self::new(start, heading_rad, vec![node])
    }

    /// The same trajectory with another start.
    pub(crate) fn with_start(self, start: SimTime) -> Self {
        Self { start, ..self }
    }

    /// Time of the first node.
    pub const fn start(&self) -> SimTime {
        self.start
    }

    /// Time of the last node, from the first (s).
    pub fn duration_s(&self) -> f64 {
        self.last().time_s
    }

    /// The nodes.
    pub fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// The last node.
    pub fn last(&self) -> &Node {
        self.nodes.last().expect("a trajectory has at least one node")
    }

    /// The reference `elapsed_s` after the start; before the start the first node stands still.
    pub fn after(&self, elapsed_s: f64) -> Reference {
        let upper = self.nodes.partition_point(|node| node.time_s <= elapsed_s);
        let (p, v, a) = if upper == 0 {
            (self.nodes[0].position_ned_m, Vec3::zeros(), Vec3::zeros())
        } else {
            let n = &self.nodes[upper - 1];
            let t = elapsed_s - n.time_s;
            match self.nodes.get(upper) {
                Some(next) => {
                    let a0 = n.acceleration_ned_m_s2;
                    let jerk = (next.acceleration_ned_m_s2 - a0) / (next.time_s - n.time_s);
                    (
                        n.position_ned_m + (n.velocity_ned_m_s + (a0 * 0.5 + jerk * (t / 6.0)) * t) * t,
                        n.velocity_ned_m_s + (a0 + jerk * (0.5 * t)) * t,
                        a0 + jerk * t,
                    )
                }
                None => (n.position_ned_m + n.velocity_ned_m_s * t, n.velocity_ned_m_s, Vec3::zeros()),
            }
        };
        Reference {
            position_ned_m: p,
            velocity_ned_m_s: v,
            acceleration_ned_m_s2: a,
            heading_rad: self.heading_rad,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn node(time_s: f64, p: f64, v: f64, a: f64) -> Node {
        Node {
            time_s,
            position_ned_m: Vec3::new(p, 0.0, 0.0),
            velocity_ned_m_s: Vec3::new(v, 0.0, 0.0),
            acceleration_ned_m_s2: Vec3::new(a, 0.0, 0.0),
        }
    }

    #[test]
    fn between_nodes_the_motion_is_the_exact_cubic() {
        // a(t) = 1 - t on 0..2: v = t - t²/2, p = t²/2 - t³/6; at 2 s: v = 0, p = 2/3.
        let trajectory = Trajectory::new(
            SimTime::from_s(5.0),
            0.0,
            vec![node(0.0, 0.0, 0.0, 1.0), node(2.0, 2.0 / 3.0, 0.0, -1.0)],
        );
        for t in [0.0, 0.3, 1.0, 1.7, 2.0 - 1e-12] {
            let r = trajectory.after(t);
            assert!((r.position_ned_m.x - (t * t / 2.0 - t * t * t / 6.0)).abs() < 1e-14);
            assert!((r.velocity_ned_m_s.x - (t - t * t / 2.0)).abs() < 1e-14);
            assert!((r.acceleration_ned_m_s2.x - (1.0 - t)).abs() < 1e-14);
        }
        // Before it stands, after it coasts.
        assert_eq!(trajectory.after(-1.0).velocity_ned_m_s.x, 0.0);
        assert!((trajectory.after(9.0).position_ned_m.x - 2.0 / 3.0).abs() < 1e-14);
        assert_eq!(trajectory.after(9.0).acceleration_ned_m_s2.x, 0.0);
    }
}
