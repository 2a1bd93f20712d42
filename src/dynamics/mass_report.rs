//! Dry mass properties as a CAD program prints them: the text report "Mass Properties" of SolidWorks.
//!
//! Read are the mass, the centre of mass and the moments "taken at the center of mass and aligned with the
//! output coordinate system", each in the unit that the report names. The products of inertia are where
//! imports go wrong: under "positive tensor notation", the default, SolidWorks prints `Lxy = +∫ x y dm`,
//! which is the negative of the tensor's element; under "negative tensor notation" the element itself. The
//! report holds what it takes to see that: the moments about its origin differ from those at the centre of
//! mass by the parallel-axis terms, and the principal moments are the tensor's eigenvalues. Both are checked
//! to the digits printed. Source: Steiner's theorem, `Ixy = Lxy + m x y` for products, `Ixx = Lxx + m (y² +
//! z²)`.

use crate::frame::{Mat3, Vec3, point_inertia};

/// What a report says, in SI units and in its own axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MassReport {
    /// Mass (kg).
    pub mass_kg: f64,
    /// Centre of mass from the report's origin (m).
    pub centre_m: Vec3,
    /// Inertia about the centre of mass (kg m²), tensor convention.
    pub inertia_kg_m2: Mat3,
}

/// Why a report cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("line {line}: {message}")]
pub struct MassReportError {
    /// Line of the report, from 1.
    pub line: usize,
    /// What is wrong there, and what is allowed.
    pub message: String,
}

/// A number and half a unit of its last digit.
#[derive(Clone, Copy, Debug, Default)]
struct Printed {
    value: f64,
    half_digit: f64,
}

/// A 3 x 3 table of moments as printed, in SI units.
#[derive(Clone, Copy, Debug)]
struct Moments {
    line: usize,
    per_unit_kg_m2: f64,
    negative_notation: bool,
    value: [[Option<Printed>; 3]; 3],
}

/// The part of the report that a line belongs to.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Section {
    Head,
    Centre,
    Principal,
    AtCentre,
    AtOrigin,
}

const MASS_UNITS: [(&str, f64); 8] = [
    ("gram", 1e-3),
    ("kilogram", 1.0),
    ("milligram", 1e-6),
    ("tonne", 1e3),
    ("pound", 0.453_592_37),
    ("ounce", 0.028_349_523_125),
    ("slug", 14.593_902_937_206_4),
    ("ton", 1e3),
];
const LENGTH_UNITS: [(&str, f64); 6] = [
    ("millimeter", 1e-3),
    ("centimeter", 1e-2),
    ("meter", 1.0),
    ("inch", 0.0254),
    ("foot", 0.3048),
    ("feet", 0.3048),
];
const AXES: [&str; 3] = ["x", "y", "z"];

impl MassReport {
    /// From the text of a report.
    ///
    /// # Errors
    /// When something is missing, in a unit that is not known, or contradicts itself.
    pub fn parse(text: &str) -> Result<Self, MassReportError> {
        let mut found = Found::default();
        let mut section = Section::Head;
        let mut last = 1;
        for (i, line) in text.lines().enumerate() {
            let (number, line) = (i + 1, line.trim());
            last = number;
            section = found.section_after(section, number, line)?;
            found.take(section, number, line)?;
        }
        found.report(last)
    }
}

/// What has been read so far.
#[derive(Debug, Default)]
struct Found {
    mass: Option<(usize, f64, Printed)>,
    centre_line: usize,
    per_length_m: Option<f64>,
    centre: [Option<Printed>; 3],
    principal_per_unit: Option<f64>,
    principal: [Option<Printed>; 3],
    heading: Option<(usize, f64)>,
    at_centre: Option<Moments>,
    at_origin: Option<Moments>,
}

