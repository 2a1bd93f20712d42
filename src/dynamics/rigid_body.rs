//! Accelerations of a body that loses mass, carries a sloshing liquid and swings its engine.
//!
//! Momentum is balanced about the body-fixed pivot O. With A the specific force at O (acceleration less
//! gravity), S the first moment, I the inertia about O, w the rate, r the sloshing mass's place, P and J
//! the flow terms of [`super::mass`], all in body FRD, primes taken in the body:
//!
//! ```text
//! m A + w'×S + m_s r'' + w×(w×S) + 2 w×P + 2 m_s w×r'              = F
//! S×A + I w' + m_s r×r'' + w×(I w) + J w + 2 m_s r×(w×r')          = M
//! [A + w'×r + w×(w×r) + 2 w×r' + r'']_xy                           = spring, damper and stop per mass
//! ```
//!
//! with one such m_s, r and last row for each sloshing mode.
//!
//! The swinging engine's angles are prescribed (its servo is a position servo). With W its rate relative
//! to the body, S_e and I_e its deflected first moment and inertia about O, S and I hold the deflected
//! engine and
//!
//! ```text
//! F += -(W'×S_e + W×(W×S_e)) - 2 w×(W×S_e)
//! M += -(I_e W' + W×(I_e W)) - (W~ I_e - I_e W~) w - w×(I_e W)
//! ```
//!
//! The system is symmetric and positive definite. The rows of the modes give r'' by themselves; what is left
//! for A is diagonal; so one 3 x 3 solve for w' remains. Neglected: dP/dt (some newtons during a throttle
//! step), swirl of the jet, the deflection of the engine in P and J, the exchange of mass between liquid
//! at rest and sloshing liquid.
//!
//! Source: momentum theorem for variable-mass systems (Thomson, Introduction to Space Dynamics, 1961);
//! checked against Gauss's principle for a cloud of point masses (`tests/reference/motion.rs`).

use super::Load;
use super::mass::{FlowTerms, MassProperties};
use super::slosh::{Coupling, MODES, Mode, SloshState};
use crate::frame::{Mat3, Vec3};
use nalgebra::Vector2;

/// Everything the balance of momentum needs at one instant.
#[derive(Clone, Copy, Debug)]
pub struct Balance<'a> {
    /// The vehicle, liquid frozen, engine at zero gimbal.
    pub vehicle: &'a MassProperties,
    /// What its moving contents add.
    pub flow: &'a FlowTerms,
    /// Body rate (rad/s).
    pub rate_body_rad_s: Vec3,
    /// Every applied force but gravity, and its moment about O.
    pub load: Load,
    /// The sloshing liquid, mode by mode; `None`: frozen.
    pub slosh: [Option<(&'a Mode, &'a SloshState)>; MODES],
    /// The swinging engine; `None`: it has no inertia of its own.
    pub swing: Option<Swing<'a>>,
}

/// The part that turns with the gimbal, and its prescribed motion.
#[derive(Clone, Copy, Debug)]
pub struct Swing<'a> {
    /// Its mass properties about O at zero gimbal.
    pub part: &'a MassProperties,
    /// Its angles.
    pub gimbal: GimbalMotion,
}

/// Gimbal angles, rates and accelerations; x and y as commanded, positive for a positive moment about
/// body FRD x and y.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GimbalMotion {
    /// Angles (rad).
    pub angle_rad: Vector2<f64>,
    /// Rates (rad/s).
    pub rate_rad_s: Vector2<f64>,
    /// Accelerations (rad/s²).
    pub acceleration_rad_s2: Vector2<f64>,
}

/// Whether a solve succeeded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SolveStatus {
    /// The accelerations balance the loads.
    Solved,
    /// Mass or inertia is not that of a body, or a load is not finite; accelerations are zero.
    Singular,
}

/// What the vehicle does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Acceleration {
    /// Specific force at O: its acceleration less gravity, body FRD (m/s²).
    pub specific_force_body_m_s2: Vec3,
    /// Angular acceleration, body FRD (rad/s²).
    pub angular_body_rad_s2: Vec3,
    /// Second derivative of the slosh displacement of each mode, body FRD x and y (m/s²).
    pub slosh_body_m_s2: [Vector2<f64>; MODES],
    /// Force of springs, dampers and stops on the vehicle, all modes, body FRD x and y (N).
    pub slosh_force_body_n: Vector2<f64>,
    /// Whether it is a solution.
    pub status: SolveStatus,
}

