#!/usr/bin/env python3
"""A register that is polled six times as often as its device writes it.

With `every_s` each value is one reading. So a line connects different values, and a median counts
each value once. The test's own device has a sine as its true speed.
"""
import contextlib
import math
import struct
import threading
import time

from live_test import Device, Program, check_replay, end_well, number, query
from tree import OMEGA
from twinlock_test import PLAIN_LIVE, at_most, edited_config, expect, main

WRITTEN_S, POLLED_S, EVERY_S = 0.03, 0.005, 0.045
AMPLITUDE, PERIOD_S, PERIODS = 12.0, 3.0, 2
STEP_S, SETTLED_S = 0.01, 2.0
READINGS = """SELECT p.stamp_ns, p.value FROM samples p JOIN signals USING (run, signal)
              WHERE run = 1 AND name = ? AND quality = 0 GROUP BY p.stamp_ns ORDER BY p.stamp_ns"""


@contextlib.contextmanager
def written(device, spoil=lambda count, value: value):
    """A device that writes the true speed into its register every WRITTEN_S."""
    stop = threading.Event()

    def write():
        begun, count = time.monotonic(), 0
        while not stop.wait(max(0.0, begun + count * WRITTEN_S - time.monotonic())):
            value = OMEGA + AMPLITUDE * math.sin(2 * math.pi * (time.monotonic() - begun) / PERIOD_S)
            device.omega, count = spoil(count, value), count + 1
    writer = threading.Thread(target=write)
    writer.start()
    try:
        yield
    finally:
        stop.set()
        writer.join()


def live(match, spoil=lambda count, value: value, **signal):
    """(configuration, database, report of --json)"""
    with Device(OMEGA) as device:
        config = edited_config(PLAIN_LIVE, {
            "duration_s": SETTLED_S + PERIODS * PERIOD_S + 1, "sources": {"inverter": {"modbus_tcp": {"port": device.port, "period_s": POLLED_S}}},
            "plant": {"omega": signal}, "synchronise": {"match": {"motor.omega": match}}})
        database = config.parent / "run.db"
        with written(device, spoil), Program("run", config, "--json", "--db", database) as run:
            told, _ = end_well(run)
    return config, database, told


def mse_of(database):
    """The mean square error of the twin against its best-fitting sine of that period, so a delay
    has no effect."""
    steps = round(PERIODS * PERIOD_S / STEP_S)
    y = [row[0] for row in query(database, "SELECT simulated FROM outputs WHERE step >= ? AND run = 1 ORDER BY step", round(SETTLED_S / STEP_S))[:steps]]
    expect(len(y) == steps, f"{len(y)} steps, wanted {steps}")
    wave = [2 * math.pi * i * STEP_S / PERIOD_S for i in range(steps)]
    mean = sum(y) / steps
    sine, cosine = (2 / steps * sum(value * shape(angle) for value, angle in zip(y, wave)) for shape in (math.sin, math.cos))
    return sum((value - mean - sine * math.sin(angle) - cosine * math.cos(angle)) ** 2 for value, angle in zip(y, wave)) / steps


def read_again(database, name="plant.omega"):
    """(number of readings that repeat the one before within `every_s`, number of all readings)"""
    found = query(database, READINGS, name)
    pairs = list(zip(found, found[1:]))
    return sum(value == before and stamp - since < (EVERY_S - POLLED_S) * 1e9 for (since, before), (stamp, value) in pairs), len(pairs)


def test_each_value_is_one_reading():
    _, database, _ = live({})
    again, readings = read_again(database)
    expect(again > 0.4 * readings, f"without every_s {again} of {readings} readings were only read again")
    _, database, _ = live({}, every_s=EVERY_S)
    again, readings = read_again(database)
    expect(again == 0 and readings > 50, f"{again} of {readings} readings were only read again")


def test_a_line_is_truer():
    _, database, _ = live({})
    last = mse_of(database)
    config, database, told = live({"between": "line"}, every_s=EVERY_S)
    at_most(mse_of(database), 0.3 * last, f"true MSE on the line, (rad/s)²; {last:.4f} by the last reading")
    check_replay(config, database, number(database, "SELECT count(*) FROM steps"))
    expect(told["match"]["motor.omega"]["readings"] < 0.6 * told["steps"], f"{told['match']}")


def test_a_median_counts_readings():
    """One value in eleven is 30 rad/s off, for six polls, so a median of three polls does not
    remove it."""
    def spoil(count, value):
        return value + (30.0 if count % 11 == 5 else 0.0)
    median = {"condition": {"median": 3}}
    _, database, _ = live(median, spoil)
    polls = mse_of(database)
    _, database, _ = live({**median, "between": "line"}, spoil, every_s=EVERY_S)
    at_most(mse_of(database), 0.1 * polls, f"true MSE, (rad/s)²; {polls:.4f} if each poll counts")


class CountedDevice(Device):
    """Notes the time of each request."""

    def __init__(self, omega):
        super().__init__(omega)
        self.asked = []

    def _reply(self, request):
        self.asked.append(time.monotonic())
        return super()._reply(request)