impl Found {
    /// Headings open sections; they carry the units.
    fn section_after(
        &mut self,
        section: Section,
        number: usize,
        line: &str,
    ) -> Result<Section, MassReportError> {
        let lower = line.to_ascii_lowercase();
        if lower.starts_with("center of mass") || lower.starts_with("centre of mass") {
            self.centre_line = number;
            self.per_length_m = Some(length_unit(number, parenthesis(number, line)?)?);
            return Ok(Section::Centre);
        }
        if lower.starts_with("principal axes of inertia") {
            // Older versions name the unit two lines on; without it the principal moments are not checked.
            self.principal_per_unit =
                parenthesis(number, line).ok().map(|unit| moment_unit(number, unit)).transpose()?;
            return Ok(Section::Principal);
        }
        if lower.starts_with("moments of inertia") {
            self.heading = Some((number, moment_unit(number, parenthesis(number, line)?)?));
        }
        let at_centre = lower.contains("taken at the center of mass and aligned");
        if let Some((_, per_unit_kg_m2)) =
            self.heading.filter(|_| at_centre || lower.contains("taken at the output"))
        {
            let negative_notation = lower.contains("negative tensor notation");
            let moments = Moments { line: number, per_unit_kg_m2, negative_notation, value: [[None; 3]; 3] };
            if at_centre {
                self.at_centre = Some(moments);
                return Ok(Section::AtCentre);
            }
            self.at_origin = Some(moments);
            return Ok(Section::AtOrigin);
        }
        Ok(section)
    }

    /// Values of a line.
    fn take(&mut self, section: Section, number: usize, line: &str) -> Result<(), MassReportError> {
        if section == Section::Head && line.to_ascii_lowercase().starts_with("mass =") {
            let (value, rest) = line[6..].trim().split_once(' ').unwrap_or((line[6..].trim(), ""));
            let per_unit = unit(number, rest, &MASS_UNITS)?;
            // A report copied with the mass in two units keeps the first.
            self.mass.get_or_insert((number, per_unit, printed(number, "Mass", value)?));
            return Ok(());
        }
        // "NAME = VALUE" any number of times in a line.
        let parts: Vec<&str> = line.split('=').collect();
        for pair in parts.windows(2) {
            let name = pair[0].split_whitespace().last().unwrap_or("").to_ascii_lowercase();
            let value = pair[1].split_whitespace().next().unwrap_or("");
            let place = |prefix: &str| AXES.iter().position(|axis| name == format!("{prefix}{axis}"));
            let moment = |prefix: char| {
                let rest = name.strip_prefix(prefix)?;
                let axis = |letter: &str| AXES.iter().position(|axis| *axis == letter);
                Some((axis(rest.get(..1)?)?, axis(rest.get(1..)?)?))
            };
            match section {
                Section::Centre => {
                    if let Some(axis) = place("") {
                        self.centre[axis] = Some(printed(number, pair[0].trim(), value)?);
                    }
                }
                Section::Principal => {
                    if let Some(axis) = place("p") {
                        self.principal[axis] = Some(printed(number, "principal moment", value)?);
                    }
                }
                Section::AtCentre | Section::AtOrigin => {
                    let (letter, table) = if section == Section::AtCentre {
                        ('l', &mut self.at_centre)
                    } else {
                        ('i', &mut self.at_origin)
                    };
                    if let (Some((row, column)), Some(table)) = (moment(letter), table) {
                        table.value[row][column] = Some(printed(number, &name, value)?);
                    }
                }
                Section::Head => {}
            }
        }
        Ok(())
    }

