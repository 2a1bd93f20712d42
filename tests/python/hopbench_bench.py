"""One Hopbench run under test: starts `hopbench hil`, gives a MAVLink connection to it, reads its verdict.

    from hopbench_bench import Bench

    with Bench("hover_5m", fc="tcp-listen", profile="px4-sitl", lockstep=True, fast=True) as bench:
        for sensor in bench.sensors():
            bench.send_controls([0.0] * 4, armed=False, time_usec=sensor.time_usec)
            if sensor.time_usec > 2_000_000:
                break
        bench.fall_silent()
    ...
    with Bench("hover_5m", fc=None) as bench:      # the built-in autopilot flies
        result = bench.result(timeout_s=60)
        assert result.code == 0 and result.json["outcome"] == "landed"

The test plays the flight controller (FC). `fc` says how the link is made, named as the bench's own LINK:

    "udp"         the test binds a port, the bench speaks first          "tcp-listen"  the bench listens
    "udp-listen"  the bench binds a port and answers whoever writes      "tcp"         the test listens
    "serial"      a pseudo-terminal pair, 921600 baud                    None          no --fc at all

Ports are ephemeral, so that runs may go side by side. The process ends with the `with` block, whatever happens in it.
Needs pymavlink alone and runs on Linux; the binary is $HOPBENCH, else target/release/hopbench of this checkout.
"""

import json
import os
import select
import signal
import subprocess
import tempfile
import time
import tty
from dataclasses import dataclass
from pathlib import Path

os.environ["MAVLINK20"] = "1"  # read when pymavlink is imported
os.environ["MAVLINK_DIALECT"] = "common"
from pymavlink import mavutil  # noqa: E402
from pymavlink.dialects.v20 import common as mavlink  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
ARMED = mavlink.MAV_MODE_FLAG_SAFETY_ARMED
CUSTOM = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
HIL = mavlink.MAV_MODE_FLAG_HIL_ENABLED


def hopbench_binary() -> Path:
    """The program under test. Raises FileNotFoundError: a missing program fails a test, it never skips it."""
    binary = Path(os.environ.get("HOPBENCH", ROOT / "target" / "release" / "hopbench"))
    if not binary.is_file():
        raise FileNotFoundError(f"{binary} is missing: run `cargo xtask test`, or set HOPBENCH to the hopbench binary")
    return binary


def scenario_path(scenario) -> Path:
    """`hover_5m` is scenarios/hover_5m.toml; anything with a folder or an ending is a path."""
    path = Path(scenario)
    return path if path.suffix or path.parent != Path(".") else ROOT / "scenarios" / f"{path}.toml"


def run_hopbench(*arguments, timeout_s=60.0):
    """Runs the program to its end; the Result. For commands that need no link."""
    command = [str(hopbench_binary()), *map(str, arguments)]
    done = subprocess.run(command, cwd=ROOT, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=timeout_s)
    return Result(done.returncode, done.stdout, done.stderr)


class BenchEnded(Exception):
    """The bench's process ended, or closed the link, while the test waited for a message."""


@dataclass
class Result:
    """What a finished run left: exit code, standard output and error."""

    code: int
    stdout: str
    stderr: str

    @property
    def json(self) -> dict:
        """The one JSON object on standard output. Raises ValueError, with stderr in it, when there is none."""
        try:
            return json.loads(self.stdout)
        except ValueError as error:
            raise ValueError(f"stdout is no JSON object ({error}); exit {self.code}\n{self.stdout}\n{self.stderr}") from None

    def event(self, name):
        """The first event of that name, or None."""
        return next((event for event in self.json["events"] if event["name"] == name), None)

    def expectation(self, name_part):
        """The `[expect]` items whose name contains `name_part`."""
        return [item for item in self.json["expect"]["items"] if name_part in item["name"]]


