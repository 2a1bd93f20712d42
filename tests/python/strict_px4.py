"""A strict PX4 at the end of the link: reads what a simulator sends and names whatever PX4 would refuse, mistrust or mistake.

    strict = StrictPx4("px4-sitl", lockstep=True)
    for message in bench.messages():
        strict.take(message, time.monotonic())
        ...                                            # answer HIL_SENSOR
        strict.answered(sensor.time_usec, armed=False)
    assert not strict.violations, strict.report()

Each violation carries rule, sensor time and the value that broke it; RULES says where a rule comes from. A rule looks at one
thing only, so that one mistake is one kind of violation. Facts: PX4 v1.16.1 on the wire and in its source.
"""

import math
from collections import Counter, deque
from dataclasses import dataclass, field

G = 9.80665
ACCEL_LSB = G / 2048.0  # m/s2, 16-bit FIFO of IMU 0 at +-16 g
GYRO_LSB = math.radians(2000.0 / 32768.0)  # rad/s, the same at +-2000 deg/s
ACCEL, GYRO, MAG, BARO, DIFF = 0x7, 0x38, 0x1C0, 0x1A00, 0x400
GROUPS = (ACCEL, GYRO, MAG, BARO, DIFF)
RESET_MARK = 1 << 31
NOT_A_BIT_OF_THE_MESSAGE = 0xFFFFFFFF & ~0x1FFF
UNKNOWN_COURSE = 65535
EARTH_RADIUS_M = 6_378_137.0

# Rule: what must hold, and why.
RULES = {
    "frame": "every byte belongs to a MAVLink frame with a good checksum; PX4's parser throws the rest away",
    "sequence": "frame numbers of a sender count up by one; a gap is a lost frame, a step back a reordered one",
    "duplicate": "no frame comes twice, under its own number or a new one; a repeated sample counts towards STALE",
    "sender": "the simulator keeps one system and component and is not the flight controller (1/1)",
    "stranger": "only messages that the simulator link of PX4 takes (generic: the bench's own list as well)",
    "heartbeat": "px4-hitl: a HEARTBEAT at least every 3 s (1 Hz by convention); PX4 on USB opens on it and watches it",
    "truth": "px4-hitl: never HIL_STATE_QUATERNION; the board publishes it as its attitude, against its own estimator",
    "time_zero": "time_usec > 0: it becomes the clock, and 0 means no time",
    "time_back": "time_usec never goes back: PX4 logs a timestamp error and stops answering until the old time is passed",
    "time_repeated": "no two samples of one instant: a step of lockstep has one answer",
    "gap": "less than 20 ms of sensor time from sample to sample: the sensor validators' timeout",
    "late": "arrival: SITL polls for 1 s before it says poll timeout; HITL's inertial validators wait 200 ms",
    "old": "px4-hitl stamps on arrival: a sample that left its grid by 200 ms is an old one",
    "outstanding": "lockstep: no HIL_SENSOR while another waits for its answer",
    "sensor_id": "HIL_SENSOR id 0 drives the clock and is the only one here; ids beyond 2 are errors",
    "mask": "fields_updated: accel 0x7 and gyro 0x38 in every sample, mag 0x1C0 and baro 0x1A00 whole or not at all, no bit "
    "beyond 0x1FFF but bit 31 alone; a half group is ignored",
    "first_baro": "barometer within 60 ms of the first sample: its temperature holds for all others, and PX4 boots for that long",
    "finite": "no NaN and no infinity in a field that counts",
    "acceleration": "within +-16 g: beyond it the cast to the 16-bit FIFO overflows",
    "rate": "within +-2000 deg/s, the same",
    "magnetic": "0.1 to 1 gauss: the Earth's field is 0.22 to 0.67; tesla or milligauss fall outside",
    "pressure": "300 to 1100 hPa: pascals pass every pre-flight check of PX4 unnoticed",
    "temperature": "-40 to 85 deg C: kelvin falls outside",
    "pressure_altitude": "pressure_alt is the standard atmosphere's height of abs_pressure, within 5 m",
    "rest": "on the pad the accelerometer means (0, 0, -9.81) m/s2 within 0.6, EKF2's bias limit and more, and the gyro's "
    "scatter is below 0.02 rad/s; +9.81, g or deg/s fall outside",
    "stale": "fewer than 100 equal values in a row, counted over the axes after the FIFO's steps: PX4's validator says STALE",
    "gps_time": "HIL_GPS time_usec counts up",
    "gps_rate": "5 to 10 Hz, a tenth of play",
    "gps_id": "one receiver, id 0",
    "gps_fix": "fix_type 3 or better and 6 satellites or more: EKF2_REQ_NSATS",
    "gps_accuracy": "eph 1..300, epv 1..500: PX4 reads cm of accuracy (EKF2_REQ_EPH 3 m, _EPV 5 m); DOP or metres fall outside "
    "or are 0",
    "gps_place": "latitude and longitude in 1e-7 deg, not 0; altitude in mm within 500 m of the pressure's",
    "gps_speed": "vel is the length of (vn, ve) within 2 cm/s, and the course, where given, their direction within 3 deg",
    "gps_velocity": "over 4 s the place moves by the sum of the velocity: 1.7 m across, 3.1 m up, five sigma of a plain receiver",
    "altimeter": "DISTANCE_SENSOR: orientation 25 (down), least < greatest, reading in cm between them or one beyond with quality 1",
    "altimeter_height": "its change over 4 s is the GNSS height's within 3.5 m; millimetres or metres fall outside",
    "boot_time": "time_boot_ms is the sensors' clock, within 0.1 s",
    "pose": "ODOMETRY: time counts up, finite position, quaternion of length 1",
}

