"""Flights with a scripted flight controller: arming, controls, disarming, silence, and a hop from pad to pad."""

import subprocess
import sys

import pytest
from hopbench_bench import ROOT, Bench
from scripted_fc import Pilot

LOCKSTEP_FAST = {"lockstep": True, "fast": True}


def answer(bench, pilot, until=lambda sensor, pilot: False):
    """Lets the pilot answer every HIL_SENSOR until the run ends or `until` is true; the last sensor seen."""
    sensor = None
    for message in bench.messages():
        if message.get_type() == "ODOMETRY":
            pilot.on_odometry(message)
        elif message.get_type() == "HIL_SENSOR":
            sensor = message
            armed, controls = pilot.controls(sensor)
            bench.send_controls(controls, armed=armed, time_usec=sensor.time_usec)
            if until(sensor, pilot):
                break
    return sensor


def hovering(sensor, pilot):
    return pilot.phase == "hover" and sensor.time_usec * 1e-6 > pilot.since_s + 1.0


@pytest.mark.alone  # no stall: 100 ms by the clock
@pytest.mark.parametrize("fc", ["udp", "tcp-listen", "serial"])
def test_scripted_controller_hops(bench, fc):
    run = bench("hover_5m", fc=fc, profile="generic", **LOCKSTEP_FAST)
    answer(run, Pilot())
    result = run.result()
    assert result.code == 0, result.stdout
    assert result.json["outcome"] == "landed" and result.json["expect"]["passed"]
    assert [part["source"] for part in result.json["flown_by"]] == ["fc"]
    assert result.json["touchdown"]["vertical_speed_m_s"] <= 1.0
    assert result.json["touchdown"]["control_error_m"] is None  # the bench does not know an outside controller's estimate
    names = [event["name"] for event in result.json["events"]]
    order = ["fc_first", "armed", "ignition", "liftoff", "touchdown", "shutdown"]
    assert sorted(order, key=names.index) == order
    assert result.json["link"]["stalls"] == 0 and result.json["timing"]["realtime_factor"] > 1.0


@pytest.mark.alone
def test_script_flies_in_real_time_as_its_documentation_says(bench):
    run = bench("hover_5m", fc="udp-listen", lockstep=False, connect=False)
    link = run.ready["fc"].replace("udp-listen", "udp")
    script = subprocess.Popen([sys.executable, ROOT / "tools" / "scripted_fc.py", link])
    try:
        result = run.result(timeout_s=60.0)
        assert result.code == 0, result.stdout
        assert result.json["outcome"] == "landed"
        assert script.wait(10.0) == 0
    finally:
        script.kill()
        script.wait()


def test_controls_count_in_armed_frames_only(bench):
    run = bench("hover_5m", fc="udp", sets={"arm_wait_s": 6}, **LOCKSTEP_FAST)
    for sensor in run.sensors():
        run.send_controls([0.5, 0.5, -0.5, 1.0], armed=False, time_usec=sensor.time_usec)
        assert abs(sensor.zacc + 9.81) < 1.0  # stands still
    result = run.result()
    assert result.json["outcome"] == "timeout" and result.event("ignition") is None and result.event("armed") is None
    assert result.json["propellant"]["nitrous_used_kg"] == 0.0
    assert result.json["propellant"]["nitrogen_rcs_kg"] == 0.0


def test_two_minutes_disarmed_on_the_pad_cost_no_oxidiser(bench):
    run = bench("hover_5m", fc="tcp-listen", sets={"arm_wait_s": 120}, **LOCKSTEP_FAST)
    for sensor in run.sensors():
        run.send_controls([0.0] * 4, armed=False, time_usec=sensor.time_usec)
    result = run.result()
    assert result.json["outcome"] == "timeout" and result.json["timing"]["simulated_s"] >= 120.0
    assert result.json["propellant"]["nitrous_used_kg"] == 0.0
    assert result.json["propellant"]["nitrogen_vented_kg"] == 0.0
    assert result.json["mass"]["final_kg"] == result.json["mass"]["initial_kg"]


def test_a_wait_on_the_pad_does_not_spoil_the_flight(bench):
    class LatePilot(Pilot):
        def controls(self, sensor):
            if sensor.time_usec < 30_000_000:
                return False, [0.0] * 4
            return super().controls(sensor)

    run = bench("hover_5m", fc="udp", **LOCKSTEP_FAST)
    answer(run, LatePilot())
    assert run.result().code == 0


def test_disarm_in_flight_cuts_the_engine(bench):
    run = bench("hover_5m", fc="udp", **LOCKSTEP_FAST)
    cut_us = answer(run, Pilot(), until=hovering).time_usec
    falling = []
    for sensor in run.sensors():
        run.send_controls([0.4, 0.0, 0.0, 0.0], armed=False, time_usec=sensor.time_usec)
        if 500_000 <= sensor.time_usec - cut_us <= 750_000:  # the valve shuts in 0.25 s, 5 m take 1 s to fall
            falling.append(sensor.zacc)
    # Free fall: the accelerometer shows bias and drag alone.
    assert falling and all(abs(zacc) < 0.6 for zacc in falling)
    result = run.result()
    assert result.code == 1 and result.json["outcome"] in ("crashed", "tipped", "aborted")
    assert {part["source"] for part in result.json["flown_by"]} == {"fc"}
    assert result.event("fc_lost") is None and result.event("handover") is None


@pytest.mark.parametrize(
    "options",
    [pytest.param(LOCKSTEP_FAST, id="lockstep"), pytest.param({"lockstep": False}, id="realtime", marks=pytest.mark.alone)],
)
def test_controller_silent_in_mid_hop_is_named_and_the_vehicle_comes_home(bench, options):
    run = bench("hover_5m", fc="udp", **options)
    last_s = answer(run, Pilot(), until=hovering).time_usec * 1e-6
    result = run.result(timeout_s=60.0)
    assert result.code == 1
    lost, handover = result.event("fc_lost"), result.event("handover")
    assert lost and last_s <= lost["time_s"] <= last_s + 1.0
    assert handover and handover["time_s"] <= last_s + 1.0
    assert result.json["outcome"] == "landed"
    assert [part["source"] for part in result.json["flown_by"]] == ["fc", "autopilot"]
    assert not result.json["expect"]["passed"]
    failed = [item for item in result.json["expect"]["items"] if not item["passed"]]
    assert any("fc" in item["name"] or "flown" in item["name"] for item in failed), failed
    assert result.json["touchdown"]["vertical_speed_m_s"] <= 1.0


def test_heartbeats_alone_do_not_keep_a_controller_alive(bench):
    run = bench("hover_5m", fc="udp", lockstep=True, fast=True)
    last_s = answer(run, Pilot(), until=hovering).time_usec * 1e-6
    for _ in run.sensors():
        run.send_heartbeat()
    lost = run.result().event("fc_lost")
    assert lost and lost["time_s"] <= last_s + 1.0


def test_loss_can_be_set_to_cut(bench):
    run = bench("hover_5m", fc="udp", sets={"on_fc_loss": '"cut"'}, **LOCKSTEP_FAST)
    answer(run, Pilot(), until=hovering)
    result = run.result()
    assert result.event("fc_lost") and result.event("handover") is None
    assert result.code == 1 and result.json["outcome"] in ("crashed", "tipped")
    assert "autopilot" not in {part["source"] for part in result.json["flown_by"]}
