"""A stand-in for PX4, for tests: not PX4, and nothing here proves that PX4 flies.

It reads the parameter file that `hopbench px4-params` wrote and flies by the structure that PX4 publishes: position P,
velocity PID, thrust vector to attitude, attitude P, rate PID, servo = torque over its scale; throttle ramp from 0 at
take-off, landing detected in three stages by low thrust and low speed, disarming after that. On the wire it is PX4 in
software as observed: dials in by TCP, says SET_MESSAGE_INTERVAL and HEARTBEAT first, answers nothing for the first
0.2 s, then one HIL_ACTUATOR_CONTROLS per HIL_SENSOR with its time, all zero while disarmed, motors in steps of 0.001 and
servos of 0.002. What it does not have: EKF2 (a complementary filter on the same messages stands for it), the hover
throttle estimator, failsafes and pre-flight checks.

State comes from HIL_SENSOR, HIL_GPS and DISTANCE_SENSOR alone, never from HIL_STATE_QUATERNION.

    mission = Hop(height_m=10, hold_s=8)                        # or UdpApi(port): `tools/px4_mission.py` commands it
    Px4Like(read_parameters("hopbench_sitl.params")).fly("127.0.0.1", 4560, mission)
"""

import math
import os
import socket

os.environ["MAVLINK20"] = "1"
os.environ["MAVLINK_DIALECT"] = "common"
from pymavlink.dialects.v20 import common as mavlink  # noqa: E402

G = 9.80665
BOOT_GAP_US = 200_000
ALIGNMENT_S = 3.0
# Firmware defaults of what the parameter file leaves alone.
DEFAULTS = {"LNDMC_Z_VEL_MAX": 0.25, "LNDMC_XY_VEL_MAX": 1.5, "LNDMC_ROT_MAX": 20.0, "LNDMC_TRIG_TIME": 1.0}
DEFAULTS |= {"MPC_THR_XY_MARG": 0.3, "IMU_GYRO_CUTOFF": 40.0, "IMU_DGYRO_CUTOFF": 30.0, "MPC_VELD_LP": 5.0}
# Modes: main and sub number.
HOLD, TAKEOFF, LAND, OFFBOARD = (4, 3), (4, 2), (4, 6), (6, 0)


def read_parameters(path):
    """Name to number, with PX4's types, of a QGroundControl parameter file."""
    parameters = dict(DEFAULTS)
    for line in open(path, encoding="utf-8"):
        if line.startswith("#") or not line.strip():
            continue
        vehicle, component, name, value, kind = line.rstrip("\n").split("\t")
        assert (vehicle, component) == ("1", "1") and len(name) <= 16, line
        parameters[name] = {"6": int, "9": float}[kind](value)
    return parameters


def clamp(value, low, high):
    return max(low, min(high, value))


def add(a, b, k=1.0):
    return [x + k * y for x, y in zip(a, b)]


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def product(p, q):
    (a, b, c, d), (e, f, g, h) = p, q
    return [
        a * e - b * f - c * g - d * h, a * f + b * e + c * h - d * g,
        a * g - b * h + c * e + d * f, a * h + b * g - c * f + d * e,
    ]


def turned(q, v):
    """Body to world."""
    t = [2.0 * x for x in cross(q[1:], v)]
    return add(add(v, t, q[0]), cross(q[1:], t))


def between(x, x0, x1, y0, y1):
    """Linear from (x0, y0) to (x1, y1), constant outside."""
    return y0 + (y1 - y0) * clamp((x - x0) / (x1 - x0), 0.0, 1.0)


