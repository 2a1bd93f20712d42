"""`tools/px4_mission.py` against the stand-in for PX4 (`px4_like.py`, not PX4), in flight on the bench."""

import socket
import subprocess
import sys

import pytest
from hopbench_bench import ROOT
from px4_like import UdpApi
from test_px4_hop import hop, parameters_of

SCRIPT = ROOT / "tools" / "px4_mission.py"


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def script(port, *options):
    command = [sys.executable, SCRIPT, "--link", f"udpin:127.0.0.1:{port}", *options]
    return subprocess.Popen(list(map(str, command)), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.parametrize(
    "options, steps",
    [
        (["--height", 10, "--hold", 5], ["ready to arm", "armed", "held 5.0 s", "landed", "disarmed"]),
        (["--height", 5, "--offboard"], ["armed, offboard", "up:", "east:", "turn:", "landed", "disarmed"]),
    ],
    ids=["modes", "offboard"],
)
def test_script_flies_the_hop_and_says_each_step(tmp_path, options, steps):
    parameters, _ = parameters_of("reference", tmp_path)
    # The script streams setpoints in wall time: a starved machine must not make the stand-in lose them.
    parameters["COM_OF_LOSS_T"] = 60.0
    port = free_port()
    mission = script(port, *options)
    try:
        # An offboard hop to 5 m is no hop to 9 m, and ends 2 m east.
        result, _ = hop(parameters, commander=UdpApi(port), sets={"expect.max_altitude_min_m": 4.0})
        out, err = mission.communicate(timeout=60.0)
    finally:
        mission.kill()
        mission.wait()
    assert mission.returncode == 0, out + err
    assert result.code == 0, result.stdout
    places = [out.index(step) for step in steps]
    assert places == sorted(places), out


def test_nobody_there_is_exit_3_and_a_wrong_argument_2():
    nobody = script(free_port(), "--wait", 1)
    out, err = nobody.communicate(timeout=30.0)
    assert nobody.returncode == 3 and ("nothing heard" in err or "in vain" in err)
    wrong = script(free_port(), "--height", -1)
    out, err = wrong.communicate(timeout=30.0)
    assert wrong.returncode == 2 and "--height 1 to 200" in err