    /// Everything there, in SI units, and free of contradictions.
    fn report(&self, last: usize) -> Result<MassReport, MassReportError> {
        let Some((_, per_mass_kg, mass)) = self.mass else {
            return Err(error(
                last,
                "no mass: expected a line \"Mass = NUMBER UNIT\" before the other sections",
            ));
        };
        if mass.value <= 0.0 {
            return Err(error(
                self.mass.map_or(last, |m| m.0),
                format!("mass {}: must be positive", mass.value),
            ));
        }
        let (Some(per_length_m), [Some(x), Some(y), Some(z)]) = (self.per_length_m, self.centre) else {
            let message = "no centre of mass: expected \"Center of mass: ( UNIT )\" and X, Y, Z below it";
            return Err(error(self.centre_line.max(1), message));
        };
        let Some(at_centre) = &self.at_centre else {
            let message = "no moments of inertia \
                           \"Taken at the center of mass and aligned with the output coordinate system.\"";
            return Err(error(last, message));
        };
        let mass_kg = per_mass_kg * mass.value;
        let centre_m = Vec3::new(x.value, y.value, z.value) * per_length_m;
        let inertia_kg_m2 = at_centre.tensor("L")?;
        let own_digits = 3.0 * at_centre.half_digit();
        self.agrees_with_principal(at_centre, inertia_kg_m2, own_digits)?;
        if let Some(at_origin) = &self.at_origin {
            if at_origin.negative_notation != at_centre.negative_notation {
                return Err(error(
                    at_origin.line,
                    "the two tables of moments are in different tensor notations",
                ));
            }
            let moved = inertia_kg_m2 + point_inertia(centre_m) * mass_kg;
            // Half a digit of each factor, carried to the product; twice for the diagonal's two squares.
            let reach_m = centre_m.abs().max();
            let of_centre = 2.0
                * 2.0
                * mass_kg
                * reach_m
                * per_length_m
                * x.half_digit.max(y.half_digit).max(z.half_digit);
            let of_mass = 2.0 * reach_m * reach_m * per_mass_kg * mass.half_digit;
            let digits = at_origin.half_digit() + at_centre.half_digit() + of_centre + of_mass;
            let printed = at_origin.tensor("I")?;
            for (row, column) in [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)] {
                let (is, must) = (printed[(row, column)], moved[(row, column)]);
                if (is - must).abs() > 1.01 * digits + 1e-9 * moved.trace() {
                    let element = format!("{}{}", AXES[row], AXES[column]);
                    let products = if row == column { "" } else { "; is the tensor notation right?" };
                    let message = format!(
                        "I{element} at the output coordinate system contradicts mass, centre of mass and L{element}: \
                         as tensor elements {is:.6e} kg m2 against {must:.6e}{products}"
                    );
                    return Err(error(at_origin.line, message));
                }
            }
        }
        Ok(MassReport { mass_kg, centre_m, inertia_kg_m2 })
    }

    /// The principal moments are the eigenvalues.
    fn agrees_with_principal(
        &self,
        moments: &Moments,
        tensor: Mat3,
        digits: f64,
    ) -> Result<(), MassReportError> {
        let (Some(per_unit), [Some(a), Some(b), Some(c)]) = (self.principal_per_unit, self.principal) else {
            return Ok(());
        };
        let sorted = |mut v: [f64; 3]| {
            v.sort_by(f64::total_cmp);
            v
        };
        let is = sorted([a, b, c].map(|p| per_unit * p.value));
        let must = sorted(tensor.symmetric_eigenvalues().into());
        let digits = digits + per_unit * a.half_digit.max(b.half_digit).max(c.half_digit);
        for (is, must) in is.iter().zip(must) {
            if (is - must).abs() > 1.01 * digits + 1e-9 * tensor.trace() {
                let message = format!(
                    "the principal moments contradict these moments: {is:.6e} kg m2 against {must:.6e}; \
                     is the tensor notation right, and are all digits there?"
                );
                return Err(error(moments.line, message));
            }
        }
        Ok(())
    }
}

impl Moments {
    /// The tensor (kg m²), from elements or products; `letter` is that of the names.
    fn tensor(&self, letter: &str) -> Result<Mat3, MassReportError> {
        let mut tensor = Mat3::zeros();
        for row in 0..3 {
            for column in 0..3 {
                let name = format!("{letter}{}{}", AXES[row], AXES[column]);
                let Some(printed) = self.value[row][column] else {
                    return Err(error(
                        self.line,
                        format!("{name} is missing below; expected {letter}xx to {letter}zz"),
                    ));
                };
                let other = self.value[column][row].unwrap_or(printed);
                if (printed.value - other.value).abs() > 2.02 * printed.half_digit.max(other.half_digit) {
                    let message =
                        format!("{name}: {} against {} of its mirror image", printed.value, other.value);
                    return Err(error(self.line, message));
                }
                let sign = if row == column || self.negative_notation { 1.0 } else { -1.0 };
                // Equal on both sides of the diagonal, whatever the last digits.
                tensor[(row, column)] = sign * self.per_unit_kg_m2 * 0.5 * (printed.value + other.value);
            }
        }
        Ok(tensor)
    }

    /// Half of the coarsest last digit (kg m²).
    fn half_digit(&self) -> f64 {
        let digits = self.value.iter().flatten().flatten().map(|p| p.half_digit);
        self.per_unit_kg_m2 * digits.fold(0.0, f64::max)
    }
}