AGES = """SELECT min(tick) * ? - stamp_ns AS age FROM samples JOIN signals USING (run, signal)
          WHERE kind = 'plant' AND quality = 0 GROUP BY signal, stamp_ns ORDER BY age"""


def test_ages_add_up():
    """At most one poll per period, and the ages shown are those of the recorded samples. The ages
    depend on the load of the machine, so they are only printed."""
    for step_s, period_s in ((0.01, 0.01), (0.01, 0.005), (0.001, 0.001), (0.01, 0.02)):
        with CountedDevice(OMEGA) as device:
            config = edited_config(PLAIN_LIVE, {
                "duration_s": 3, "step_s": step_s, "sources": {"inverter": {"modbus_tcp": {"port": device.port, "period_s": period_s}}},
                "synchronise": {"match": {"motor.omega": {"condition": {"outliers": "keep"}}}}})  # no omega@reading, which would count once more
            database = config.parent / "run.db"
            with Program("run", config, "--json", "--db", database) as run:
                told, log = end_well(run)
        polls, periods = len(device.asked), (device.asked[-1] - device.asked[0]) / period_s
        expect(polls <= periods + 4, f"{polls} requests in {periods:.1f} periods")
        ages = [age for (age,) in query(database, AGES, round(step_s * 1e9))]
        expect(told["age"]["values"] == len(ages) > 0, f"{told['age']}, but {len(ages)} values are recorded")
        for share, key in (0.5, "p50_s"), (0.99, "p99_s"):
            age, shown = ages[math.ceil(share * len(ages)) - 1] * 1e-9, told["age"][key]
            expect(age < shown <= age * 17 / 16 + 1.1e-6, f"{key}: {shown}, recorded {age}")
        texts = query(database, "SELECT text FROM events WHERE source = 'plant' AND text LIKE '%p50%p99%'")
        expect(len(texts) == 1 and texts[0][0] in log, f"{texts}")
        print(f"    step {step_s * 1e3:g} ms, polled every {period_s * 1e3:g} ms: {polls} polls, {told['ticks']} ticks, {texts[0][0]}")


class SlowDevice(Device):
    """Answers after 0.15 s."""

    def _reply(self, request):
        time.sleep(0.15)
        return super()._reply(request)


class HastyDevice(Device):
    """Answers one request of each connection."""

    def _serve(self, client):
        with client:
            transaction, _, _, unit = struct.unpack(">HHHB", client.recv(7))
            reply = self._reply(client.recv(5))
            client.sendall(struct.pack(">HHHB", transaction, 0, len(reply) + 1, unit) + reply)


def polled_every_50_ms(device):
    """(report of --json, log, plant events) of a run with two requests per poll"""
    torque = {"stale_s": None, "modbus": {"unit_id": 2}}
    config = edited_config(PLAIN_LIVE, {
        "duration_s": 6, "step_s": 0.05, "sources": {"inverter": {"modbus_tcp": {"port": device.port, "period_s": 0.05, "timeout_s": 5}}},
        "plant": {"omega": {"stale_s": None}, "torque": torque}})
    database = config.parent / "run.db"
    with Program("run", config, "--json", "--db", database) as run:
        told, log = end_well(run)
    return told, log, [text for text, in query(database, "SELECT text FROM events WHERE source = 'plant'")]


def test_slow_device():
    """The rate that does not come is reported once for each signal, and counted."""
    with SlowDevice(OMEGA) as device:
        told, _, events = polled_every_50_ms(device)
    for name in "omega", "torque":
        found = told["plant"][name]
        expect(0 < found["readings"] < found["expected"] / 3, f"{found}")
        expect(sum(f"plant.{name}: " in text and "one per 0.05 s" in text for text in events) == 1, f"{events}")


def test_device_that_closes_after_each_answer():
    """No reading is lost: nothing is reported."""
    with HastyDevice(OMEGA) as device:
        told, _, events = polled_every_50_ms(device)
    plant = told["plant"]
    expect(plant["torque"]["not_good"] == plant["omega"]["not_good"] == 0, f"{plant}: {events}")
    expect(not any("closes" in text or "answers again" in text for text in events), f"{events}")


class FlappingDevice(Device):
    """Each second value of omega is out of range."""

    def _reply(self, request):
        if request[2] == 0:  # the address of omega
            self.omega = 1000.0 if self.omega < 1000 else OMEGA
        return super()._reply(request)


def test_flapping_signal():
    """The log has two lines of each kind and then a count; the database has each event."""
    with FlappingDevice(OMEGA) as device:
        told, log, events = polled_every_50_ms(device)
    for text in "plant.omega: good again", "plant.omega: 1000 rad/s is outside":
        all_of_them, logged = sum(text in event for event in events), [line for line in log.splitlines() if text in line]
        expect(all_of_them > 10 and len(logged) == 3, f"{logged}, and {all_of_them} events")
        expect(logged[-1].endswith(f"({all_of_them - 3} more were not logged)"), f"{logged}, and {all_of_them} events")
    expect(told["plant"]["omega"]["not_good"] > 10, f"{told}")


if __name__ == "__main__":
    main()