class Estimator:
    """Attitude from the gyroscope, levelled and turned north at rest; velocity and position of the inertial unit from
    the accelerometer, corrected by HIL_GPS and barometer; all told at the centre of mass, NED, from where it stood."""

    def __init__(self, parameters, declination_rad):
        self.arm = {s: [parameters[f"EKF2_{s}_POS_{a}"] for a in "XYZ"] for s in ("IMU", "GPS")}
        self.declination_rad, self.count, self.gps_count, self.last_us = declination_rad, 0, 0, None
        self.force, self.field, self.bias, self.pressure = [0.0] * 3, [0.0] * 3, [0.0] * 3, 0.0
        self.rate, self.q, self.v, self.p = [0.0] * 3, [1.0, 0.0, 0.0, 0.0], [0.0] * 3, [0.0] * 3
        self.acceleration, self.trim, self.origin = [0.0] * 3, [0.0] * 3, [0.0] * 3
        self.derivative_s, self.derivative, self.last_velocity = 1.0 / (2 * math.pi * parameters["MPC_VELD_LP"]), [0.0] * 3, [0.0] * 3
        self.range_rest_m, self.range_m, self.range_us = None, None, 0
        self.ready = self.moving = False

    def on_sensor(self, m):
        dt = (m.time_usec - self.last_us) * 1e-6 if self.last_us else 0.004
        self.last_us = m.time_usec
        gyro, force = [m.xgyro, m.ygyro, m.zgyro], [m.xacc, m.yacc, m.zacc]
        if not self.moving:  # at rest: means
            self.count += 1
            k = 1.0 / min(self.count, 1000)
            self.bias, self.force = add(self.bias, add(gyro, self.bias, -1.0), k), add(self.force, add(force, self.force, -1.0), k)
            if m.fields_updated & 0x1C0:
                self.field = add(self.field, add([m.xmag, m.ymag, m.zmag], self.field, -1.0), 0.02)
            if m.fields_updated & 0x1A00 == 0x1A00:
                self.pressure += (m.abs_pressure - self.pressure) * (0.02 if self.pressure else 1.0)
            self.rate, self.v, self.p = add(gyro, self.bias, -1.0), [0.0] * 3, [0.0] * 3
            self.level()
            self.p = turned(self.q, self.arm["IMU"])
            self.ready = self.count * dt > ALIGNMENT_S and self.gps_count > 5
            return dt
        self.rate = add(gyro, self.bias, -1.0)
        half = [0.5 * dt * w for w in self.rate]
        self.q = product(self.q, [1.0, *half])
        size = math.sqrt(sum(x * x for x in self.q))
        self.q = [x / size for x in self.q]
        self.acceleration = add(add(turned(self.q, force), [0.0, 0.0, G]), self.trim)
        self.p = add(self.p, add(self.v, self.acceleration, 0.5 * dt), dt)
        self.v = add(self.v, self.acceleration, dt)
        if m.fields_updated & 0x1A00 == 0x1A00:  # 8.3 m a hPa near the ground
            self.p[2] += 0.01 * (8.33 * (m.abs_pressure - self.pressure) + turned(self.q, self.arm["IMU"])[2] - self.p[2])
        change = [d / dt for d in add(self.velocity, self.last_velocity, -1.0)]
        self.last_velocity = self.velocity
        self.derivative = add(self.derivative, add(change, self.derivative, -1.0), 1.0 - math.exp(-dt / self.derivative_s))
        return dt

    def level(self):
        fx, fy, fz = self.force
        size = math.sqrt(fx * fx + fy * fy + fz * fz) or 1.0
        roll, pitch = math.atan2(-fy, -fz), math.asin(clamp(fx / size, -1.0, 1.0))
        tilt = product([math.cos(pitch / 2), 0, math.sin(pitch / 2), 0], [math.cos(roll / 2), math.sin(roll / 2), 0, 0])
        north, east, _ = turned(tilt, self.field)
        yaw = self.declination_rad - math.atan2(east, north)
        self.q = product([math.cos(yaw / 2), 0, 0, math.sin(yaw / 2)], tilt)
        # What is left over is taken as bias: the vehicle does stand still.
        self.trim = [-x for x in add(turned(self.q, self.force), [0.0, 0.0, G])]

    def on_gps(self, m):
        self.gps_count += 1
        scale = 6_371_000.0 * math.pi / 180.0 * 1e-7
        place = [m.lat * scale, m.lon * scale * math.cos(math.radians(m.lat * 1e-7)), -m.alt * 1e-3]
        antenna = turned(self.q, self.arm["GPS"])
        if not self.moving:
            self.origin = add(self.origin, add(add(place, antenna, -1.0), self.origin, -1.0), 1.0 / min(self.gps_count, 50))
            return
        between_arms = add(self.arm["GPS"], self.arm["IMU"], -1.0)
        seen_p = add(add(place, self.origin, -1.0), turned(self.q, between_arms), -1.0)
        seen_v = add([m.vn * 0.01, m.ve * 0.01, m.vd * 0.01], turned(self.q, cross(self.rate, between_arms)), -1.0)
        dp, dv = add(seen_p, self.p, -1.0), add(seen_v, self.v, -1.0)
        self.p = [p + k * d for p, d, k in zip(self.p, dp, (0.1, 0.1, 0.03))]
        self.v, self.trim = add(self.v, dv, 0.25), add(self.trim, dv, 0.03)

    def on_range(self, m):
        self.range_m, self.range_us = m.current_distance * 0.01, self.last_us or 0
        if not self.moving:
            self.range_rest_m = self.range_m

    @property
    def position(self):
        return add(self.p, turned(self.q, self.arm["IMU"]), -1.0)

    @property
    def velocity(self):
        return add(self.v, turned(self.q, cross(self.rate, self.arm["IMU"])), -1.0)

    @property
    def yaw(self):
        w, x, y, z = self.q
        return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))

    @property
    def height_m(self):
        """Above the ground where it stood: by the altimeter while that speaks."""
        fresh = self.range_m is not None and self.range_rest_m is not None and (self.last_us or 0) - self.range_us < 500_000
        return self.range_m - self.range_rest_m if fresh else -self.position[2]