impl Acceleration {
    /// Nothing accelerates.
    const SINGULAR: Self = Self {
        specific_force_body_m_s2: Vec3::new(0.0, 0.0, 0.0),
        angular_body_rad_s2: Vec3::new(0.0, 0.0, 0.0),
        slosh_body_m_s2: [Vector2::new(0.0, 0.0); MODES],
        slosh_force_body_n: Vector2::new(0.0, 0.0),
        status: SolveStatus::Singular,
    };

    /// Specific force at a point fixed in the body, what an accelerometer there feels (m/s²).
    pub(crate) fn specific_force_at(&self, position_body_m: Vec3, rate_body_rad_s: Vec3) -> Vec3 {
        self.specific_force_body_m_s2
            + self.angular_body_rad_s2.cross(&position_body_m)
            + rate_body_rad_s.cross(&rate_body_rad_s.cross(&position_body_m))
    }
}

/// Engine axes to body axes.
///
/// The vehicle file turns by `δx = -gimbal_x` about structural x, then by `δy = +gimbal_y` about structural
/// y. FRD shares the x axis and has the opposite y axis, so in FRD these are turns by `-gimbal_x` about x
/// and by `-gimbal_y` about y: `E = Ry(-gimbal_y) Rx(-gimbal_x)`.
pub fn body_from_engine(gimbal_rad: Vector2<f64>) -> Mat3 {
    let (sx, cx) = libm::sincos(-gimbal_rad.x);
    let (sy, cy) = libm::sincos(-gimbal_rad.y);
    Mat3::new(cy, sy * sx, sy * cx, 0.0, cx, -sx, -sy, cy * sx, cy * cx)
}

/// Direction of the force that the engine exerts on the vehicle, a line through O.
///
/// `u = E (0, 0, -1) = (sin gy cos gx, -sin gx, -cos gy cos gx)`. With the centre of mass at (0, 0, -l) the
/// moment about it is `(0, 0, l) × T u = l T (sin gx, sin gy cos gx, 0)`: positive gimbal_x and gimbal_y
/// give positive moments about FRD x and y, as commands promise.
pub fn thrust_direction_body(gimbal_rad: Vector2<f64>) -> Vec3 {
    let (sx, cx) = libm::sincos(gimbal_rad.x);
    let (sy, cy) = libm::sincos(gimbal_rad.y);
    Vec3::new(sy * cx, -sx, -cy * cx)
}

/// Accelerations of the free vehicle. Pure: the integrator calls it once per stage.
#[inline]
pub fn accelerations(balance: &Balance) -> Acceleration {
    match balance.slosh[0] {
        Some((mode, state)) if mode.coupling == Coupling::OneWay => one_way(balance, mode, state),
        _ => coupled(balance),
    }
}

/// A vehicle that a stand holds still: its accelerations and what the stand exerts on it about O.
///
/// `gravity_body_m_s2` is gravity in body axes; the liquid goes on sloshing and the engine swinging.
pub fn clamped(balance: &Balance, gravity_body_m_s2: Vec3) -> (Acceleration, Load) {
    let terms = Terms::new(&Balance { rate_body_rad_s: Vec3::zeros(), ..*balance });
    let specific_force = -gravity_body_m_s2;
    let mut force = specific_force * terms.body.mass_kg - terms.load.force_body_n;
    let mut moment = terms.body.first_moment_kg_m.cross(&specific_force) - terms.load.moment_body_n_m;
    let (mut slosh, mut slosh_force) = ([Vector2::zeros(); MODES], Vector2::zeros());
    for (slosh, sloshing) in slosh.iter_mut().zip(&balance.slosh) {
        let Some((mode, state)) = *sloshing else { continue };
        let restoring = mode.restoring_m_s2(state);
        *slosh = restoring - specific_force.xy();
        let on_vehicle = restoring * -mode.mass_kg;
        slosh_force += on_vehicle;
        let on_body = match mode.coupling {
            Coupling::TwoWay => lateral(*slosh) * mode.mass_kg,
            Coupling::OneWay => -lateral(on_vehicle),
        };
        force += on_body;
        moment += slosh_place(mode, state).cross(&on_body);
    }
    let acceleration = Acceleration {
        specific_force_body_m_s2: specific_force,
        angular_body_rad_s2: Vec3::zeros(),
        slosh_body_m_s2: slosh,
        slosh_force_body_n: slosh_force,
        status: SolveStatus::Solved,
    };
    (acceleration, Load { force_body_n: force, moment_body_n_m: moment })
}

