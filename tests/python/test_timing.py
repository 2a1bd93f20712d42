"""What a run in real time says of its own time, held against this process's clock, and the page to sign.

Nothing here bounds how fast this machine is: figures have to be there, to agree with each other and to leave nothing out.
"""

import os
import time

import pytest
from hopbench_bench import ROOT, Bench, run_hopbench
from scripted_fc import Pilot

QUANTILES = ("p50", "p99", "p999", "max")


def echo(sensor):
    return sensor.time_usec // 1000 % 1000 / 1000


def check_account(timing):
    """No overrun without its end, no time that is neither simulated nor slipped."""
    parts = timing["overruns_caught_up"] + timing["overruns_slipped"] + timing["overruns_open"]
    assert timing["overruns"] == parts, timing
    assert timing["unaccounted_us"] == 0.0, timing
    assert (timing["slips"] > 0) == (timing["slipped_s"] > 0.0), timing
    for name in ("step_us", "cycle_us", "lateness_us", "round_trip_us", "echo_us", "reference_sleep_us", "reference_echo_us"):
        quantiles = [timing[name][quantile] for quantile in QUANTILES]
        assert quantiles == sorted(quantiles), name


def stand(bench):
    """Answers every sample, disarmed, with its echo; the (time here, time there) of the first and the last in seconds."""
    seen = []
    for sensor in bench.sensors():
        bench.send_controls([0.0] * 15 + [echo(sensor)], armed=False, time_usec=sensor.time_usec)
        seen.append((time.monotonic(), sensor.time_usec * 1e-6))
    return seen[0], seen[-1]


@pytest.mark.alone
@pytest.mark.parametrize("fc", ["udp", "serial"])
def test_certificate_of_a_run_in_real_time(bench, fc):
    run = bench("hover_5m", fc=fc, profile="generic", lockstep=False, sets={"arm_wait_s": 4}, extra=["--references"])
    (here_0, there_0), (here_1, there_1) = stand(run)
    result = run.result()
    timing, link = result.json["timing"], result.json["link"]
    check_account(timing)
    assert timing["plant_mode"] == "full" and timing["pacing"] == "realtime"
    assert (timing["plant_hz"], timing["sensor_hz"], timing["step_budget_us"]) == (1000.0, 250.0, 1000.0)
    # Another clock in another process: simulated time and slips are the time that went by. A message takes its time; a busy
    # machine may hold up this process at either end, and what the bench is late by at its end, up to 50 ms.
    assert abs((here_1 - here_0) - (there_1 - there_0) - timing["slipped_s"]) < 0.5
    # Stamp and echo answer the same frames, but for the first, which has nothing before it to differ from.
    assert timing["round_trip_us"]["p50"] == pytest.approx(timing["echo_us"]["p50"], rel=0.05)
    assert timing["reference_sleep_us"]["p50"] > 0.0 and timing["reference_echo_us"]["p50"] > 0.0
    scheduler = timing["scheduler"]
    assert scheduler["fifo"] == (scheduler["priority"] is not None)
    missing = [scheduler["fifo"], scheduler["locked"], scheduler["pinned_cpu"] is not None].count(False)
    assert len(scheduler["notes"]) >= missing
    assert link["duplicates"] == link["out_of_order"] == link["crc_errors"] == link["lost"] == 0
    assert 0.0 < link["longest_gap_ms"] and link["sent_bytes"] > 250 * 77 and link["received_bytes"] > 250 * 93
    # HIL_SENSOR and what goes with it: 250 + 10 + 50 + 50 + ... frames in a simulated second, fewer where time slipped.
    share = timing["simulated_s"] / (timing["simulated_s"] + timing["slipped_s"])
    assert 300.0 * share * 0.8 < link["rate_out_hz"] < 700.0
    if fc == "serial":  # ten symbols to a byte at 921600 baud
        seconds = link["sent_bytes"] * 10 / 921600 / (link["wire_load_percent"] / 100)
        assert seconds == pytest.approx(link["received_bytes"] * 10 / 921600 / (link["wire_load_in_percent"] / 100))
        assert seconds >= 4.0 - 0.1
    page = (run.folder / "run" / "certificate.txt").read_text()
    for word in ("TIMING CERTIFICATE", "hover_5m", "seed", "kernel", "processor", "plant", "modified", "arm_wait_s=4",
                 "beside a bare sleep", "beside a bare echo", "unaccounted for", "CRC errors", "signature"):
        assert word in page, page
    assert "not measured" not in page


