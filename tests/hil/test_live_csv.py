#!/usr/bin/env python3
"""CSV sources live: a FIFO that another process writes, and a file that is played in real time."""
import csv
import errno
import fcntl
import os
import pty
import re
import signal
import struct
import termios
import threading
import time

from live_test import (GOOD, NO_LINK, NOT_A_NUMBER, STALE, Program, check_free_run, check_replay,
                       check_summary, end_well, expect_events, expect_in_order, last_step, number, qualities, query,
                       wait_for_lock, wait_for_quality, wait_for_steps, wait_until)
from twinlock_test import NOT_LOCKED, PLAIN_LIVE, SOURCE, edited_config, expect, finish, main, start

OMEGA = 62.981  # rad/s: where config/motor's twin starts


def csv_config(file, **changes):
    """The motor bench, live, with its signals from a CSV source. Returns the paths (configuration,
    CSV file, database)."""
    signals = {name: {"modbus": None, "csv": {"source": "stream"}} for name in ("torque", "omega")}
    sources = {"inverter": None, "stream": {"csv": {"file": file, "time_column": "t"}}}
    config = edited_config(PLAIN_LIVE, {"duration_s": None, "record": {"commit_s": 0.1},
                                               "plant": signals, "sources": sources, **changes})
    return config, config.parent / file, config.parent / "twin.db"


class Feeder(threading.Thread):
    """Writes a row with `speed` into a FIFO every 10 ms. It writes `extra` once, after the next
    row."""

    def __init__(self, fifo, run):
        super().__init__(daemon=True)
        self.file = wait_until(lambda: self._open(fifo), "a reader of the FIFO", run.log)
        self.speed, self.extra, self.stopped = repr(OMEGA), None, False

    @staticmethod
    def _open(fifo):
        try:
            return os.open(fifo, os.O_WRONLY | os.O_NONBLOCK)
        except OSError as reason:
            if reason.errno != errno.ENXIO:
                raise
            return None

    def run(self):
        os.set_blocking(self.file, True)
        begun = time.monotonic()
        try:
            os.write(self.file, b"t,omega,M_brake\n")
            while not self.stopped:
                os.write(self.file, f"{time.monotonic() - begun:.6f},{self.speed},0\n".encode())
                extra, self.extra = self.extra, None
                os.write(self.file, (extra or "").encode())
                time.sleep(0.01)
        except BrokenPipeError:
            pass
        os.close(self.file)

    def __enter__(self):
        self.start()
        return self

    def __exit__(self, *unused):
        self.stopped = True
        self.join(10)


def test_fifo_and_its_writer_twice():
    config, fifo, database = csv_config("plant.fifo")
    with Program("plant", config, "--fifo", fifo) as first:
        wait_until(fifo.exists, "the FIFO", first.log)
        with Program("run", config, "--json") as live:
            live.wait_for("stream|plant.fifo|rows")
            wait_for_lock(live, database)
            code, _, log = first.end(signal.SIGTERM)
            expect(code == 0, f"the first writer ended with {code}\n{log}")
            wait_for_quality(live, database, "omega", NO_LINK)
            wait_for_steps(live, database, last_step(database) + 20)
            with Program("plant", config, "--fifo", fifo) as second:
                live.wait_for("stream|plant.fifo|rows", times=2)
                wait_for_quality(live, database, "omega", GOOD)
                wait_for_lock(live, database, last_step(database))
                told, _ = end_well(live, signal.SIGTERM)
                code, _, log = second.end(signal.SIGTERM)
                expect(code == 0, f"the second writer ended with {code}\n{log}")
    rows = check_summary(told, database)
    expect_events(database, ("info", "stream|plant.fifo|rows"), ("warning", "stream|plant.fifo|closed"),
                  ("info", "stream|plant.fifo|rows"))
    expect_events(database, ("warning", "plant.omega|stream"), ("info", "plant.omega|good"))
    expect_in_order(qualities(database, "omega"), [GOOD, NO_LINK, GOOD], "quality of omega")
    check_free_run(database)
    check_replay(config, database, rows)