TAKEN = {"HIL_SENSOR", "HIL_GPS", "DISTANCE_SENSOR", "HIL_STATE_QUATERNION", "HEARTBEAT"}
# What the bench says to a controller that is not PX4.
GENERIC_TOO = {"ODOMETRY", "SYSTEM_TIME", "NAMED_VALUE_FLOAT", "COMMAND_ACK", "PARAM_VALUE", "STATUSTEXT"}
TIMELESS = {"HEARTBEAT", "COMMAND_ACK", "PARAM_VALUE", "STATUSTEXT"}

GAP_US, BOOT_US = 20_000, 60_000
LATE_S = {"px4-hitl": 0.2, "px4-sitl": 1.0, "generic": 1.0}
OLD_S = 0.2
HEARTBEAT_S = 3.0
STALE_COUNT = 100
REST_S = 1.0
WINDOW_S = 4.0
ACROSS_M, UP_M, ALTIMETER_M = 1.7, 3.1, 3.5


@dataclass(frozen=True)
class Violation:
    """One broken rule; `time_s` is the last HIL_SENSOR's."""

    rule: str
    time_s: float
    value: object


@dataclass
class Equal:
    """Counts equal values as PX4's DataValidator does: over the axes, from nought at the first that differs."""

    last: tuple = ()
    count: int = 0

    def take(self, values):
        for old, new in zip(self.last, values):
            self.count = self.count + 1 if abs(old - new) < 1e-6 else 0
        self.last = values
        return self.count


@dataclass
class Rest:
    """The first second on the pad."""

    samples: list = field(default_factory=list)
    judged: bool = False

    def take(self, sensor, armed):
        """What is wrong with the mean, once enough samples have come; None otherwise."""
        if self.judged or armed:
            self.judged = True
            return None
        self.samples.append((sensor.time_usec, sensor.xacc, sensor.yacc, sensor.zacc, sensor.xgyro, sensor.ygyro, sensor.zgyro))
        if self.samples[-1][0] - self.samples[0][0] < REST_S * 1e6:
            return None
        self.judged = True
        count = len(self.samples)
        mean = [sum(column) / count for column in zip(*self.samples)]
        scatter = [math.sqrt(sum((s[i] - mean[i]) ** 2 for s in self.samples) / count) for i in (4, 5, 6)]
        good = all(abs(m - e) < 0.6 for m, e in zip(mean[1:4], (0.0, 0.0, -G)))
        good = good and all(abs(m) < 0.1 for m in mean[4:]) and max(scatter) < 0.02
        return None if good else (mean[1:], scatter)