/// How velocities jump when the swinging engine's angles and rates do, its play being taken up or left: what
/// the accelerations would be if the loss of relative momentum were a load for a second, with nothing else
/// that acts in no time. `before` and `after` differ in the gimbal's motion alone; `velocity_body_m_s` is
/// O's, in body axes.
pub(crate) fn velocity_jump(before: &Balance, after: &Balance, velocity_body_m_s: Vec3) -> Acceleration {
    let [had, has] = [before, after].map(|balance| momentum(balance, velocity_body_m_s));
    // Springs, dampers and stops give nothing in no time.
    let free = after.slosh.map(|sloshing| {
        let (mode, state) = sloshing?;
        let mode =
            Mode { stiffness_1_s2: 0.0, hardening_1_m2_s2: 0.0, stop_radius_m: f64::INFINITY, ..*mode };
        Some((mode, SloshState { velocity_body_m_s: Vector2::zeros(), ..*state }))
    });
    let slosh = [0, 1].map(|n: usize| free[n].as_ref().map(|(mode, state)| (mode, state)));
    let at_rest = |gimbal: GimbalMotion| GimbalMotion { angle_rad: gimbal.angle_rad, ..Default::default() };
    accelerations(&Balance {
        flow: &FlowTerms::none(),
        rate_body_rad_s: Vec3::zeros(),
        load: Load { force_body_n: had.0 - has.0, moment_body_n_m: had.1 - has.1 },
        slosh,
        swing: after.swing.map(|swing| Swing { gimbal: at_rest(swing.gimbal), ..swing }),
        ..*after
    })
}

/// Linear and angular momentum about O in body axes (kg m/s, kg m²/s), given O's velocity in body axes;
/// without what leaves the vehicle. For audits.
pub fn momentum(balance: &Balance, velocity_body_m_s: Vec3) -> (Vec3, Vec3) {
    let terms = Terms::new(balance);
    let w = balance.rate_body_rad_s;
    let (m, s, i) = (terms.body.mass_kg, terms.body.first_moment_kg_m, terms.body.inertia_kg_m2);
    let mut linear = velocity_body_m_s * m + w.cross(&s) + balance.flow.momentum_body_kg_m_s;
    let mut angular = s.cross(&velocity_body_m_s) + i * w;
    for (mode, state) in two_way(balance) {
        let relative = lateral(state.velocity_body_m_s) * mode.mass_kg;
        linear += relative;
        angular += slosh_place(mode, state).cross(&relative);
    }
    if let Some(engine) = terms.engine {
        linear += engine.rate.cross(&engine.first_moment);
        angular += engine.inertia * engine.rate;
    }
    (linear, angular)
}

/// Loads and mass properties with the engine deflected and the liquid displaced.
struct Terms {
    body: MassProperties,
    load: Load,
    engine: Option<Engine>,
}

/// The deflected engine about O.
struct Engine {
    rate: Vec3,
    first_moment: Vec3,
    inertia: Mat3,
}

impl Terms {
    fn new(balance: &Balance) -> Self {
        let mut terms = Self::rigid(balance);
        for (mode, state) in two_way(balance) {
            // A point mass taken from (0, 0, z) and put at (x, y, z).
            let (m_s, r) = (mode.mass_kg, slosh_place(mode, state));
            let (x, y) = (m_s * r.x, m_s * r.y);
            terms.body.first_moment_kg_m += Vec3::new(x, y, 0.0);
            let (xx, yy, xy, xz, yz) = (y * r.y, x * r.x, -x * r.y, -x * r.z, -y * r.z);
            terms.body.inertia_kg_m2 += Mat3::new(xx, xy, xz, xy, yy, yz, xz, yz, xx + yy);
        }
        terms
    }

