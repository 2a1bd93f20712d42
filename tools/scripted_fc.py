"""A flight controller in one page: flies `hover_5m` on profile `generic`, valve throttle, from MAVLink alone.

    hopbench hil scenarios/hover_5m.toml --fc udp-listen:127.0.0.1:14600
    python tools/scripted_fc.py udp:127.0.0.1:14600
Pose from the rig's tracking (ODOMETRY, 50 Hz), rates from HIL_SENSOR; every HIL_SENSOR is answered by one
HIL_ACTUATOR_CONTROLS with its time. Cascade: position P, velocity PI, attitude P, rate P. Body FRD, world NED.
"""

import os
import sys
import time

os.environ["MAVLINK20"] = "1"
from pymavlink import mavutil  # noqa: E402

# Steady working points of the reference vehicle: thrust [N], valve angle [deg]; integrators take up wear and port radius.
THRUST_TO_VALVE = [(300, 15.022), (450, 17.878), (650, 21.451), (850, 25.040), (1000, 28.888)]
G, FULL_OPEN_DEG, GIMBAL_LIMIT_RAD, ISP_S = 9.80665, 78.84, 0.12217, 193.0
INERTIA_KG_M2, COM_ABOVE_PIVOT_M, HOVER_M, HOVER_S = 22.0, 0.40, 5.0, 5.0
PHASES = ["pad", "armed", "lit", "climb", "hover", "descend", "down", "disarmed"]


def clamp(value, limit):
    return max(-limit, min(limit, value))


def valve_control(thrust_n):
    """controls[0] for a thrust within the table: linear between working points."""
    for (t0, a0), (t1, a1) in zip(THRUST_TO_VALVE, THRUST_TO_VALVE[1:]):
        if thrust_n <= t1:
            return (a0 + (a1 - a0) * (thrust_n - t0) / (t1 - t0)) / FULL_OPEN_DEG


class Pilot:
    """From ODOMETRY and HIL_SENSOR to (armed, controls)."""

    def __init__(self):
        self.mass_kg, self.last_s, self.phase, self.since_s = 73.2, None, "pad", None
        self.position, self.velocity, self.attitude, self.rest_down = [0.0] * 3, [0.0] * 3, [0.0] * 3, None
        self.rate_bias, self.accel_trim = [0.0] * 3, [0.0] * 3

    def on_odometry(self, m):
        q0, q1, q2, q3 = m.q
        x, y, z = (0, 0, 0) if m.child_frame_id == 1 else (2 * q1, 2 * q2, 2 * q3)  # 1: NED; else body, tilted a little
        self.velocity = [m.vx - z * m.vy + y * m.vz, m.vy + z * m.vx - x * m.vz, m.vz - y * m.vx + x * m.vy]
        self.position = [m.x, m.y, m.z]
        measured = (2 * (q0 * q1 + q2 * q3), 2 * (q0 * q2 - q1 * q3), 2 * (q0 * q3 + q1 * q2))  # small angles
        self.attitude = [a + 0.3 * (b - a) for a, b in zip(self.attitude, measured)]
        if self.phase == "pad":
            self.rest_down = m.z if self.rest_down is None else self.rest_down + 0.05 * (m.z - self.rest_down)

    def controls(self, sensor):
        now_s = sensor.time_usec * 1e-6
        dt_s = now_s - self.last_s if self.last_s else 0.004
        self.last_s, self.since_s = now_s, self.since_s or now_s  # the first sample starts the first phase
        in_phase_s = now_s - self.since_s
        height = self.rest_down - self.position[2] if self.rest_down is not None else 0.0
        finished = {
            "pad": in_phase_s > 2.5 and self.rest_down is not None,
            "armed": in_phase_s > 1.5,  # the isolation valve opens in 1 s
            "lit": in_phase_s > 1.2,  # at least thrust: delay 0.3 s, the flame rises in 0.6 s
            "climb": height > HOVER_M - 0.3, "hover": in_phase_s > HOVER_S, "down": in_phase_s > 1.0,
            "descend": height < 0.2 and sensor.zacc < -14.0,  # the legs push
        }
        if finished.get(self.phase):
            self.phase, self.since_s, in_phase_s = PHASES[PHASES.index(self.phase) + 1], now_s, 0.0
            print(f"{now_s:7.3f} s {self.phase}, {height:.2f} m", file=sys.stderr)

        gyro, learning = (sensor.xgyro, sensor.ygyro, sensor.zgyro), 0.01 if self.phase == "pad" else 0.0
        self.rate_bias = [b + learning * (g - b) for b, g in zip(self.rate_bias, gyro)]
        rate = [g - b for g, b in zip(gyro, self.rate_bias)]
        self.attitude = [a + r * dt_s for a, r in zip(self.attitude, rate)]

        if self.phase in ("pad", "armed", "lit", "down", "disarmed"):
            throttle = valve_control(300.0) if self.phase == "lit" else 0.0
            return self.phase not in ("pad", "disarmed"), [throttle, 0.0, 0.0, 0.0]

        # Velocity wanted, then acceleration, then thrust and tilt.
        climb_m_s, sink_m_s = clamp(0.8 * (HOVER_M - height), min(1.5, 0.3 + in_phase_s)), 0.5 if height < 1.2 else 1.2
        down_m_s = sink_m_s if self.phase == "descend" else -climb_m_s
        wanted = [clamp(-0.35 * self.position[0], 0.5), clamp(-0.35 * self.position[1], 0.5), down_m_s]
        error = [w - v for w, v in zip(wanted, self.velocity)]
        self.accel_trim = [clamp(t + k * e * dt_s, 1.5) for t, k, e in zip(self.accel_trim, (0.15, 0.15, 0.6), error)]
        north, east, down = (clamp(k * e + t, 2.0) for k, e, t in zip((0.9, 0.9, 1.8), error, self.accel_trim))
        thrust_n = min(1000.0, max(300.0, self.mass_kg * (G - down)))
        self.mass_kg -= thrust_n / (G * ISP_S) * dt_s

        # Thrust is along -z: pitch down to go north, roll right to go east; nose to north.
        tilt = (clamp(east / G, 0.1), clamp(-north / G, 0.1))
        turn = [clamp(2.2 * (t - a), 0.3) for t, a in zip(tilt, self.attitude)]  # rate wanted
        authority = thrust_n * COM_ABOVE_PIVOT_M / INERTIA_KG_M2 * GIMBAL_LIMIT_RAD  # rad/s2 of a full deflection
        gimbal = [clamp(6.0 * (w - r) / authority, 1.0) for w, r in zip(turn, rate)]
        return True, [valve_control(thrust_n), *gimbal, clamp(-2.0 * self.attitude[2] - 2.5 * rate[2], 1.0)]


