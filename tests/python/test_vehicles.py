"""Vehicle files from the command line: throttle map, valve maps of the user's own, dry parts from a CAD report."""

import csv
import json
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
from hopbench_bench import run_hopbench

ROOT = Path(__file__).parents[2]
VEHICLES = ROOT / "scenarios" / "vehicles"


@pytest.mark.parametrize("vehicle", ["reference", "gt_lander"])
def test_sweep_leaves_table_and_picture_and_marks_its_limits(vehicle, tmp_path):
    result = run_hopbench("engine", VEHICLES / f"{vehicle}.toml", "--sweep", "--json", "--out", tmp_path)
    assert result.code == 0, result.stderr
    sweep = json.loads(result.stdout)
    assert json.loads((tmp_path / "sweep.json").read_text()) == sweep
    points = sweep["points"]
    agreed = "valve_deg valve_area_m2 oxidizer_kg_s fuel_kg_s of_ratio chamber_pa injector_inlet_pa quality thrust_n isp_s saturated"
    assert set(agreed.split()) <= set(points[0])

    rows = list(csv.DictReader((tmp_path / "sweep.csv").open()))
    assert len(rows) == len(points) and float(rows[40]["thrust_n"]) == points[40]["thrust_n"]

    # Nothing is extrapolated: beyond the clamp every demand gives the point at the clamp, before it the demand.
    assert sweep["limited_by"] == "oxidizer_flow"
    beyond = [point for point in points if point["saturated"]]
    assert beyond and all(point["oxidizer_kg_s"] == pytest.approx(0.560, abs=1e-8) for point in beyond)
    assert all(point["thrust_command_n"] > sweep["thrust_greatest_n"] - 1e-3 for point in beyond)
    assert all(abs(point["thrust_n"] - point["thrust_command_n"]) < 1e-3 for point in points if not point["saturated"])
    assert all(point["below_minimum_command"] == (point["thrust_command_n"] < 300.0) for point in points)

    # The picture is well-formed and says what it shows, with units.
    picture = ElementTree.parse(tmp_path / "throttle_map.svg").getroot()
    words = " ".join("".join(text.itertext()) for text in picture.iter("{http://www.w3.org/2000/svg}text"))
    for label in ["thrust (N)", "valve angle (deg)", "Pc (bar)", "P2 (bar)", "O/F", "throttle (% of rated thrust)", "0.560 kg/s", vehicle]:
        assert label in words, label


def test_a_mixture_ratio_outside_the_map_is_marked(tmp_path):
    folder = copy_of_vehicles(tmp_path)
    rows = (folder / "cea_reference_fit.csv").read_text().splitlines()
    kept = [row for row in rows if not row[:1].isdigit() or float(row.split(",")[0]) >= 3.0]
    (folder / "cea_reference_fit.csv").write_text("\n".join(kept) + "\n")
    result = run_hopbench("engine", folder / "reference.toml", "--sweep", "--json")
    points = json.loads(result.stdout)["points"]
    assert {point["of_clamped"] for point in points} == {True, False}
    assert all(point["of_clamped"] == (point["of_ratio"] < 3.0) for point in points)


def test_without_fuel_there_is_no_mixture_ratio(tmp_path):
    sweep = ["engine", VEHICLES / "reference.toml", "--sweep", "--port-radius-mm", "68"]
    result = run_hopbench(*sweep, "--json", "--out", tmp_path)
    assert result.code == 0, result.stderr
    points = json.loads(result.stdout)["points"]
    assert all(point["fuel_kg_s"] == 0 and point["of_ratio"] is None and point["of_clamped"] for point in points)
    assert {row["of_ratio"] for row in csv.DictReader((tmp_path / "sweep.csv").open())} == {""}
    assert "no fuel is left" in (tmp_path / "throttle_map.svg").read_text()
    lines = run_hopbench(*sweep).stdout.splitlines()
    assert sum("no fuel left" in line and " inf " in line for line in lines) == len(points)
    one = run_hopbench("engine", VEHICLES / "reference.toml", "--thrust-n", "700", "--port-radius-mm", "68", "--json")
    assert one.json["of_ratio"] is None


