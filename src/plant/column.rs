//! What is written down of a [`Snapshot`], number by number: name, unit, and where the number comes from.
//!
//! One list. `fly --csv` and the array of the plant on the wire are selections of it. A number that
//! [`Snapshot`] has is a line here: `.csv()` appends it to the CSV table. Every place of the array is taken,
//! as many as its message has.

use super::Snapshot;

/// A number of a snapshot.
#[derive(Clone, Copy, Debug)]
pub struct Column {
    /// Ends with the unit, if it has one.
    pub name: &'static str,
    /// Empty: a number without unit.
    pub unit: &'static str,
    /// In the table that `fly --csv` writes.
    in_csv: bool,
    /// Place in the array of the plant on the wire.
    place: Option<usize>,
    value: fn(&Snapshot) -> f64,
}

impl Column {
    /// Its number at an instant.
    pub fn of(&self, snapshot: &Snapshot) -> f64 {
        (self.value)(snapshot)
    }

    const fn csv(self) -> Self {
        Self { in_csv: true, ..self }
    }

    const fn array(self, place: usize) -> Self {
        Self { place: Some(place), ..self }
    }
}

const fn column(name: &'static str, unit: &'static str, value: fn(&Snapshot) -> f64) -> Column {
    Column { name, unit, in_csv: false, place: None, value }
}

/// Everything that is written down. Centre of mass in the structural frame; inertia about it, slosh and
/// specific force in FRD; position and velocity of the gimbal pivot; actuators as realised.
pub const COLUMNS: &[Column] = &[
    column("time_s", "s", |s| s.time.s()).csv(),
    column("north_m", "m", |s| s.position_ned_m.x).csv(),
    column("east_m", "m", |s| s.position_ned_m.y).csv(),
    column("down_m", "m", |s| s.position_ned_m.z).csv(),
    column("vn_m_s", "m/s", |s| s.velocity_ned_m_s.x).csv(),
    column("ve_m_s", "m/s", |s| s.velocity_ned_m_s.y).csv(),
    column("vd_m_s", "m/s", |s| s.velocity_ned_m_s.z).csv(),
    column("qw", "", |s| s.q_ned_from_body.w).csv(),
    column("qx", "", |s| s.q_ned_from_body.i).csv(),
    column("qy", "", |s| s.q_ned_from_body.j).csv(),
    column("qz", "", |s| s.q_ned_from_body.k).csv(),
    column("p_rad_s", "rad/s", |s| s.rate_body_rad_s.x).csv(),
    column("q_rad_s", "rad/s", |s| s.rate_body_rad_s.y).csv(),
    column("r_rad_s", "rad/s", |s| s.rate_body_rad_s.z).csv(),
    column("mass_kg", "kg", |s| s.mass_kg).csv().array(0),
    column("com_x_m", "m", |s| s.com_structural_m.x).csv().array(1),
    column("com_y_m", "m", |s| s.com_structural_m.y).csv().array(2),
    column("com_z_m", "m", |s| s.com_structural_m.z).csv().array(3),
    column("ixx_kg_m2", "kg m²", |s| s.inertia_kg_m2[(0, 0)]).csv().array(4),
    column("iyy_kg_m2", "kg m²", |s| s.inertia_kg_m2[(1, 1)]).csv().array(5),
    column("izz_kg_m2", "kg m²", |s| s.inertia_kg_m2[(2, 2)]).csv().array(6),
    column("ixy_kg_m2", "kg m²", |s| s.inertia_kg_m2[(0, 1)]).csv().array(7),
    column("ixz_kg_m2", "kg m²", |s| s.inertia_kg_m2[(0, 2)]).csv().array(8),
    column("iyz_kg_m2", "kg m²", |s| s.inertia_kg_m2[(1, 2)]).csv().array(9),
    column("nitrous_kg", "kg", |s| s.nitrous_kg).csv().array(10),
    column("fuel_kg", "kg", |s| s.fuel_kg).csv().array(11),
    column("nitrogen_bottle_kg", "kg", |s| s.nitrogen_bottle_kg).csv().array(12),
    column("nitrogen_ullage_kg", "kg", |s| s.nitrogen_ullage_kg).csv().array(13),
    column("port_radius_m", "m", |s| s.port_radius_m).csv().array(27),
    column("throat_radius_m", "m", |s| s.throat_radius_m).csv().array(28),
    column("oxidizer_kg_s", "kg/s", |s| s.oxidizer_kg_s).csv().array(24),
    column("fuel_kg_s", "kg/s", |s| s.fuel_kg_s).csv().array(25),
    column("of_ratio", "", |s| s.of_ratio).csv().array(26),
    column("chamber_pa", "Pa", |s| s.chamber_pa).csv().array(22),
    column("injector_inlet_pa", "Pa", |s| s.injector_inlet_pa).csv().array(21),
    column("quality", "", |s| s.quality).csv().array(23),
    column("tank_pa", "Pa", |s| s.tank_pa).csv().array(19),
    column("bottle_pa", "Pa", |s| s.bottle_pa).csv().array(20),
    column("valve_deg", "deg", |s| s.valve_rad.to_degrees()).csv(),
    column("valve_area_m2", "m²", |s| s.valve_area_m2).csv().array(30),
    column("thrust_command_n", "N", |s| s.thrust_command_n).csv().array(31),
    column("thrust_n", "N", |s| s.thrust_n).csv().array(32),
    column("gimbal_x_deg", "deg", |s| s.gimbal_rad[0].to_degrees()).csv(),
    column("gimbal_y_deg", "deg", |s| s.gimbal_rad[1].to_degrees()).csv(),
    column("rcs_roll", "", |s| s.rcs_roll).csv().array(35),
    column("slosh_x_m", "m", |s| s.slosh_m[0]).csv().array(15),
    column("slosh_y_m", "m", |s| s.slosh_m[1]).csv().array(16),
    column("slosh_force_x_n", "N", |s| s.slosh_force_n[0]).csv().array(17),
    column("slosh_force_y_n", "N", |s| s.slosh_force_n[1]).csv().array(18),
    column("wind_n_m_s", "m/s", |s| s.wind_ned_m_s.x).csv().array(41),
    column("wind_e_m_s", "m/s", |s| s.wind_ned_m_s.y).csv().array(42),
    column("wind_d_m_s", "m/s", |s| s.wind_ned_m_s.z).csv().array(43),
    column("nitrous_vapor_kg", "kg", |s| s.nitrous_vapor_kg).array(14),
    column("valve_rad", "rad", |s| s.valve_rad).array(29),
    column("gimbal_x_rad", "rad", |s| s.gimbal_rad[0]).array(33),
    column("gimbal_y_rad", "rad", |s| s.gimbal_rad[1]).array(34),
    column("liquid_k", "K", |s| s.liquid_k).array(36),
    column("bottle_gas_k", "K", |s| s.gas_k[0]).array(37),
    column("ullage_gas_k", "K", |s| s.gas_k[1]).array(38),
    column("chamber_gas_kg", "kg", |s| s.chamber_gas_kg).array(39),
    column("manifold_kg", "kg", |s| s.manifold_kg).array(40),
    column("height_m", "m", |s| s.height_m).array(44),
    column("pads_down", "", |s| f64::from(s.pads_down)).array(45),
    column("leg_deflection_m", "m", |s| s.leg_deflection_m).array(46),
    column("lit", "", |s| f64::from(u8::from(s.lit))).array(47),
    column("expelled_nozzle_kg", "kg", |s| s.expelled_kg[0]).array(48),
    column("expelled_rcs_kg", "kg", |s| s.expelled_kg[1]).array(49),
    column("expelled_vent_kg", "kg", |s| s.expelled_kg[2]).array(50),
    column("com_vn_m_s", "m/s", |s| s.com_velocity_ned_m_s.x).array(51),
    column("com_ve_m_s", "m/s", |s| s.com_velocity_ned_m_s.y).array(52),
    column("com_vd_m_s", "m/s", |s| s.com_velocity_ned_m_s.z).array(53),
    column("specific_force_x_m_s2", "m/s²", |s| s.specific_force_body_m_s2.x).array(54),
    column("specific_force_y_m_s2", "m/s²", |s| s.specific_force_body_m_s2.y).array(55),
    column("specific_force_z_m_s2", "m/s²", |s| s.specific_force_body_m_s2.z).array(56),
    column("tilt_rad", "rad", |s| s.tilt_rad()).array(57),
];

