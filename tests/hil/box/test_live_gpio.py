#!/usr/bin/env python3
"""On the box: GPIO lines as a plant, on chips that this test makes and removes (gpio-sim): the
driver alone, and a live run with a GPIO line, a serial line and a TCP server, which a replay
repeats to the bit."""
import fcntl
import os
import struct
import subprocess
import termios
import threading
import time
from pathlib import Path

import twinlock_test
from live_test import (Device, Program, RESULTS, check_database, end_well, expect_repeated, number, query, wait_until)
from twinlock_test import BUILD, Skip, edited_config, expect, expect_line, has_line, replay_json, scratch

SIM = Path("/sys/kernel/config/gpio-sim")
PROBE = BUILD / "tests" / "gpio_probe"
GOOD, NO_LINK = 0, 4
GET_LINE, OUTPUT = 0xC250B407, 1 << 3  # linux/gpio.h, as in test_gpio.py
LINE_REQUEST = struct.Struct("=64I32sQI20x240sII20xi")


class Chip:
    """A chip of gpio-sim, whose named lines the test pulls. A hog is a user of a line inside the
    kernel."""

    def __init__(self, label, names, hogs=()):
        if not SIM.is_dir():
            raise Skip("no gpio-sim here")
        self.folder, self.names = SIM / label, names
        bank = self.folder / "bank"
        bank.mkdir(parents=True)
        (bank / "label").write_text(label)
        (bank / "num_lines").write_text(str(len(names)))
        for offset, name in enumerate(names):
            (bank / f"line{offset}").mkdir()
            (bank / f"line{offset}" / "name").write_text(name)
            if name in hogs:
                hog = bank / f"line{offset}" / "hog"
                hog.mkdir()
                (hog / "name").write_text("door")
                (hog / "direction").write_text("input")
        self.plug_in()

    def plug_in(self):
        (self.folder / "live").write_text("1")
        bank = self.folder / "bank"
        self.chip = (bank / "chip_name").read_text().strip()
        self.device = Path("/sys/devices/platform") / (self.folder / "dev_name").read_text().strip() / self.chip
        wait_until(Path("/dev", self.chip).exists, f"/dev/{self.chip}")

    def pull_out(self):
        (self.folder / "live").write_text("0")

    def set(self, name, is_high):
        """Pulls a line. Returns the times before and after, in ns."""
        before = time.monotonic_ns()
        pull = self.device / f"sim_gpio{self.names.index(name)}" / "pull"
        pull.write_text("pull-up" if is_high else "pull-down")
        return before, time.monotonic_ns()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.pull_out()
        for hog in self.folder.glob("bank/line*/hog"):
            hog.rmdir()
        for line in self.folder.glob("bank/line*"):
            line.rmdir()
        (self.folder / "bank").rmdir()
        self.folder.rmdir()


class Probe:
    """Runs the driver (gpio_probe) and reads its output."""

    def __init__(self, seconds, chip, *lines, period=0.02):
        self.path = scratch() / "probe"
        with open(self.path, "wb") as file:
            self.process = subprocess.Popen([PROBE, str(seconds), str(period), chip, *lines], stdout=file)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.kill()
        self.process.wait()

    def said(self):
        return self.path.read_text().splitlines()

    def posts(self, channel):
        """[(value, quality, stamp)] of the changes."""
        found = [line.split()[1:] for line in self.said() if line.startswith("post ")]
        return [(float(value), int(quality), int(stamp)) for name, value, quality, stamp in found if int(name) == channel]

    def wait_for_line(self, parts):
        wait_until(lambda: has_line("\n".join(self.said()), parts), parts, lambda: "\n".join(self.said()))

    def wait_for(self, channel, value, quality=GOOD):
        wait_until(lambda: [post[:2] for post in self.posts(channel)][-1:] == [(value, quality)],
                   f"{value} of quality {quality} in channel {channel}", lambda: "\n".join(self.said()))

    def cpu_s(self):
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def expect_stamp(probe, channel, value, span):
    """The newest change is to that value, with a stamp within `span`."""
    probe.wait_for(channel, value)
    stamp = probe.posts(channel)[-1][2]
    expect(span[0] <= stamp <= span[1], f"the edge was between {span[0]} and {span[1]} ns, its stamp is {stamp}")


def test_names_offsets_levels_and_stamps():
    with Chip("bench", ["START", "STOP", "DOOR"]) as chip:
        chip.set("STOP", True)
        with Probe(60, "bench", "START", "#1", "DOOR:low:none") as probe:
            for channel, value in ((0, 0), (1, 1), (2, 1)):
                probe.wait_for(channel, value)
            probe.wait_for_line(f"up|line 1 of bench|connected|{chip.chip} (bench)")
            for value in (1, 0, 1):
                expect_stamp(probe, 0, value, chip.set("START", value == 1))
                expect_stamp(probe, 1, 1 - value, chip.set("STOP", value == 0))
                expect_stamp(probe, 2, 1 - value, chip.set("DOOR", value == 1))
            expect(not any("missed" in line for line in probe.said()), "\n".join(probe.said()))
        with Probe(60, f"/dev/{chip.chip}", "STOP") as by_path, Probe(60, chip.chip, "DOOR") as by_name:
            by_path.wait_for(0, 0)
            by_name.wait_for(0, 1)