    /// With the liquid at rest.
    #[inline]
    fn rigid(balance: &Balance) -> Self {
        let terms = Self { body: *balance.vehicle, load: balance.load, engine: None };
        match &balance.swing {
            None => terms,
            Some(swing) => terms.swung(swing, balance.rate_body_rad_s),
        }
    }

    /// With the engine deflected.
    #[inline(never)]
    fn swung(mut self, swing: &Swing, w: Vec3) -> Self {
        let (deflected, relative_acceleration) = deflect(swing);
        let (rate, s_e, i_e) = (deflected.rate, deflected.first_moment, deflected.inertia);
        self.body.first_moment_kg_m += s_e - swing.part.first_moment_kg_m;
        self.body.inertia_kg_m2 += i_e - swing.part.inertia_kg_m2;
        let velocity_moment = rate.cross(&s_e);
        self.load.force_body_n -= relative_acceleration.cross(&s_e)
            + rate.cross(&velocity_moment)
            + w.cross(&velocity_moment) * 2.0;
        let relative_momentum = times(&i_e, rate);
        // (W~ I - I W~) w = W×(I w) - I (W×w)
        self.load.moment_body_n_m -= times(&i_e, relative_acceleration - rate.cross(&w))
            + (rate + w).cross(&relative_momentum)
            + rate.cross(&times(&i_e, w));
        self.engine = Some(deflected);
        self
    }
}

/// The engine as it is deflected, and its angular acceleration relative to the body.
fn deflect(swing: &Swing) -> (Engine, Vec3) {
    // In FRD the angles are a = -gimbal_x about x and b = -gimbal_y about y, E = Ry(b) Rx(a), hence
    // W = Ry(b) (a', 0, 0) + (0, b', 0).
    let gimbal = &swing.gimbal;
    let (a1, b1) = (-gimbal.rate_rad_s.x, -gimbal.rate_rad_s.y);
    let (a2, b2) = (-gimbal.acceleration_rad_s2.x, -gimbal.acceleration_rad_s2.y);
    let e = body_from_engine(gimbal.angle_rad);
    let (cb, sb) = (e[(0, 0)], -e[(2, 0)]);
    let rate = Vec3::new(a1 * cb, b1, -a1 * sb);
    let acceleration = Vec3::new(a2 * cb - a1 * b1 * sb, b2, -a2 * sb - a1 * b1 * cb);
    let engine = Engine {
        rate,
        first_moment: times(&e, swing.part.first_moment_kg_m),
        inertia: product(&product(&e, &swing.part.inertia_kg_m2), &e.transpose()),
    };
    (engine, acceleration)
}

/// The modes whose mass is part of the vehicle's.
fn two_way<'a>(balance: &'a Balance) -> impl Iterator<Item = (&'a Mode, &'a SloshState)> {
    balance.slosh.iter().flatten().copied().filter(|(mode, _)| mode.coupling == Coupling::TwoWay)
}

/// Where the sloshing mass is, body FRD from O. The one-way form leaves it on the axis.
fn slosh_place(mode: &Mode, state: &SloshState) -> Vec3 {
    let s = match mode.coupling {
        Coupling::TwoWay => state.displacement_body_m,
        Coupling::OneWay => Vector2::zeros(),
    };
    Vec3::new(s.x, s.y, mode.station_z_body_m)
}

fn lateral(v: Vector2<f64>) -> Vec3 {
    Vec3::new(v.x, v.y, 0.0)
}

