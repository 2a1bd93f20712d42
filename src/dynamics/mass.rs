//! Mass, first moment and inertia of the vehicle from what is in it, and how fast they change.
//!
//! Dry components are summed once. On top of them stand, all on the long axis: the liquid as a solid
//! column on the tank floor, the pressurant above it as a gas column up to the tank top, the stored
//! nitrogen as a cylinder, and the grain as a cylinder with N ports. Rates follow from the flow rates by
//! the chain rule, at constant liquid density; the outflows turn them into the momentum of the internal
//! flow P and the jet-damping tensor J of the equations of motion ([`super::rigid_body`]).
//!
//! Everything is about the gimbal pivot O in body FRD, inertia in the tensor convention, engine at zero
//! gimbal. Source: textbook solids; P and J from the momentum theorem for a body with steady internal
//! flow (Thomson, Introduction to Space Dynamics, 1961, chapter 7).

use crate::frame::{Mat3, Vec3, frd_from_structural, inertia_frd_from_structural, point_inertia};
use core::f64::consts::PI;

/// A dry part with its mass properties, structural frame.
#[derive(Clone, Debug)]
pub struct Component {
    /// Name of the part.
    pub name: String,
    /// Mass (kg).
    pub mass_kg: f64,
    /// Centre of mass from the gimbal pivot, structural frame (m).
    pub position_m: [f64; 3],
    /// Inertia about the part's own centre of mass in structural axes (kg m²), tensor convention, symmetric.
    pub inertia_kg_m2: [[f64; 3]; 3],
    /// Whether the part turns with the gimbal.
    pub swings: bool,
}

impl Component {
    /// The part alone, about O in body FRD.
    pub fn properties(&self) -> MassProperties {
        let position = frd_from_structural(self.position_m);
        let own = inertia_frd_from_structural(Mat3::from_fn(|row, column| self.inertia_kg_m2[row][column]));
        MassProperties {
            mass_kg: self.mass_kg,
            first_moment_kg_m: position * self.mass_kg,
            inertia_kg_m2: own + point_inertia(position) * self.mass_kg,
        }
    }

    /// Inertia that a real body can have: symmetric, and no principal moment above the sum of the others.
    pub fn validate(&self) -> Result<(), crate::input::Invalid> {
        let i = &self.inertia_kg_m2;
        let (a, b, c) = (i[0][0], i[1][1], i[2][2]);
        if i[0][1] != i[1][0] || i[0][2] != i[2][0] || i[1][2] != i[2][1] {
            return Err(crate::input::Invalid::new("inertia_kg_m2", format!("{}: not symmetric", self.name)));
        }
        let slack = 1e-9 * (a + b + c);
        let principal = Mat3::from_fn(|row, column| i[row][column]).symmetric_eigenvalues();
        let (a, b, c) = (principal.x, principal.y, principal.z);
        let least = a.min(b).min(c);
        if !(least >= -slack && a <= b + c + slack && b <= a + c + slack && c <= a + b + slack) {
            return Err(crate::input::Invalid::new(
                "inertia_kg_m2",
                format!(
                    "{}: principal moments {a:.4}, {b:.4}, {c:.4}: \
                     none may be negative or above the sum of the others",
                    self.name
                ),
            ));
        }
        Ok(())
    }
}

/// Inner cylinder of the run tank, standing on the long axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TankGeometry {
    /// Inner radius (m).
    pub radius_m: f64,
    /// Inner length (m).
    pub length_m: f64,
    /// Height of the floor above the gimbal pivot (m).
    pub floor_z_m: f64,
}

/// Stored pressurant as a uniform cylinder on the long axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BottleGeometry {
    /// Radius (m).
    pub radius_m: f64,
    /// Volume (m³); the length follows.
    pub volume_m3: f64,
    /// Height of the centre above the gimbal pivot (m).
    pub centre_z_m: f64,
}

