"""Flies a PX4 by MAVLink: arm, take off, hold, land; or offboard steps. A line for each step.

    python tools/px4_mission.py                          # PX4 in software on this machine, 10 m, 8 s of hover
    python tools/px4_mission.py --offboard --height 5    # steps of position, height and heading
    python tools/px4_mission.py --link /dev/ttyACM1 --baud 921600

Times and holds are PX4's own clock (`time_boot_ms`), so the script is right at any speed of simulation. It sends the
ground station's HEARTBEAT, 2 a second, all the while. Exit 0: landed and disarmed, every step within its tolerance.
1: refused, failsafe, or a step missed. 2: wrong arguments, or no pymavlink. 3: no PX4, or it fell silent.
"""

import argparse
import math
import os
import sys
import time

os.environ["MAVLINK20"] = "1"
os.environ["MAVLINK_DIALECT"] = "common"
try:
    from pymavlink import mavutil
    from pymavlink.dialects.v20 import common as mavlink
except ImportError as error:
    print(
        f"{error}: this script needs pymavlink. In a checkout: `cargo xtask python`, then run it with .venv/bin/python; "
        f"elsewhere: {sys.executable} -m pip install pymavlink",
        file=sys.stderr,
    )
    sys.exit(2)

PREARM_BIT = 0x10000000
MODES = {(4, 2): "takeoff", (4, 3): "hold", (4, 6): "land", (6, 0): "offboard", (4, 5): "return", (4, 4): "mission"}
POSITION_AND_YAW = 0b100111111000
STEP_TOLERANCE_M, STEP_TOLERANCE_DEG = 0.5, 10.0
STEPS = ("east", "back", "higher", "lower", "turn")
ON_GROUND = mavlink.MAV_LANDED_STATE_ON_GROUND


class NoLink(Exception):
    """PX4 is not there, or fell silent: exit 3."""


class Refused(Exception):
    """PX4 said no, or did something else: exit 1."""