class Bench:
    """A running `hopbench hil`; see the module's documentation.

    scenario    name in scenarios/, or a path
    fc          kind of link, see above
    profile     px4-sitl, px4-hitl, generic; None: the link's default
    lockstep    True: --lockstep, False: --realtime, None: neither, the profile decides
    fast        --fast: lockstep not held to real time
    sets        {"arm_wait_s": 5} or ["arm_wait_s=5"], each a --set
    seed        --seed
    extra       further arguments
    connect     False: with a listening bench, leave the link to another program (its address is ready["fc"])
    """

    def __init__(
        self, scenario, fc="udp", profile=None, lockstep=None, fast=False, sets=(), seed=None, extra=(), connect=True
    ):
        self.scenario, self.fc, self.profile, self.connect = scenario_path(scenario), fc, profile, connect
        self.lockstep, self.fast, self.seed, self.extra = lockstep, fast, seed, list(extra)
        pairs = [f"{key}={value}" for key, value in sets.items()] if isinstance(sets, dict) else sets
        self.sets = list(pairs)
        self.process = self.connection = self.ready = self._result = None
        self._closers = []

    # ---------------------------------------------------------------------------------------------- life

    def __enter__(self):
        try:
            return self._start()
        except BaseException:
            self.close()
            raise

    def __exit__(self, *_):
        self.close()

    def _start(self):
        folder = tempfile.TemporaryDirectory(prefix="hopbench-")
        self._closers.append(folder.cleanup)
        self.folder = Path(folder.name)
        link = self._open_own_end()
        command = [hopbench_binary(), "hil", self.scenario, "--json", "--ready-file", self.folder / "ready.json"]
        command += ["--out", self.folder / "run"]
        command += ["--fc", link] if link else []
        command += ["--profile", self.profile] if self.profile else []
        if self.fc == "serial" or (link and self.profile == "px4-hitl"):
            command += ["--igniter-disconnected"]  # a script has no igniter
        command += {None: [], True: ["--lockstep"], False: ["--realtime"]}[self.lockstep]
        command += ["--fast"] if self.fast else []
        command += ["--seed", self.seed] if self.seed is not None else []
        for pair in self.sets:
            command += ["--set", pair]
        self.command = [str(word) for word in command + self.extra]
        # Files, not pipes: a full pipe nobody reads would stop the bench.
        with open(self.folder / "stdout", "w") as out, open(self.folder / "stderr", "w") as err:
            self.process = subprocess.Popen(self.command, cwd=ROOT, stdin=subprocess.DEVNULL, stdout=out, stderr=err)
        self._wait_until_ready()
        if self.connection is None and self.fc and self.connect:
            _, host, port = self.ready["fc"].rsplit(":", 2)
            pymavlink_kind = {"udp-listen": "udpout", "tcp-listen": "tcp"}[self.fc]
            self._own(mavutil.mavlink_connection(f"{pymavlink_kind}:{host}:{port}", **self._identity()))
            if self.fc == "udp-listen":
                self.send_heartbeat()  # the bench answers whoever writes
        return self

    def _identity(self):
        # PX4's own numbers: system 1, component 1.
        return {"source_system": 1, "source_component": 1}

    def _own(self, connection):
        self.connection = connection
        self._closers.append(connection.close)

    def _open_own_end(self):
        """Opens what must exist before the bench starts; the LINK for --fc."""
        if self.fc is None:
            return None
        if self.fc in ("udp-listen", "tcp-listen"):
            return f"{self.fc}:127.0.0.1:0"
        if self.fc == "udp":
            self._own(mavutil.mavlink_connection("udpin:127.0.0.1:0", **self._identity()))
            return "udp:127.0.0.1:%d" % self.connection.port.getsockname()[1]
        if self.fc == "tcp":
            self._own(mavutil.mavlink_connection("tcpin:127.0.0.1:0", **self._identity()))
            return "tcp:127.0.0.1:%d" % self.connection.listen.getsockname()[1]
        if self.fc == "serial":
            self._own(PtyConnection(**self._identity()))
            return f"serial:{self.connection.address}:921600"
        raise ValueError(f"unknown kind of link {self.fc!r}")

    def _wait_until_ready(self, timeout_s=10.0):
        path, deadline = self.folder / "ready.json", time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            try:
                self.ready = json.loads(path.read_text())
                return
            except (OSError, ValueError):  # not there, or half written
                pass
            if self.process.poll() is not None:
                raise BenchEnded(f"exit {self.process.returncode} before the ready file\n{self.stderr()}")
            time.sleep(0.01)
        raise TimeoutError(f"no ready file after {timeout_s} s\n{self.stderr()}")

    def close(self):
        """Ends the process, if it still runs, and the link."""
        if self.process and self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
            try:
                self.process.wait(5.0)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
        while self._closers:
            self._closers.pop()()

    def stderr(self) -> str:
        return (self.folder / "stderr").read_text()

    def result(self, timeout_s=60.0) -> Result:
        """Waits for the end of the run, reading away what still comes on the link; TimeoutError if it does not end."""
        deadline = time.monotonic() + timeout_s
        while self.process.poll() is None:
            if time.monotonic() > deadline:
                raise TimeoutError(f"the bench still runs after {timeout_s} s\n{self.stderr()[-2000:]}")
            if self.connection is None or self._poll() is None:
                time.sleep(0.01)
        self._result = self._result or Result(self.process.returncode, (self.folder / "stdout").read_text(), self.stderr())
        return self._result

    # ---------------------------------------------------------------------------------------------- messages

    def _poll(self):
        try:
            return self.connection.recv_msg()
        except OSError:  # the bench closed the link
            return None

    def recv(self, *types, timeout_s=5.0):
        """The next message of these types (of any, without); BenchEnded at the end of the run, TimeoutError on silence."""
        deadline = time.monotonic() + timeout_s
        ended = False
        while True:
            message = self._poll()
            if message is not None:
                if not types or message.get_type() in types:
                    return message
                continue
            if ended:
                raise BenchEnded(f"exit {self.process.returncode}\n{self.stderr()[-2000:]}")
            ended = self.process.poll() is not None  # once more round: read what came before the end
            if time.monotonic() > deadline:
                raise TimeoutError(f"no {' or '.join(types) or 'message'} within {timeout_s} s\n{self.stderr()[-2000:]}")
            if not ended:
                select.select([self.connection.fd], [], [], 0.05)

    def recv_sensor(self, timeout_s=5.0):
        """The next HIL_SENSOR."""
        return self.recv("HIL_SENSOR", timeout_s=timeout_s)

    def messages(self, timeout_s=5.0):
        """All messages, until the run ends."""
        try:
            while True:
                yield self.recv(timeout_s=timeout_s)
        except BenchEnded:
            return

    def sensors(self, timeout_s=5.0):
        """All HIL_SENSOR, until the run ends."""
        return (message for message in self.messages(timeout_s) if message.get_type() == "HIL_SENSOR")

    def send_controls(self, controls, armed, time_usec):
        """HIL_ACTUATOR_CONTROLS; `controls` is filled up with zeros to 16."""
        filled = [float(value) for value in controls] + [0.0] * (16 - len(controls))
        mode = CUSTOM | (ARMED if armed else 0) | (HIL if self.profile == "px4-hitl" else 0)
        flags = 1 if self.lockstep or self.profile == "px4-sitl" else 0
        self.connection.mav.hil_actuator_controls_send(time_usec, filled, mode, flags)

    def send_heartbeat(self, base_mode=CUSTOM | HIL):
        """HEARTBEAT of a flight controller, with the HIL flag unless told otherwise."""
        self.connection.mav.heartbeat_send(mavlink.MAV_TYPE_ROCKET, mavlink.MAV_AUTOPILOT_GENERIC, base_mode, 0, 0)

    def request_interval(self, message_id, interval_us):
        """COMMAND_LONG 511, SET_MESSAGE_INTERVAL."""
        self.connection.mav.command_long_send(
            0, 0, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 0, message_id, interval_us, 0, 0, 0, 0, 0
        )

    def send_bytes(self, data: bytes):
        """Raw bytes on the link."""
        self.connection.write(data)


class PtyConnection(mavutil.mavfile):
    """pymavlink on the near end of a pseudo-terminal pair; `address` is the path of the far end."""

    def __init__(self, **identity):
        self.near, self.far = os.openpty()
        tty.setraw(self.near)
        tty.setraw(self.far)  # stays open: the near end must not see a hang-up between two openings by the bench
        os.set_blocking(self.near, False)
        super().__init__(self.near, os.ttyname(self.far), **identity)

    def recv(self, n=None):
        try:
            return os.read(self.near, n or 4096)
        except OSError:  # nothing there
            return b""

    def write(self, data):
        view = memoryview(bytes(data))
        while view:
            try:
                view = view[os.write(self.near, view) :]
            except BlockingIOError:  # the bench does not read: wait for room, as a UART does
                if not select.select([], [self.near], [], 1.0)[1]:
                    return

    def close(self):
        os.close(self.near)
        os.close(self.far)