/// Solves the balance with the liquid frozen or coupled both ways. Written out by components: this is the
/// innermost function of the plant.
#[inline(always)]
fn coupled(balance: &Balance) -> Acceleration {
    let Terms { body, load, .. } = Terms::rigid(balance);
    let (m, rest, i) = (body.mass_kg, body.first_moment_kg_m, &body.inertia_kg_m2);
    let w = balance.rate_body_rad_s;
    let w2 = w.dot(&w);

    // The rows as blocks: diag(a) A + C w' = force, Cᵀ A + D w' = moment, with C = -S~. The slosh rows say
    // r'' = free - [A + w'×r]_xy; put into the others they take the sloshing mass out of the lateral inertia
    // and leave m_s `free` as a load. What is left of D's third row and column and of C's third column is
    // that of the body with the liquid at rest.
    let (mut s, mut height) = (rest, rest.z); // first moment, and that of the mass with lateral inertia
    let mut lateral_kg = m;
    let (mut d00, mut d10, mut d11) = (i[(0, 0)], i[(1, 0)], i[(1, 1)]);
    let (mut d20, mut d21, mut d22) = (i[(2, 0)], i[(2, 1)], i[(2, 2)]);
    let mut momentum = times(i, w); // I w
    let (mut force, mut moment) = (load.force_body_n, load.moment_body_n_m);
    let mut slosh_force_body_n = Vector2::zeros();
    let mut free = [Vector2::zeros(); MODES];
    for (free, sloshing) in free.iter_mut().zip(&balance.slosh) {
        let Some((mode, state)) = *sloshing else { continue };
        let m_s = mode.mass_kg;
        let (x, y) = (state.displacement_body_m.x, state.displacement_body_m.y);
        let z = mode.station_z_body_m;
        let (qx, qy, qz) = (m_s * x, m_s * y, m_s * z);
        let restoring = mode.restoring_m_s2(state);
        slosh_force_body_n -= restoring * m_s;
        // w×(w×r) = w (w·r) - r w², and the Coriolis term.
        let along = w.x * x + w.y * y + w.z * z;
        let v = state.velocity_body_m_s * 2.0;
        let relative =
            Vector2::new(restoring.x - (w.x * along - x * w2), restoring.y - (w.y * along - y * w2));
        *free = Vector2::new(relative.x + w.z * v.y, relative.y - w.z * v.x);
        let (fx, fy, fz) = (m_s * relative.x, m_s * relative.y, m_s * (w.x * v.y - w.y * v.x));
        force -= Vec3::new(fx, fy, fz);
        moment -= Vec3::new(y * fz - z * fy, z * fx - x * fz, x * fy - y * fx);
        // Angular momentum of a point mass taken from (0, 0, z) and put at (x, y, z).
        let turn = y * w.x - x * w.y;
        let up = z * w.z;
        momentum.x += qy * turn - qx * up;
        momentum.y -= qx * turn + qy * up;
        momentum.z += (qx * x + qy * y) * w.z - z * (qx * w.x + qy * w.y);
        s.x += qx;
        s.y += qy;
        height -= qz;
        lateral_kg -= m_s;
        d00 += qy * y - qz * z;
        d10 -= qx * y;
        d11 += qx * x - qz * z;
    }

    let along = w.dot(&s);
    let p = balance.flow.momentum_body_kg_m_s * 2.0;
    force -= w * along - s * w2 + w.cross(&p);
    moment -= w.cross(&momentum) + times(&balance.flow.jet_damping_kg_m2_s, w);

    if !(lateral_kg > 0.0 && m > 0.0) {
        return Acceleration::SINGULAR;
    }
    // A = diag(a)⁻¹ (force - C w'), so (D - Cᵀ diag(a)⁻¹ C) w' = moment - Cᵀ diag(a)⁻¹ force, with the
    // columns of C (0, -h, S_y), (h, 0, -S_x), (-R_y, R_x, 0): h the height, R the first moment with the
    // liquid at rest.
    let (per_lateral, per_mass) = (1.0 / lateral_kg, 1.0 / m);
    let f = Vec3::new(force.x * per_lateral, force.y * per_lateral, force.z * per_mass);
    moment.x -= s.y * f.z - height * f.y;
    moment.y -= height * f.x - s.x * f.z;
    moment.z -= rest.x * f.y - rest.y * f.x;
    let lever = height * per_lateral;
    d00 -= lever * height + per_mass * s.y * s.y;
    d10 += per_mass * s.x * s.y;
    d11 -= lever * height + per_mass * s.x * s.x;
    d20 += lever * rest.x;
    d21 += lever * rest.y;
    d22 -= per_lateral * (rest.x * rest.x + rest.y * rest.y);
    let Some(angular) = solve_positive_definite([d00, d10, d11, d20, d21, d22], moment) else {
        return Acceleration::SINGULAR;
    };
    let specific_force = Vec3::new(
        f.x - per_lateral * (height * angular.y - rest.y * angular.z),
        f.y - per_lateral * (rest.x * angular.z - height * angular.x),
        f.z - per_mass * (s.y * angular.x - s.x * angular.y),
    );
    if !(specific_force.norm_squared() + angular.norm_squared()).is_finite() {
        return Acceleration::SINGULAR;
    }
    let mut slosh_body_m_s2 = [Vector2::zeros(); MODES];
    for (n, sloshing) in balance.slosh.iter().enumerate() {
        let Some((mode, state)) = *sloshing else { continue };
        let (x, y) = (state.displacement_body_m.x, state.displacement_body_m.y);
        let z = mode.station_z_body_m;
        slosh_body_m_s2[n] = Vector2::new(
            free[n].x - (specific_force.x + angular.y * z - angular.z * y),
            free[n].y - (specific_force.y + angular.z * x - angular.x * z),
        );
    }
    Acceleration {
        specific_force_body_m_s2: specific_force,
        angular_body_rad_s2: angular,
        slosh_body_m_s2,
        slosh_force_body_n,
        status: SolveStatus::Solved,
    }
}

