#!/usr/bin/env python3
"""A signal that is miswired: nothing bounds the correction, so the twin agrees with the plant. It must not read plainly locked.

What released twins found is in the results and in the database; if there are none, the reason is."""
import csv
import hashlib
import json
import random
import sqlite3
from contextlib import closing

from brakes import hand
from twinlock_test import SOURCE, at_most, edited_config, expect, expect_line, expect_no_line, main, run, run_well, scratch

SECONDS, SAMPLE_S = 40, 0.02
OMEGA, TORQUE = 1, 2  # columns of a recording
RPM = 9.5493
UNBOUNDED = {"duration_s": SECONDS - 2, "delays": None,
             "plant": {"torque": {"min": None, "max": None}, "omega": {"min": None, "max": None}},
             "synchronise": {"adjust": {"motor.d": {"min": None, "max": None}}}}


def plant():
    """Rows of a recording of a plant that the model matches, up to the noise of its sensor."""
    brake, recording = scratch() / "brake.csv", scratch() / "recording.csv"
    torque = hand(random.Random(4711))
    rows = (f"{i * SAMPLE_S:.2f},{torque(i * SAMPLE_S):.4f}\n" for i in range(round((SECONDS + 1) / SAMPLE_S)))
    brake.write_text("t,torque\n" + "".join(rows), encoding="utf-8")
    edits = {"duration_s": SECONDS, "components": {"motor": {"set": {"J": 0.0515}}}, "recording": {"file": str(brake)}}
    run_well(["plant", edited_config("motor/plant.json", edits), "--record", recording, "--seed", 7])
    with open(recording, encoding="utf-8", newline="") as file:
        return list(csv.reader(file))


