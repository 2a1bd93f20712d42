"""The strict peer: each rule has a stream that breaks it and nothing else; then the bench must break none, on any link.

Flights: the built-in autopilot flies as the controller it is (`hopbench autopilot`), and the strict peer sits between it and
the bench, so that touchdown, descent and climb are judged too and the controller knows no more than the wire tells.
"""

import math
import random
import select
import socket
import struct
import subprocess
import time
from contextlib import contextmanager
from functools import lru_cache

import pytest
from hopbench_bench import ROOT, Bench, hopbench_binary, mavlink
from strict_px4 import ACCEL, BARO, GYRO, MAG, RESET_MARK, RULES, StrictPx4

# ---------------------------------------------------------------------------------------------------- streams of our own

DOWN_25 = mavlink.MAV_SENSOR_ROTATION_PITCH_270
PAD_HPA, PAD_MM, SECONDS = 953.0, 512_000, 12.0


def standard_height_m(hpa):
    return 44330.77 * (1.0 - (hpa / 1013.25) ** 0.190263)


@lru_cache(maxsize=None)
def stream(climb_m_s=0.0):
    """(arrival, kind, fields) of some good seconds: 250 Hz inertial, 50 Hz mag, baro and altimeter, 10 Hz GNSS, 1 Hz heartbeat."""
    chance = random.Random(3)
    rows = []
    for step in range(1, int(SECONDS * 250) + 1):
        now_us, now_s = step * 4000, step * 0.004
        height_m = climb_m_s * now_s
        if step % 250 == 1:
            rows.append((now_s, "heartbeat", dict(type=6, autopilot=8, base_mode=0, custom_mode=0, system_status=4, mavlink_version=3)))
        if step % 25 == 1:
            gps = dict(time_usec=now_us, fix_type=3, lat=481_000_000, lon=114_000_000, alt=PAD_MM + round(1000 * height_m))
            gps.update(alt=gps["alt"] + round(chance.gauss(0, 100)), eph=90, epv=150, vel=0, vn=3, ve=4, vd=-round(100 * climb_m_s))
            gps.update(vel=5, cog=65535, satellites_visible=14)
            rows.append((now_s, "hil_gps", gps))
        if step % 5 == 1:
            distance_cm = round(100 * (0.8 + height_m) + chance.gauss(0, 2))
            ranges = dict(time_boot_ms=now_us // 1000, min_distance=20, max_distance=20_000, current_distance=distance_cm)
            ranges.update(type=0, id=0, orientation=DOWN_25, covariance=255, signal_quality=100)
            rows.append((now_s, "distance_sensor", ranges))
        sensor = dict(time_usec=now_us, fields_updated=ACCEL | GYRO, id=0, temperature=20.0)
        for axis, force, rate in (("x", 0.0, 0.001), ("y", 0.05, 0.0), ("z", -9.81, -0.001)):
            sensor[axis + "acc"] = chance.gauss(force, 0.02)
            sensor[axis + "gyro"] = chance.gauss(rate, 0.0016)
        sensor.update(xmag=0.0, ymag=0.0, zmag=0.0, abs_pressure=0.0, diff_pressure=0.0, pressure_alt=0.0)
        if step % 5 == 1:
            hpa = PAD_HPA * math.exp(-height_m / 8400.0) + chance.gauss(0, 0.025)
            sensor.update(fields_updated=ACCEL | GYRO | MAG | BARO, abs_pressure=hpa, pressure_alt=standard_height_m(hpa))
            sensor.update(xmag=chance.gauss(0.21, 0.002), ymag=chance.gauss(0.01, 0.002), zmag=chance.gauss(0.42, 0.002))
        rows.append((now_s, "hil_sensor", sensor))
    return rows


def pack(rows):
    """Rows as frames from one simulator; None stands for a frame lost on the way."""
    mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=200)
    for row in rows:
        if row is None:
            mav.seq = (mav.seq + 1) % 256
            continue
        arrival_s, kind, fields = row
        yield arrival_s, bytes(getattr(mav, kind + "_encode")(**fields).pack(mav))
        mav.seq = (mav.seq + 1) % 256


def judge(frames, profile="px4-hitl", answers=True):
    """The rules that these frames break."""
    strict = StrictPx4(profile, lockstep=profile == "px4-sitl", realtime=profile == "px4-hitl")
    parser = mavlink.MAVLink(None)
    parser.robust_parsing = True
    for arrival_s, data in frames:
        for message in parser.parse_buffer(data) or []:
            strict.take(message, arrival_s)
            if answers and message.get_type() == "HIL_SENSOR":
                strict.answered(message.time_usec, armed=False)
    return {violation.rule for violation in strict.violations}