/// The seed paper's coupling: the frozen body drives the oscillator, then the oscillator's force acts on
/// the frozen body at its station.
#[inline(never)]
fn one_way(balance: &Balance, mode: &Mode, state: &SloshState) -> Acceleration {
    let frozen = Balance { slosh: [None; MODES], ..*balance };
    let station = slosh_place(mode, state);
    let driving = coupled(&frozen).specific_force_at(station, balance.rate_body_rad_s);
    let restoring = mode.restoring_m_s2(state);
    let force = restoring * -mode.mass_kg;
    let load = balance.load + Load::at(station, lateral(force));
    Acceleration {
        slosh_body_m_s2: [restoring - driving.xy(), Vector2::zeros()],
        slosh_force_body_n: force,
        ..coupled(&Balance { load, ..frozen })
    }
}

/// Matrix times vector, written out: in this inner loop the general product takes several times as long.
fn times(m: &Mat3, v: Vec3) -> Vec3 {
    Vec3::new(
        m[(0, 0)] * v.x + m[(0, 1)] * v.y + m[(0, 2)] * v.z,
        m[(1, 0)] * v.x + m[(1, 1)] * v.y + m[(1, 2)] * v.z,
        m[(2, 0)] * v.x + m[(2, 1)] * v.y + m[(2, 2)] * v.z,
    )
}

/// Matrix times matrix, by columns.
fn product(a: &Mat3, b: &Mat3) -> Mat3 {
    let column = |j: usize| times(a, Vec3::new(b[(0, j)], b[(1, j)], b[(2, j)]));
    Mat3::from_columns(&[column(0), column(1), column(2)])
}

/// Solves `k x = b` for a symmetric positive definite 3 x 3 `k`, given by the rows of its lower triangle, by
/// its L D Lᵀ factors; `None` otherwise.
#[inline]
fn solve_positive_definite([d0, k10, k11, k20, k21, k22]: [f64; 6], b: Vec3) -> Option<Vec3> {
    let per_d0 = 1.0 / d0;
    let (l10, l20) = (k10 * per_d0, k20 * per_d0);
    let d1 = k11 - l10 * k10;
    let per_d1 = 1.0 / d1;
    let t21 = k21 - l20 * k10;
    let l21 = t21 * per_d1;
    let d2 = k22 - l20 * k20 - l21 * t21;
    if !(d0 > 0.0 && d1 > 0.0 && d2 > 0.0) {
        return None;
    }
    let y1 = b.y - l10 * b.x;
    let y2 = b.z - l20 * b.x - l21 * y1;
    let z = y2 / d2;
    let y = y1 * per_d1 - l21 * z;
    Some(Vec3::new(b.x * per_d0 - l10 * y - l20 * z, y, z))
}
