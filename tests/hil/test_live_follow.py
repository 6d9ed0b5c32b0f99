#!/usr/bin/env python3
"""`run --follow`: JSON lines of a live run. They agree with its database. A reader that is gone, or does not read, never
disturbs the run."""
import fcntl
import json
import os
import signal
import socket

from live_test import Program, free_port, number, query, wait_until
from supervised import Supervised
from twinlock_test import SOURCE, at_least, at_most, edited_config, expect, expect_line, main, merge, read_config, run_well, scratch, within, write_config

VESSELS = SOURCE / "config" / "vessels"
KEYS = ["time", "lock", "step_s", "ticks", "steps", "skipped", "deadline_misses", "in_lock", "line", "is_in_lock", "tick", "evaluations",
        "executions", "time_limited", "late_s", "used_s", "lost", "open_findings", "corrections", "match", "dropped_lines"]
DROPPED = 3  # lines


class Bench:
    """The two vessels of config/vessels, played by Modbus, and a configuration of their twin."""

    def __init__(self, alarm=None):
        self.config = edited_config(VESSELS / "live.json", {"sources": {"device": {"modbus_tcp": {"port": free_port()}}},
                                                            "detect": {"alarm": alarm or {}}})
        self.database = self.config.parent / "twin.db"

    def __enter__(self):
        self.plant = Program("plant", VESSELS / "plant.json", "--for", self.config)
        self.plant.wait_for("by Modbus TCP")
        return self

    def __exit__(self, *unused):
        self.plant.kill()


def objects(text):
    return [json.loads(line) for line in text.splitlines()]


def test_lines():
    with Bench() as bench, Program("run", bench.config, "--follow", "--duration", "6") as live:
        code, out, log = live.end()
        expect(code == 0, log)
        expect_line(log, "in lock|at the end locked")
        lines = objects(out)
        at_least(len(lines), 5, "lines in 6 s")
        at_most(len(lines), 9, "lines in 6 s")
        for line in lines:
            expect(list(line) == KEYS, f"other keys: {line}")
            expect(line["dropped_lines"] == 0 and line["open_findings"] == 0, f"{line}")
        expect(lines[0]["lock"] == "" and not lines[0]["is_in_lock"] and lines[0]["corrections"] == {}, f"{lines[0]}")
        last = lines[-1]
        expect(last["lock"] == "locked" and last["is_in_lock"] and last["in_lock"] > 50 and "locked" in last["line"], f"{last}")
        expect(list(last["match"]) == ["second.y", "first.y"] and last["match"]["second.y"]["unit"] == "1", f"{last}")
        expect_values(bench.database, lines[1:])


def expect_values(database, lines):
    rows = dict(query(database, "SELECT step, applied - nominal FROM adjustments WHERE run = 1"))
    checked = 0
    for before, line in zip(lines, lines[1:]):
        if before["ticks"] == 0:
            continue
        wanted = [rows[step] for step in range(before["ticks"], line["ticks"])]
        within(line["corrections"]["first.u"], sum(wanted) / len(wanted), 1e-6, "mean correction since the line before")
        executions = number(database, "SELECT sum(executions) FROM steps WHERE run = 1 AND step < ?", line["ticks"])
        expect(line["executions"] == executions, f"{executions} executions in the database: {line}")
        simulated, measured = query(database, "SELECT simulated, measured FROM outputs WHERE step = ? AND run = 1 ORDER BY signal",
                                    line["ticks"] - 1)[0]
        within(line["match"]["second.y"]["simulated"], simulated, 1e-12, "simulated")
        within(line["match"]["second.y"]["measured"], measured, 1e-12, "measured")
        at_most(line["used_s"], 0.1, "time of a step, s")
        at_least(line["late_s"], 0, "lateness, s")
        checked += 1
    at_least(checked, 2, "lines that were compared with the database")


def test_a_reader_that_is_gone():
    with Bench() as bench, Program("run", bench.config, "--follow", "--status", "--duration", "5") as live:
        live.process.stdout.readline()
        live.process.stdout.close()
        live.process.stdout = None
        live.wait_for("notice|--follow|reader is gone")
        code, _, log = live.end()
        expect(code == 0, log)
        expect_line(log, "locked|second.y")
        expect(number(bench.database, "SELECT max(step) FROM steps") > 400, "the run has ended early")


def small_pipe():
    reader, writer = os.pipe()
    fcntl.fcntl(writer, fcntl.F_SETPIPE_SZ, 4096)
    return reader, writer


def small_socket():
    """As Node-RED gives it to a program."""
    reader, writer = socket.socketpair()
    writer.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
    return reader.detach(), writer.detach()


def expect_undisturbed(opened):
    reader, writer = opened()
    with Bench() as bench, Program("run", bench.config, "--follow", stdout=writer) as live, open(reader, encoding="utf-8") as lines:
        os.close(writer)
        wait_until(lambda: bench.database.exists() and number(bench.database, "SELECT count(*) FROM steps") >= 1200, "12 s", live.log)
        read = json.loads(lines.readline())
        while read["dropped_lines"] == 0:
            read = json.loads(lines.readline())
        at_least(read["dropped_lines"], DROPPED, "dropped lines")
        expect(read["lock"] == "locked", f"{read}")
        live.signal(signal.SIGTERM)
        for line in lines:
            expect(list(json.loads(line)) == KEYS, line)
        code, _, log = live.end()
        expect(code == 0, log)
        rows, last = query(bench.database, "SELECT count(*), max(step) FROM steps")[0]
        expect(rows == last + 1, f"{rows} rows, last step {last}")


def test_a_pipe_without_a_reader():
    expect_undisturbed(small_pipe)


def test_a_socket_without_a_reader():
    expect_undisturbed(small_socket)


def test_supervised():
    """The lines continue over a killed twin, and over a restart of the whole run by a reload. The finding of an alarm stays one."""
    place = scratch() / "control"
    with Bench({"first.u": {"above": -1, "for_s": 0.5}}) as bench, Supervised(bench.config, "--follow", "--control", place) as live:
        def wait_for(condition, what):
            while not condition(line := json.loads(live.process.stdout.readline())):
                pass
            print(f"    {what}: {line['line']}")
            return line
        before = wait_for(lambda line: line["is_in_lock"] and line["steps"] > 200 and line["open_findings"] == 1, "in lock")
        os.kill(live.child(), signal.SIGKILL)
        again = wait_for(lambda line: line["steps"] < before["steps"] and line["is_in_lock"], "again")
        expect(again["corrections"].keys() == before["corrections"].keys(), f"{again}")
        changed = write_config(merge(read_config(bench.config), {"name": "two other vessels"}))
        run_well(["reload", changed, "--control", place, "--restart"])
        wait_for(lambda line: line["lock"] == "", "restarted")
        wait_for(lambda line: line["is_in_lock"] and line["open_findings"] == 1, "in lock")
        live.signal(signal.SIGTERM)
        code, _, log = live.end()
        expect(code == 0, log)
        found = query(bench.database, "SELECT kind, variable, state FROM findings")
        expect(found == [("limit", "first.u", "open")], f"{found}")
        expect_line(log, "warning|first.u|limits")


if __name__ == "__main__":
    main()
