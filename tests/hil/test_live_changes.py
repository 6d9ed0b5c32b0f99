#!/usr/bin/env python3
"""A live run finds a change of the plant. What is normal, it knows from a replay into the same database. The finding survives
a recorder that dies and a restart, and ends when the plant is as before."""
import contextlib
import csv
import json
import os
import random
import re
import signal
import sqlite3
import time

from live_test import Program, check_database, end_well, free_port, member, number, query, stop, wait_until
from twinlock_test import at_most, expect, expect_line, expect_no_line, main, merge, run, run_well, scratch

STEP, NORMAL_S, LEARN_S = 0.01, 600, 300
BREAKS, MENDED = 42, 100  # s: the pump is weak meanwhile
LEFT_OUT = LEARN_S / 10  # s after a start
LAGS = {"first": {"fmu": "lag.fmu", "set": {"T": 0.6, "x_start": 1, "t_step": 0.01}},
        "second": {"fmu": "lag.fmu", "set": {"T": 0.4, "x_start": 1, "t_step": 0.01}}}
COMMON = {"twinlock": 1, "name": "two vessels", "step_s": STEP, "components": LAGS, "recording": {"time_column": "time"}}
CONNECT = [["plant.q", "first.u"], ["first.y", "second.u"]]


def write_commands(path, length, seed, leaks=()):
    """Commands, and what a pump makes of them; it is weak between the times of `leaks`."""
    choice = random.Random(seed)
    with open(path, "w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["time", "q", "q_actual"])
        value, until = 1.0, 0.0
        for i in range(int(length / 0.1)):
            at = 0.1 * i
            if at >= until:
                value, until = choice.uniform(0.5, 2.0), at + choice.uniform(1, 4)
            weak = any(begin <= at < end for begin, end in leaks)
            rows.writerow([f"{at:.1f}", f"{value:.5g}", f"{value * (0.85 if weak else 1.0):.6g}"])


def write(path, document):
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


class Bench:
    """A plant with a pump, played by Modbus, and a twin of it."""

    def __init__(self):
        self.folder = scratch()
        self.port = free_port()
        self.database = self.folder / "twin.db"

    def plant(self, length, seed, leaks):
        write_commands(self.folder / "commands.csv", length, seed, leaks)
        return write(self.folder / "plant.json", {
            **COMMON, "duration_s": length - 1, "recording": {"file": "commands.csv", "time_column": "time"},
            "plant": {"q": {}, "q_actual": {}}, "connect": [["plant.q_actual", "first.u"], ["first.y", "second.u"]],
            "emulate": {"columns": {"q": {"from": "plant.q"}, "level": {"from": "second.y", "noise": 0.01}}}})

    def twin(self, change=None):
        signal_of = {"source": "device", "unit_id": 1, "table": "input", "type": "float32"}
        lock = {**COMMON, "plant": {"q": {"modbus": {**signal_of, "address": 0}, "csv": {"column": "q"}},
                                    "level": {"modbus": {**signal_of, "address": 2}, "csv": {"column": "level"}}},
                "sources": {"device": {"modbus_tcp": {"host": "127.0.0.1", "port": self.port, "period_s": 0.005, "timeout_s": 0.5}}},
                "connect": CONNECT, "record": {"file": "twin.db", "max_mb": 100, "commit_s": 0.1, "resume_s": 1},
                "detect": {"learn_s": LEARN_S},
                "synchronise": {"adjust": {"first.u": {"step": 0.1, "min": 0, "max": 4}}, "horizon": {"prediction": 30},
                                "match": {"second.y": {"to": "plant.level", "tolerance": 0.03}}}}
        return write(self.folder / "twin.json", merge(lock, change or {}))

    def learn(self):
        """Stores what is normal, from a recording."""
        recording = self.folder / "normal.csv"
        run_well(["plant", self.plant(NORMAL_S, 1, ()), "--record", recording])
        return json.loads(run_well(["replay", self.twin({"duration_s": NORMAL_S - 2}), "--recording", recording, "--db", self.database,
                                    "--json"]))

    def play(self, length, seed, leaks):
        plant = self.plant(length, seed, leaks)
        return Program("plant", plant, "--for", self.twin(), "--seed", str(seed))

    def states(self):
        return [state for state, in query(self.database, "SELECT state FROM findings ORDER BY finding")]


def epoch(database, column, table):
    return number(database, f"SELECT (julianday({column}) - 2440587.5) * 86400 FROM {table} ORDER BY 1 DESC LIMIT 1")


def shown(database):
    return json.loads(run_well(["show", database, "--json", "--events"]))


def expect_found(bench, live, began):
    live.wait_for("finding|first.u|since|UTC")
    at_most(time.time() - began, 15, "time until the change was found, s")
    wait_until(bench.states, "a stored finding", live.log)


def test_a_change_of_the_plant():
    bench = Bench()
    learned = bench.learn()
    expect(learned["detection"]["state"] == "watching" and learned["findings"] == [], f"{learned['detection']}, {learned['findings']}")
    with bench.play(150, 2, [(BREAKS, MENDED)]) as plant:
        plant.wait_for("by Modbus TCP")
        began = time.time()
        expect_a_change(bench, began)
    check_database(bench.database)
    expect_nothing_learned(bench)


def expect_explained(bench, live):
    """The run explains the finding itself."""
    wait_until(lambda: number(bench.database, "SELECT count(explanation) FROM findings"), "an explanation", live.log)
    finding = shown(bench.database)["findings"][0]
    size = re.search(r"first\.u gain ([-+.0-9]+) ", finding["explanation"])
    expect(size, finding)
    at_most(abs(float(size[1]) + 15), 1, "error of the explained size, %")
    expect(finding["explained_at"] > finding["found_at"], finding)
    live.wait_for("finding 1|first.u gain")
    expect_line(run_well(["show", bench.database]), "explanation:|first.u")


def expect_same_from_checkpoint(bench, checkpoint):
    """If the ticks before a checkpoint were removed, the answer is the same. Without the checkpoint, or a step that
    it needs, there is an error."""
    copy = bench.folder / "copy.db"
    with contextlib.closing(sqlite3.connect(bench.database)) as database, contextlib.closing(sqlite3.connect(copy)) as other, other:
        database.backup(other)
        other.execute("DELETE FROM checkpoints")
        other.execute("INSERT INTO checkpoints VALUES (?, ?, ?, ?, ?)", checkpoint)
        lead, = query(copy, "SELECT max(lead) FROM runs")[0]
        first = checkpoint[1] + 1 - lead
        other.execute("DELETE FROM samples WHERE tick < ?", [first])
        other.execute("DELETE FROM steps WHERE step < ?", [first])
        other.execute("UPDATE runs SET removed_before = ?", [first])
    whole, part = (json.loads(run_well(["explain", path, "--json"])) for path in (bench.database, copy))
    expect(whole["verdict"] == "found" and part == whole, f"{whole}\nbut from the checkpoint\n{part}")
    for missing in ("UPDATE runs SET removed_before = removed_before + 1", "DELETE FROM checkpoints"):
        with contextlib.closing(sqlite3.connect(copy)) as other, other:
            other.execute(missing)
        code, _, log = run(["explain", copy])
        expect(code == 65, f"{missing}: {code}")
        expect_line(log, "no start|removed")


def expect_a_change(bench, began):
    with Program("run", bench.twin(), "--json", "--status") as live:
        live.wait_for("lock|locked")
        time.sleep(13)
        checkpoint, = query(bench.database, "SELECT * FROM checkpoints WHERE tick > 0 ORDER BY tick LIMIT 1")
        time.sleep(LEFT_OUT - 10)
        os.kill(member(live, "recorder"), signal.SIGKILL)  # the next one continues
        expect(bench.states() == [], "found in a healthy plant")
        expect_found(bench, live, began + BREAKS)
        live.wait_for("locked|1 change")
        expect_explained(bench, live)
        told, log = end_well(live, signal.SIGTERM)
        expect([finding["state"] for finding in told["findings"]] == ["open"], f"the summary has: {told['findings']}")
        expect_no_line(log, "learning begins at zero")
    expect_same_from_checkpoint(bench, checkpoint)
    found = shown(bench.database)
    expect(found["detection"]["state"] == "watching", found["detection"])
    expect([finding["state"] for finding in found["findings"]] == ["open"], f"not one open finding: {found['findings']}")
    finding = found["findings"][0]
    expect(finding["variable"] == "first.u" and finding["kind"] == "step", finding)
    at_most(abs(finding["onset"] - BREAKS), 3, "error of the onset, s")
    at_most(abs(finding["percent"] + 15), 4, "error of the size, %")
    at_most(abs(epoch(bench.database, "onset_at", "findings") - epoch(bench.database, "started", "runs") - finding["onset"]),
            0.01, "difference between both times of the onset, s")
    expect([event["severity"] for event in found["events"] if event["source"] == "finding"][:1] == ["warning"], found["events"])
    expect_line(run_well(["show", bench.database]), "first.u|since|UTC")

    with Program("run", bench.twin(), "--json") as live:  # another run: the same change, which ends
        run_well(["finding", bench.database, "--acknowledge", "1", "--note", "pump ordered"])
        wait_until(lambda: bench.states() == ["gone"], "the end of the finding", live.log)
        expect(shown(bench.database)["findings"][0]["note"] == "pump ordered", "the note is lost")
        expect_line(run_well(["show", bench.database]), "change|1 is gone")
        run_well(["finding", bench.database, "--normal", "1", "--note", "product B"])
        live.wait_for("finding 1|normal from now on")
        wait_until(lambda: bench.states() == ["normal"], "a normal finding", live.log)
        expect(run(["finding", bench.database, "--normal", "1"])[0] == 65, "accepted twice")
        run_well(["learn", bench.database])
        live.wait_for("removed|learning begins at zero")
        expect(shown(bench.database)["detection"]["learnt_s"] < 10, "not learnt again")
        end_well(live, signal.SIGTERM)


def test_end_during_an_explanation():
    """A run does not wait for its explainer, and stores no part of an answer."""
    bench = Bench()
    bench.learn()
    with bench.play(100, 3, [(LEFT_OUT + 5, 100)]) as plant:
        plant.wait_for("by Modbus TCP")
        with Program("run", bench.twin(), "--json", "--status") as live:
            live.wait_for("lock|locked")
            live.wait_for("finding|first.u|since|UTC")
            explainer = member(live, "explainer")
            stop(explainer)
            _, log = end_well(live, signal.SIGTERM)
            expect_no_line(log, "error")
            expect(not os.path.exists(f"/proc/{explainer}"), "the explainer still runs")
    check_database(bench.database)
    expect(number(bench.database, "SELECT count(explanation) FROM findings") == 0, "half an answer was stored")


def expect_nothing_learned(bench):
    """Another configuration: what was learnt does not apply, but the findings are kept."""
    twin = bench.twin({"step_s": 0.02, "duration_s": 3})
    _, _, log = run(["run", twin])
    expect_line(log, "learning begins at zero")
    found = shown(bench.database)
    expect(found["detection"]["state"] == "learning", found["detection"])
    expect([finding["state"] for finding in found["findings"]] == ["normal"], "the finding is lost")
    expect_line(run_well(["show", bench.database]), "learning")


if __name__ == "__main__":
    main()