/// Fuel grain: a cylinder with N equal straight ports.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GrainGeometry {
    /// Ports; 1 is central, 2 lie along body x, more are evenly spaced on a circle.
    pub port_count: u32,
    /// Radius of the circle of port axes (m); 0 for one port.
    pub port_circle_radius_m: f64,
    /// Outer radius (m).
    pub outer_radius_m: f64,
    /// Length (m).
    pub length_m: f64,
    /// Height of the fore end above the gimbal pivot (m), usually negative.
    pub top_z_m: f64,
    /// Fuel density (kg/m³).
    pub fuel_density_kg_m3: f64,
}

impl GrainGeometry {
    /// What of the grain does not change in flight.
    fn constants(&self) -> GrainConstants {
        let n = f64::from(self.port_count);
        let ro2 = self.outer_radius_m * self.outer_radius_m;
        let column = self.fuel_density_kg_m3 * self.length_m * PI; // [kg/m²]
        let b2 = self.port_circle_radius_m * self.port_circle_radius_m;
        // Sums of the squared port-axis coordinates, for the parallel-axis share of each port.
        let (sum_x2, sum_y2) = match self.port_count {
            0 | 1 => (0.0, 0.0),
            2 => (2.0 * b2, 0.0),
            _ => (0.5 * n * b2, 0.5 * n * b2),
        };
        let z = -(self.top_z_m - 0.5 * self.length_m);
        let shape = self.length_m * self.length_m / 12.0 + z * z; // [m²]
        let disc = 0.25 * ro2 * ro2;
        GrainConstants {
            port_count: n,
            outer_radius_2: ro2,
            column,
            z,
            unported_inertia: column * Vec3::new(disc + ro2 * shape, disc + ro2 * shape, 2.0 * disc),
            ports: column * Vec3::new(sum_y2 + n * shape, sum_x2 + n * shape, sum_x2 + sum_y2),
        }
    }
}

/// Constants of a grain: with q the square of the port radius, `mass = column (Ro² - N q)` and inertia
/// `unported_inertia - q (ports + column N q (1/4, 1/4, 1/2))` about the axes of O.
#[derive(Clone, Copy, Debug)]
struct GrainConstants {
    port_count: f64,
    outer_radius_2: f64,
    /// ρ π L: fuel mass per squared radius (kg/m²).
    column: f64,
    z: f64,
    /// Inertia of the grain without ports.
    unported_inertia: Vec3,
    /// Inertia that thin ports remove, per squared port radius (kg).
    ports: Vec3,
}

impl GrainConstants {
    /// The grain at a port radius (m) that grows at a rate (m/s).
    #[inline]
    fn contribution(&self, r: f64, r_dot: f64) -> AxialContribution {
        let (q, q_dot) = (r * r, 2.0 * r * r_dot);
        let (nq, nq_dot) = (self.port_count * q, self.port_count * q_dot);
        if self.outer_radius_2 <= nq {
            return AxialContribution::default();
        }
        // Second moments of area of disc less ports: π (Ro⁴ - N R⁴)/4 about a diameter, twice that about
        // the axis; a port off the axis takes π R² d² more.
        let (mass, mass_dot) = (self.column * (self.outer_radius_2 - nq), -self.column * nq_dot);
        let port = self.column * nq;
        AxialContribution {
            mass,
            mass_dot,
            moment: mass * self.z,
            moment_dot: mass_dot * self.z,
            xx: self.unported_inertia.x - q * (self.ports.x + 0.25 * port),
            xx_dot: -q_dot * (self.ports.x + 0.5 * port),
            yy: self.unported_inertia.y - q * (self.ports.y + 0.25 * port),
            yy_dot: -q_dot * (self.ports.y + 0.5 * port),
            zz: self.unported_inertia.z - q * (self.ports.z + 0.5 * port),
            zz_dot: -q_dot * (self.ports.z + port),
        }
    }
}

/// What is in the vehicle at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contents {
    /// Liquid nitrous oxide (kg).
    pub nitrous_kg: f64,
    /// Its density (kg/m³).
    pub nitrous_density_kg_m3: f64,
    /// Radius of each port (m).
    pub port_radius_m: f64,
    /// Pressurant above the liquid (kg).
    pub nitrogen_run_tank_kg: f64,
    /// Pressurant in the bottle (kg).
    pub nitrogen_bottle_kg: f64,
}

