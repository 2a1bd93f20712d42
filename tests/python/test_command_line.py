"""The bench as a program: exit codes, ready file, overrides, and the run with nothing attached."""

import os
import subprocess
import sys
import time

import pytest
from hopbench_bench import ROOT, Bench, run_hopbench, scenario_path


def test_nothing_attached_flies_in_real_time():
    started = time.monotonic()
    with Bench("hover_5m", fc=None) as bench:
        result = bench.result(timeout_s=60.0)
    assert time.monotonic() - started < 35.0
    assert result.code == 0, result.stdout
    report = result.json
    assert report["outcome"] == "landed" and report["expect"]["passed"]
    assert [part["source"] for part in report["flown_by"]] == ["autopilot"]
    assert report["timing"]["realtime_factor"] == pytest.approx(1.0, abs=0.1)
    assert report["timing"]["overruns"] >= 0 and report["timing"]["lateness_us"]["p50"] is not None
    assert report["link"]["received"] > 1000  # it flew over a real link


def test_report_has_the_agreed_keys():
    with Bench("hover_5m", fc="udp", lockstep=True, fast=True, sets={"arm_wait_s": 1}, seed=42) as bench:
        for sensor in bench.sensors():
            bench.send_controls([0.0] * 4, armed=False, time_usec=sensor.time_usec)
        result = bench.result()
    report = result.json
    agreed = "scenario seed outcome flown_by expect touchdown max_altitude_m hover autopilot propellant mass timing link events state_hash run overrides"
    assert set(report) == set(agreed.split()) | {"modified", "modified_count"}
    assert (report["modified"], report["modified_count"]) == ([], 0)
    assert report["seed"] == 42 and report["touchdown"] is None
    # The contract's keys; the certificate's come on top.
    assert set(report["link"]) >= set("sent dropped received crc_errors lost skipped_bytes refused stalls wire_load_percent".split())
    assert set(report["link"]) >= set("duplicates out_of_order gaps longest_gap_ms controls_refused controls_old".split())
    timing = "simulated_s wall_s realtime_factor steps overruns step_us lateness_us round_trip_us"
    assert set(report["timing"]) >= set(timing.split())
    assert set(report["timing"]) >= set("plant_mode pacing step_budget_us cycle_us echo_us slips slipped_s unaccounted_us".split())
    assert all(set(item) == {"name", "value", "limit", "passed"} for item in report["expect"]["items"])
    assert all(set(event) == {"time_s", "name", "detail"} for event in report["events"])


@pytest.mark.parametrize("fc", ["udp-listen", "tcp-listen"])
def test_ready_file_names_the_port_in_use(fc):
    with Bench("hover_5m", fc=fc) as bench:
        kind, host, port = bench.ready["fc"].rsplit(":", 2)
        assert (kind, host) == (fc, "127.0.0.1") and int(port) > 0


def test_two_benches_run_side_by_side():
    with Bench("hover_5m", fc="tcp-listen") as one, Bench("hover_5m", fc="tcp-listen") as other:
        assert one.ready["fc"] != other.ready["fc"]
        assert one.recv_sensor().time_usec == other.recv_sensor().time_usec == 4000


