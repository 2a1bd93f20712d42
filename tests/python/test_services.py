"""Services of the bench and the ground station's link, by pymavlink alone: parameters, failures, pause, speed, reset, telemetry.

The flight controller's end is played by the test in lockstep, or by the built-in autopilot; the ground station listens on --gcs.
"""

import time
from contextlib import contextmanager

import pytest
from hopbench_bench import Bench, BenchEnded, mavlink, mavutil

ACCEPTED, DENIED, UNSUPPORTED = (
    mavlink.MAV_RESULT_ACCEPTED,
    mavlink.MAV_RESULT_DENIED,
    mavlink.MAV_RESULT_UNSUPPORTED,
)
GROUND = (250, 1)
PATIENCE_S = 60.0  # a bound for a machine under load, not a measure of speed


class Station:
    """A ground station on --gcs: it speaks first, as UDP listeners need."""

    def __init__(self, bench):
        self.bench = bench
        _, host, port = bench.ready["gcs"].rsplit(":", 2)
        self.connection = mavutil.mavlink_connection(f"udpout:{host}:{port}", source_system=255, source_component=190)
        self.connection.mav.heartbeat_send(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0)

    def recv(self, *types, where=lambda _: True):
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            message = self.connection.recv_match(type=list(types), blocking=True, timeout=0.5)
            if message is not None and where(message):
                return message
            if self.bench.process.poll() is not None:
                raise BenchEnded(self.bench.stderr()[-2000:])
        raise TimeoutError(f"no {types}\n{self.bench.stderr()[-2000:]}")

    def command(self, command, *parameters, target=GROUND):
        filled = [float(p) for p in parameters] + [0.0] * (7 - len(parameters))
        self.connection.mav.command_long_send(*target, command, 0, *filled)
        return self.recv("COMMAND_ACK", where=lambda ack: ack.command == command).result

    def read(self, name):
        self.connection.mav.param_request_read_send(*GROUND, name.encode(), -1)
        return self.recv("PARAM_VALUE", where=lambda value: value.param_id == name).param_value

    def set(self, name, value):
        kind = mavlink.MAV_PARAM_TYPE_REAL32
        self.connection.mav.param_set_send(*GROUND, name.encode(), float(value), kind)
        return self.recv("PARAM_VALUE", where=lambda value: value.param_id == name).param_value

    def text(self, part):
        return self.recv("STATUSTEXT", where=lambda text: part in text.text).text

    def height(self):
        return -self.recv("LOCAL_POSITION_NED").z


@contextmanager
def watched(fc=None, **options):
    extra = ["--gcs", "udp-listen:127.0.0.1:0", *options.pop("extra", [])]
    with Bench("hover_5m", fc=fc, extra=extra, **options) as bench:
        station = Station(bench)
        try:
            yield bench, station
        finally:
            station.connection.close()


def test_the_true_vehicle_is_told_and_named_so_that_nobody_takes_it_for_the_controller():
    with watched() as (_, station):
        beat = station.recv("HEARTBEAT", where=lambda m: m.get_srcSystem() == GROUND[0])
        assert beat.autopilot == mavlink.MAV_AUTOPILOT_INVALID and beat.type == mavlink.MAV_TYPE_ROCKET
        assert not station.connection.probably_vehicle_heartbeat(beat)
        pilot = station.recv("HEARTBEAT", where=lambda m: m.get_srcSystem() == 1)  # the autopilot's own, forwarded
        assert pilot.autopilot == mavlink.MAV_AUTOPILOT_GENERIC
        assert station.text("").startswith("SIMULATED")
        kinds = "ATTITUDE_QUATERNION", "LOCAL_POSITION_NED", "GLOBAL_POSITION_INT", "SYS_STATUS", "EXTENDED_SYS_STATE"
        for kind in kinds:
            assert station.recv(kind).get_srcSystem() == GROUND[0]


def test_the_plant_is_read_by_pymavlink_alone():
    with watched() as (_, station):
        plant = station.recv("DEBUG_FLOAT_ARRAY")
        assert (plant.name, plant.array_id, len(plant.data)) == ("plant", 1, 58)
        mass_kg, nitrous_kg, tank_pa = plant.data[0], plant.data[10], plant.data[19]
        assert 50.0 < mass_kg < 150.0 and 1.0 < nitrous_kg < mass_kg and 60e5 < tank_pa < 70e5


def test_parameters_are_listed_set_and_refused():
    with watched() as (bench, station):
        station.connection.mav.param_request_list_send(*GROUND)
        first = station.recv("PARAM_VALUE")
        names = {first.param_index: first.param_id}
        while len(names) < first.param_count:
            value = station.recv("PARAM_VALUE")
            names[value.param_index] = value.param_id
        assert len(set(names.values())) == first.param_count > 80
        assert station.set("WIND_E", 2.5) == 2.5 and station.read("WIND_E") == 2.5
        assert station.set("WIND_E", 1000.0) == 2.5
        assert "-30 to 30" in station.text("WIND_E")
        assert station.set("F_MAG_OFF", 1.0) == 1.0
        bench.process.terminate()
        result = bench.result()
    assert any("WIND_E 2.5" in what for what in result.json["modified"])
    assert any("magnetometer off" in what for what in result.json["modified"])
    assert result.event("fault:magnetometer_off") is not None