def nth(rows, kind, place):
    """Index of the `place`-th row of a kind."""
    return [i for i, row in enumerate(rows) if row[1] == kind][place]


def put(kind, place, **fields):
    """A stream in which one row has other values."""
    rows = list(stream())
    i = nth(rows, kind, place)
    rows[i] = (rows[i][0], kind, {**rows[i][2], **fields})
    return pack(rows)


def every(kind, change, of=None):
    """A stream in which every row of a kind is changed by `change(fields)`."""
    rows = [(t, k, {**f, **change(f)}) if k == kind else (t, k, f) for t, k, f in (of or stream())]
    return pack(rows)


def moved(kind, place, to):
    """One frame comes later than it should, under its own number."""
    frames = list(pack(stream()))
    i = nth(stream(), kind, place)
    frames.insert(i + to, frames.pop(i))
    return frames


def tail_arrives_later(place, by_s):
    rows = stream()
    i = nth(rows, "hil_sensor", place)
    return pack(rows[:i] + [(t + by_s, k, f) for t, k, f in rows[i:]])


def slips(by_s, over_s=1.0):
    """Arrivals fall behind little by little, no single one by much."""
    return pack([(t + by_s * min(1.0, max(0.0, (t - 3.0) / over_s)), k, f) for t, k, f in stream()])


def twice(under_a_new_number):
    rows = stream()
    i = nth(rows, "hil_sensor", 500)
    if under_a_new_number:
        return pack(rows[: i + 1] + rows[i:])
    frames = list(pack(rows))
    return frames[: i + 1] + frames[i:]


def without(kind, keep):
    rows = stream()
    places = iter(range(len(rows)))
    return pack([row for row in rows if row[1] != kind or keep(next(places))])


def as_sender(frames, system, component):
    mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
    for arrival_s, data in frames:
        message = mavlink.MAVLink(None).parse_buffer(data)[0]
        mav.seq = message.get_seq()
        yield arrival_s, bytes(message.pack(mav))


def switched_sender():
    frames = list(pack(stream()))
    return frames[:900] + list(as_sender(frames[900:901], 1, 77)) + frames[901:]


def shifted(kind, place, **fields):
    """From this row on, values are raised by so much."""
    rows = stream()
    i = nth(rows, kind, place)
    raise_by = lambda f: {k: f[k] + by for k, by in fields.items()}  # noqa: E731
    return pack(rows[:i] + [(t, k, {**f, **raise_by(f)}) if k == kind else (t, k, f) for t, k, f in rows[i:]])


def lost_frame():
    rows = stream()
    i = nth(rows, "heartbeat", 3)
    return pack(rows[:i] + [None] + rows[i + 1 :])


def corrupted_in_place():
    frames = list(pack(stream()))
    noise = (frames[700][0], b"\x00\x01\x02")
    return frames[:700] + [noise] + frames[700:]