class Axis:
    """A setpoint that moves within limits of speed, acceleration and jerk."""

    def __init__(self, x):
        self.x, self.v, self.a = x, 0.0, 0.0

    def step(self, wanted_v, a_low, a_high, jerk, dt):
        wanted_a = clamp(3.0 * (wanted_v - self.v), -a_low, a_high)
        self.a += clamp(wanted_a - self.a, -jerk * dt, jerk * dt)
        self.v += self.a * dt
        self.x += self.v * dt

    def toward(self, target, v_low, v_high, a_low, a_high, jerk, dt):
        gap = target - self.x
        braking = math.copysign(math.sqrt(a_low * abs(gap)), gap)  # half of the deceleration allowed
        self.step(clamp(min(abs(braking), abs(0.8 * gap)) * (1 if gap > 0 else -1), -v_low, v_high), a_low, a_high, jerk, dt)


class LowPass:
    """Second-order Butterworth filter at the rate of the samples, as PX4 filters its gyroscope."""

    def __init__(self, cutoff_hz, rate_hz=250.0):
        k = math.tan(math.pi * min(cutoff_hz, 0.45 * rate_hz) / rate_hz)
        scale = 1.0 + math.sqrt(2.0) * k + k * k
        self.b, self.a1, self.a2 = k * k / scale, 2.0 * (k * k - 1.0) / scale, (1.0 - math.sqrt(2.0) * k + k * k) / scale
        self.d1 = self.d2 = 0.0

    def step(self, x):
        d = x - self.a1 * self.d1 - self.a2 * self.d2
        y = self.b * (d + 2.0 * self.d1 + self.d2)
        self.d1, self.d2 = d, self.d1
        return y


class Steady:
    """True once its condition has held for a time."""

    def __init__(self, for_s):
        self.for_s, self.held_s = for_s, 0.0

    def update(self, holds, dt):
        self.held_s = self.held_s + dt if holds else 0.0
        return self.held_s >= self.for_s