def fly(connection):
    """Answers HIL_SENSOR until the bench is silent for 3 s; True when the pilot came down and disarmed."""
    pilot, heartbeat_s, deadline_s = Pilot(), 0.0, time.monotonic() + 30.0
    while time.monotonic() < deadline_s:
        if time.monotonic() > heartbeat_s:  # once a second, faster until the bench answers
            connection.mav.heartbeat_send(9, 0, 32 | (0 if pilot.phase in ("pad", "disarmed") else 128), 0, 4)
            heartbeat_s = time.monotonic() + (1.0 if pilot.last_s else 0.1)
        message = connection.recv_match(type=["ODOMETRY", "HIL_SENSOR"], blocking=True, timeout=0.1)
        deadline_s = time.monotonic() + 3.0 if message else deadline_s
        if message and message.get_type() == "ODOMETRY":
            pilot.on_odometry(message)
        elif message:
            armed, controls = pilot.controls(message)
            mode = 1 | (128 if armed else 0)
            echo = message.time_usec // 1000 % 1000 / 1000  # the last channel: by it the bench measures the round trip
            connection.mav.hil_actuator_controls_send(message.time_usec, controls + [0.0] * 11 + [echo], mode, 1)
    return pilot.phase == "disarmed"


if __name__ == "__main__":
    kind, place, last = sys.argv[1].split(":")  # udp:HOST:PORT, udp-listen:…, tcp:…, tcp-listen:…, serial:PATH:BAUD
    names = {"udp": "udpout:", "udp-listen": "udpin:", "tcp": "tcp:", "tcp-listen": "tcpin:"}
    device, baud = (place, int(last)) if kind == "serial" else (f"{names[kind]}{place}:{last}", 0)
    landed = fly(mavutil.mavlink_connection(device, baud=baud, source_system=1, source_component=1))
    sys.exit(0 if landed else "the vehicle did not come down")
