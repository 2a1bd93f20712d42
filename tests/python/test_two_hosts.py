"""Bench and flight controller on two hosts: two network namespaces and a cable (veth) between them.

Needs root and iproute2. Where either is missing the tests are skipped by name; with HOPBENCH_NETNS=required, as CI sets it,
they fail instead and say what is missing.
"""

import os
import shutil
import subprocess
import sys
import time

import pytest
from hopbench_bench import ROOT, Result, hopbench_binary, scenario_path

BENCH_IP, FC_IP, PORT = "10.77.0.1", "10.77.0.2", 14600

REQUIRED = os.environ.get("HOPBENCH_NETNS") == "required"
ABLE = os.geteuid() == 0 and shutil.which("ip") is not None
pytestmark = [
    pytest.mark.alone,
    pytest.mark.skipif(not ABLE and not REQUIRED, reason="two hosts need root and the program ip (iproute2)"),
]


def run(*words):
    done = subprocess.run(list(map(str, words)), capture_output=True, text=True)
    assert done.returncode == 0, f"{' '.join(map(str, words))}: {done.stderr.strip()} (root and iproute2 are needed)"
    return done.stdout


class TwoHosts:
    """Two namespaces, named after this process, joined by one cable."""

    def __init__(self):
        self.bench, self.fc = (f"hopbench-{os.getpid()}-{end}" for end in ("bench", "fc"))

    def __enter__(self):
        assert shutil.which("ip"), "the program ip is missing: apt-get install iproute2"
        try:
            for name in (self.bench, self.fc):
                run("ip", "netns", "add", name)
            run("ip", "-n", self.bench, "link", "add", "cable", "type", "veth", "peer", "name", "cable", "netns", self.fc)
            for name, address in ((self.bench, BENCH_IP), (self.fc, FC_IP)):
                run("ip", "-n", name, "addr", "add", f"{address}/24", "dev", "cable")
                run("ip", "-n", name, "link", "set", "cable", "up")
                run("ip", "-n", name, "link", "set", "lo", "up")
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_):
        for name in (self.bench, self.fc):
            subprocess.run(["ip", "netns", "del", name], capture_output=True)

    def start(self, name, *words, **options):
        return subprocess.Popen(["ip", "netns", "exec", name, *map(str, words)], cwd=ROOT, stdin=subprocess.DEVNULL, **options)

    def pull(self):
        """The cable out of the controller's socket."""
        run("ip", "-n", self.fc, "link", "set", "cable", "down")

    def disturb(self, *netem):
        """Delay and loss in both directions; False when this kernel has no netem."""
        for name in (self.bench, self.fc):
            words = ["tc", "-n", name, "qdisc", "add", "dev", "cable", "root", "netem", *netem]
            if shutil.which("tc") is None or subprocess.run(words, capture_output=True).returncode != 0:
                return False
        return True


@pytest.fixture
def hosts():
    with TwoHosts() as two:
        yield two


class Flight:
    """The bench on one host, tools/scripted_fc.py on the other."""

    def __init__(self, hosts, tmp_path, link, *arguments):
        self.out, self.err = tmp_path / "stdout", tmp_path / "stderr"
        address = f"{link}-listen:{BENCH_IP}:{PORT}"
        ready = tmp_path / "ready.json"
        words = ["hil", scenario_path("hover_5m"), "--json", "--fc", address, "--profile", "generic", "--ready-file", ready]
        with open(self.out, "w") as out, open(self.err, "w") as err:
            self.bench = hosts.start(hosts.bench, hopbench_binary(), *words, "--out", tmp_path / "run", *arguments, stdout=out, stderr=err)
        deadline_s = time.monotonic() + 10.0
        while not ready.exists():
            assert self.bench.poll() is None and time.monotonic() < deadline_s, self.err.read_text()
            time.sleep(0.02)
        self.told = open(tmp_path / "fc", "w+")
        script = ROOT / "tools" / "scripted_fc.py"
        self.fc = hosts.start(hosts.fc, sys.executable, script, f"{link}:{BENCH_IP}:{PORT}", stdout=self.told, stderr=self.told)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for process in (self.bench, self.fc):
            process.kill()
            process.wait()
        self.told.close()

    def until(self, phase, timeout_s=60.0):
        deadline_s = time.monotonic() + timeout_s
        while phase not in self.err.with_name("fc").read_text():
            assert self.bench.poll() is None and time.monotonic() < deadline_s, self.err.read_text()
            time.sleep(0.02)

    def result(self, timeout_s=90.0):
        code = self.bench.wait(timeout_s)
        return Result(code, self.out.read_text(), self.err.read_text())


PATIENT = ["--lockstep", "--fast", "--lockstep-timeout-ms", "1000", "--set", "fc_timeout_ms=5000"]


@pytest.mark.parametrize("link", ["udp", "tcp"])
def test_a_hop_over_the_network(hosts, tmp_path, link):
    with Flight(hosts, tmp_path, link, *PATIENT) as flight:
        result = flight.result()
    assert result.code == 0 and result.json["outcome"] == "landed", result.stdout + result.stderr
    assert [part["source"] for part in result.json["flown_by"]] == ["fc"]
    assert f"{FC_IP}:" in result.stderr  # the other host, not this one


@pytest.mark.parametrize("link", ["udp", pytest.param("tcp", marks=pytest.mark.long)])
def test_a_cable_pulled_in_flight_is_handed_over(hosts, tmp_path, link):
    with Flight(hosts, tmp_path, link, "--realtime") as flight:
        flight.until("hover")
        hosts.pull()
        result = flight.result()
    lost = result.event("fc_lost")
    assert result.code == 1 and lost and result.event("handover"), result.stdout + result.stderr
    assert result.json["outcome"] == "landed" and "FC lost" in result.stderr


def test_delay_and_lost_datagrams_are_flown_through_and_counted(hosts, tmp_path):
    # In lockstep, so that it is the cable alone that disturbs: half a millisecond each way, one datagram in 200 lost.
    disturbed = hosts.disturb("delay", "0.5ms", "loss", "0.5%")
    patient = ["--lockstep", "--fast", "--lockstep-timeout-ms", "50", "--set", "fc_timeout_ms=5000"]
    with Flight(hosts, tmp_path, "udp", *patient) as flight:
        result = flight.result()
    assert result.json["outcome"] == "landed" and result.event("fc_lost") is None, result.stdout + result.stderr
    if disturbed:  # some 70 of 7000 exchanges lose one half
        assert result.json["link"]["stalls"] > 10 and result.json["link"]["lost"] > 5
    else:
        print("this kernel has no netem: flown without delay and loss")
