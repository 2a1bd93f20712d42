"""Bytes that are no MAVLink, on every link: counted, named in the verdict, and never in the way of good frames."""

import random

import pytest
from hopbench_bench import Bench


@pytest.mark.alone  # no stall: 100 ms by the clock
@pytest.mark.parametrize("fc", ["udp", "tcp-listen", "serial"])
def test_garbage_is_counted_and_does_no_harm(bench, fc):
    chance = random.Random(1)
    run = bench("hover_5m", fc=fc, profile="generic", lockstep=True, fast=True, sets={"arm_wait_s": 4})
    answered = 0
    for sensor in run.sensors():
        kind = chance.randrange(4)
        if kind == 0:
            run.send_bytes(chance.randbytes(chance.randrange(1, 64)).replace(b"\xfd", b"\x00").replace(b"\xfe", b"\x00"))
        elif kind == 1:  # a frame with a wrong checksum
            frame = bytearray(controls_frame(run, sensor.time_usec))
            frame[-1] ^= 0x55
            run.send_bytes(bytes(frame))
        run.send_controls([0.0] * 4, armed=False, time_usec=sensor.time_usec)
        answered += 1
    result = run.result()
    assert result.json["outcome"] == "timeout" and answered > 900
    link = result.json["link"]
    assert link["crc_errors"] > 0.15 * answered
    assert link["received"] >= 0.97 * answered
    assert link["stalls"] == 0


def controls_frame(run, time_usec):
    mav = run.connection.mav
    message = mav.hil_actuator_controls_encode(time_usec, [1.0] * 16, 129, 1)
    return message.pack(mav)


@pytest.mark.parametrize("fc", ["udp", "tcp-listen", "serial"])
def test_a_flood_of_random_bytes_ends_nothing(bench, fc):
    chance = random.Random(2)
    run = bench("hover_5m", fc=fc, profile="generic", lockstep=False)
    first = run.recv_sensor(timeout_s=5.0)
    for _ in range(200):
        run.send_bytes(chance.randbytes(1000))
        while run._poll() is not None:
            pass
    later = run.recv_sensor()
    while later.time_usec < first.time_usec + 500_000:
        later = run.recv_sensor()
    assert run.process.poll() is None
    run.send_controls([0.0] * 4, armed=False, time_usec=later.time_usec)
    assert run.recv_sensor().time_usec > later.time_usec