class Px4Like:
    """One flight controller; `commander.step(self)` is called once per sample and may arm, take off and land."""

    def __init__(self, parameters, declination_deg=-7.4):
        self.p = parameters
        self.estimate = Estimator(parameters, math.radians(declination_deg))
        self.armed, self.mode, self.landed, self.now_s, self.armed_s, self.landed_s = False, HOLD, True, 0.0, None, None
        self.target, self.target_yaw, self.throttle, self.flown = [0.0] * 3, 0.0, 0.0, False
        self.events, self.answer = [], [0.0] * 16
        self.reset()

    def reset(self):
        self.ramp, self.airborne, self.axes = None, False, None
        self.v_int, self.rate_int, self.saturated = [0.0] * 3, [0.0] * 3, [0.0] * 3
        self.gyro, self.gyro_rate, self.last_gyro = [0.0] * 3, [0.0] * 3, [0.0] * 3
        self.filters = [LowPass(self.p["IMU_GYRO_CUTOFF"]) for _ in range(3)]
        third = self.p["LNDMC_TRIG_TIME"] / 3.0
        self.contact, self.maybe, self.down = Steady(third), Steady(third), Steady(third)
        self.in_contact = self.maybe_landed = False

    # ------------------------------------------------------------------------------------------- commands

    def say(self, text):
        self.events.append((self.now_s, text))

    def arm(self):
        if not self.armed and self.estimate.ready:
            self.reset()
            self.armed, self.armed_s, self.landed, self.landed_s = True, self.now_s, True, None
            self.estimate.moving = True
            self.target, self.target_yaw = list(self.estimate.position), self.estimate.yaw
            self.say("Armed by external command")
        return self.armed

    def disarm(self, why):
        self.armed, self.estimate.moving = False, False
        self.estimate.count = 0
        self.say(why)

    def take_off(self, height_m):
        self.mode, self.target = TAKEOFF, [*self.estimate.position[:2], -height_m]

    def land(self):
        self.mode = LAND
        self.say("Landing at current position")

    # -------------------------------------------------------------------------------------------- control

    def trajectory(self, dt):
        """Position and velocity wanted, and the greatest speed up."""
        p, here = self.p, self.estimate.position
        if self.axes is None:
            self.axes = [Axis(x) for x in here]
        if self.mode == OFFBOARD:  # setpoints go straight to the controller
            self.axes = [Axis(x) for x in (self.target if dt else here)]
            return [a.x for a in self.axes], [0.0] * 3, [0.0] * 3, p["MPC_Z_VEL_MAX_UP"]
        north, east, down = self.axes
        jerk, height_m = p["MPC_JERK_AUTO"], self.estimate.height_m
        lateral_error = math.hypot(north.x - here[0], east.x - here[1])
        running = dt if lateral_error < p["MPC_XY_ERR_MAX"] else 0.0
        for axis, target in zip((north, east), self.target):
            axis.toward(target, p["MPC_XY_CRUISE"], p["MPC_XY_CRUISE"], p["MPC_ACC_HOR"], p["MPC_ACC_HOR"], jerk, running)
        up, sink = p["MPC_Z_V_AUTO_UP"], p["MPC_Z_V_AUTO_DN"]
        low, high = p["MPC_LAND_ALT2"], p["MPC_LAND_ALT1"]
        if self.mode == LAND:
            speed = between(height_m, low, high, p["MPC_LAND_SPEED"], sink)
            down.step(speed, p["MPC_ACC_UP_MAX"], p["MPC_ACC_DOWN_MAX"], jerk, running)
        else:
            if self.mode == TAKEOFF:
                up = between(height_m, low, high, p["MPC_TKO_SPEED"], up)
            down.toward(self.target[2], up, sink, p["MPC_ACC_UP_MAX"], p["MPC_ACC_DOWN_MAX"], jerk, running)
            if self.mode == TAKEOFF and abs(here[2] - self.target[2]) < 0.5 and abs(down.v) < 0.2:
                self.mode = HOLD
        return [a.x for a in self.axes], [a.v for a in self.axes], [a.a for a in self.axes], up

    def thrust(self, dt):
        """Thrust vector in shares of the rated one, NED; None on the ground at rest."""
        p = self.p
        if self.now_s - self.armed_s < p["COM_SPOOLUP_TIME"] or (self.landed and self.mode == HOLD):
            return None
        if self.ramp is None:
            self.ramp = 0.0
            self.say("Takeoff detected")
        self.ramp = min(1.0, self.ramp + dt / max(dt, p["MPC_TKO_RAMP_T"]))
        flying = self.ramp >= 1.0
        held = dt if flying else 0.0  # the trajectory waits for the ramp
        x, v, a, up = self.trajectory(held)
        start = -G / p["MPC_Z_VEL_P_ACC"]
        up = up if flying else start + self.ramp * (p["MPC_TKO_SPEED"] - start)
        least = p["MPC_THR_MIN"] if flying else 0.0
        self.landing(dt)
        if self.maybe_landed:
            return [0.0, 0.0, -1e-3]
        if self.in_contact:
            self.v_int = [0.0] * 3
            return [0.0, 0.0, -least]
        here, speed = self.estimate.position, self.estimate.velocity
        xy = [w + p["MPC_XY_P"] * (t - h) for w, t, h in zip(v[:2], x, here)]
        size = math.hypot(*xy)
        xy = [w * min(1.0, p["MPC_XY_VEL_MAX"] / size) if size else w for w in xy]
        z = clamp(v[2] + p["MPC_Z_P"] * (x[2] - here[2]), -up, p["MPC_Z_VEL_MAX_DN"])
        error = [w - s for w, s in zip([*xy, z], speed)]
        gains = [("XY", 0), ("XY", 1), ("Z", 2)]
        wanted = [
            a[i] * (flying or 0) + p[f"MPC_{n}_VEL_P_ACC"] * error[i] + self.v_int[i]
            - p[f"MPC_{n}_VEL_D_ACC"] * self.estimate.derivative[i] for n, i in gains
        ]
        if not flying:
            wanted[:2] = [0.0, 0.0]
        hover, most = p["MPC_THR_HOVER"], p["MPC_THR_MAX"]
        z_axis = [-wanted[0], -wanted[1], G]
        tilt_max = math.radians(p["MPC_TILTMAX_LND"] if self.mode == LAND and self.estimate.height_m < 1.0 else p["MPC_TILTMAX_AIR"])
        tilt = math.hypot(*z_axis[:2])
        if tilt > G * math.tan(tilt_max):
            z_axis[:2] = [w * G * math.tan(tilt_max) / tilt for w in z_axis[:2]]
        size = math.sqrt(sum(w * w for w in z_axis))
        z_axis = [w / size for w in z_axis]
        collective = clamp((hover - wanted[2] * hover / G) / z_axis[2], least, most)
        vertical = collective * z_axis[2]
        if not ((vertical <= least and error[2] > 0) or (vertical >= most - 1e-3 and error[2] < 0)):
            self.v_int[2] = clamp(self.v_int[2] + p["MPC_Z_VEL_I_ACC"] * error[2] * dt, -G, G)
        if flying and tilt <= G * math.tan(tilt_max):
            self.v_int[:2] = [i + p["MPC_XY_VEL_I_ACC"] * e * dt for i, e in zip(self.v_int, error)]
        return [-collective * w for w in z_axis]

    def landing(self, dt):
        """Ground contact, perhaps landed, landed."""
        p, v = self.p, self.estimate.velocity
        least, span = p["MPC_THR_MIN"], p["MPC_THR_HOVER"] - p["MPC_THR_MIN"]
        still = abs(v[2]) < p["LNDMC_Z_VEL_MAX"] * (2.5 if self.maybe_landed else 1.0)
        still = still and math.hypot(*v[:2]) < p["LNDMC_XY_VEL_MAX"] and self.ramp >= 1.0
        low = self.throttle <= least + 0.3 * span
        self.in_contact = self.contact.update(still and low and (self.mode == LAND or self.maybe_landed), dt)
        turning = math.hypot(*self.estimate.rate[:2]) > math.radians(p["LNDMC_ROT_MAX"]) * (2.5 if self.maybe_landed else 1.0)
        self.maybe_landed = self.maybe.update(self.in_contact and not turning and self.throttle <= least + 0.1 * span, dt)
        if self.down.update(self.maybe_landed, dt) and not self.landed:
            self.landed, self.landed_s = True, self.now_s
            self.say("Landing detected")

    def torque(self, thrust, dt):
        """Torque setpoints about x, y, z."""
        p, q = self.p, self.estimate.q
        size = math.sqrt(sum(t * t for t in thrust))
        down = [-t / size for t in thrust] if size > 1e-2 else [0.0, 0.0, 1.0]
        # The least turn that brings z to where the thrust wants it, after the heading.
        tip = [1.0 + down[2], -down[1], down[0], 0.0]
        norm = math.sqrt(sum(t * t for t in tip))
        heading = [math.cos(self.target_yaw / 2), 0.0, 0.0, math.sin(self.target_yaw / 2)]
        error = product([q[0], -q[1], -q[2], -q[3]], product([t / norm for t in tip], heading))
        sign = 2.0 if error[0] >= 0 else -2.0
        out, names = [], [("ROLL", "RR"), ("PITCH", "PR"), ("YAW", "YR")]
        d_share = 1.0 - math.exp(-2 * math.pi * p["IMU_DGYRO_CUTOFF"] * dt)
        for i, (name, short) in enumerate(names):
            self.gyro[i] = self.filters[i].step(self.estimate.rate[i])
            self.gyro_rate[i] += d_share * ((self.gyro[i] - self.last_gyro[i]) / dt - self.gyro_rate[i])
            self.last_gyro[i] = self.gyro[i]
            most = math.radians(p[f"MC_{name}RATE_MAX"])
            rate_error = clamp(sign * p[f"MC_{name}_P"] * error[i + 1], -most, most) - self.gyro[i]
            torque = p[f"MC_{name}RATE_P"] * rate_error + self.rate_int[i] - p[f"MC_{name}RATE_D"] * self.gyro_rate[i]
            if self.airborne and not (abs(torque) > 1.0 and torque * rate_error > 0):
                limit = p[f"MC_{short}_INT_LIM"]
                self.rate_int[i] = clamp(self.rate_int[i] + p[f"MC_{name}RATE_I"] * rate_error * dt, -limit, limit)
            out.append(torque)
        return out

    def allocate(self, throttle, torque):
        """controls[16]; functions 101 and on are motors, 201 and on servos. The custom airframe of the parameter file."""
        p = self.p
        assert p["CA_AIRFRAME"] == 9 and p["CA_ROTOR0_PX"] == 0.0 and p["CA_ROTOR0_AZ"] == -1.0
        servos = [
            sum(torque[a] / p[f"CA_SV_CS{s}_TRQ_{c}"] for a, c in enumerate("RPY") if abs(p[f"CA_SV_CS{s}_TRQ_{c}"]) > 0.05)
            for s in range(p["CA_SV_CS_COUNT"])
        ]
        motors = [throttle]
        for r in range(1, p["CA_ROTOR_COUNT"]):  # thrusters about z: pseudo-inverse of a row of ±k
            k = p[f"CA_ROTOR{r}_PX"] * p[f"CA_ROTOR{r}_AY"] * p[f"CA_ROTOR{r}_CT"]
            motors.append(torque[2] / (k * (p["CA_ROTOR_COUNT"] - 1)))
        controls = [0.0] * 16
        for channel in range(16):
            function = p.get(f"PWM_MAIN_FUNC{channel + 1}", 0)
            if 101 <= function <= 112:
                motor = round(clamp(motors[function - 101], 0.0, 1.0), 3)
                controls[channel] = motor if motor >= 0.02 else 0.0
            elif 201 <= function <= 208:
                controls[channel] = round(clamp(servos[function - 201], -1.0, 1.0) / 0.002) * 0.002
        return controls

    def controls(self, sensor):
        """The answer to one HIL_SENSOR."""
        dt = self.estimate.on_sensor(sensor)
        self.now_s = sensor.time_usec * 1e-6
        if self.armed and self.landed and self.landed_s is not None and self.now_s - self.landed_s > self.p["COM_DISARM_LAND"]:
            self.disarm("Disarmed by landing")
            self.flown = True
        if self.armed and not self.flown and self.ramp is None and self.now_s - self.armed_s > self.p["COM_DISARM_PRFLT"]:
            self.disarm("Disarmed by auto preflight disarming")
        if not self.armed:
            self.throttle = 0.0
            return [0.0] * 16
        thrust = self.thrust(dt) if self.landed_s is None else None
        if thrust is None:
            self.throttle = 0.0
            return self.allocate(0.0, [0.0] * 3)
        if self.estimate.height_m > 0.3 and not self.airborne:
            self.airborne, self.landed = True, False
        torque = self.torque(thrust, dt)
        self.throttle = math.sqrt(sum(t * t for t in thrust))
        return self.allocate(self.throttle, torque)

    # --------------------------------------------------------------------------------------------- the wire

    def fly(self, host, port, commander, silence_s=20.0):
        """Plays PX4 at the simulator's TCP port until that closes, or is silent."""
        with socket.create_connection((host, port), timeout=silence_s) as link:
            link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            wire = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)

            def send(message):
                link.sendall(message.pack(wire))

            send(mavlink.MAVLink_command_long_message(0, 0, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 0, 115, 5000, 0, 0, 0, 0, 0))
            send(mavlink.MAVLink_heartbeat_message(0, mavlink.MAV_AUTOPILOT_PX4, 0, 0, 0, 3))
            first_us = None
            try:
                while data := link.recv(65536):
                    for m in wire.parse_buffer(data) or []:
                        if m.get_type() == "HIL_SENSOR" and m.id == 0:
                            first_us = first_us or m.time_usec
                            self.answer = self.controls(m)
                            commander.step(self)
                            if m.time_usec - first_us > BOOT_GAP_US:
                                mode = 129 if self.armed else 1
                                send(mavlink.MAVLink_hil_actuator_controls_message(m.time_usec, self.answer, mode, 1))
                        elif m.get_type() == "HIL_GPS":
                            self.estimate.on_gps(m)
                        elif m.get_type() == "DISTANCE_SENSOR":
                            self.estimate.on_range(m)
            except OSError:  # the bench closed the link, or says nothing
                pass


