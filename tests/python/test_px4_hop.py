"""`hop_10m_px4` with a stand-in for PX4 that reads the parameters `hopbench px4-params` wrote.

The stand-in is not PX4: see `px4_like.py` for what it has and what it lacks. What these flights show is that files,
wire, plant and a controller of PX4's structure with those gains fit together, and that the propellant suffices.
"""

import json
import math

import pytest
from hopbench_bench import ROOT, Bench, run_hopbench
from px4_like import Hop, Px4Like, read_parameters

# Lockstep waits in wall time. A loaded machine must not end a flight: ten seconds, not 0.2.
PATIENT = {"fc_timeout_ms": 10000}


def parameters_of(vehicle, folder, *options):
    """What px4-params leaves in a folder, and what it says."""
    result = run_hopbench("px4-params", ROOT / "scenarios" / "vehicles" / f"{vehicle}.toml", "--out", folder, "--json", *options)
    assert result.code == 0, result.stderr
    return read_parameters(folder / "hopbench_sitl.params"), result.json


def hop(parameters, scenario="hop_10m_px4", commander=None, sets=()):
    options = {"profile": "px4-sitl", "lockstep": True, "fast": True, "connect": False}
    with Bench(scenario, fc="tcp-listen", sets=PATIENT | dict(sets), extra=["--lockstep-timeout-ms", "10000"], **options) as bench:
        _, host, port = bench.ready["fc"].rsplit(":", 2)
        fc = Px4Like(parameters)
        fc.fly(host, int(port), commander or Hop(height_m=10.0, hold_s=8.0))
        return bench.result(), fc


@pytest.mark.parametrize("vehicle", ["reference", "gt_lander"])
def test_hop_lands_within_what_is_expected_and_within_the_budget(vehicle, tmp_path):
    parameters, written = parameters_of(vehicle, tmp_path / "px4")
    scenario = tmp_path / "hop.toml"
    text = (ROOT / "scenarios" / "hop_10m_px4.toml").read_text()
    vehicle_file = ROOT / "scenarios" / "vehicles" / f"{vehicle}.toml"
    scenario.write_text(text.replace('"vehicles/reference.toml"', json.dumps(str(vehicle_file))))
    result, fc = hop(parameters, scenario)
    assert result.code == 0, result.stdout
    assert result.json["outcome"] == "landed"
    assert [part["source"] for part in result.json["flown_by"]] == ["fc"]
    assert result.json["link"]["stalls"] == 0
    said = [text for _, text in fc.events]
    order = ["Armed by external command", "Takeoff detected", "Landing at current position", "Landing detected", "Disarmed by landing"]
    assert said == order
    # The budget charges full weight from the ramp to the end, so it bounds the flight from above; by less than a
    # quarter, or it would be no budget: landing and touchdown, a quarter of the burn, are what it rounds up.
    budget = written["airframe"]["budget"]
    budgeted_kg = sum(leg["nitrous_kg"] for leg in budget["legs"])
    assert 0.75 * budgeted_kg < result.json["propellant"]["nitrous_used_kg"] < budgeted_kg
    # Landing speed, MPC_LAND_SPEED, and as much again as PX4's own threshold of vertical motion.
    assert result.json["touchdown"]["vertical_speed_m_s"] < parameters["MPC_LAND_SPEED"] + parameters["LNDMC_Z_VEL_MAX"]


def test_thrusters_on_two_channels_hold_the_heading_as_one_does(tmp_path):
    channels = {
        "controls.channels.rcs_roll": "{ index = 3, range = [0.0, 1.0] }",
        "controls.channels.rcs_roll_negative": "{ index = 8, range = [0.0, 1.0] }",
    }
    options = [word for key, value in channels.items() for word in ("--set", f"{key}={value}")]
    parameters, _ = parameters_of("reference", tmp_path, *options)
    assert parameters["PWM_MAIN_FUNC4"] == 102 and parameters["PWM_MAIN_FUNC9"] == 103
    result, fc = hop(parameters, sets={f"vehicle.{key}": value for key, value in channels.items()})
    assert result.code == 0, result.stdout
    # PX4's dead band of 2 % and the thrusters' of 5 % over the yaw gain leave about a degree, the pulses as much again.
    assert abs(fc.estimate.yaw - fc.target_yaw) < 0.1


class Watched(Hop):
    """A hop whose gimbal commands about y are kept while it hovers."""

    def __init__(self):
        super().__init__(height_m=10.0, hold_s=4.0)
        self.commands = []

    def step(self, fc):
        super().step(fc)
        if self.stage == "hold":
            self.commands.append(fc.answer[2])

    @property
    def rms(self):
        return math.sqrt(sum(c * c for c in self.commands) / len(self.commands))


def test_differential_gain_that_flew_elsewhere_makes_this_gimbal_hum_and_the_written_one_does_not(tmp_path):
    written, facts = parameters_of("reference", tmp_path)
    effect = facts["airframe"]["tuning"]["unit_effect_rad_s2"][0]
    quiet, humming = Watched(), Watched()
    hop(written, commander=quiet)
    # A share of 0.03 s of the rate gain and PX4's own filter: a loop gain of 3 where the swinging engine turns the phase.
    flown = written | {"IMU_GYRO_CUTOFF": 40.0}
    for axis in ("ROLL", "PITCH"):
        flown[f"MC_{axis}RATE_P"] = 7.0 / effect
        flown[f"MC_{axis}RATE_D"] = 0.03 * flown[f"MC_{axis}RATE_P"]
    hop(flown, commander=humming)
    # A stable loop answers noise and wander: a tenth of the stroke. A growing oscillation ends at the stops: 0.7 and more
    # for anything between a sine and a square, half of that asked for.
    assert quiet.rms < 0.1 and humming.rms > 0.35, (quiet.rms, humming.rms)


def test_gains_with_the_wrong_sign_do_not_fly(tmp_path):
    parameters, _ = parameters_of("reference", tmp_path)
    parameters["CA_SV_CS1_TRQ_P"] *= -1.0
    result, _ = hop(parameters)
    assert result.code == 1 and result.json["outcome"] in ("tipped", "crashed", "aborted")


def test_what_cannot_be_served_is_refused_and_nothing_is_written(tmp_path):
    vehicle = ROOT / "scenarios" / "vehicles" / "reference.toml"
    result = run_hopbench("px4-params", vehicle, "--out", tmp_path / "px4", "--set", 'controls.throttle="valve"')
    assert result.code == 2 and "controls.throttle" in result.stderr and "allowed" in result.stderr
    assert not (tmp_path / "px4").exists()
    result = run_hopbench("px4-params", vehicle, "--out", tmp_path / "px4", "--hold-s", "200")
    assert result.code == 2 and "--hold-s" in result.stderr and "allowed a hover up to" in result.stderr
    result = run_hopbench("px4-params", ROOT / "scenarios" / "hop_50m.toml")
    assert result.code == 2 and "not a vehicle file" in result.stderr
