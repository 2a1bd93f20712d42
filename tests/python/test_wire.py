"""What each profile puts on the wire while the vehicle stands on the pad, over every link, in lockstep and in real time.

Bounds come from the reference vehicle's sensors (scenarios/vehicles/reference.toml) and from what PX4 does with them.
"""

import statistics
import time
from functools import lru_cache

import pytest
from hopbench_bench import Bench, mavlink

PAD_S = 3.0
ACCEL_GYRO, MAG, BARO, DIFF_PRESSURE = 0x3F, 0x1C0, 0x1A00, 0x400
PX4_ACCEL_LSB = 9.80665 / 2048.0  # 16-bit FIFO of PX4's simulated IMU
PX4_GYRO_LSB = 2000.0 / 32768.0 * 3.141592653589793 / 180.0

LOCKSTEP, REALTIME = True, False
CASES = [
    *(("generic", fc, pacing) for fc in ("udp", "udp-listen", "tcp-listen", "tcp", "serial") for pacing in (LOCKSTEP,)),
    *(("generic", fc, REALTIME) for fc in ("udp", "tcp-listen", "serial")),
    *(("px4-sitl", fc, LOCKSTEP) for fc in ("udp", "tcp-listen", "serial")),
    *(("px4-sitl", fc, REALTIME) for fc in ("udp", "tcp-listen", "serial")),
    *(("px4-hitl", fc, REALTIME) for fc in ("udp", "tcp-listen", "serial")),
]
every_case = pytest.mark.parametrize(
    "case",
    [
        pytest.param((p, fc, pacing), id=f"{p}-{fc}-lockstep")
        if pacing
        else pytest.param((p, fc, pacing), id=f"{p}-{fc}-realtime", marks=pytest.mark.alone)
        for p, fc, pacing in CASES
    ],
)


class Capture:
    """Every message of some seconds on the pad, answered by disarmed controls, with its wall time; and the verdict."""

    def __init__(self, profile, fc, lockstep, ask_truth_us=None):
        self.arrived = []
        options = {"sets": {"arm_wait_s": PAD_S}, "lockstep": lockstep, "fast": lockstep}
        with Bench("hover_5m", fc=fc, profile=profile, **options) as bench:
            heartbeat_s = 0.0
            for message in bench.messages():
                self.arrived.append((time.monotonic(), message))
                if time.monotonic() > heartbeat_s:
                    if heartbeat_s == 0.0 and ask_truth_us is not None:
                        bench.request_interval(mavlink.MAVLINK_MSG_ID_HIL_STATE_QUATERNION, ask_truth_us)
                    bench.send_heartbeat()
                    heartbeat_s = time.monotonic() + 1.0
                if message.get_type() == "HIL_SENSOR":
                    bench.send_controls([0.0] * 4, armed=False, time_usec=message.time_usec)
            self.result = bench.result()

    def of(self, kind):
        return [message for _, message in self.arrived if message.get_type() == kind]

    def kinds(self):
        return {message.get_type() for _, message in self.arrived}


@lru_cache(maxsize=None)
def capture(case):
    return Capture(*case)


def group(sensors, mask):
    return [sensor for sensor in sensors if sensor.fields_updated & mask]


@every_case
def test_time_is_a_grid_of_sensor_periods(case):
    times = [sensor.time_usec for sensor in capture(case).of("HIL_SENSOR")]
    assert len(times) > 0.9 * PAD_S * 250
    if case[0] == "px4-hitl":  # sensors begin when the board has answered; the clock does not wait for it
        assert times[0] > 0 and times[0] % 4000 == 0
    else:
        assert times[0] == 4000
    assert times == list(range(times[0], times[0] + 4000 * len(times), 4000))
    for kind in ("HIL_GPS", "HIL_STATE_QUATERNION", "ODOMETRY"):
        stamps = [message.time_usec for message in capture(case).of(kind)]
        assert all(0 < a < b for a, b in zip(stamps, stamps[1:])), kind