def extra(kind, profile_us=2_000_000, **fields):
    rows = stream()
    i = nth(rows, "hil_sensor", profile_us // 4000)
    return pack(rows[:i] + [(rows[i][0], kind, fields)] + rows[i:])


TRUTH = dict(
    time_usec=2_000_000, attitude_quaternion=[1, 0, 0, 0], rollspeed=0, pitchspeed=0, yawspeed=0, lat=1, lon=1, alt=0, vx=0, vy=0,
    vz=0, ind_airspeed=0, true_airspeed=0, xacc=0, yacc=0, zacc=-1000,
)  # fmt: skip
POSE = dict(
    time_usec=2_000_000, frame_id=1, child_frame_id=12, x=0, y=0, z=-0.7, q=[1, 0, 0, 0], vx=0, vy=0, vz=0, rollspeed=0,
    pitchspeed=0, yawspeed=0, pose_covariance=[math.nan] * 21, velocity_covariance=[math.nan] * 21,
)  # fmt: skip
FROZEN_BARO = dict(abs_pressure=PAD_HPA, pressure_alt=standard_height_m(PAD_HPA))

# Rule, what the mistake is, the profile, the stream.
BROKEN = [
    ("frame", "bytes between frames", "px4-hitl", corrupted_in_place),
    ("sequence", "a frame lost", "px4-hitl", lost_frame),
    ("sequence", "two frames changed places", "px4-hitl", lambda: moved("distance_sensor", 30, 1)),
    ("duplicate", "the same frame twice", "px4-hitl", lambda: twice(False)),
    ("duplicate", "the same sample under a new number", "px4-hitl", lambda: twice(True)),
    ("sender", "another component in between", "px4-hitl", switched_sender),
    ("sender", "the flight controller's own address", "px4-hitl", lambda: as_sender(pack(stream()), 1, 1)),
    ("stranger", "a message PX4 does not take here", "px4-hitl", lambda: extra("system_time", time_unix_usec=1, time_boot_ms=2000)),
    ("heartbeat", "none after the fourth", "px4-hitl", lambda: without("heartbeat", lambda n: n < 4)),
    ("truth", "truth to a board", "px4-hitl", lambda: extra("hil_state_quaternion", **TRUTH)),
    ("time_zero", "no time", "px4-hitl", lambda: put("hil_sensor", 700, time_usec=0)),
    ("time_back", "an old time", "px4-hitl", lambda: put("hil_sensor", 700, time_usec=1_000_000)),
    ("time_repeated", "the last one's time", "px4-hitl", lambda: put("hil_sensor", 700, time_usec=700 * 4000)),
    ("gap", "a jump forward by 20 ms", "px4-hitl", lambda: shifted("hil_sensor", 700, time_usec=20_000)),
    ("late", "0.25 s of silence", "px4-hitl", lambda: tail_arrives_later(700, 0.25)),
    ("late", "1.1 s of silence", "px4-sitl", lambda: tail_arrives_later(700, 1.1)),
    ("old", "slips behind by 0.3 s", "px4-hitl", lambda: slips(0.3)),
    ("sensor_id", "a second sensor", "px4-hitl", lambda: put("hil_sensor", 700, id=1)),
    ("mask", "half an accelerometer", "px4-hitl", lambda: put("hil_sensor", 701, fields_updated=0x3B)),
    ("mask", "pressure without altitude and temperature bits", "px4-hitl", lambda: put("hil_sensor", 701, fields_updated=0x3F | 0x200)),
    ("mask", "no gyro", "px4-hitl", lambda: put("hil_sensor", 701, fields_updated=ACCEL)),
    ("mask", "one axis of the magnetometer", "px4-hitl", lambda: put("hil_sensor", 701, fields_updated=0x3F | 0x40)),
    ("mask", "a bit beyond", "px4-hitl", lambda: put("hil_sensor", 701, fields_updated=0x3F | 0x2000)),
    ("mask", "the reset mark with sensors", "px4-hitl", lambda: put("hil_sensor", 701, fields_updated=0x3F | RESET_MARK)),
    ("first_baro", "no temperature to begin with", "px4-hitl", lambda: every("hil_sensor", without_baro_at_first)),
    ("finite", "NaN", "px4-hitl", lambda: put("hil_sensor", 700, xgyro=math.nan)),
    ("finite", "infinity in the field", "px4-hitl", lambda: put("hil_sensor", 700, xmag=math.inf)),
    ("finite", "infinite pressure", "px4-hitl", lambda: put("hil_sensor", 700, abs_pressure=math.inf)),
    ("acceleration", "beyond 16 g", "px4-hitl", lambda: put("hil_sensor", 700, zacc=-160.0)),
    ("rate", "beyond 2000 deg/s", "px4-hitl", lambda: put("hil_sensor", 700, zgyro=35.0)),
    ("magnetic", "tesla", "px4-hitl", lambda: every("hil_sensor", lambda f: {k: f[k] * 1e-4 for k in ("xmag", "ymag", "zmag")})),
    ("magnetic", "milligauss", "px4-hitl", lambda: every("hil_sensor", lambda f: {k: f[k] * 1e3 for k in ("xmag", "ymag", "zmag")})),
    ("pressure", "pascals", "px4-hitl", lambda: every("hil_sensor", lambda f: {"abs_pressure": f["abs_pressure"] * 100.0})),
    ("temperature", "kelvin", "px4-hitl", lambda: every("hil_sensor", lambda f: {"temperature": 293.0})),
    ("pressure_altitude", "another height", "px4-hitl", lambda: put("hil_sensor", 700, pressure_alt=12.0)),
    ("rest", "gravity's sign", "px4-hitl", lambda: every("hil_sensor", lambda f: {"zacc": -f["zacc"]})),
    ("rest", "deg/s", "px4-hitl", lambda: every("hil_sensor", lambda f: {k: f[k] * 57.3 for k in ("xgyro", "ygyro", "zgyro")})),
    ("rest", "x and z exchanged", "px4-hitl", lambda: every("hil_sensor", lambda f: {"xacc": f["zacc"], "zacc": f["xacc"]})),
    ("stale", "an accelerometer within its step", "px4-hitl", lambda: every("hil_sensor", lambda f: dict(xacc=0.0, yacc=0.0, zacc=-9.81))),
    ("stale", "a gyro without noise", "px4-hitl", lambda: every("hil_sensor", lambda f: {k: f[k] * 0.01 for k in ("xgyro", "ygyro", "zgyro")})),
    ("stale", "a magnetometer without noise", "px4-hitl", lambda: every("hil_sensor", lambda f: dict(xmag=0.2, ymag=0.0, zmag=0.4))),
    ("stale", "a barometer without noise", "px4-hitl", lambda: every("hil_sensor", lambda f: FROZEN_BARO)),
    ("gps_time", "an old fix", "px4-hitl", lambda: put("hil_gps", 60, time_usec=1_000_000)),
    ("gps_rate", "1 Hz", "px4-hitl", lambda: without("hil_gps", lambda n: n % 10 == 0)),
    ("gps_id", "a second receiver", "px4-hitl", lambda: put("hil_gps", 60, id=1)),
    ("gps_fix", "a flat fix", "px4-hitl", lambda: put("hil_gps", 60, fix_type=2)),
    ("gps_fix", "five satellites", "px4-hitl", lambda: put("hil_gps", 60, satellites_visible=5)),
    ("gps_accuracy", "millimetres", "px4-hitl", lambda: put("hil_gps", 60, eph=900, epv=1500)),
    ("gps_accuracy", "metres, rounded away", "px4-hitl", lambda: put("hil_gps", 60, eph=0, epv=1)),
    ("gps_place", "radians", "px4-hitl", lambda: every("hil_gps", lambda f: dict(lat=0, lon=0))),
    ("gps_place", "metres", "px4-hitl", lambda: every("hil_gps", lambda f: {"alt": f["alt"] // 1000})),
    ("gps_speed", "m/s beside cm/s", "px4-hitl", lambda: every("hil_gps", lambda f: dict(vn=300, ve=400, vel=5), of=still_east())),
    ("gps_speed", "course in degrees", "px4-hitl", lambda: put("hil_gps", 60, vn=0, ve=30, vel=30, cog=90)),
    ("gps_velocity", "climbs with the velocity of m/s", "px4-hitl", lambda: every("hil_gps", lambda f: dict(vd=-2), of=stream(2.0))),
    ("gps_velocity", "down is up", "px4-hitl", lambda: every("hil_gps", lambda f: dict(vd=200), of=stream(2.0))),
    ("altimeter", "looks forward", "px4-hitl", lambda: put("distance_sensor", 60, orientation=0)),
    ("altimeter", "0 instead of too near", "px4-hitl", lambda: put("distance_sensor", 60, current_distance=0)),
    ("altimeter_height", "millimetres", "px4-hitl", lambda: every("distance_sensor", millimetres, of=stream(2.0))),
    ("boot_time", "seconds", "px4-hitl", lambda: put("distance_sensor", 60, time_boot_ms=1)),
    ("pose", "no quaternion", "generic", lambda: extra("odometry", **{**POSE, "q": [0.5, 0, 0, 0]})),
]  # fmt: skip


def still_east():
    """Moves as it says, 5 m/s, so that only the speed is wrong."""
    turn_m = math.radians(1e-7) * 6_378_137.0
    across = turn_m * math.cos(math.radians(48.1))
    return [
        (t, k, {**f, "lat": f["lat"] + round(3.0 * t / turn_m), "lon": f["lon"] + round(4.0 * t / across)}) if k == "hil_gps" else (t, k, f)
        for t, k, f in stream()
    ]


def without_baro_at_first(fields):
    return dict(fields_updated=ACCEL | GYRO) if fields["time_usec"] < 100_000 else {}


def millimetres(fields):
    return dict(current_distance=min(20_000, fields["current_distance"] * 10))


@pytest.mark.parametrize("profile", ["px4-hitl", "px4-sitl", "generic"])
@pytest.mark.parametrize("climb_m_s", [0.0, 2.0])
def test_a_good_stream_breaks_no_rule(profile, climb_m_s):
    assert judge(pack(stream(climb_m_s)), profile) == set()


def test_a_reset_mark_alone_and_differential_pressure_break_no_rule():
    assert judge(put("hil_sensor", 701, fields_updated=RESET_MARK)) == set()
    assert judge(put("hil_sensor", 701, fields_updated=ACCEL | GYRO | 0x400)) == set()


@pytest.mark.parametrize("rule,what,profile,broken", BROKEN, ids=[f"{rule}: {what}" for rule, what, _, _ in BROKEN])
def test_each_mistake_breaks_its_own_rule(rule, what, profile, broken):
    assert judge(broken(), profile) == {rule}


def test_a_second_sample_before_the_answer_is_a_violation_once_answers_have_come():
    frames = list(pack(stream()))
    assert judge(frames, "px4-sitl", answers=False) == set()  # PX4 says nothing while it boots
    strict = StrictPx4("px4-sitl", lockstep=True)
    parser = mavlink.MAVLink(None)
    for arrival_s, data in frames:
        for message in parser.parse_buffer(data):
            strict.take(message, arrival_s)
            if message.get_type() == "HIL_SENSOR" and message.time_usec != 2_000_000:
                strict.answered(message.time_usec, armed=False)
    assert [violation.rule for violation in strict.violations] == ["outstanding"]
    assert "2004000" in strict.report()


def test_every_rule_has_a_stream_that_breaks_it():
    assert {rule for rule, *_ in BROKEN} | {"outstanding"} == set(RULES)


# ------------------------------------------------------------------------------------------------------------ the bench


class Controller:
    """`hopbench autopilot` on a UDP socket of its own; frames go to it, its answers come back as bytes."""

    def __init__(self, profile, scenario):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(10.0)
        link = "udp:127.0.0.1:%d" % self.socket.getsockname()[1]
        command = [hopbench_binary(), "autopilot", "--plant", link, "--profile", profile, "--scenario", scenario]
        self.process = subprocess.Popen(command, cwd=ROOT, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        _, self.address = self.socket.recvfrom(2048)  # it speaks first, and goes on with heartbeats until it hears a sensor

    def tell(self, frame):
        self.socket.sendto(frame, self.address)

    def replies(self, until_us, timeout_s):
        """Its frames, up to and with the answer to the sample of `until_us`, or what comes in time: (bytes, time_usec, armed)."""
        deadline_s = time.monotonic() + timeout_s
        while (left_s := deadline_s - time.monotonic()) > 0.0:
            self.socket.settimeout(left_s)
            try:
                data = self.socket.recv(2048)
            except TimeoutError:
                return
            stamp_us, armed = answer_of(data)
            yield data, stamp_us, armed
            if stamp_us == until_us:  # of a heartbeat both are None: one is enough
                return

    def close(self):
        self.process.terminate()
        self.process.wait()
        self.socket.close()


def answer_of(frame):
    """Time and armed bit of HIL_ACTUATOR_CONTROLS (93), whose payload's trailing zeros are cut; (None, False) of any other."""
    if frame[0] != 0xFD or int.from_bytes(frame[7:10], "little") != 93:
        return None, False
    payload = frame[10 : 10 + frame[1]].ljust(81, b"\0")
    return struct.unpack_from("<Q", payload)[0], bool(payload[80] & 128)


@contextmanager
def strict_bench(scenario, fc, profile, **options):
    """A bench, and the strict peer that belongs to it."""
    lockstep = options.get("lockstep", False)
    extra = ["--lockstep-timeout-ms", "10000"] if lockstep else []  # a busy machine is no stall
    with Bench(scenario, fc=fc, profile=profile, extra=extra, sets={"fc_timeout_ms": 30000} if lockstep else {}, **options) as bench:
        yield bench, StrictPx4(profile, lockstep=lockstep, realtime=not lockstep)


def arrivals(bench, timeout_s=10.0):
    """All messages, each with the last look that found nothing and the time it was read: it came in between."""
    looked_s = time.monotonic()
    ended_s = None
    while True:
        message = bench._poll()
        now_s = time.monotonic()
        if message is not None:
            yield message, looked_s, now_s
            continue
        looked_s = now_s
        if bench.process.poll() is not None:
            # A closed connection is readable for ever: what was still under way comes within this time.
            ended_s = ended_s or now_s
            if now_s - ended_s > 0.1:
                return
            time.sleep(0.005)
        elif not select.select([bench.connection.fd], [], [], timeout_s)[0]:
            assert bench.process.poll() is not None, f"silent for {timeout_s} s\n{bench.stderr()[-2000:]}"


def fly(bench, strict, controller):
    """Relays between bench and controller until the run ends; the Result."""
    started_s = time.monotonic()
    for message, earliest_s, read_s in arrivals(bench):
        strict.take(message, earliest_s, read_s)
        controller.tell(bytes(message.get_msgbuf()))
        if message.get_type() == "HIL_SENSOR":
            # Nobody waits in real time: what is not there yet goes with the next sample.
            replies = controller.replies(message.time_usec, 5.0 if strict.lockstep else 0.002)
        elif message.get_type() == "HEARTBEAT" and not strict.samples:  # the bench waits for the controller's own
            replies = controller.replies(None, 0.2)
        else:
            continue
        for data, stamp_us, armed in replies:
            bench.send_bytes(data)
            if stamp_us is not None:
                strict.answered(stamp_us, armed, time.monotonic() - started_s)
    return bench.result()


def flight(scenario, fc, profile, seed=None, **options):
    """One flight; (Result, StrictPx4)."""
    with strict_bench(scenario, fc, profile, seed=seed, **options) as (bench, strict):
        controller = Controller(profile, bench.scenario)
        try:
            return fly(bench, strict, controller), strict
        finally:
            controller.close()


LOCKSTEP_FAST = {"lockstep": True, "fast": True}


@pytest.mark.parametrize(
    "fc,profile",
    [("tcp-listen", "px4-sitl"), ("udp", "px4-sitl"), ("udp-listen", "generic"), ("serial", "px4-sitl")],
    ids=lambda name: name,
)
def test_a_flight_in_lockstep_breaks_no_rule(fc, profile):
    result, strict = flight("hover_5m", fc, profile, **LOCKSTEP_FAST)
    assert result.code == 0 and result.json["outcome"] == "landed", result.stdout + result.stderr
    assert not strict.violations, strict.report()
    assert strict.first_answer_s <= 2.0
    assert strict.samples >= 250 * 20 and strict.kinds["HIL_GPS"] >= 200 and strict.kinds["DISTANCE_SENSOR"] >= 1000
    assert result.json["link"]["stalls"] == 0
    # On udp-listen the helper's first heartbeat has a count of its own.
    assert result.json["link"]["lost"] == 0 or fc == "udp-listen"


@pytest.mark.alone
@pytest.mark.parametrize("fc", ["serial", pytest.param("udp", marks=pytest.mark.long)])
def test_a_flight_in_real_time_breaks_no_rule_of_a_board(fc):
    result, strict = flight("hover_5m", fc, "px4-hitl", lockstep=False)
    broken = {violation.rule for violation in strict.violations}
    # A machine too busy for real time may break these, and then the bench must have said so itself.
    if result.json["timing"]["lateness_us"]["max"] > 0.1e6:
        broken -= {"late", "old"}
    if result.json["link"]["dropped"] > 0:
        broken -= {"sequence", "gap"}
    assert not broken, strict.report()
    assert strict.first_answer_s <= 2.0
    assert result.json["outcome"] == "landed", result.stdout + result.stderr
    assert strict.kinds["HEARTBEAT"] >= 20 and "HIL_STATE_QUATERNION" not in strict.kinds


@pytest.mark.long
def test_one_hour_of_flight_breaks_no_rule():
    hour_s, simulated_s, violations, flights = 3600.0, 0.0, [], 0
    transports = [("tcp-listen", "px4-sitl"), ("udp", "px4-sitl"), ("serial", "px4-sitl"), ("udp-listen", "generic")]
    while simulated_s < hour_s:
        fc, profile = transports[flights % len(transports)]
        result, strict = flight("hop_10m_px4", fc, profile, seed=flights + 1, **LOCKSTEP_FAST)
        assert result.json["outcome"] == "landed", f"seed {flights + 1}\n{result.stdout}\n{result.stderr}"
        assert strict.first_answer_s <= 2.0 and result.json["link"]["stalls"] == 0
        violations += strict.violations
        assert not violations, f"seed {flights + 1}\n{strict.report()}"
        simulated_s, flights = simulated_s + strict.simulated_s, flights + 1
    print(f"{flights} flights, {simulated_s:.0f} s simulated, no violation")