def written(rows):
    recording = scratch() / "wired.csv"
    with open(recording, "w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows(rows)
    return recording


def lock_of(rows):
    """(exit code, lock of --json) of the twin with this recording."""
    code, out, _ = run(["replay", edited_config("motor/lock.json", UNBOUNDED), "--recording", written(rows), "--json"])
    return code, json.loads(out)["lock"]


def scaled(column, factor, offset=0.0):
    def change(rows):
        return [[f"{factor * float(cell) + offset:.9f}" if i == column and cell else cell for i, cell in enumerate(row)] for row in rows]
    return change


def frozen(column, after_s):
    def change(rows):
        kept = next(row[column] for row in rows if float(row[0]) >= after_s and row[column])
        return [[kept if i == column and cell and float(row[0]) >= after_s else cell for i, cell in enumerate(row)] for row in rows]
    return change


def late(column, lines):
    def change(rows):
        cells = [row[column] for row in rows]
        cells = cells[:1] * lines + cells[:-lines]
        return [[cells[n] if i == column else cell for i, cell in enumerate(row)] for n, row in enumerate(rows)]
    return change


def swapped(rows):
    return [[row[0], row[TORQUE], row[OMEGA], *row[3:]] for row in rows]


WIRINGS = {
    "an address with another value: the speed reads 0": scaled(OMEGA, 0.0),
    "speed times 10": scaled(OMEGA, 10.0),
    "speed in revolutions a minute": scaled(OMEGA, RPM),
    "the sign of the speed": scaled(OMEGA, -1.0),
    "an offset of the speed": scaled(OMEGA, 1.0, 4.0),
    "a speed that freezes": frozen(OMEGA, 12.0),
    "an address with another value: the torque reads 0": scaled(TORQUE, 0.0),
    "torque times 10": scaled(TORQUE, 10.0),
    "the sign of the torque": scaled(TORQUE, -1.0),
    "a torque that freezes": frozen(TORQUE, 12.0),
    "a torque of another time": late(TORQUE, 100),
    "speed and torque are swapped": swapped,
}


def test_none_is_plainly_locked():
    header, *rows = plant()
    code, lock = lock_of([header, *rows])
    expect(code == 0 and lock["state"] == "locked" and lock["percent"] == 100, f"wired right: {code}, {lock}")
    at_most(lock["steps"]["corrected"], 0, "wired right: corrected steps")
    for what, change in WIRINGS.items():
        code, lock = lock_of([header, *change(rows)])
        print(f"    {what}: exit code {code}, {lock['state']}, {lock['percent']:.4g} % in lock, {lock['steps']['corrected']} steps corrected")
        expect(lock["state"] != "locked" and code in (0, 3), f"{what}: {code}, {lock}")


def warmer(**keys):
    """The configuration of a twin of a board, corrected by the temperature of the surroundings, nominally 296.8 K."""
    return edited_config("tclab/ambient.json", {"components": {"board": {"set": {"mCp": 2}}}, "synchronise": {
        "release_s": 240, "horizon": {"prediction": 40}, "match": {"board.T2": {"weight": 0}}, "adjust": {"board.Ta": {"nominal": 296.8, "step": 2, **keys}}}})


def lock_events(database):
    with closing(sqlite3.connect(database)) as opened:
        return opened.execute("SELECT tick, severity, text FROM v_events WHERE source = 'lock' ORDER BY tick").fetchall()


def twin_of(database):
    with closing(sqlite3.connect(database)) as opened:
        return opened.execute("SELECT applied, simulated, flags FROM adjustments JOIN outputs USING (run, step) JOIN steps"
                              " USING (run, step) ORDER BY step").fetchall()


def test_a_standing_disturbance():
    """The surroundings are 5 K warmer. This is corrected until a person approves it, in place or in another run. Afterwards a
    sensor that is off is corrected again."""
    heaters, recording, database, again = scratch() / "heaters.csv", scratch() / "warm.csv", scratch() / "run.db", scratch() / "again.db"
    heaters.write_text("time,Q1,Q2\n0,50,40\n1700,50,40\n", encoding="utf-8")
    edits = {"duration_s": 1600, "recording": {"file": str(heaters)}, "components": {"board": {"set": {"Ta": 301.8}}}}
    run_well(["plant", edited_config("tclab/plant.json", edits), "--record", recording, "--seed", 7])
    out = run_well(["replay", warmer(), "--recording", recording])
    as_json = run_well(["replay", warmer(), "--recording", recording, "--db", database, "--json"])
    for shown in (out, run_well(["show", database, "--events"])):
        expect_line(shown, "locked, corrected: board.Ta|K since t = 0 s")
        expect_line(shown, "to accept it: \"approved\":|in synchronise.adjust.board.Ta")
        expect(all(len(line) <= 80 for line in shown.splitlines() if line.lstrip().startswith(("locked", "to accept"))), shown)
    (_, severity, _), *_ = events = [event for event in lock_events(database) if "corrected" in event[2]]
    expect(severity == "warning" and all(event[1] == "info" for event in events[1:]), f"{events}")
    for told in (json.loads(as_json), json.loads(run_well(["show", database, "--json"]))):
        corrected = told["lock"]["corrected"]
        expect(corrected.pop("value") - 5 < 0.5 and corrected == {
            "reason": "correction", "variable": "board.Ta", "unit": "K", "since_s": 0, "since": None}, f"{corrected}")
    approved = warmer(approved=5)
    lock = json.loads(run_well(["replay", approved, "--recording", recording, "--json"]))["lock"]
    expect(lock["state"] == "locked" and lock["percent"] == 100 and lock["steps"]["corrected"] == 0, f"{lock}")
    with closing(sqlite3.connect(database)) as opened, opened:
        text = approved.read_text(encoding="utf-8")
        name = hashlib.sha256(text.encode()).hexdigest()
        opened.execute("INSERT INTO configurations VALUES (?, ?)", (name, text))
        opened.execute("INSERT INTO tunings VALUES (1, 800, ?, '2026-11-23T10:00:00.000Z', 'ann', 'test', 'warm')", (name,))
    run_well(["replay", warmer(), "--recording", database, "--db", again])
    after = [event for event in lock_events(again) if event[0] >= 800]
    expect(len(after) == 1 and after[0][0] < 810 and after[0][2].startswith("locked: "), f"{after}")
    expect(twin_of(again) == twin_of(database), "the twin has other bits")
    header, *rows = list(csv.reader(recording.open(encoding="utf-8", newline="")))
    off = [[f"{float(cell) + 3}" if i == header.index("T1") and cell and float(row[0]) > 1000 else cell for i, cell in enumerate(row)]
           for row in rows]
    lock = json.loads(run_well(["replay", approved, "--recording", written([header, *off]), "--json"]))["lock"]
    expect(lock["state"] != "locked" and 900 < lock["corrected"]["since_s"] < 1200, f"a sensor that is off: {lock}")


def test_the_database_has_the_same_error():

    database = scratch() / "run.db"
    out = run_well(["replay", edited_config("motor/lock.json"), "--json", "--db", database])
    told = json.loads(out)
    with closing(sqlite3.connect(database)) as opened:
        (pairs, squares), = opened.execute("SELECT count(*), sum((released - measured) * (released - measured)) FROM v_outputs"
                                           " WHERE quality = 'good'")
        (ages,), = opened.execute("SELECT max(release_age) FROM steps")
    mse = told["match"]["motor.omega"]["mse_released"]
    expect(abs(squares / (pairs - 1) / mse - 1) < 1e-9 and ages == told["released"]["steps"] == 600, f"{squares}, {pairs}, {ages}: {told}")
    expect(json.loads(run_well(["show", database, "--json"]))["match"]["motor.omega"]["mse_released"] == mse, "show has another error")


def test_why_there_are_none():
    for edits, parts in (({"components": {"motor": {"rollback": "replay"}}}, "released|none|repeat"),
                         ({"components": {"motor": {"keep": "outputs"}}}, "released|none|keep|outputs")):
        config = edited_config("motor/lock.json", edits)
        expect_line(run_well(["check", config]), parts)
        expect_line(run_well(["replay", config, "--verbose"]), parts)
        expect_no_line(run_well(["replay", config]), "without corrections")
    config = edited_config("motor/lock.json", {"synchronise": {"release_s": 0}})
    expect_no_line(run_well(["check", config]), "released")
    expect("released" not in json.loads(run_well(["replay", config, "--json"])), "not wanted, but in the results")


if __name__ == "__main__":
    main()