@every_case
def test_fields_updated_names_the_rate_groups(case):
    sensors = capture(case).of("HIL_SENSOR")
    for sensor in sensors:
        assert sensor.fields_updated & ACCEL_GYRO == ACCEL_GYRO
        assert sensor.fields_updated & MAG in (0, MAG)
        assert sensor.fields_updated & BARO in (0, BARO)
        assert sensor.fields_updated & ~(ACCEL_GYRO | MAG | BARO | DIFF_PRESSURE) == 0
        assert sensor.id == 0
    for mask in (MAG, BARO):  # 50 Hz
        stamps = [sensor.time_usec for sensor in group(sensors, mask)]
        assert {b - a for a, b in zip(stamps, stamps[1:])} == {20_000}


@every_case
def test_units_at_rest(case):
    sensors = capture(case).of("HIL_SENSOR")
    mean = {name: statistics.fmean(getattr(s, name) for s in sensors) for name in ("xacc", "yacc", "zacc", "xgyro", "ygyro", "zgyro")}
    # Turn-on biases are within 3 sigma of the vehicle file's; an axis or a sign wrong is off by 9.8.
    assert abs(mean["zacc"] + 9.81) < 0.3 and abs(mean["xacc"]) < 0.3 and abs(mean["yacc"]) < 0.3
    assert all(abs(mean[name]) < 0.03 for name in ("xgyro", "ygyro", "zgyro"))
    for sensor in group(sensors, MAG):  # gauss: the Earth's field is 0.22 to 0.67
        assert 0.2 < (sensor.xmag**2 + sensor.ymag**2 + sensor.zmag**2) ** 0.5 < 0.7
        assert sensor.zmag > 0.0 or sensor.xmag > 0.0
    for sensor in group(sensors, BARO):  # hPa, metres, degrees Celsius
        assert 700.0 < sensor.abs_pressure < 1080.0
        assert abs(sensor.pressure_alt - 44330.0 * (1.0 - (sensor.abs_pressure / 1013.25) ** 0.190263)) < 1.0
        assert -20.0 < sensor.temperature < 60.0


@every_case
def test_no_two_samples_are_alike(case):
    sensors = capture(case).of("HIL_SENSOR")
    groups = {
        ("xacc", "yacc", "zacc", "xgyro", "ygyro", "zgyro"): sensors,
        ("xmag", "ymag", "zmag"): group(sensors, MAG),
        ("abs_pressure",): group(sensors, BARO),
    }
    for names, samples in groups.items():
        for name in names:
            values = [getattr(sample, name) for sample in samples]
            # One channel may repeat by chance: a pressure near 1000 hPa has steps of 6e-5 on the wire, against a noise of
            # 0.025. A stuck one repeats always, and three at once never by chance.
            assert sum(a == b for a, b in zip(values, values[1:])) < 0.02 * len(values), name
        if len(names) > 1:
            rows = [tuple(getattr(sample, name) for name in names) for sample in samples]
            assert all(a != b for a, b in zip(rows, rows[1:])), names


@pytest.mark.parametrize("case", [case for case in CASES if case[0] != "generic"], ids=str)
def test_px4_sees_noise_of_at_least_one_step(case):
    sensors = capture(case).of("HIL_SENSOR")
    for names, step, samples in (
        (("xacc", "yacc", "zacc"), PX4_ACCEL_LSB, sensors),
        (("xgyro", "ygyro", "zgyro"), PX4_GYRO_LSB, sensors),
        (("xmag", "ymag", "zmag"), 1.0e-3, group(sensors, MAG)),  # gauss; enough to keep PX4's validator content
        (("abs_pressure",), 0.01, group(sensors, BARO)),  # hPa
    ):
        for name in names:
            assert statistics.pstdev(getattr(sample, name) for sample in samples) >= step, name