def test_a_bias():
    """A line of gpio-sim follows the bias that the driver requests."""
    with Chip("bench", ["START", "STOP"]) as chip:
        chip.set("STOP", True)
        with Probe(60, "bench", "START:up", "STOP:down") as probe:
            probe.wait_for(0, 1)
            probe.wait_for(1, 0)


def test_a_bouncing_line():
    with Chip("bench", ["START"]) as chip, Probe(60, "bench", "START:0.3") as probe:
        probe.wait_for(0, 0)
        for value in (1, 0):
            for i in range(9):
                span = chip.set("START", (i % 2 == 0) == (value == 1))
            expect_stamp(probe, 0, value, span)
        chip.set("START", True)
        chip.set("START", False)
        time.sleep(0.6)
        expect([post[0] for post in probe.posts(0)] == [0, 1, 0], f"found {probe.posts(0)}")


def test_a_burst():
    with Chip("bench", ["START", "STOP"]) as chip, Probe(60, "bench", "START", "STOP", period=0.1) as probe:
        probe.wait_for(0, 0)
        pull = os.open(chip.device / "sim_gpio0" / "pull", os.O_WRONLY)
        for _ in range(2000):
            os.pwrite(pull, b"pull-up", 0)
            os.pwrite(pull, b"pull-down", 0)
        os.pwrite(pull, b"pull-up", 0)
        os.close(pull)
        probe.wait_for(0, 1)
        expect_stamp(probe, 1, 1, chip.set("STOP", True))
        time.sleep(0.3)
        probe.wait_for(0, 1)
        told = [line for line in probe.said() if "missed" in line]
        print(f"    of 4001 edges {len(probe.posts(0)) - 1} were posted; reports: {told}")
        expect(told or len(probe.posts(0)) == 4002, "edges were missed without a report")
        expect(not any(has_line(line, "down|stamp|channel") for line in probe.said()), "\n".join(probe.said()[-5:]))


def test_a_duplicate_name():
    with Chip("bench", ["A", "START"]) as chip, Chip("spare", ["START"]) as spare:
        with Probe(60, "-", "START") as probe:
            probe.wait_for(0, 0, NO_LINK)
            probe.wait_for_line("down|START")
            expect_line(probe.said()[0], f'down|START|{chip.chip} (bench)|line 1|{spare.chip} (spare)|line 0|"chip"')
            spare.pull_out()
            probe.wait_for(0, 0)
            spare.plug_in()  # the driver keeps its line
            expect_stamp(probe, 0, 1, chip.set("START", True))
    with Chip("bench", ["START", "START"]) as chip, Probe(60, "bench", "START") as probe:
        probe.wait_for_line(f"down|START|{chip.chip} (bench)|line 0|line 1")


def test_unavailable_lines():
    with Chip("bench", ["START", "DOOR", "LAMP"], hogs=["DOOR"]) as chip:
        with open(f"/dev/{chip.chip}", "rb") as device:
            request = bytearray(LINE_REQUEST.pack(*([2] + 63 * [0]), b"test", OUTPUT, 0, b"", 1, 0, 0))
            fcntl.ioctl(device, GET_LINE, request)
        os.close(LINE_REQUEST.unpack(request)[-1])  # released, but still an output
        with Probe(60, "bench", "DOOR", "LAMP", "WINDOW", "#3", "START") as probe:
            probe.wait_for(4, 0)
            with Probe(60, "bench", "START") as late:
                late.wait_for_line(f'down|START|line 0|{chip.chip} (bench)|"twinlock"')
                time.sleep(1)
                for parts in (f'down|DOOR|line 1|{chip.chip} (bench)|"door"', f"down|LAMP|line 2|{chip.chip} (bench)|output",
                              f"down|WINDOW|{chip.chip} (bench)|name", f"down|line 3|{chip.chip} (bench)|0|2"):
                    probe.wait_for_line(parts)
                expect(len(probe.said()) == 10, "\n".join(probe.said()))  # each once, although the driver retried
                probe.process.kill()
                late.wait_for(0, 0)


# ---- a live run ----

def check_sum(data):
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ 0xA001 if value & 1 else value >> 1
    return struct.pack("<H", value)