def test_a_scaled_column():
    """Samples are in the signal's unit; a replay of the database does not scale them again."""
    signals = {"torque": {"modbus": None, "csv": {"source": "stream"}},
               "omega": {"modbus": None, "csv": {"source": "stream", "scale": 2, "offset": -8}}}
    config, fifo, database = csv_config("plant.fifo", plant=signals)
    os.mkfifo(fifo)
    with Program("run", config, "--json") as live, Feeder(fifo, live) as feeder:
        feeder.speed = repr((OMEGA + 8) / 2)
        wait_for_lock(live, database)
        feeder.speed = "nan"
        wait_for_quality(live, database, "omega", NOT_A_NUMBER)
        told, _ = end_well(live, signal.SIGTERM)
    rows = check_summary(told, database)
    check_free_run(database)
    check_replay(config, database, rows)


def test_invalid_rows():
    config, fifo, database = csv_config("plant.fifo")
    os.mkfifo(fifo)
    with Program("run", config, "--json") as live, Feeder(fifo, live) as feeder:
        wait_for_lock(live, database)
        for times, bad in enumerate(("1e999\n", "some;thing,else\n", "1,2,3,4,5\n", "0,0,0\n")):
            time.sleep(1 if times else 0)  # there is at most one such event per second
            feeder.extra = bad
            wait_until(lambda: number(database, "SELECT count(*) FROM events WHERE text LIKE '%skipped%'") > times, "an event", live.log)
        feeder.speed = "nan"
        wait_for_quality(live, database, "omega", NOT_A_NUMBER)
        feeder.speed = repr(OMEGA)
        wait_for_quality(live, database, "omega", GOOD)
        wait_for_lock(live, database, last_step(database))
        told, _ = end_well(live, signal.SIGTERM)
    rows = check_summary(told, database)
    expect_events(database, ("warning", "plant.fifo|skipped|1|3"), ("warning", "plant.fifo|skipped|2|3"),
                  ("warning", "plant.fifo|skipped|5|3"), ("warning", "plant.fifo|skipped|time|0.000000000 s"),
                  ("warning", "plant.omega|not a number"), ("info", "plant.omega|good"))
    check_free_run(database)
    check_replay(config, database, rows)


def rows_of_recording(path, seconds):
    """Writes the beginning of the recording into a file."""
    with open(SOURCE / "config" / "motor" / "recording.csv", encoding="utf-8", newline="") as file:
        rows = list(csv.reader(file))
    lines = [",".join(row) for row in rows[:1] + [row for row in rows[1:] if float(row[0]) < seconds]]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def test_file():
    config, path, database = csv_config("plant.csv")
    rows_of_recording(path, 1)
    with Program("run", config, "--json") as live:
        wait_for_lock(live, database)
        wait_for_quality(live, database, "omega", STALE)  # after the end of the file
        wait_for_steps(live, database, last_step(database) + 20)
        told, _ = end_well(live, signal.SIGTERM)
    rows = check_summary(told, database)
    expect_in_order(qualities(database, "omega"), [GOOD, STALE], "quality of omega")
    expect_events(database, ("info", "stream|plant.csv"), ("warning", "plant.omega|stale_s"), ("warning", "no matched signal|nominal"))
    check_free_run(database)
    check_replay(config, database, rows)


def test_file_that_goes_back_in_time():
    config, path, database = csv_config("plant.csv")
    rows_of_recording(path, 0.5)
    with open(path, "a", encoding="utf-8") as file:
        file.write("0.6,sixty,0\n0.7,60,0\n0.1,60,0\n0.2,60,0\n")
    with Program("run", config, "--json") as live:
        wait_for_quality(live, database, "omega", STALE)  # after the end of the file
        wait_for_steps(live, database, last_step(database) + 20)
        told, _ = end_well(live, signal.SIGTERM)
    rows = check_summary(told, database)
    expect_in_order(qualities(database, "omega"), [GOOD, NOT_A_NUMBER, GOOD, STALE], "quality of omega")
    expect_events(database, ("info", "stream|plant.csv"), ("info", "plant.csv|0.700000000 s|0.100000000 s"),
                  ("warning", "plant.omega|stale_s"))
    check_free_run(database)
    check_replay(config, database, rows)


