#!/usr/bin/env python3
"""A signal that is miswired: nothing bounds the correction, so the twin agrees with the plant. It must not read plainly locked.

What released twins found is in the results and in the database; if there are none, the reason is."""
import csv
import json
import random
import sqlite3
from contextlib import closing

from brakes import hand
from twinlock_test import at_most, edited_config, expect, expect_line, expect_no_line, main, run, run_well, scratch

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


def lock_of(rows):
    """(exit code, lock of --json) of the twin with this recording."""
    recording = scratch() / "wired.csv"
    with open(recording, "w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows(rows)
    code, out, _ = run(["replay", edited_config("motor/lock.json", UNBOUNDED), "--recording", recording, "--json"])
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