def test_a_valve_map_of_a_spreadsheet_is_read_and_one_wider_than_its_seat_is_not(tmp_path):
    folder = copy_of_vehicles(tmp_path)
    check = ["check", folder / "reference.toml", "--set", 'vehicle.feed.valve.area_file="mine.csv"']
    rows = "percent_open,area_mm2\n" + "".join(f"{10 * i},{0.8 * i * i}\n" for i in range(11))
    (folder / "mine.csv").write_text("\ufeff" + rows, encoding="utf-8")
    result = run_hopbench(*check)
    assert result.code == 0, result.stderr
    # Rows of a parabola: the worst is right to round-off, which has no sign.
    assert "-0.000" not in result.stdout and "+0.000 deg from there" in result.stdout
    (folder / "mine.csv").write_text("percent_open,cv\n0,0\n50,5\n100,1e6\n")
    wrong = run_hopbench(*check)
    assert wrong.code == 2 and "feed.valve.seat_radius_m" in wrong.stderr and "126.6769 mm2" in wrong.stderr


def copy_of_vehicles(tmp_path):
    folder = tmp_path / "vehicles"
    folder.mkdir()
    for file in VEHICLES.iterdir():
        (folder / file.name).write_text(file.read_text())
    return folder


def test_check_prints_how_good_a_valve_map_is(tmp_path):
    folder = copy_of_vehicles(tmp_path)
    by_cv = ["--set", 'vehicle.feed.valve.area_file="gt_vport_cv.csv"']
    result = run_hopbench("check", folder / "gt_lander.toml", *by_cv)
    assert result.code == 0, result.stderr
    assert "10 rows of Cv" in result.stdout and "angle to area to angle within" in result.stdout and "worst row" in result.stdout
    report = json.loads(run_hopbench("check", folder / "gt_lander.toml", *by_cv, "--json").stdout)
    # Newton inside a segment ends at 1e-15 of it; the curve's slope costs two or three digits.
    assert report["valve_map"]["round_trip_deg"] < 1e-9 and report["valve_map"]["worst_row"]["angle_deg"] == pytest.approx(36.0)


def test_a_component_may_name_a_cad_report(tmp_path):
    folder = copy_of_vehicles(tmp_path)
    vehicle = folder / "gt_lander.toml"
    numbers = 'mass_kg = 15.66\nposition_m = [0.02, 0.01, 0.24]\ninertia_kg_m2 = [[6.65, 0.35, -0.02], [0.35, 6.65, -0.02], [-0.02, -0.02, 2.30]]'
    assert numbers in vehicle.read_text()
    vehicle.write_text(vehicle.read_text().replace(numbers, 'file = "frame.txt"'))
    report = (ROOT / "tests" / "data" / "frame_mass_properties.txt").read_text()
    (folder / "frame.txt").write_text(report)
    assert run_hopbench("check", vehicle).code == 0

    (folder / "frame.txt").write_text(report.replace("positive tensor", "negative tensor"))
    wrong = run_hopbench("check", vehicle)
    assert wrong.code == 2 and "frame.txt:24:" in wrong.stderr and "tensor notation" in wrong.stderr
    (folder / "frame.txt").write_text(report.replace("15660.000000 grams", "15.66 stones"))
    wrong = run_hopbench("check", vehicle)
    assert wrong.code == 2 and "frame.txt:6:" in wrong.stderr and "kilogram" in wrong.stderr
    (folder / "frame.txt").unlink()
    wrong = run_hopbench("check", vehicle)
    assert wrong.code == 2 and "frame.txt" in wrong.stderr


def test_a_scenario_may_replace_values_of_its_vehicle(tmp_path):
    result = run_hopbench("check", ROOT / "scenarios" / "static_fire_50.toml")
    assert result.code == 0, result.stderr
    for folder in ["scenarios", "scenarios/vehicles"]:
        (tmp_path / folder).mkdir()
        for file in (ROOT / folder).glob("*.*"):
            (tmp_path / folder / file.name).write_text(file.read_text())
    scenario = tmp_path / "scenarios" / "static_fire_50.toml"
    scenario.write_text(scenario.read_text().replace('"feed.tank.radius_m" = 0.050', '"feed.tank.radius_m" = 50.0'))
    wrong = run_hopbench("check", scenario)
    assert wrong.code == 2 and "feed.tank.radius_m: 50 is out of range" in wrong.stderr and "static_fire_50.toml" in wrong.stderr