/// Rates of [`Contents`]: negative while something empties.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ContentsRate {
    /// Liquid nitrous oxide (kg/s).
    pub nitrous_kg_s: f64,
    /// Growth of the port radius (m/s).
    pub port_radius_m_s: f64,
    /// Pressurant above the liquid (kg/s).
    pub nitrogen_run_tank_kg_s: f64,
    /// Pressurant in the bottle (kg/s).
    pub nitrogen_bottle_kg_s: f64,
}

/// Mass, first moment and inertia of a body about O, body FRD.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MassProperties {
    /// Mass (kg).
    pub mass_kg: f64,
    /// Mass times centre of mass (kg m).
    pub first_moment_kg_m: Vec3,
    /// Inertia about O (kg m²).
    pub inertia_kg_m2: Mat3,
}

impl MassProperties {
    /// No mass.
    pub fn none() -> Self {
        Self { mass_kg: 0.0, first_moment_kg_m: Vec3::zeros(), inertia_kg_m2: Mat3::zeros() }
    }

    /// Centre of mass (m); O for a body without mass.
    pub fn centre_of_mass_body_m(&self) -> Vec3 {
        if self.mass_kg > 0.0 { self.first_moment_kg_m / self.mass_kg } else { Vec3::zeros() }
    }

    /// Inertia about the centre of mass (kg m²).
    pub fn inertia_about_com_kg_m2(&self) -> Mat3 {
        self.inertia_kg_m2 - point_inertia(self.centre_of_mass_body_m()) * self.mass_kg
    }

    fn add(&mut self, other: &Self) {
        self.mass_kg += other.mass_kg;
        self.first_moment_kg_m += other.first_moment_kg_m;
        self.inertia_kg_m2 += other.inertia_kg_m2;
    }

    #[inline]
    fn add_axial(&mut self, part: &AxialContribution) {
        self.mass_kg += part.mass;
        self.first_moment_kg_m.z += part.moment;
        self.inertia_kg_m2[(0, 0)] += part.xx;
        self.inertia_kg_m2[(1, 1)] += part.yy;
        self.inertia_kg_m2[(2, 2)] += part.zz;
    }
}

/// Rates of [`MassProperties`] in the body frame. What moves stays on the long axis, so the first moment
/// changes along z and the inertia in its diagonal.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MassRate {
    /// Mass (kg/s).
    pub mass_kg_s: f64,
    /// First moment along body z (kg m/s).
    pub first_moment_z_kg_m_s: f64,
    /// Diagonal of the inertia about O (kg m²/s).
    pub inertia_diagonal_kg_m2_s: Vec3,
}

/// Mass that leaves the vehicle at a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outflow {
    /// Where it leaves, body FRD (m).
    pub position_body_m: Vec3,
    /// How much, positive outward (kg/s).
    pub mass_flow_kg_s: f64,
}

/// What the moving contents add to the equations of motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlowTerms {
    /// Momentum of the internal flow, `P = dS/dt + Σ ṁ_k r_k` (kg m/s).
    pub momentum_body_kg_m_s: Vec3,
    /// Jet damping, `J = dI/dt + Σ ṁ_k (r_k·r_k E - r_k r_kᵀ)` (kg m²/s).
    pub jet_damping_kg_m2_s: Mat3,
}

impl FlowTerms {
    /// Nothing flows.
    pub fn none() -> Self {
        Self { momentum_body_kg_m_s: Vec3::zeros(), jet_damping_kg_m2_s: Mat3::zeros() }
    }

    /// From the rates in the body and what leaves it: nozzle exit, thrusters, vent.
    #[inline]
    pub fn new(rate: &MassRate, outflows: &[Outflow]) -> Self {
        let mut terms = Self {
            momentum_body_kg_m_s: Vec3::new(0.0, 0.0, rate.first_moment_z_kg_m_s),
            jet_damping_kg_m2_s: Mat3::from_diagonal(&rate.inertia_diagonal_kg_m2_s),
        };
        outflows.iter().for_each(|outflow| terms.add(outflow));
        terms
    }