class Unit:
    """A Modbus unit with one coil, at address 5, on the other end of the serial line."""

    def __init__(self, device):
        self.port = os.open(device, os.O_RDWR | os.O_NOCTTY)
        settings = termios.tcgetattr(self.port)
        settings[:4] = [0, 0, termios.CS8 | termios.CREAD | termios.CLOCAL | termios.PARENB, 0]
        settings[4] = settings[5] = termios.B19200
        settings[6][termios.VMIN], settings[6][termios.VTIME] = 1, 0
        termios.tcsetattr(self.port, termios.TCSAFLUSH, settings)
        self.coil, self.requests = 0, 0
        threading.Thread(target=self.run, daemon=True).start()

    def run(self):
        heard = b""
        while True:
            heard = (heard + os.read(self.port, 8))[-8:]
            if len(heard) == 8 and heard[:2] == b"\x07\x01" and check_sum(heard[:6]) == heard[6:]:
                self.requests += 1
                reply = bytes((7, 1, 1, self.coil))
                os.write(self.port, reply + check_sum(reply))
                heard = b""


def configuration(port):
    return edited_config("cylinder/hold.json", {
        "step_s": 0.02, "duration_s": 7,
        "sources": {"box": {"gpio": {"chip": "bench", "period_s": 0.01}},
                    "bus": {"modbus_rtu": {"device": "/dev/ttyS1", "period_s": 0.04}},
                    "plc": {"modbus_tcp": {"host": "127.0.0.1", "port": port, "period_s": 0.05}}},
        "plant": {"move_out": {"gpio": {"source": "box", "line": "START", "debounce_s": 0.005}},
                  "extended": {"gpio": {"source": "box", "offset": 1, "active_low": True}},
                  "retracted": {"type": "boolean",
                                "modbus": {"source": "bus", "unit_id": 7, "table": "coil", "address": 5}},
                  "airflow": {"modbus": {"source": "plc", "table": "input", "address": 0, "type": "float32"}}},
        "synchronise": {"match": {"cylinder.retract_signal": {"to": "plant.retracted", "weight": 0}},
                        "budget": {"time_s": 0.01}},
        "record": {"file": "run.db", "commit_s": 0.1}, "realtime": {"priority": 0, "lock_memory": False}})


def samples(database, name):
    return query(database, "SELECT value, quality FROM v_samples WHERE name = ? ORDER BY tick", f"plant.{name}")


def test_a_live_run_with_three_kinds_of_sources():
    if not Path("/dev/ttyS2").exists():
        raise Skip("no serial line here")
    unit = Unit("/dev/ttyS2")
    with Chip("bench", ["START", "DONE"]) as chip, Device(1.5) as device:
        chip.set("DONE", True)
        config = configuration(device.port)
        database = config.parent / "run.db"
        with Program("run", config, "--json") as run:
            run.wait_for("connected", times=4)
            wait_until(lambda: database.exists() and number(database, "SELECT count(*) FROM steps") > 10, "steps", run.log)
            for _ in range(2):  # strokes
                unit.coil = 0
                chip.set("START", True)
                time.sleep(0.8)
                chip.set("DONE", False)
                time.sleep(0.4)
                chip.set("START", False)
                chip.set("DONE", True)
                time.sleep(0.6)
                unit.coil = 1
            told, log = end_well(run)
    check_database(database)
    for name, wanted in (("move_out", {0, 1}), ("extended", {0, 1}), ("retracted", {0, 1}), ("airflow", {1.5})):
        found = set(samples(database, name)[50:])
        expect(found == {(value, "good") for value in wanted}, f"{name} was read as {found}")
    expect(unit.requests > 50 and device.functions == {4}, f"{unit.requests} requests; functions {device.functions}")
    rows = number(database, "SELECT count(*) FROM steps")
    columns = number(database, "SELECT count(*) FROM signals WHERE kind = 'match'")
    again = scratch() / "again.db"
    repeated = replay_json(config, "--recording", database, "--db", again)
    expect(repeated["adjust"] == told["adjust"] and repeated["match"] == told["match"], f"{repeated}\n{told}\n{log}")
    expect_repeated(database, 1, again, RESULTS, columns * rows)
    print(f"    {rows} steps, {unit.requests} requests on the line, outcomes {told['outcomes']}")


def test_a_chip_that_is_pulled_out():
    """The driver alone. test_gpio_faults.py does the same with a run."""
    with Chip("bench", ["START"]) as chip, Probe(60, "bench", "START") as probe:
        for _ in range(2):
            chip.set("START", False)
            probe.wait_for(0, 0)
            chip.pull_out()
            probe.wait_for(0, 0, NO_LINK)
            before = probe.cpu_s()
            time.sleep(1.5)
            expect(probe.cpu_s() - before < 0.7, f"{probe.cpu_s() - before} s of CPU in 1.5 s without a chip")
            chip.plug_in()
            probe.wait_for(0, 0)
            expect_stamp(probe, 0, 1, chip.set("START", True))
        text = "\n".join(probe.said())
        expect_line(text, "down|START|chip|gone")
        expect_line(text, "down|START|chip|bench")


if __name__ == "__main__":
    twinlock_test.main()