@every_case
def test_gnss_is_in_wire_units(case):
    fixes = capture(case).of("HIL_GPS")
    assert 0.8 * PAD_S * 10 - 2 <= len(fixes) <= PAD_S * 10 + 2  # 10 Hz
    for fix in fixes:
        assert 1_000_000 < abs(fix.lat) < 900_000_000 and 1_000_000 < abs(fix.lon) < 1_800_000_000  # 1e-7 deg
        assert abs(fix.alt - fixes[0].alt) < 5_000 and abs(fix.alt) < 9_000_000  # mm
        assert fix.fix_type in (3, 6) and fix.satellites_visible >= 6
        assert 1 <= fix.eph <= 300 and 1 <= fix.epv <= 500  # cm: 0.9 m and 1.5 m for a plain receiver
        assert all(abs(speed) < 50 for speed in (fix.vn, fix.ve, fix.vd))  # cm/s; noise 0.08 m/s, six sigma
        assert fix.vel < 60


@every_case
def test_altimeter_looks_down(case):
    readings = capture(case).of("DISTANCE_SENSOR")
    assert len(readings) > 10
    for reading in readings:
        assert reading.orientation == mavlink.MAV_SENSOR_ROTATION_PITCH_270
        assert reading.type == mavlink.MAV_DISTANCE_SENSOR_LASER
        assert (reading.min_distance, reading.max_distance) == (20, 4000)  # cm
        assert 65 <= reading.current_distance <= 95  # 0.05 m above the pivot, which stands 0.74 m high


@every_case
def test_each_profile_sends_its_own_messages(case):
    seen = capture(case)
    common = {"HIL_SENSOR", "HIL_GPS", "DISTANCE_SENSOR"}
    own = {
        "generic": {"HEARTBEAT", "ODOMETRY", "SYSTEM_TIME", "NAMED_VALUE_FLOAT"},
        "px4-sitl": set(),
        "px4-hitl": {"HEARTBEAT"},
    }
    assert seen.kinds() == common | own[case[0]]


@every_case
def test_run_ends_by_itself_when_nobody_arms(case):
    result = capture(case).result
    assert result.code == 1 and result.json["outcome"] == "timeout"
    link = result.json["link"]
    assert link["crc_errors"] == 0 and link["lost"] == 0
    assert link["sent"] >= len(capture(case).arrived) and link["received"] > 0.5 * PAD_S * 250


@every_case
def test_simulated_time_keeps_to_its_pace(case):
    sensors = [(wall_s, m.time_usec * 1e-6) for wall_s, m in capture(case).arrived if m.get_type() == "HIL_SENSOR"]
    wall_s, simulated_s = sensors[-1][0] - sensors[0][0], sensors[-1][1] - sensors[0][1]
    if case[2] == REALTIME:  # behind on a busy machine it may be, ahead never
        assert 0.95 * simulated_s < wall_s


def test_lockstep_without_fast_does_not_run_ahead():
    with Bench("hover_5m", fc="tcp-listen", profile="px4-sitl", lockstep=True) as bench:
        bench.send_heartbeat()
        stamps = []
        for sensor in bench.sensors():
            bench.send_controls([0.0] * 4, armed=False, time_usec=sensor.time_usec)
            stamps.append((time.monotonic(), sensor.time_usec * 1e-6))
            if stamps[-1][1] > 2.0:
                break
    assert stamps[-1][0] - stamps[0][0] > 0.95 * (stamps[-1][1] - stamps[0][1])


def test_lockstep_waits_for_the_reply():
    with Bench("hover_5m", fc="tcp-listen", profile="px4-sitl", lockstep=True, fast=True) as bench:
        bench.send_heartbeat()
        for sensor in bench.sensors():
            bench.send_controls([0.0] * 4, armed=False, time_usec=sensor.time_usec)
            if sensor.time_usec >= 400_000:
                break
        # Answered up to here: the next sample comes, and no other before it is answered (or the stall is over, 100 ms).
        first = bench.recv_sensor()
        with pytest.raises(TimeoutError):
            bench.recv_sensor(timeout_s=0.05)
        bench.send_controls([0.0] * 4, armed=False, time_usec=first.time_usec)
        assert bench.recv_sensor().time_usec == first.time_usec + 4000