fn error(line: usize, message: impl Into<String>) -> MassReportError {
    MassReportError { line, message: message.into() }
}

/// What stands between the parentheses of a heading.
fn parenthesis(number: usize, line: &str) -> Result<&str, MassReportError> {
    let inside = line.split_once('(').and_then(|(_, rest)| rest.split_once(')'));
    inside.map(|(inside, _)| inside.trim()).ok_or_else(|| error(number, "no unit in parentheses"))
}

fn unit(number: usize, text: &str, known: &[(&str, f64)]) -> Result<f64, MassReportError> {
    let word = text.trim().to_ascii_lowercase().replace("metre", "meter");
    let singular = word
        .strip_suffix("es")
        .filter(|w| w.ends_with("ch"))
        .or_else(|| word.strip_suffix('s'))
        .unwrap_or(&word);
    known.iter().find(|(name, _)| *name == singular).map(|(_, si)| *si).ok_or_else(|| {
        let names: Vec<&str> = known.iter().map(|(name, _)| *name).collect();
        error(
            number,
            format!(
                "unit \"{}\" is not known; allowed (also in the plural): {}",
                text.trim(),
                names.join(", ")
            ),
        )
    })
}

fn length_unit(number: usize, text: &str) -> Result<f64, MassReportError> {
    unit(number, text, &LENGTH_UNITS)
}

/// "grams * square millimeters", in kg m².
fn moment_unit(number: usize, text: &str) -> Result<f64, MassReportError> {
    let expected =
        || error(number, format!("unit \"{text}\" is not known; expected \"MASS * square LENGTH\""));
    let (mass, area) = text.split_once('*').ok_or_else(expected)?;
    let length = area.trim().strip_prefix("square").ok_or_else(expected)?;
    let length_m = length_unit(number, length)?;
    Ok(unit(number, mass, &MASS_UNITS)? * length_m * length_m)
}