class Logger(threading.Thread):
    """Appends a row to a file every 20 ms. The second half of a row follows 5 ms later. `rotate`
    replaces the file as logrotate does; `ahead` is added to the time of the rows."""

    def __init__(self, path):
        super().__init__(daemon=True)
        self.path, self.rows, self.ahead, self.stopped = path, 0, 0.0, False
        self.begin()

    def begin(self):
        self.file = open(self.path, "w", encoding="utf-8")
        self.file.write("t,omega,M_brake\n")

    def rotate(self):
        self.path.rename(self.path.with_suffix(".1"))
        self.begin()

    def run(self):
        while not self.stopped:
            row = f"{time.monotonic() + self.ahead:.6f},{OMEGA + self.rows / 1000},0\n"
            file, self.rows = self.file, self.rows + 1
            for half in row[:9], row[9:]:
                file.write(half)
                file.flush()
                time.sleep(0.005)
            time.sleep(0.01)

    def __enter__(self):
        self.start()
        return self

    def __exit__(self, *unused):
        self.stopped = True
        self.join(10)


def test_growing_file():
    """A file that another program writes is followed when it is replaced, truncated, and when its
    clock is set by 5 s. Missed ticks may omit a value."""
    config, path, database = csv_config("plant.csv")
    path.write_text("t,omega,M_brake\n" + "".join(f"{i},0,0\n" for i in range(100)), encoding="utf-8")  # 100 s of old rows

    def used(count=25):
        """Waits until so many new values were used."""
        first = writer.rows
        wait_until(lambda: query(database, "SELECT coalesce(max(value), 0) FROM v_samples WHERE name = 'plant.omega'")[0][0]
                   > OMEGA + (first + count) / 1000, "new values", live.log)

    with Program("run", config, "--json") as live:
        wait_for_steps(live, database, 20)
        with Logger(path) as writer:
            for change in None, writer.rotate, writer.begin:
                if change:
                    change()
                used()
            for writer.ahead in -5, 0, 5, 0:
                used()
        wait_for_quality(live, database, "omega", STALE)
        live.wait_for("plant.csv|no new one")
        told, _ = end_well(live, signal.SIGTERM)
    rows = check_summary(told, database)
    values = [value for value, in query(database, "SELECT DISTINCT value FROM v_samples WHERE name = 'plant.omega' AND value > 1 "
                                        "ORDER BY tick")]
    missing = writer.rows - len(values)
    expect(values == sorted(values) and missing < writer.rows / 3, f"{missing} of {writer.rows} rows were not used")
    expect_events(database, ("info", "plant.csv|only new rows"), ("info", "plant.csv|goes back"), ("info", "plant.csv|goes back"))
    check_free_run(database)
    check_replay(config, database, rows)


class Terminal(threading.Thread):
    """A terminal of 80 columns that reads continuously."""

    def __init__(self):
        super().__init__(daemon=True)
        self.master, self.end = pty.openpty()
        self.shown = b""
        fcntl.ioctl(self.end, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
        self.start()

    def run(self):
        try:
            while part := os.read(self.master, 4096):
                self.shown += part
        except OSError:  # all processes have closed it
            pass


def test_status_on_a_terminal():
    """The status line has the time, the correction and the output, and at most 77 columns, so that
    ^C fits behind it."""
    config, fifo, _ = csv_config("plant.fifo")
    os.mkfifo(fifo)
    terminal = Terminal()
    live = start(["run", config, "--duration", "1"], stderr=terminal.end)
    live.log = lambda: terminal.shown
    with Feeder(fifo, live) as feeder:
        wait_until(lambda: b"motor.d " in terminal.shown, "a status line", live.log)
        feeder.speed = "x"
        code, _, _ = finish(live)
        feeder.stopped = True
    os.close(terminal.end)
    terminal.join(5)
    lines = [part.split("\r\n")[0] for part in terminal.shown.decode().split("\r\033[K") if re.match(r" *[0-9.]+ s  .*motor\.d ", part)]
    expect(code in (0, NOT_LOCKED) and len(lines) > 3, f"{code}: {terminal.shown}")  # on a busy machine only one step precedes the "x"
    begun = [part for part in terminal.shown.split(b"twinlock: ")[:-1] if part]
    expect(b"not a number" in terminal.shown and all(part.endswith((b"\n", b"\r\033[K")) for part in begun),
           f"an event within a line: {begun}")
    expect(all(len(line) <= 77 and ("motor.omega" in line or "missed" in line) for line in lines), f"{lines}")  # too narrow for both


if __name__ == "__main__":
    main()