def test_generic_sends_tracking_time_and_pressures():
    seen = capture(("generic", "udp", LOCKSTEP))
    poses = seen.of("ODOMETRY")
    stamps = [pose.time_usec for pose in poses]
    assert {b - a for a, b in zip(stamps, stamps[1:])} == {20_000}
    for pose in poses:
        assert pose.frame_id == mavlink.MAV_FRAME_LOCAL_NED
        assert abs(pose.x) < 0.2 and abs(pose.y) < 0.2 and abs(pose.z + 0.741) < 0.2
        assert pose.q[0] > 0.99
    assert len({(pose.x, pose.y, pose.z) for pose in poses}) == len(poses)  # the rig is noisy too
    boot_ms = [message.time_boot_ms for message in seen.of("SYSTEM_TIME")]
    assert boot_ms == sorted(boot_ms)
    latest = {message.name: message.value for message in seen.of("NAMED_VALUE_FLOAT")}
    assert set(latest) == {"tank_bar", "bottle_bar", "chamb_bar"}
    # Standard deviation and bias of the transducers, four sigma.
    assert abs(latest["tank_bar"] - 65.0) < 1.2 and abs(latest["bottle_bar"] - 300.0) < 6.0 and abs(latest["chamb_bar"] - 1.0) < 0.8
    assert 2 <= len(seen.of("HEARTBEAT")) <= PAD_S + 2


def test_truth_comes_when_asked_for():
    truth = Capture("px4-sitl", "tcp-listen", LOCKSTEP, ask_truth_us=20_000).of("HIL_STATE_QUATERNION")
    stamps = [message.time_usec for message in truth]
    assert len(stamps) > 0.8 * PAD_S * 50
    assert {b - a for a, b in zip(stamps, stamps[1:])} == {20_000}
    for message in truth:
        assert abs(message.attitude_quaternion[0]) > 0.999
        assert all(abs(speed) <= 2 for speed in (message.vx, message.vy, message.vz))  # cm/s
    assert Capture("generic", "udp", LOCKSTEP, ask_truth_us=20_000).of("HIL_STATE_QUATERNION")


@pytest.mark.alone
def test_truth_never_goes_to_a_flying_board():
    assert "HIL_STATE_QUATERNION" not in Capture("px4-hitl", "serial", REALTIME, ask_truth_us=5_000).kinds()


def test_same_seed_same_bytes_on_the_wire():
    def wire(seed):
        with Bench("hover_5m", fc="tcp-listen", profile="px4-sitl", lockstep=True, fast=True, seed=seed) as bench:
            bench.send_heartbeat()
            frames = []
            for message in bench.messages():
                frames.append(bytes(message.get_msgbuf()))
                if message.get_type() == "HIL_SENSOR":
                    bench.send_controls([0.0] * 4, armed=False, time_usec=message.time_usec)
                    if message.time_usec >= 1_000_000:
                        return frames

    assert wire(7) == wire(7)
    assert wire(7) != wire(8)


def test_hitl_sends_nothing_but_heartbeats_to_a_board_without_the_hil_flag():
    with Bench("hover_5m", fc="serial", profile="px4-hitl") as bench:
        beats = [bench.recv("HEARTBEAT") for _ in range(5)]  # faster than 1 Hz until somebody answers
        assert len(beats) == 5
        deadline_s, kinds = time.monotonic() + 2.0, set()
        while time.monotonic() < deadline_s:
            bench.send_heartbeat(base_mode=mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)
            try:
                kinds.add(bench.recv(timeout_s=0.2).get_type())
            except TimeoutError:
                pass
        assert kinds <= {"HEARTBEAT"}
        bench.send_heartbeat()
        assert bench.recv_sensor().time_usec > 0