@pytest.mark.parametrize(
    "arguments, named",
    [
        (["hil", "scenarios/no_such_file.toml"], "no_such_file.toml"),
        (["hil", scenario_path("hover_5m"), "--set", "missionn.altitude=3"], "missionn.altitude"),
        (["hil", scenario_path("hover_5m"), "--set", "vehicle.engine.grain.lenght_m=0.24"], "vehicle.engine.grain.lenght_m"),
        (["hil", scenario_path("hover_5m"), "--set", "vehicle.engine.grain.length_m=-1"], "length_m"),
        (["hil", scenario_path("hover_5m"), "--set", "timeout_s=never"], "timeout_s"),
        (["hil", scenario_path("hover_5m"), "--profile", "no-such"], "no-such"),
        (["hil", scenario_path("hover_5m"), "--fc", "carrier-pigeon:1"], "carrier-pigeon"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_wrong_input_is_exit_2_and_named(arguments, named):
    result = run_hopbench(*arguments, "--json")
    assert result.code == 2
    assert named in result.stderr and "panicked" not in result.stderr
    assert result.stdout == ""


def test_a_device_that_is_not_there_is_exit_3():
    result = run_hopbench("hil", scenario_path("hover_5m"), "--fc", "serial:/dev/no-such-tty:921600", "--igniter-disconnected", "--json")
    assert result.code == 3 and "/dev/no-such-tty" in result.stderr


def test_a_port_in_use_is_exit_3():
    with Bench("hover_5m", fc="tcp-listen") as bench:
        result = run_hopbench("hil", scenario_path("hover_5m"), "--fc", bench.ready["fc"], "--json")
    assert result.code == 3 and bench.ready["fc"].rsplit(":", 1)[1] in result.stderr


def test_waiting_for_a_controller_is_said_every_second():
    with Bench("hover_5m", fc="serial", profile="px4-hitl") as bench:
        time.sleep(3.5)  # the one place where silence itself is awaited
        lines = [line for line in bench.stderr().splitlines() if "waiting for FC" in line]
    assert 2 <= len(lines) <= 5 and "0 bytes" in lines[0]


def test_a_serial_line_too_slow_is_refused():
    with Bench("hover_5m", fc="serial", profile="px4-hitl") as bench:
        path = bench.connection.address
        bench.process.terminate()
        bench.process.wait()
        result = run_hopbench("hil", scenario_path("hover_5m"), "--fc", f"serial:{path}:115200", "--profile", "px4-hitl",
                              "--igniter-disconnected", "--json")
    assert result.code == 2 and "--sensor-hz" in result.stderr


def test_a_real_board_needs_the_word_that_its_igniter_is_disconnected():
    # Refused before the port is opened: there is none.
    result = run_hopbench("hil", scenario_path("hover_5m"), "--fc", "serial:/dev/no-such-tty:921600", "--json")
    assert result.code == 2 and "--igniter-disconnected" in result.stderr
    # A board may hang at a serial port whatever its profile.
    for profile in ("generic", "px4-sitl"):
        result = run_hopbench("hil", scenario_path("hover_5m"), "--fc", "serial:/dev/no-such-tty:921600", "--profile", profile, "--json")
        assert result.code == 2 and "--igniter-disconnected" in result.stderr, profile
    result = run_hopbench("hil", scenario_path("hover_5m"), "--fc", "udp-listen:0", "--profile", "px4-hitl", "--json")
    assert result.code == 2 and "--igniter-disconnected" in result.stderr


@pytest.mark.parametrize(
    "scenario, change, named",
    [
        ("static_fire_50", "initial.nitrous_kg=5", "initial.nitrous_kg: 5 is out of range; the tank holds"),
        ("static_fire_50", "initial.port_radius_m=0.2", "initial.port_radius_m: 0.2 is out of range"),
        ("hop_50m", "vehicle.vehicle.thrust_command_max_n=5000", "thrust_command_max_n"),
        ("hop_50m", "sensors.enabled=false", "needs a command schedule"),
        ("open_loop_a", "disturbance=[{name='a', thrust_bias=0.1, duration_s=0}]", "disturbance.0.duration_s"),
        ("open_loop_a", "disturbance=[{name='a', thrust_bias=0.1}, {name='a', thrust_bias=0.1}]", "disturbance.1.name"),
    ],
)
def test_check_refuses_what_fly_refuses(scenario, change, named):
    checked = run_hopbench("check", scenario_path(scenario), "--set", change)
    flown = run_hopbench("fly", scenario_path(scenario), "--set", change)
    assert checked.code == flown.code == 2
    assert checked.stderr == flown.stderr and named in checked.stderr


@pytest.mark.parametrize("name", sorted(path.stem for path in (ROOT / "scenarios").glob("*.toml")))
def test_check_passes_every_scenario(name):
    result = run_hopbench("check", scenario_path(name))
    assert result.code == 0, result.stderr


@pytest.mark.parametrize(
    "key, said",
    [
        ("expect.outcome", ['"landed", "tipped", "crashed"', '"tipped": Fell over on the ground.']),
        ("physics.freeze", ['"com", "inertia", "port"', '"throat": The throat does not wear.']),
        ("fidelity", ['"full", "paper"', "slosh.second_mode", "physics.integrator are refused"]),
        ("initial.place", ['"pad", "free"']),
    ],
)
def test_explain_lists_the_choices_and_what_they_mean(key, said):
    result = run_hopbench("check", scenario_path("open_loop_a"), "--explain", key)
    assert result.code == 0, result.stderr
    for words in said:
        assert words in result.stdout, result.stdout


@pytest.mark.parametrize(
    "line, named",
    [
        ('"feed.tank.lenght_m" = 0.3', ['unknown key', 'flight.toml:4 vehicle_set."feed.tank.lenght_m"']),
        ('"feed.tank.length_m.x" = 0.3', ['flight.toml:4: vehicle_set."feed.tank.length_m.x"']),
        ("feed.tank.length_m = 0.3", ["flight.toml:4: vehicle_set.feed: quote the dotted key", '"feed.tank.length_m" = 0.3']),
    ],
)
def test_a_wrong_vehicle_set_names_its_line(line, named, tmp_path):
    scenario = tmp_path / "flight.toml"
    vehicle = ROOT / "scenarios" / "vehicles" / "reference.toml"
    scenario.write_text(f'vehicle = "{vehicle}"\n[vehicle_set]\n"feed.tank.radius_m" = 0.08\n{line}\n')
    result = run_hopbench("check", scenario)
    assert result.code == 2
    for words in named:
        assert words in result.stderr, result.stderr


def test_the_mission_script_says_what_it_needs(tmp_path):
    (tmp_path / "pymavlink.py").write_text("raise ImportError('No module named pymavlink')\n")
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    script = ROOT / "tools" / "px4_mission.py"
    done = subprocess.run([sys.executable, script, "--help"], env=environment, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2 and "pip install pymavlink" in done.stderr and "Traceback" not in done.stderr


@pytest.mark.parametrize("command", [["doctor"], ["check", "scenarios/hover_5m.toml"], ["engine", "scenarios/vehicles/reference.toml"]])
def test_out_is_refused_where_nothing_is_left(command, tmp_path):
    result = run_hopbench(*command, "--out", tmp_path / "run")
    assert result.code == 2 and "--out" in result.stderr
    assert not (tmp_path / "run").exists()