@pytest.mark.alone
def test_nothing_is_asked_of_the_kernel_where_nobody_wants_it(bench):
    run = bench("hover_5m", fc="udp", lockstep=False, sets={"arm_wait_s": 1}, extra=["--no-realtime-priority"])
    stand(run)
    timing = run.result().json["timing"]
    assert timing["scheduler"] is None and timing["reference_sleep_us"] is None
    assert "nothing was asked" in (run.folder / "run" / "certificate.txt").read_text()


@pytest.mark.alone
def test_a_cpu_is_chosen_by_number(bench):
    cpu = max(os.sched_getaffinity(0))
    run = bench("hover_5m", fc="udp", lockstep=False, sets={"arm_wait_s": 1}, extra=["--cpu", str(cpu)])
    stand(run)
    assert run.result().json["timing"]["scheduler"]["pinned_cpu"] == cpu
    wrong = run_hopbench("hil", ROOT / "scenarios" / "hover_5m.toml", "--cpu", "4096")
    assert wrong.code == 2 and "--cpu" in wrong.stderr and "allowed" in wrong.stderr


@pytest.mark.alone
def test_a_run_that_follows_no_clock_claims_nothing_of_one(bench):
    run = bench("hover_5m", fc="udp", lockstep=True, fast=True, sets={"arm_wait_s": 2})
    stand(run)
    timing = run.result().json["timing"]
    assert timing["pacing"] == "fast"
    for name in ("unaccounted_us", "lateness_us", "cycle_us", "scheduler"):
        assert timing[name] is None, name
    assert timing["overruns"] == timing["slips"] == 0


@pytest.mark.parametrize("hz", [250, 500])
def test_the_built_in_autopilot_flies_in_real_time(bench, hz):
    run = bench("hover_5m", fc=None, extra=["--sensor-hz", str(hz)])
    result = run.result(timeout_s=120.0)
    timing = result.json["timing"]
    assert (timing["plant_hz"], timing["sensor_hz"]) == (1000.0, float(hz))
    assert timing["overruns"] == timing["overruns_caught_up"] + timing["overruns_slipped"] + timing["overruns_open"]
    assert timing["unaccounted_us"] == 0.0
    assert result.json["outcome"] == "landed", result.stdout


class PatientPilot(Pilot):
    """Stands on the pad for most of the time, then hops."""

    def __init__(self, wait_s):
        super().__init__()
        self.wait_us = wait_s * 1e6

    def controls(self, sensor):
        return super().controls(sensor) if sensor.time_usec >= self.wait_us else (False, [0.0] * 4)


@pytest.mark.long
def test_ten_minutes_in_real_time_leave_no_overrun_uncounted():
    """HOPBENCH_TIMING_S shortens it. Leaves the page in target/timing."""
    length_s = float(os.environ.get("HOPBENCH_TIMING_S", 600.0))
    with Bench("hover_5m", fc="udp", lockstep=False, extra=["--references"]) as run:
        pilot, first, last = PatientPilot(length_s - 25.0), None, None
        for message in run.messages():
            if message.get_type() == "ODOMETRY":
                pilot.on_odometry(message)
            elif message.get_type() == "HIL_SENSOR":
                armed, controls = pilot.controls(message)
                run.send_controls(controls + [0.0] * 11 + [echo(message)], armed=armed, time_usec=message.time_usec)
                last = (time.monotonic(), message.time_usec * 1e-6)
                first = first or last
        result = run.result()
        page = (run.folder / "run" / "certificate.txt").read_text()
    kept = ROOT / "target" / "timing"
    kept.mkdir(parents=True, exist_ok=True)
    (kept / "certificate.txt").write_text(page)
    print(page)
    timing = result.json["timing"]
    check_account(timing)
    assert timing["simulated_s"] > length_s - 10.0
    assert abs((last[0] - first[0]) - (last[1] - first[1]) - timing["slipped_s"]) < 0.5
    assert result.json["outcome"] == "landed", result.stdout
