#!/usr/bin/env python3
"""Faults of a sensor that a lock hides: it repeats its last value, or it is late.

A frozen sensor is found and left out, unless the plant is at rest. A delay that grows is followed in lock."""
import csv
import random
import sqlite3
from contextlib import closing

from brakes import hand
from truth import make_truth, true_mse
from twinlock_test import at_least, at_most, edited_config, expect, expect_line, main, replay_csv, replay_json, run_well, scratch

SECONDS, SAMPLE_S, FROM_S, UNTIL_S = 90, 0.02, 20, 80
INERTIA, LIGHT = 0.0515, 0.0015  # kg m2: of the model, of the bench
DRIFT = 2e-3
SETTLED_S = 60  # the drive of the twin has recovered from the frozen value
FROZEN = 6  # code of the quality


def plant(torque, inertia=INERTIA):
    """Edits of a plant; the model matches it."""
    brake = scratch() / "brake.csv"
    rows = (f"{i * SAMPLE_S:.2f},{torque(i * SAMPLE_S):.4f}\n" for i in range(round((SECONDS + 1) / SAMPLE_S)))
    brake.write_text("t,torque\n" + "".join(rows), encoding="utf-8")
    return {"duration_s": SECONDS, "components": {"motor": {"set": {"J": inertia}}}, "recording": {"file": str(brake)}}


def record(edits):
    """Path of a recording of this plant."""
    recording = scratch() / "plant.csv"
    recording.unlink(missing_ok=True)
    run_well(["plant", edited_config("motor/plant.json", edits), "--record", recording, "--seed", 7])
    return recording


def rewrite(recording, change):
    """Path of a copy with other rows: change(rows) gets a dictionary for each."""
    with open(recording, encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    path = recording.with_name("changed.csv")
    with open(path, "w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(change(rows))
    return path


def freeze(rows):
    """The speed keeps the value of FROM_S until UNTIL_S."""
    kept = next(row["omega"] for row in rows if float(row["t"]) >= FROM_S and row["omega"])
    return [{**row, "omega": kept} if row["omega"] and FROM_S <= float(row["t"]) < UNTIL_S else row for row in rows]


def drift(rows):
    """From FROM_S on the clock of the speed sensor is slow by DRIFT."""
    made = {}
    for row in rows:
        time = float(row["t"])
        for column, at in (("omega", time + DRIFT * max(0.0, time - FROM_S)), ("M_brake", time)):
            if row[column]:
                made.setdefault(f"{at:.9f}", {"t": f"{at:.9f}", "omega": "", "M_brake": ""})[column] = row[column]
    return [made[time] for time in sorted(made, key=float)]


def events(database, source="plant"):
    with closing(sqlite3.connect(f"file:{database}?mode=ro", uri=True)) as connection:
        return connection.execute("SELECT tick, severity, text FROM v_events WHERE source = ? ORDER BY tick", (source,)).fetchall()


def frozen_ticks(database):
    with closing(sqlite3.connect(f"file:{database}?mode=ro", uri=True)) as connection:
        return [tick for tick, in connection.execute("SELECT tick FROM samples WHERE signal = 1 AND quality = ? ORDER BY tick", (FROZEN,))]


def lock(ref=10, inertia=INERTIA, delays=None, **edits):
    components = {"drive": {"set": {"ref": ref}}, "motor": {"set": {"J": inertia}}}
    return edited_config("motor/lock.json", {"duration_s": SECONDS - 2, "synchronise": edits, "components": components,
                                             "delays": delays or {"output": -0.005}})


def later(truth, from_s):
    kept = [i for i, time in enumerate(truth["t"]) if time > from_s]
    return {name: [column[i] for i in kept] for name, column in truth.items()}


def test_frozen():
    """Without released twins the frozen sensor is not found, and the twin stays at its value."""
    edits = plant(hand(random.Random(4711)))
    recording, database, again = rewrite(record(edits), freeze), scratch() / "run.db", scratch() / "again.db"
    run_well(["replay", lock(), "--recording", recording, "--db", database])
    (tick, severity, text), (end, mild, good) = events(database)
    expect_line(text, "plant.omega|frozen|since t|not used|check the sensor")
    expect((severity, mild, good) == ("warning", "info", "plant.omega: good again"), (severity, mild, good))
    expect(3000 <= tick <= 3700 and 100 * UNTIL_S < end < 100 * UNTIL_S + 30, f"left out from tick {tick} to {end}")
    expect(frozen_ticks(database) == list(range(tick, end)), "other samples are marked")

    truth = later(make_truth("motor/plant.json", edits), SETTLED_S)
    found, missed = (true_mse(replay_csv(lock(release_s=release_s), "--recording", recording), "motor.omega", truth, "omega", 0.01)
                     for release_s in (6, 0))
    at_most(found, 0.1, "MSE against the true speed after it is left out, (rad/s)\u00b2")
    at_least(missed, 1, "the same if it is matched")

    run_well(["replay", lock(), "--recording", database, "--db", again])
    expect((events(again), frozen_ticks(again)) == (events(database), frozen_ticks(database)), "the replay of the run differs")
    again.unlink()
    run_well(["replay", lock(release_s=0), "--recording", database, "--db", again])
    expect(frozen_ticks(again) == [], "another configuration does not decide again")


def test_rest():
    """A plant at rest is not found, also if the model without corrections would move away."""
    recording, database = rewrite(record(plant(lambda time: 0.0)), freeze), scratch() / "rest.db"
    for ref, error in ((10, 0), (9.5, 4)):
        database.unlink(missing_ok=True)
        match = replay_json(lock(ref), "--recording", recording, "--db", database)["match"]["motor.omega"]
        at_least(match["mse_released"], error, f"ref {ref}: MSE without corrections, (rad/s)\u00b2")
        expect(events(database) == [], events(database))


def test_a_growing_delay_is_followed_in_lock():
    """The model has twice the inertia of the plant, so it lags too: only the change of the lag counts."""
    edits = plant(hand(random.Random(4711)), LIGHT)
    recording, database = rewrite(record(edits), drift), scratch() / "run.db"
    truth = later(make_truth("motor/plant.json", edits), FROM_S)
    follows = {"output": -0.005, "measure": {"range_s": 0.25}}
    rows = replay_csv(lock(inertia=2 * LIGHT, delays=follows), "--recording", recording, "--db", database)
    fixed_db = scratch() / "fixed.db"
    fixed, followed = (true_mse(found, "motor.omega", truth, "omega", 0.01)
                       for found in (replay_csv(lock(inertia=2 * LIGHT), "--recording", recording, "--db", fixed_db), rows))
    expect_line("\n".join(text for _, _, text in events(fixed_db, "twin")), "delay|ms later|clock")
    at_least(fixed, 0.5, "MSE against the true speed with the delay of the start, (rad/s)\u00b2")
    at_most(followed, 0.2, "the same if the delay is followed")
    expect(rows == replay_csv(lock(inertia=2 * LIGHT, delays=follows), "--recording", database), "the replay of the run differs")


if __name__ == "__main__":
    main()
