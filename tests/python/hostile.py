"""Peers that mean no good, or are broken in ways that look like it: fuzz, floods, half-open connections, slow readers.

    nasty = Fuzz(seed=1)
    bench.send_bytes(nasty.datum())                 # one piece of nonsense of some kind
    client = tcp_client(bench.ready["fc"])          # a raw socket to a listening bench
    vanish(client)                                  # gone without a word
    assert high_water_kb(bench) < 100_000
"""

import math
import random
import socket
import struct
import time

from hopbench_bench import mavlink

TCP_REPAIR = 19  # linux/tcp.h; a socket closed in this state says nothing to its peer


class Fuzz:
    """Nonsense of every kind, reproducible by its seed. `armed` says what the wild controls claim."""

    def __init__(self, seed, armed=False):
        self.chance, self.armed = random.Random(seed), armed
        self.mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self.signing = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self.signing.signing.secret_key = bytes(range(32))
        self.signing.signing.sign_outgoing, self.signing.signing.timestamp = True, 1
        self.kinds = [
            self.noise,
            self.mutated,
            self.truncated,
            self.wrong_checksum,
            self.huge_claim,
            self.unknown_message,
            self.wild_controls,
            self.signed,
            self.version_1,
            self.strange_commands,
        ]

    def datum(self):
        """One piece, its kind by chance."""
        return self.chance.choice(self.kinds)()

    def controls(self, value=0.0, mav=None, time_usec=1):
        """HIL_ACTUATOR_CONTROLS in which every channel has this value; each frame has a number of its own."""
        mav = mav or self.mav
        mav.seq = (mav.seq + 1) % 256
        mode = mavlink.MAV_MODE_FLAG_SAFETY_ARMED if self.armed else 0
        return bytes(mav.hil_actuator_controls_encode(time_usec, [value] * 16, 1 | mode, 1).pack(mav))

    def noise(self):
        return self.chance.randbytes(self.chance.randrange(1, 300))

    def mutated(self):
        """A good frame in which some bits are turned."""
        frame = bytearray(self.controls(0.3))
        for _ in range(self.chance.randrange(1, 6)):
            frame[self.chance.randrange(len(frame))] ^= 1 << self.chance.randrange(8)
        return bytes(frame)

    def truncated(self):
        frame = self.controls(0.3)
        return frame[: self.chance.randrange(1, len(frame))]

    def wrong_checksum(self):
        frame = bytearray(self.controls(0.3))
        frame[-1] ^= 0x55
        return bytes(frame)

    def huge_claim(self):
        """The heading of a frame of 255 bytes, and no more."""
        return b"\xfd\xff\x00\x00" + self.chance.randbytes(6)

    def unknown_message(self):
        """A frame of a message that nobody knows."""
        payload = self.chance.randbytes(self.chance.randrange(0, 255))
        heading = struct.pack("<BBBBBB", len(payload), 0, 0, self.chance.randrange(256), 1, 1)
        return b"\xfd" + heading + self.chance.randrange(60_000, 1 << 24).to_bytes(3, "little") + payload + self.chance.randbytes(2)

    def wild_controls(self):
        """A good frame whose numbers are none, or without measure."""
        return self.controls(self.chance.choice([math.nan, math.inf, -math.inf, 1e38, -1e38, 1e-40]))

    def signed(self):
        return self.controls(0.0, mav=self.signing)

    def version_1(self):
        frame = self.mav.heartbeat_encode(2, 12, 0, 0, 0)
        return bytes(frame.pack(self.mav, force_mavlink1=True))

    def strange_commands(self):
        """SET_MESSAGE_INTERVAL with intervals that are no times, to and from anybody; parameters nobody has."""
        interval_us = self.chance.choice([math.nan, math.inf, -math.inf, 1e38, -1.0, 1e-30])
        command = self.mav.command_long_encode(255, 255, 511, 255, 115.0, interval_us, math.nan, 0, 0, 0, 0)
        asked = self.mav.param_request_read_encode(255, 255, b"\xff" * 16, -32768)
        return bytes(command.pack(self.mav)) + bytes(asked.pack(self.mav))


def tcp_client(address, receive_buffer=None):
    """A raw TCP connection to `tcp-listen:HOST:PORT`; a small receive buffer makes a slow reader of it."""
    _, host, port = address.rsplit(":", 2)
    client = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    if receive_buffer:
        client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
    client.settimeout(5.0)
    client.connect((host, int(port)))
    return client


def vanish(client):
    """Closes a TCP connection without FIN or RST, as a pulled plug does; needs root, else it is reset."""
    try:
        client.setsockopt(socket.IPPROTO_TCP, TCP_REPAIR, 1)
    except PermissionError:
        client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    client.close()


def high_water_kb(bench):
    """The most memory that the bench's process has had so far (kB), as the kernel counts it; 0 when it has just ended."""
    with open(f"/proc/{bench.process.pid}/status") as status:
        return int(next((line.split()[1] for line in status if line.startswith("VmHWM:")), 0))


def says(bench, text, within_s=5.0):
    """Whether stderr comes to hold this text. The contract is 1 s; the rest is for a busy machine."""
    deadline_s = time.monotonic() + within_s
    while text not in bench.stderr():
        if time.monotonic() > deadline_s or bench.process.poll() is not None:
            return text in bench.stderr()
        time.sleep(0.02)
    return True