def test_a_failure_is_acknowledged_as_it_is():
    inject, off, stuck = mavlink.MAV_CMD_INJECT_FAILURE, mavlink.FAILURE_TYPE_OFF, mavlink.FAILURE_TYPE_STUCK
    with watched() as (_, station):
        assert station.command(inject, mavlink.FAILURE_UNIT_SENSOR_GPS, off) == ACCEPTED
        assert station.read("F_GNS_OFF") == 1.0
        healthy = mavlink.MAV_SYS_STATUS_SENSOR_GPS
        station.recv("SYS_STATUS", where=lambda m: not m.onboard_control_sensors_health & healthy)
        assert station.command(inject, mavlink.FAILURE_UNIT_SENSOR_GPS, mavlink.FAILURE_TYPE_OK) == ACCEPTED
        assert station.read("F_GNS_OFF") == 0.0
        assert station.command(inject, mavlink.FAILURE_UNIT_SYSTEM_BATTERY, off) == UNSUPPORTED
        assert station.command(inject, mavlink.FAILURE_UNIT_SYSTEM_SERVO, stuck, 7) == DENIED


def test_pause_step_and_speed():
    with watched() as (_, station):
        station.recv("LOCAL_POSITION_NED", where=lambda m: m.time_boot_ms > 0)
        assert station.command(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 0) == ACCEPTED
        station.text("paused")
        at_ms = station.recv("SYS_STATUS") and station.recv("LOCAL_POSITION_NED").time_boot_ms
        for _ in range(5):
            assert station.recv("LOCAL_POSITION_NED").time_boot_ms == at_ms
        station.set("SIM_STEP", 250)
        station.recv("LOCAL_POSITION_NED", where=lambda m: m.time_boot_ms >= at_ms + 250)
        assert station.recv("SYS_STATUS") and station.recv("LOCAL_POSITION_NED").time_boot_ms == at_ms + 250
        assert station.set("SIM_SPEED", 0.1) == pytest.approx(0.1)
        assert station.command(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 1) == ACCEPTED
        first, began_s = station.recv("LOCAL_POSITION_NED"), time.monotonic()
        while time.monotonic() < began_s + 2.0:
            last = station.recv("LOCAL_POSITION_NED")
        # A slow machine makes less of it; a message may be a tenth of a second late.
        assert last.time_boot_ms - first.time_boot_ms <= 0.1 * (time.monotonic() - began_s + 0.2) * 1000 + 50


def test_two_resets_then_the_flight_is_flown_to_its_end():
    with watched(lockstep=True, fast=True, extra=["--stay"]) as (bench, station):
        for flight in range(1, 3):
            station.text("touchdown")
            assert station.command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1) == ACCEPTED
            station.text("reset" if flight == 0 else "armed")
        station.text("touchdown")
        time.sleep(3.0)  # in fast lockstep the landing is judged within that many wall seconds
        bench.process.terminate()
        result = bench.result()
    flights = result.json["flights"]
    assert len(flights) == 2
    assert all(flight["touchdown"] is not None for flight in [*flights, result.json])


def test_the_controller_s_traffic_passes_both_ways():
    with watched(fc="udp", lockstep=True, fast=True) as (bench, station):
        bench.recv_sensor()
        sent = armed = heard = False
        deadline = time.monotonic() + PATIENCE_S
        while not (armed and heard) and time.monotonic() < deadline:
            message = bench.recv()
            if message.get_type() == "HIL_SENSOR":
                assert message.get_srcSystem() == 1
                bench.send_controls([0.0] * 4, armed=False, time_usec=message.time_usec)
                bench.connection.mav.statustext_send(mavlink.MAV_SEVERITY_INFO, b"from the controller")
                if not sent:
                    arm = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
                    station.connection.mav.command_long_send(1, 1, arm, 0, 1, 0, 0, 0, 0, 0, 0)
                    station.connection.mav.hil_sensor_send(1, *[0.0] * 13, 0)
                    sent = True
            elif message.get_type() == "COMMAND_LONG":
                assert (message.get_srcSystem(), message.command) == (255, mavlink.MAV_CMD_COMPONENT_ARM_DISARM)
                armed = True
            text = station.connection.recv_match(type="STATUSTEXT", blocking=False)
            heard = heard or (text is not None and text.text == "from the controller" and text.get_srcSystem() == 1)
        assert armed and heard
        kinds = {m.get_type() for m in iter(lambda: station.connection.recv_match(blocking=False), None)}
        assert not any(kind.startswith("HIL_") for kind in kinds)


def test_an_armed_px4_is_not_reset():
    with watched(fc="tcp-listen", profile="px4-sitl", lockstep=True, fast=True) as (bench, station):
        command = mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN
        asked, result = False, None
        deadline = time.monotonic() + PATIENCE_S
        while result is None and time.monotonic() < deadline:
            sensor = bench.recv_sensor()
            bench.send_controls([0.0] * 4, armed=True, time_usec=sensor.time_usec)
            if sensor.time_usec > 200_000 and not asked:
                station.connection.mav.command_long_send(*GROUND, command, 0, 1, 0, 0, 0, 0, 0, 0)
                asked = True
            ack = station.connection.recv_match(type="COMMAND_ACK", blocking=False)
            result = ack.result if ack is not None else None
        assert result == DENIED