/// Columns of the table that `fly --csv` writes, in its order.
pub fn csv() -> impl Iterator<Item = &'static Column> {
    COLUMNS.iter().filter(|column| column.in_csv)
}

/// The array of the plant on the wire: as many as MAVLink's DEBUG_FLOAT_ARRAY holds.
pub const ARRAY: [&Column; 58] = array();

/// The columns that have a place in the array, each at its place; a place without a column does not compile.
const fn array<const N: usize>() -> [&'static Column; N] {
    let mut array = [None; N];
    let mut i = 0;
    while i < COLUMNS.len() {
        if let Some(place) = COLUMNS[i].place {
            assert!(array[place].is_none(), "two columns have one place");
            array[place] = Some(&COLUMNS[i]);
        }
        i += 1;
    }
    let mut full = [&COLUMNS[0]; N];
    let mut place = 0;
    while place < N {
        full[place] = array[place].expect("every place has a column");
        place += 1;
    }
    full
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The contract; what is new comes after it.
    const CSV_HEADER: &str = "time_s,north_m,east_m,down_m,vn_m_s,ve_m_s,vd_m_s,qw,qx,qy,qz,\
p_rad_s,q_rad_s,r_rad_s,mass_kg,com_x_m,com_y_m,com_z_m,ixx_kg_m2,iyy_kg_m2,izz_kg_m2,ixy_kg_m2,ixz_kg_m2,iyz_kg_m2,\
nitrous_kg,fuel_kg,nitrogen_bottle_kg,nitrogen_ullage_kg,port_radius_m,throat_radius_m,oxidizer_kg_s,fuel_kg_s,of_ratio,chamber_pa,injector_inlet_pa,\
quality,tank_pa,bottle_pa,valve_deg,valve_area_m2,thrust_command_n,thrust_n,gimbal_x_deg,gimbal_y_deg,rcs_roll,\
slosh_x_m,slosh_y_m,slosh_force_x_n,slosh_force_y_n,wind_n_m_s,wind_e_m_s,wind_d_m_s";

    #[test]
    fn the_csv_table_begins_with_the_columns_agreed_on() {
        let names: Vec<_> = csv().map(|column| column.name).collect();
        assert!(names.join(",").starts_with(CSV_HEADER), "{names:?}");
    }

    #[test]
    fn a_name_stands_once_and_ends_with_its_unit() {
        for (i, Column { name, unit, .. }) in COLUMNS.iter().enumerate() {
            assert!(COLUMNS[..i].iter().all(|above| above.name != *name), "{name} stands there twice");
            let spelled = unit.to_lowercase().replace([' ', '/'], "_").replace('²', "2");
            assert!(unit.is_empty() || name.ends_with(&format!("_{spelled}")), "{name} ({unit})");
        }
    }
}