    /// One outflow more.
    #[inline]
    pub fn add(&mut self, outflow: &Outflow) {
        let (r, flow) = (outflow.position_body_m, outflow.mass_flow_kg_s);
        if flow == 0.0 {
            return;
        }
        self.momentum_body_kg_m_s += r * flow;
        if r.x == 0.0 && r.y == 0.0 {
            // On the long axis (nozzle, vent): only the lateral axes are damped.
            let damping = r.z * r.z * flow;
            self.jet_damping_kg_m2_s[(0, 0)] += damping;
            self.jet_damping_kg_m2_s[(1, 1)] += damping;
        } else {
            self.jet_damping_kg_m2_s += point_inertia(r) * flow;
        }
    }
}

/// Everything that [`MassModel::evaluate`] finds at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MassState {
    /// The whole vehicle, liquid frozen, engine at zero gimbal.
    pub vehicle: MassProperties,
    /// The part that turns with the gimbal: swinging components and the grain, at zero gimbal.
    pub swinging: MassProperties,
    /// How fast `vehicle` changes.
    pub rate: MassRate,
}

/// Mass model of a vehicle: dry sums and the shapes of what it holds.
#[derive(Clone, Debug)]
pub struct MassModel {
    dry: MassProperties,
    dry_swinging: MassProperties,
    tank: TankGeometry,
    bottle: BottleGeometry,
    grain: GrainConstants,
    bottle_length_m: f64,
    roll_inertia_factor: f64,
}

impl MassModel {
    /// From components in the structural frame. `roll_inertia_factor` is the share of the liquid's own
    /// inertia about the long axis that turns with the tank.
    pub fn new(
        components: &[Component],
        tank: TankGeometry,
        bottle: BottleGeometry,
        grain: GrainGeometry,
        roll_inertia_factor: f64,
    ) -> Self {
        let mut dry = MassProperties::none();
        let mut dry_swinging = MassProperties::none();
        for component in components {
            dry.add(&component.properties());
            if component.swings {
                dry_swinging.add(&component.properties());
            }
        }
        Self {
            dry,
            dry_swinging,
            tank,
            bottle,
            grain: grain.constants(),
            bottle_length_m: bottle.volume_m3 / (PI * bottle.radius_m * bottle.radius_m),
            roll_inertia_factor,
        }
    }

    /// Takes another share of the liquid's own inertia about the long axis that turns with the tank.
    pub(crate) fn set_roll_inertia_factor(&mut self, factor: f64) {
        self.roll_inertia_factor = factor;
    }

    /// The vehicle without contents.
    pub fn dry(&self) -> &MassProperties {
        &self.dry
    }

    /// The run tank, which the slosh model needs too.
    pub fn tank(&self) -> &TankGeometry {
        &self.tank
    }