class Px4:
    """What PX4 last said, and what is to be said to it."""

    def __init__(self, device, baud, silence_s, patience_s):
        self.link = mavutil.mavlink_connection(device, baud=baud, source_system=255, source_component=190)
        self.silence_s, self.patience_s = silence_s, patience_s
        self.armed = self.ready = False
        self.mode, self.landed, self.local, self.amsl_m, self.yaw, self.setpoint = None, None, None, None, 0.0, None
        self.acks, self.parameters, self.said = {}, {}, []
        self.heartbeat_s = self.setpoint_s = 0.0
        self.heard_s = time.monotonic()

    # ------------------------------------------------------------------------------------------ messages

    def pump(self):
        """One message in, and what is due out."""
        now_s = time.monotonic()
        if self.link.target_system and now_s > self.heartbeat_s:
            self.heartbeat_s = now_s + 0.5
            self.link.mav.heartbeat_send(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0)
        if self.setpoint and now_s > self.setpoint_s:
            self.setpoint_s = now_s + 0.05
            (north, east, down), yaw = self.setpoint
            target = (self.link.target_system, 1)
            self.link.mav.set_position_target_local_ned_send(
                0, *target, mavlink.MAV_FRAME_LOCAL_NED, POSITION_AND_YAW, north, east, down, 0, 0, 0, 0, 0, 0, yaw, 0
            )
        m = self.link.recv_match(blocking=True, timeout=0.02)
        if m is None:
            if now_s - self.heard_s > self.silence_s:
                raise NoLink(f"nothing heard for {self.silence_s:.0f} s")
            return
        if m.get_srcComponent() != 1 or m.get_type() == "BAD_DATA":
            return
        self.heard_s = now_s
        kind = m.get_type()
        if kind == "HEARTBEAT" and m.autopilot == mavlink.MAV_AUTOPILOT_PX4:
            self.link.target_system = m.get_srcSystem()
            self.armed = bool(m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
            self.mode = (m.custom_mode >> 16 & 0xFF, m.custom_mode >> 24 & 0xFF)
        elif kind == "SYS_STATUS":
            self.ready = bool(m.onboard_control_sensors_health & PREARM_BIT)
        elif kind == "EXTENDED_SYS_STATE":
            self.landed = m.landed_state
        elif kind == "LOCAL_POSITION_NED":
            self.local = m
        elif kind == "GLOBAL_POSITION_INT":
            self.amsl_m = m.alt * 1e-3
        elif kind == "ATTITUDE":
            self.yaw = m.yaw
        elif kind == "COMMAND_ACK":
            self.acks[m.command] = m.result
        elif kind == "PARAM_VALUE":
            self.parameters[m.param_id] = m.param_value
        elif kind == "STATUSTEXT":
            self.said.append(m.text)
            # The bench ends when the vehicle is landed and disarmed, and with it PX4's clock: no HEARTBEAT may follow.
            self.armed = self.armed and not m.text.startswith("Disarmed")
            print(f"{self.now_s:8.2f} s  PX4: {m.text}")

    @property
    def now_s(self):
        return self.local.time_boot_ms * 1e-3 if self.local else 0.0

    def wait(self, what, condition):
        """Until a condition holds, or patience ends."""
        end_s = time.monotonic() + self.patience_s
        while not condition():
            if time.monotonic() > end_s:
                last = f"; PX4 last said: {self.said[-1]}" if self.said else ""
                raise Refused(f"waited {self.patience_s:.0f} s for {what} in vain{last}")
            self.pump()

    def command(self, number, *values, again=False):
        """COMMAND_LONG and its answer; `again`: tried anew while refused for now."""
        values = list(values) + [0.0] * (7 - len(values))
        end_s = time.monotonic() + self.patience_s
        while True:
            self.acks.pop(number, None)
            self.link.mav.command_long_send(self.link.target_system, 1, number, 0, *values)
            resend_s = time.monotonic() + 1.0
            while number not in self.acks and time.monotonic() < min(resend_s, end_s):
                self.pump()
            result = self.acks.get(number)
            if result == mavlink.MAV_RESULT_ACCEPTED:
                return
            if time.monotonic() > end_s or (result is not None and not again):
                name = mavlink.enums["MAV_CMD"][number].name
                answer = mavlink.enums["MAV_RESULT"][result].name if result is not None else "no answer"
                why = f"; PX4 last said: {self.said[-1]}" if self.said else ""
                raise Refused(f"{name}: {answer}{why}")

    def set_parameter(self, name, value):
        self.parameters.pop(name, None)
        for _ in range(5):
            kind = mavlink.MAV_PARAM_TYPE_REAL32
            self.link.mav.param_set_send(self.link.target_system, 1, name.encode(), value, kind)
            end_s = time.monotonic() + 1.0
            while name not in self.parameters and time.monotonic() < end_s:
                self.pump()
            if abs(self.parameters.get(name, math.nan) - value) < 1e-3:
                return
        raise Refused(f"{name} was not taken")

    # --------------------------------------------------------------------------------------------- steps

    def say(self, text):
        print(f"{self.now_s:8.2f} s  {text}", flush=True)

    def watch(self, seconds, modes):
        """Positions over so many seconds of PX4's time, in these modes."""
        rows, until_s = [], self.now_s + seconds
        while self.now_s < until_s:
            self.pump()
            if not self.armed or self.mode not in modes:
                raise Refused(f"left {MODES[modes[0]]} for {MODES.get(self.mode, self.mode)}, armed {self.armed}")
            if not rows or rows[-1].time_boot_ms != self.local.time_boot_ms:
                rows.append(self.local)
        return rows


def connect(px4):
    px4.wait("a HEARTBEAT of PX4", lambda: px4.link.target_system and px4.mode is not None)
    px4.say(f"connected to system {px4.link.target_system}, mode {MODES.get(px4.mode, px4.mode)}")
    px4.wait("a local and a global position", lambda: px4.local is not None and px4.amsl_m is not None)
    px4.wait("the pre-arm bit", lambda: px4.ready)
    px4.say("ready to arm")


def land(px4):
    px4.command(mavlink.MAV_CMD_NAV_LAND, 0, 0, 0, math.nan, math.nan, math.nan, math.nan)
    px4.setpoint = None
    start, sink_m_s = px4.local, 0.0
    while px4.landed != ON_GROUND and px4.armed:
        px4.pump()
        if px4.local.time_boot_ms * 1e-3 - start.time_boot_ms * 1e-3 > 120.0:
            raise Refused("not down after 120 s")
        sink_m_s = px4.local.vz if px4.local.vz > 0.3 else sink_m_s
    px4.say(f"landed, {math.hypot(px4.local.x, px4.local.y):.2f} m from the origin, came down at {sink_m_s:.2f} m/s")
    try:
        px4.wait("disarming", lambda: not px4.armed)
        px4.say("disarmed")
    except NoLink:
        px4.say("silent once landed: the bench has ended, which it does when PX4 disarms")


def hop(px4, height_m, hold_s):
    """Take-off, hover and landing by PX4's own modes."""
    px4.set_parameter("MIS_TAKEOFF_ALT", height_m)
    ground, ground_amsl_m = px4.local, px4.amsl_m
    px4.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1, again=True)
    px4.say("armed")
    nan = math.nan
    px4.command(mavlink.MAV_CMD_NAV_TAKEOFF, -1, 0, 0, nan, nan, nan, ground_amsl_m + height_m)
    px4.wait("take-off", lambda: px4.mode == (4, 2) or ground.z - px4.local.z > 0.5)
    px4.wait("the top", lambda: not px4.armed or (px4.mode == (4, 3) and ground.z - px4.local.z > 0.9 * height_m))
    if not px4.armed:
        raise Refused("disarmed before the top")
    px4.say(f"at {ground.z - px4.local.z:.2f} m of {height_m} m")
    rows = px4.watch(hold_s, [(4, 3)])
    mean = [sum(getattr(r, a) for r in rows) / len(rows) for a in "xyz"]
    spread = [math.sqrt(sum((getattr(r, a) - m) ** 2 for r in rows) / len(rows)) for a, m in zip("xyz", mean)]
    lateral, vertical = math.hypot(*spread[:2]), spread[2]
    px4.say(f"held {hold_s} s: rms {lateral:.2f} m across, {vertical:.2f} m in height, mean {ground.z - mean[2]:.2f} m up")
    land(px4)