fn printed(number: usize, name: &str, text: &str) -> Result<Printed, MassReportError> {
    let value: f64 = text.parse().ok().filter(|v: &f64| v.is_finite()).ok_or_else(|| {
        error(number, format!("{name}: \"{text}\" is not a number; a decimal point is expected, not a comma"))
    })?;
    let mantissa = text.split(['e', 'E']).next().unwrap_or(text);
    let decimals = mantissa.split_once('.').map_or(0, |(_, d)| d.len()) as i32;
    let exponent: i32 = text.split(['e', 'E']).nth(1).and_then(|e| e.parse().ok()).unwrap_or(0);
    let half_digit = 0.5 * libm::pow(10.0, f64::from(exponent - decimals));
    Ok(Printed { value, half_digit })
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAME: &str = include_str!("../../tests/data/frame_mass_properties.txt");

    /// Two point-like parts and a box, worked by hand in tests/data: the frame's example.
    #[test]
    fn the_example_is_read_in_si_with_the_tensor_sign() {
        let report = MassReport::parse(FRAME).unwrap();
        assert!((report.mass_kg - 15.66).abs() < 1e-12);
        assert!((report.centre_m - Vec3::new(0.02, 0.01, 0.24)).norm() < 1e-12, "{report:?}");
        // The report prints Lxy = -350 000 000 g mm2 in positive notation: the tensor's element is +0.35.
        let expected = Mat3::new(6.65, 0.35, -0.02, 0.35, 6.65, -0.02, -0.02, -0.02, 2.30);
        assert!((report.inertia_kg_m2 - expected).abs().max() < 1e-12, "{report:?}");
    }

    /// A body of four known points, printed in every unit system and both notations, comes back the same.
    #[test]
    fn every_unit_and_both_notations_give_the_same_body() {
        let points = [
            (1.2, Vec3::new(0.1, 0.2, -0.3)),
            (0.7, Vec3::new(-0.4, 0.15, 0.25)),
            (2.0, Vec3::new(0.05, -0.35, 0.6)),
            (0.4, Vec3::new(0.5, 0.5, 0.1)),
        ];
        let mass: f64 = points.iter().map(|p| p.0).sum();
        let centre = points.iter().fold(Vec3::zeros(), |sum, (m, r)| sum + r * *m) / mass;
        let about = |origin: Vec3| {
            points.iter().fold(Mat3::zeros(), |sum, (m, r)| sum + point_inertia(r - origin) * *m)
        };
        let (own, moved) = (about(centre), about(Vec3::zeros()));
        for (mass_name, per_kg) in [("grams", 1e3), ("kilograms", 1.0), ("pounds", 1.0 / 0.453_592_37)] {
            for (length_name, per_m) in [("millimeters", 1e3), ("meters", 1.0), ("inches", 1.0 / 0.0254)] {
                for negative in [false, true] {
                    let sign = if negative { 1.0 } else { -1.0 };
                    let rows = |letter: char, i: Mat3| {
                        let element = |r: usize, c: usize| {
                            i[(r, c)] * if r == c { 1.0 } else { sign } * per_kg * per_m * per_m
                        };
                        (0..3).fold(String::new(), |text, r| {
                            let row = (0..3)
                                .map(|c| format!("\t{letter}{}{} = {:.9}", AXES[r], AXES[c], element(r, c)));
                            text + &row.collect::<String>() + "\n"
                        })
                    };
                    let notation = if negative {
                        " (Using negative tensor notation.)"
                    } else {
                        " (Using positive tensor notation.)"
                    };
                    let text = format!(
                        "Mass properties of part\n\nMass = {:.9} {mass_name}\n\n\
                         Center of mass: ( {length_name} )\n\tX = {:.9}\n\tY = {:.9}\n\tZ = {:.9}\n\n\
                         Moments of inertia: ( {mass_name} *  square {length_name} )\n\
                         Taken at the center of mass and aligned with the output coordinate system.{notation}\n{}\n\
                         Moments of inertia: ( {mass_name} *  square {length_name} )\n\
                         Taken at the output coordinate system.{notation}\n{}",
                        mass * per_kg,
                        centre.x * per_m,
                        centre.y * per_m,
                        centre.z * per_m,
                        rows('L', own),
                        rows('I', moved)
                    );
                    let report = MassReport::parse(&text).unwrap();
                    // Nine decimals, in kg m2 or finer.
                    assert!((report.mass_kg - mass).abs() < 1e-9 && (report.centre_m - centre).norm() < 1e-9);
                    assert!(
                        (report.inertia_kg_m2 - own).abs().max() < 2e-9,
                        "{mass_name} {length_name} {negative}"
                    );

                    // The other notation on the same numbers is found out by the parallel-axis terms.
                    let wrong = if negative {
                        text.replace("negative", "positive")
                    } else {
                        text.replace("positive", "negative")
                    };
                    let error = MassReport::parse(&wrong).unwrap_err().to_string();
                    assert!(error.contains("tensor notation"), "{error}");
                }
            }
        }
    }

    /// Without the line about notation, as older versions print it, products are positive.
    #[test]
    fn without_a_notation_the_products_are_positive() {
        let old = FRAME.replace(" (Using positive tensor notation.)", "");
        assert_eq!(MassReport::parse(&old), MassReport::parse(FRAME));
    }

    #[test]
    fn messages_name_the_line_and_what_is_allowed() {
        let refused =
            |from: &str, to: &str| MassReport::parse(&FRAME.replace(from, to)).unwrap_err().to_string();
        let stones = refused("15660.000000 grams", "2.466 stones");
        assert!(
            stones.starts_with("line 6: unit \"stones\" is not known; allowed") && stones.contains("pound"),
            "{stones}"
        );
        assert!(
            refused("X = 20.000000", "X = 20,000000").contains("line 13: X: \"20,000000\" is not a number")
        );
        assert!(refused("Lzz", "Lzq").contains("Lzz is missing"));
        assert!(refused("Mass = ", "Masse = ").contains("no mass"));
        assert!(refused("Center of mass: (", "Centroid: (").contains("no centre of mass"));
        assert!(
            refused("grams *  square millimeters", "grams * millimeters").contains("MASS * square LENGTH")
        );
        assert!(refused("Px = 22", "Px = 29").contains("principal moments contradict"));
        assert!(MassReport::parse("").unwrap_err().to_string().contains("no mass"));
    }
}
