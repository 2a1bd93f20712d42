//! Invariant: a solve of predictive control asks the allocator for nothing, however it ends.

use crate::fixture::gusts;
use allocation_counter::measure;
use hopbench::autopilot::mpc::{Settings, Solution, Status, Workspace, interior_point, oracle};

#[test]
fn no_solve_allocates() {
    let mut programs = gusts::sequence(30);
    programs[0].initial_state[0] = f64::NAN;
    let (mut workspace, mut solution) = (Workspace::default(), Solution::default());
    let mut ended = [0; 3];
    for (number, problem) in programs.iter().enumerate() {
        // Every other one is cut short.
        let settings = Settings { iterations: if number % 2 == 0 { 15 } else { 3 }, ..Settings::default() };
        let counted = measure(|| {
            interior_point::solve(problem, &settings, &mut workspace, &mut solution);
        });
        assert_eq!(counted.count_total, 0, "program {number}, {:?}", solution.status);
        ended[solution.status as usize] += 1;
    }
    let [solved, cut, failed] = ended;
    assert!(solved > 100 && cut > 100 && failed == 1, "{ended:?}");
    assert_eq!(Status::NumericalFailure as usize, 2);
}

#[test]
fn the_counter_counts_the_oracle() {
    let problem = gusts::at_hover(20, &gusts::hover());
    let counted = measure(|| {
        std::hint::black_box(oracle::solve(&problem, 1e-6));
    });
    assert!(counted.count_total > 100);
}
