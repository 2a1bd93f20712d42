//! Numeric tables as text: comma-separated values, `#` comments, one line of column names.

/// What is wrong with a table. Lines count from 1, comments included.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TableError {
    /// A column that is needed has no name in the heading.
    #[error("column `{column}` is missing; the heading (line {line}) names: {found}")]
    MissingColumn {
        /// Name of the column.
        column: String,
        /// Line of the heading.
        line: usize,
        /// Names that are there.
        found: String,
    },
    /// A row too short to have the column.
    #[error("line {line}: expected {expected} fields, got {found}")]
    FieldCount {
        /// Line.
        line: usize,
        /// Fields of the heading.
        expected: usize,
        /// Fields of the row.
        found: usize,
    },
    /// A field that is not a finite number.
    #[error("line {line}, column `{column}`: `{text}` is not a finite number")]
    NotANumber {
        /// Line.
        line: usize,
        /// Name of the column.
        column: String,
        /// The field.
        text: String,
    },
    /// A value outside what the use of the column allows.
    #[error("line {line}, column `{column}`: {value} {rule}")]
    BadValue {
        /// Line.
        line: usize,
        /// Name of the column.
        column: String,
        /// The value.
        value: f64,
        /// The rule it breaks, as a clause: "must exceed the row above".
        rule: &'static str,
    },
    /// Too few rows to interpolate.
    #[error("expected at least {expected} rows, got {found}")]
    TooShort {
        /// Rows needed.
        expected: usize,
        /// Rows there.
        found: usize,
    },
}

/// Line number of the heading of a text, and the names there; `None` without one.
pub fn heading(text: &str) -> Option<(usize, Vec<&str>)> {
    let (line, heading) = content(text).next()?;
    Some((line, heading.split(',').map(str::trim).collect()))
}

/// Lines that are neither empty nor comments, with their numbers.
fn content(text: &str) -> impl Iterator<Item = (usize, &str)> {
    // Spreadsheets begin their UTF-8 with a byte order mark.
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let lines = text.lines().enumerate().map(|(i, line)| (i + 1, line.trim()));
    lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'))
}

/// Rows of the columns asked for, each with the line it stood on.
#[derive(Clone, Debug, PartialEq)]
pub struct Table<const N: usize> {
    /// Names of the columns, in the order of the fields of a row.
    pub columns: [&'static str; N],
    /// Line number and values.
    pub rows: Vec<(usize, [f64; N])>,
}

impl<const N: usize> Table<N> {
    /// Reads the named columns of a text with at least two rows.
    pub fn read(text: &str, columns: [&'static str; N]) -> Result<Self, TableError> {
        let Some((heading_line, names)) = heading(text) else {
            return Err(TableError::TooShort { expected: 2, found: 0 });
        };
        let mut positions = [0; N];
        for (position, column) in positions.iter_mut().zip(columns) {
            *position =
                names.iter().position(|name| *name == column).ok_or_else(|| TableError::MissingColumn {
                    column: column.into(),
                    line: heading_line,
                    found: names.join(", "),
                })?;
        }
        let mut rows = Vec::new();
        for (line, text) in content(text).skip(1) {
            let fields: Vec<&str> = text.split(',').map(str::trim).collect();
            if fields.len() != names.len() {
                return Err(TableError::FieldCount { line, expected: names.len(), found: fields.len() });
            }
            let mut row = [0.0; N];
            for (k, value) in row.iter_mut().enumerate() {
                let text = fields[positions[k]];
                *value = text.parse().ok().filter(|v: &f64| v.is_finite()).ok_or_else(|| {
                    TableError::NotANumber { line, column: columns[k].into(), text: text.into() }
                })?;
            }
            rows.push((line, row));
        }
        if rows.len() < 2 {
            return Err(TableError::TooShort { expected: 2, found: rows.len() });
        }
        Ok(Self { columns, rows })
    }

    /// Requires a column to rise strictly from row to row.
    pub(crate) fn require_increasing(&self, column: usize) -> Result<(), TableError> {
        let falls = self.rows.windows(2).find(|pair| pair[1].1[column] <= pair[0].1[column]);
        match falls {
            None => Ok(()),
            Some(pair) => Err(self.bad_value(pair[1], column, "must exceed the row above")),
        }
    }

    /// Requires every value of a column to satisfy a rule, stated as a clause.
    pub(crate) fn require(
        &self,
        column: usize,
        rule: &'static str,
        holds: impl Fn(f64) -> bool,
    ) -> Result<(), TableError> {
        match self.rows.iter().find(|(_, row)| !holds(row[column])) {
            None => Ok(()),
            Some(row) => Err(self.bad_value(*row, column, rule)),
        }
    }

    /// A row whose value in a column breaks a rule, stated as a clause.
    pub(crate) fn bad_value(
        &self,
        (line, row): (usize, [f64; N]),
        column: usize,
        rule: &'static str,
    ) -> TableError {
        TableError::BadValue { line, column: self.columns[column].into(), value: row[column], rule }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "# about\na, b,c\n1,2,3\n\n4,5,6\n";

    #[test]
    fn columns_are_found_by_name_and_lines_are_kept() {
        let table = Table::read(TEXT, ["c", "a"]).unwrap();
        assert_eq!(table.rows, vec![(3, [3.0, 1.0]), (5, [6.0, 4.0])]);
        assert_eq!(table.require_increasing(0), Ok(()));
    }

    #[test]
    fn errors_name_line_and_column() {
        let message = |text: &str| Table::read(text, ["a", "b"]).unwrap_err().to_string();
        assert_eq!(message("a,x\n1,2\n"), "column `b` is missing; the heading (line 1) names: a, x");
        assert_eq!(message("a,b\n1,2\n3\n"), "line 3: expected 2 fields, got 1");
        assert_eq!(message("a,b\n1,nan\n3,4\n"), "line 2, column `b`: `nan` is not a finite number");
        assert_eq!(message("a,b\n1,2\n"), "expected at least 2 rows, got 1");
        let falling = Table::read("a,b\n2,0\n1,0\n", ["a", "b"]).unwrap();
        assert_eq!(
            falling.require_increasing(0).unwrap_err().to_string(),
            "line 3, column `a`: 1 must exceed the row above"
        );
    }
}