def offboard(px4, height_m, step_m, names, settle_s):
    """Steps of position, height and heading by setpoints at 20 Hz."""
    x, y, z, yaw = px4.local.x, px4.local.y, px4.local.z, px4.yaw
    px4.setpoint = ((x, y, z - height_m), yaw)
    stream_s = time.monotonic() + 1.5
    while time.monotonic() < stream_s:  # PX4 takes the mode only of a stream that runs
        px4.pump()
    px4.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 6, 0)
    px4.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1, again=True)
    px4.say("armed, offboard")
    px4.wait("offboard", lambda: px4.armed and px4.mode == (6, 0))
    top = z - height_m
    places = {"east": (x, y + step_m, top), "higher": (x, y, top - step_m)}
    steps = [("up", (x, y, top), yaw, 7.0 + height_m)]
    for name in names:
        yaw += math.pi / 2 if name == "turn" else 0.0
        steps.append((name, places.get(name, (x, y, top)), yaw, settle_s))
    missed = []
    for name, place, heading, seconds in steps:
        px4.setpoint = (place, (heading + math.pi) % (2 * math.pi) - math.pi)
        last = px4.watch(seconds, [(6, 0)])[-1]
        error_m = math.dist((last.x, last.y, last.z), place)
        error_deg = abs(math.degrees((px4.yaw - heading + math.pi) % (2 * math.pi) - math.pi))
        px4.say(f"{name}: {error_m:.2f} m and {error_deg:.1f} deg off after {seconds:.0f} s")
        if error_m > STEP_TOLERANCE_M or error_deg > STEP_TOLERANCE_DEG:
            missed.append(name)
    land(px4)
    if missed:
        raise Refused(f"beyond {STEP_TOLERANCE_M} m or {STEP_TOLERANCE_DEG} deg: {', '.join(missed)}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--link", default="udpin:127.0.0.1:14540", help="pymavlink address: PX4's API link (default %(default)s)")
    parser.add_argument("--baud", type=int, default=921600, help="for a serial link")
    parser.add_argument("--height", type=float, default=10.0, metavar="M", help="above the pad (default %(default)s)")
    parser.add_argument("--hold", type=float, default=8.0, metavar="S", help="hover at the top (default %(default)s)")
    parser.add_argument("--offboard", action="store_true", help="steps by setpoints instead of PX4's own modes")
    parser.add_argument("--steps", default="east,turn", metavar="LIST", help=f"of {', '.join(STEPS)} (default %(default)s)")
    parser.add_argument("--step", type=float, default=2.0, metavar="M", help="size of a step (default %(default)s)")
    parser.add_argument("--settle", type=float, default=8.0, metavar="S", help="time for a step (default %(default)s)")
    parser.add_argument("--wait", type=float, default=60.0, metavar="S", help="patience for each answer (default %(default)s)")
    options = parser.parse_args()
    if not 1.0 <= options.height <= 200.0 or not 0.0 <= options.hold <= 300.0 or not 0.0 < options.step <= 50.0:
        parser.error("allowed: --height 1 to 200, --hold 0 to 300, --step above 0 to 50")
    names = options.steps.split(",")
    if unknown := [name for name in names if name not in STEPS]:
        parser.error(f"--steps: {unknown[0]!r} is none of {', '.join(STEPS)}")
    try:
        px4 = Px4(options.link, options.baud, silence_s=min(10.0, options.wait), patience_s=options.wait)
        connect(px4)
        if options.offboard:
            offboard(px4, options.height, options.step, names, options.settle)
        else:
            hop(px4, options.height, options.hold)
    except (NoLink, OSError) as error:
        print(f"{options.link}: {error}", file=sys.stderr)
        return 3
    except Refused as error:
        print(error, file=sys.stderr)
        return 3 if "HEARTBEAT of PX4" in str(error) else 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