class Hop:
    """Arm when aligned, take off, hold, land."""

    def __init__(self, height_m, hold_s):
        self.height_m, self.hold_s, self.top_s, self.stage = height_m, hold_s, None, "pad"

    def step(self, fc):
        if self.stage == "pad" and fc.arm():
            fc.take_off(self.height_m)
            self.stage = "up"
        elif self.stage == "up" and fc.mode == HOLD:
            self.stage, self.top_s = "hold", fc.now_s
        elif self.stage == "hold" and fc.now_s - self.top_s > self.hold_s:
            fc.land()
            self.stage = "down"


class UdpApi:
    """PX4's API link, as much of it as `tools/px4_mission.py` uses: telemetry to a port, commands from it. Times are
    simulated, so it serves at any speed; while it has heard no ground station it does not arm."""

    def __init__(self, port):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setblocking(False)
        self.to = ("127.0.0.1", port)
        self.wire = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self.samples, self.said, self.height_m, self.ground_stations = 0, 0, 10.0, 0
        self.setpoint_s = -math.inf

    def send(self, name, *values):
        try:
            self.socket.sendto(getattr(mavlink, f"MAVLink_{name}_message")(*values).pack(self.wire), self.to)
        except OSError:  # nobody listens yet
            pass

    def step(self, fc):
        self.samples += 1
        while True:
            try:
                data = self.socket.recv(65536)
            except OSError:
                break
            for m in self.wire.parse_buffer(data) or []:
                getattr(self, "on_" + m.get_type().lower(), lambda m, fc: None)(m, fc)
        if fc.mode == OFFBOARD and fc.now_s - self.setpoint_s > fc.p["COM_OF_LOSS_T"]:
            fc.say("Offboard control lost")
            fc.land()
        if self.samples % 25 == 0 or len(fc.events) > self.said:  # 10 Hz, and what is said at once
            self.tell(fc)

    def tell(self, fc):
        ms, e = int(fc.now_s * 1e3), fc.estimate
        (x, y, z), v = e.position, e.velocity
        self.send("local_position_ned", ms, x, y, z, *v)
        self.send("global_position_int", ms, 0, 0, int((3.0 - z) * 1e3), int(-z * 1e3), 0, 0, 0, 0)
        self.send("attitude", ms, 0, 0, e.yaw, *e.rate)
        mode = 1 | (128 if fc.armed else 0)
        self.send("heartbeat", 2, mavlink.MAV_AUTOPILOT_PX4, mode, fc.mode[0] << 16 | fc.mode[1] << 24, 4, 3)
        healthy = 0x10000000 if e.ready and self.ground_stations else 0
        self.send("sys_status", 0, 0, healthy, 0, 16000, -1, 70, 0, 0, 0, 0, 0, 0)
        self.send("extended_sys_state", 0, 1 if fc.landed else 2)
        for _, text in fc.events[self.said :]:
            self.send("statustext", 6, text.encode())
        self.said = len(fc.events)

    def on_heartbeat(self, m, fc):
        self.ground_stations += m.type == mavlink.MAV_TYPE_GCS

    def on_param_set(self, m, fc):
        if m.param_id == "MIS_TAKEOFF_ALT":
            self.height_m = m.param_value
            self.send("param_value", b"MIS_TAKEOFF_ALT", m.param_value, 9, 1, 0)

    def on_set_position_target_local_ned(self, m, fc):
        self.setpoint_s = fc.now_s
        if fc.mode == OFFBOARD:
            fc.target, fc.target_yaw = [m.x, m.y, m.z], m.yaw

    def on_command_long(self, m, fc):
        done = True
        if m.command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
            done = bool(self.ground_stations) and fc.arm()
        elif m.command == mavlink.MAV_CMD_NAV_TAKEOFF:
            done = fc.armed
            fc.take_off(self.height_m)
        elif m.command == mavlink.MAV_CMD_NAV_LAND:
            fc.land()
        elif m.command == mavlink.MAV_CMD_DO_SET_MODE and m.param2 == OFFBOARD[0]:
            done = fc.now_s - self.setpoint_s < fc.p["COM_OF_LOSS_T"]
            fc.mode = OFFBOARD if done else fc.mode
        else:
            done = False
        self.send("command_ack", m.command, mavlink.MAV_RESULT_ACCEPTED if done else mavlink.MAV_RESULT_TEMPORARILY_REJECTED)