    /// Mass properties and their rates. Pure: the integrator calls it once per stage.
    #[inline(always)] // so that nothing is written that a stage does not read
    pub fn evaluate(&self, contents: &Contents, rate: &ContentsRate) -> MassState {
        let (height, height_dot) = self.liquid_height(contents, rate);
        // Liquid and gas above it: columns from z1 to z2 above O, of which the surface moves.
        let (floor, top) = (self.tank.floor_z_m, self.tank.floor_z_m + self.tank.length_m);
        let surface = floor + height;
        let r2 = self.tank.radius_m * self.tank.radius_m;
        let (liquid, liquid_dot) = (contents.nitrous_kg, rate.nitrous_kg_s);
        let (gas, gas_dot) = (contents.nitrogen_run_tank_kg, rate.nitrogen_run_tank_kg_s);
        let (bottle, bottle_dot) = (contents.nitrogen_bottle_kg, rate.nitrogen_bottle_kg_s);
        // Mean height, and mean square of the height: (z1² + z1 z2 + z2²)/3.
        let (liquid_z, gas_z) = (0.5 * (floor + surface), 0.5 * (surface + top));
        let (bottle_z, bottle_radius) = (self.bottle.centre_z_m, self.bottle.radius_m);
        let bottle_r2 = bottle_radius * bottle_radius;
        let liquid_z2 = (floor * (floor + surface) + surface * surface) * (1.0 / 3.0);
        let gas_z2 = (top * (top + surface) + surface * surface) * (1.0 / 3.0);
        let bottle_length = self.bottle_length_m;
        let bottle_z2 = bottle_length * bottle_length * (1.0 / 12.0) + bottle_z * bottle_z;
        // About a lateral axis r²/4 + the mean square of the height per unit of mass.
        let (liquid_xx, gas_xx) = (0.25 * r2 + liquid_z2, 0.25 * r2 + gas_z2);
        let bottle_xx = 0.25 * bottle_r2 + bottle_z2;
        let moved = height_dot * (1.0 / 3.0);
        let xx = liquid * liquid_xx + gas * gas_xx + bottle * bottle_xx;
        let xx_dot = liquid_dot * liquid_xx
            + gas_dot * gas_xx
            + bottle_dot * bottle_xx
            + moved * (liquid * (floor + 2.0 * surface) + gas * (top + 2.0 * surface));
        let roll = 0.5 * self.roll_inertia_factor * r2;
        let grain = self.grain.contribution(contents.port_radius_m, rate.port_radius_m_s);

        let mut swinging = self.dry_swinging;
        swinging.add_axial(&grain);
        let mut vehicle = self.dry;
        vehicle.add_axial(&grain);
        vehicle.mass_kg += liquid + gas + bottle;
        vehicle.first_moment_kg_m.z -= liquid * liquid_z + gas * gas_z + bottle * bottle_z;
        vehicle.inertia_kg_m2[(0, 0)] += xx;
        vehicle.inertia_kg_m2[(1, 1)] += xx;
        vehicle.inertia_kg_m2[(2, 2)] += liquid * roll + 0.5 * (gas * r2 + bottle * bottle_r2);
        let rate = MassRate {
            mass_kg_s: grain.mass_dot + liquid_dot + gas_dot + bottle_dot,
            first_moment_z_kg_m_s: grain.moment_dot
                - (liquid_dot * liquid_z
                    + gas_dot * gas_z
                    + bottle_dot * bottle_z
                    + 0.5 * height_dot * (liquid + gas)),
            inertia_diagonal_kg_m2_s: Vec3::new(
                grain.xx_dot + xx_dot,
                grain.yy_dot + xx_dot,
                grain.zz_dot + liquid_dot * roll + 0.5 * (gas_dot * r2 + bottle_dot * bottle_r2),
            ),
        };
        MassState { vehicle, swinging, rate }
    }

    /// Height of the liquid column (m) and its rate (m/s); it stays inside the tank.
    fn liquid_height(&self, contents: &Contents, rate: &ContentsRate) -> (f64, f64) {
        let height_per_kg = self.tank.height_per_kg(contents.nitrous_density_kg_m3);
        let height = contents.nitrous_kg * height_per_kg;
        if height > self.tank.length_m {
            (self.tank.length_m, 0.0)
        } else {
            (height.max(0.0), rate.nitrous_kg_s * height_per_kg)
        }
    }
}

impl TankGeometry {
    /// Height of a column of 1 kg of liquid of the given density (m/kg); 0 where density means nothing.
    pub fn height_per_kg(&self, density_kg_m3: f64) -> f64 {
        let per_height = density_kg_m3 * PI * self.radius_m * self.radius_m; // [kg/m]
        if per_height > 0.0 { 1.0 / per_height } else { 0.0 }
    }
}

/// Contents centred on the long axis, about O, and their rates; the lateral moments may differ (two ports).
/// `moment` is mass times z.
#[derive(Clone, Copy, Debug, Default)]
struct AxialContribution {
    mass: f64,
    mass_dot: f64,
    moment: f64,
    moment_dot: f64,
    xx: f64,
    xx_dot: f64,
    yy: f64,
    yy_dot: f64,
    zz: f64,
    zz_dot: f64,
}