class StrictPx4:
    """Takes messages in the order of their arrival; `violations` holds what was wrong with them."""

    def __init__(self, profile, lockstep=False, realtime=False):
        self.profile, self.lockstep, self.realtime = profile, lockstep, realtime
        self.violations, self.kinds, self.samples = [], Counter(), 0
        self.armed = False
        self.first_us = self.last_us = self.first_answer_s = None
        self.greatest_interval_s = 0.0
        self._read_s = self._outstanding = self._sender = self._sequence = self._earliest_s = None
        self._outstanding_counts = False
        self._last_frame, self._heartbeat_s, self._rest = {}, None, Rest()
        self._equal = {group: Equal() for group in (ACCEL, GYRO, MAG, BARO)}
        self._fixes, self._ranges, self._pressure_altitude_m = deque(), deque(), None
        self._pose_us, self._fix_us, self._baro_seen = 0, 0, False

    # ------------------------------------------------------------------------------------------ what the peer tells

    def answered(self, time_usec, armed, now_s=None):
        """The peer has sent HIL_ACTUATOR_CONTROLS for this time."""
        if self._outstanding == time_usec:
            self._outstanding = None
        self._outstanding_counts = True
        self.armed = armed
        if self.first_answer_s is None:
            self.first_answer_s = now_s

    def report(self, most=12):
        """The violations in words: count by rule, then the first of them."""
        counts = Counter(v.rule for v in self.violations)
        lines = [f"{count} x {rule}: {RULES[rule]}" for rule, count in counts.most_common()]
        lines += [f"  {v.time_s:.3f} s {v.rule}: {v.value}" for v in self.violations[:most]]
        return "\n".join(lines)

    @property
    def simulated_s(self):
        """Sensor time that has been judged."""
        return (self.last_us - self.first_us) * 1e-6 if self.first_us else 0.0

    # ------------------------------------------------------------------------------------------ what comes in

    def take(self, message, arrival_s, read_s=None):
        """One message as pymavlink gives it, and when it came on any steady clock (s): at `arrival_s`, or between that and `read_s`.

        A peer that was kept from the processor knows only the two bounds; late is what was late by both.
        """
        kind = message.get_type()
        self.kinds[kind] += 1
        if kind == "BAD_DATA":
            self._broken("frame", bytes(message.data)[:16].hex())
            return
        if not self._is_new(kind, message):
            return
        allowed = TAKEN | GENERIC_TOO if self.profile == "generic" else TAKEN
        if kind not in allowed:
            self._broken("stranger", kind)
        elif kind == "HIL_SENSOR":
            self._sensor(message, arrival_s, arrival_s if read_s is None else read_s)
        elif kind == "HIL_GPS":
            self._gps(message)
        elif kind == "DISTANCE_SENSOR":
            self._distance(message)
        elif kind == "HIL_STATE_QUATERNION" and self.profile == "px4-hitl":
            self._broken("truth", message.time_usec)
        elif kind == "HEARTBEAT":
            self._heartbeat_s = self._now_s()
        elif kind == "ODOMETRY":
            self._pose(message)

    def _broken(self, rule, value):
        assert rule in RULES, rule
        self.violations.append(Violation(rule, self._now_s(), value))

    def _now_s(self):
        return (self.last_us or 0) * 1e-6

    def _is_new(self, kind, message):
        """The rules of the frame's heading; False for one that came before."""
        frame = bytes(message.get_msgbuf())
        sequence, sender = message.get_seq(), (message.get_srcSystem(), message.get_srcComponent())
        header = 10 if frame[0] == 0xFD else 6
        payload = frame[header : header + frame[1]]
        seen = self._last_frame.get(kind)
        # What carries no time may say the same again, though not under the number of the last frame.
        repeats = seen is not None and (sequence == self._sequence and frame == seen[0] or kind not in TIMELESS and payload == seen[1])
        if repeats:
            self._broken("duplicate", kind)
            if frame != seen[0]:
                self._sequence = sequence
            return False
        self._last_frame[kind] = (frame, payload)
        if self._sender is None and sender != (1, 1):
            self._sender = sender
        if sender != self._sender:
            self._broken("sender", sender)
        elif self._sequence is not None and sequence != (self._sequence + 1) % 256:
            self._broken("sequence", (self._sequence, sequence))
        self._sequence = sequence
        return True

    def _sensor(self, m, arrival_s, read_s):
        if m.fields_updated == RESET_MARK:
            return  # a reset mark: no sensor in it
        if not self._clock(m, arrival_s, read_s):
            return
        self.samples += 1
        if m.id != 0:
            self._broken("sensor_id", m.id)
        updated = m.fields_updated
        halves = [group for group in GROUPS if updated & group not in (0, group)]
        # Absolute pressure (bit 9) belongs to the barometer's three.
        if halves or updated & NOT_A_BIT_OF_THE_MESSAGE or updated & (ACCEL | GYRO) != ACCEL | GYRO:
            self._broken("mask", hex(updated))
        self._baro_seen = self._baro_seen or updated & BARO == BARO
        if not self._baro_seen and m.time_usec - self.first_us >= BOOT_US:
            self._broken("first_baro", m.time_usec)
            self._baro_seen = True
        has = {group: updated & group == group for group in GROUPS}
        self._inertial(m, has)
        if has[MAG]:
            self._magnetic(m)
        if has[BARO]:
            self._barometer(m)
        if self.profile == "px4-hitl" and self._now_s() - (self._heartbeat_s or self.first_us * 1e-6) > HEARTBEAT_S:
            self._broken("heartbeat", self._now_s() - (self._heartbeat_s or 0.0))
            self._heartbeat_s = self._now_s()  # named once for each silence

    def _clock(self, m, arrival_s, read_s):
        """The rules of time; False for a sample whose values no longer count."""
        now_us = m.time_usec
        if self.lockstep and self._outstanding_counts and self._outstanding is not None:
            self._broken("outstanding", (self._outstanding, now_us))
        self._outstanding = now_us
        if now_us == 0:
            self._broken("time_zero", 0)
            return False
        if self.last_us is not None:
            step_us = now_us - self.last_us
            if step_us <= 0:
                self._broken("time_repeated" if step_us == 0 else "time_back", step_us)
                return False
            if step_us >= GAP_US:
                self._broken("gap", step_us)
            interval_s = arrival_s - self._read_s
            self.greatest_interval_s = max(self.greatest_interval_s, interval_s)
            if interval_s > LATE_S[self.profile]:
                self._broken("late", interval_s)
        else:
            self.first_us = now_us
        if self.realtime and self.profile == "px4-hitl":
            # The sample that came soonest after its time says where the grid lies on the peer's clock; a new grid after a gap.
            late = self._read_s is not None and arrival_s - self._read_s > LATE_S[self.profile]
            offset_s, latest_s = arrival_s - now_us * 1e-6, read_s - now_us * 1e-6
            self._earliest_s = latest_s if late or self._earliest_s is None else min(self._earliest_s, latest_s)
            if offset_s - self._earliest_s > OLD_S:
                self._broken("old", offset_s - self._earliest_s)
                self._earliest_s = latest_s
        self.last_us, self._read_s = now_us, read_s
        return True

    def _inertial(self, m, has):
        force, rate = (m.xacc, m.yacc, m.zacc), (m.xgyro, m.ygyro, m.zgyro)
        if not all(map(math.isfinite, force + rate)):
            self._broken("finite", force + rate)
            return
        if has[ACCEL]:
            if max(map(abs, force)) > 16.0 * G:
                self._broken("acceleration", force)
            self._count_equal(ACCEL, tuple(round(f / ACCEL_LSB) for f in force))
        if has[GYRO]:
            if max(map(abs, rate)) > math.radians(2000.0):
                self._broken("rate", rate)
            self._count_equal(GYRO, tuple(round(w / GYRO_LSB) for w in rate))
        wrong = self._rest.take(m, self.armed)
        if wrong:
            self._broken("rest", wrong)

    def _count_equal(self, group, values):
        # Named once for each row of equal values.
        if self._equal[group].take(values) >= STALE_COUNT:
            self._broken("stale", (hex(group), values))
            self._equal[group].count = -1_000_000_000

    def _magnetic(self, m):
        gauss = (m.xmag, m.ymag, m.zmag)
        if not all(map(math.isfinite, gauss)):
            self._broken("finite", gauss)
            return
        if not 0.1 <= math.hypot(*gauss) <= 1.0:
            self._broken("magnetic", gauss)
            return
        self._count_equal(MAG, gauss)

    def _barometer(self, m):
        if not all(map(math.isfinite, (m.abs_pressure, m.pressure_alt, m.temperature))):
            self._broken("finite", (m.abs_pressure, m.pressure_alt, m.temperature))
            return
        self._count_equal(BARO, (m.abs_pressure, m.temperature))
        if not -40.0 <= m.temperature <= 85.0:
            self._broken("temperature", m.temperature)
        if not 300.0 <= m.abs_pressure <= 1100.0:
            self._broken("pressure", m.abs_pressure)
            return
        height_m = 44330.77 * (1.0 - (m.abs_pressure / 1013.25) ** 0.190263)
        if abs(height_m - m.pressure_alt) > 5.0:
            self._broken("pressure_altitude", (height_m, m.pressure_alt))
        self._pressure_altitude_m = height_m

    def _gps(self, m):
        last_us, self._fix_us = self._fix_us, max(self._fix_us, m.time_usec)
        if m.time_usec <= last_us:
            self._broken("gps_time", m.time_usec)
            return
        if last_us and not 90_000 <= m.time_usec - last_us <= 220_000:
            self._broken("gps_rate", m.time_usec - last_us)
        if getattr(m, "id", 0) != 0:
            self._broken("gps_id", m.id)
        if m.fix_type < 3 or not 6 <= m.satellites_visible < 255:
            self._broken("gps_fix", (m.fix_type, m.satellites_visible))
        if not (1 <= m.eph <= 300 and 1 <= m.epv <= 500):
            self._broken("gps_accuracy", (m.eph, m.epv))
        if not self._gps_place_is_good(m):
            self._broken("gps_place", (m.lat, m.lon, m.alt))
            return
        speed = math.hypot(m.vn, m.ve)
        course_cdeg = math.degrees(math.atan2(m.ve, m.vn)) * 100.0
        # Rounding to 1 cm/s turns 30 cm/s by 1.4 deg.
        off_cdeg = abs((m.cog - course_cdeg + 18_000.0) % 36_000.0 - 18_000.0)
        off_course = m.cog != UNKNOWN_COURSE and (m.cog >= 36_000 or speed > 25.0 and off_cdeg > 300.0)
        if abs(speed - m.vel) > 2.0 or off_course:
            self._broken("gps_speed", (m.vel, m.vn, m.ve, m.cog))
        self._fixes.append(m)
        self._judge_motion()

    def _gps_place_is_good(self, m):
        on_earth = 0 < abs(m.lat) <= 900_000_000 and 0 < abs(m.lon) <= 1_800_000_000
        height_m = self._pressure_altitude_m
        return on_earth and (height_m is None or abs(m.alt * 1e-3 - height_m) < 500.0)

    def _judge_motion(self):
        """Place against velocity, once in every window."""
        fixes = list(self._fixes)
        first, last = fixes[0], fixes[-1]
        if last.time_usec - first.time_usec < WINDOW_S * 1e6:
            return
        sums = [0.0, 0.0, 0.0]
        for a, b in zip(fixes, fixes[1:]):
            half_s = 0.5e-6 * (b.time_usec - a.time_usec)
            for i, name in enumerate(("vn", "ve", "vd")):
                sums[i] += (getattr(a, name) + getattr(b, name)) * 0.01 * half_s  # cm/s -> m
        turn_m = math.radians(1e-7) * EARTH_RADIUS_M
        north_m = (last.lat - first.lat) * turn_m
        east_m = (last.lon - first.lon) * turn_m * math.cos(math.radians(first.lat * 1e-7))
        up_m = (last.alt - first.alt) * 1e-3
        if math.hypot(north_m - sums[0], east_m - sums[1]) > ACROSS_M or abs(up_m + sums[2]) > UP_M:
            self._broken("gps_velocity", (north_m, east_m, -up_m, *sums))
        elif len(self._ranges) > 1 and abs(up_m - (self._ranges[-1] - self._ranges[0])) > ALTIMETER_M:
            self._broken("altimeter_height", (up_m, self._ranges[-1] - self._ranges[0]))
        self._fixes = deque([last])
        self._ranges.clear()

    def _distance(self, m):
        if self.last_us and abs(m.time_boot_ms - self.last_us * 1e-3) > 100.0:
            self._broken("boot_time", (m.time_boot_ms, self.last_us))
        valid = m.min_distance <= m.current_distance <= m.max_distance
        said_invalid = getattr(m, "signal_quality", 0) == 1
        if m.orientation != 25 or m.min_distance >= m.max_distance or not (valid or said_invalid):
            self._broken("altimeter", (m.orientation, m.min_distance, m.current_distance, m.max_distance))
        elif valid:
            self._ranges.append(m.current_distance * 0.01)  # cm -> m
        # A reading that failed has no height: the window would compare different spans.
        else:
            self._ranges.clear()

    def _pose(self, m):
        good = m.time_usec > self._pose_us and all(map(math.isfinite, (m.x, m.y, m.z, *m.q)))
        if not good or abs(math.hypot(*m.q) - 1.0) > 1e-3:
            self._broken("pose", (m.time_usec, m.x, m.y, m.z, tuple(m.q)))
        self._pose_us = m.time_usec
