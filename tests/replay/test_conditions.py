#!/usr/bin/env python3
"""Conditions of readings before they are matched: outliers in one of fifty readings do not mislead a twin, and they are recorded."""
import csv
import os
import random
import sqlite3
from types import SimpleNamespace

import brakes
import shipped
from truth import true_mse
from twinlock_test import (BUILD, PROGRAM, at_least, at_most, config_path, edited_config, expect, expect_line, main, read_table, replay_csv, replay_json,
                           run_well, scratch)

SEEDS = (7001, 7002, 7003)
GATE = 8.0


def spoil(recording, seed):
    """(recording with outliers, their values): one reading in fifty is 10 to 40 rad/s off, but not the first, and none after 14 s."""
    choice, bad = random.Random(seed), []
    with open(recording, encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    for row in rows[1:]:
        if choice.random() < 0.02 and float(row["t"]) < 14.0:
            row["omega"] = repr(float(row["omega"]) + choice.choice((-1, 1)) * choice.uniform(10, 40))
            bad.append(float(row["omega"]))
    path = recording.with_name(f"spoilt-{seed}.csv")
    with open(path, "w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    return path, bad


def lock(**condition):
    return edited_config("motor/lock.json", {"synchronise": {"match": {"motor.omega": {"condition": condition or None}}}})


def query(database, text):
    with sqlite3.connect(f"file:{database}?mode=ro", uri=True) as connection:
        return connection.execute(text).fetchall()


def test_outliers():
    """The error by default, with a gate, and with a median. If outliers are kept, it is 4 to 13 (rad/s)\u00b2."""
    truth = read_table(brakes.make_recording(PROGRAM, scratch(), 1, exact=True))
    for seed in SEEDS:
        recording, bad = spoil(brakes.make_recording(PROGRAM, scratch(), seed), seed)
        expect(len(bad) > 3, f"{seed}: {len(bad)} bad readings")
        without = true_mse(replay_csv(lock(outliers="keep"), "--recording", recording), "motor.omega", truth, "omega", 0.01)
        for name, condition, limit in (("default", {"low_pass_s": 0.02}, 0.1), ("gate", {"gate": GATE, "low_pass_s": 0.02}, 0.15), ("median", {"median": 5}, 0.2),
                                       ("wide median", {"median": 9}, 0.3)):
            error = true_mse(replay_csv(lock(**condition), "--recording", recording), "motor.omega", truth, "omega", 0.01)
            at_most(error, limit, f"{name}, {seed}: MSE against the true speed, (rad/s)\u00b2")
            at_least(without / error, 5, f"{name}, {seed}: what it is without")


def test_rejected_readings_are_recorded():
    recording, bad = spoil(brakes.make_recording(PROGRAM, scratch(), SEEDS[0]), 99)
    database = scratch() / "run.db"
    run_well(["replay", lock(gate=GATE), "--recording", recording, "--db", database])
    rows = query(database, "SELECT DISTINCT value, stamp_ns FROM samples NATURAL JOIN signals "
                           "WHERE kind = 'plant' AND name = 'plant.omega@reading' AND quality = 5 ORDER BY stamp_ns")
    expect([value for value, _ in rows] == bad, f"{rows}, not {bad}")
    match = replay_json(lock(gate=GATE), "--recording", recording)["match"]["motor.omega"]
    expect(match["rejected"] == len(bad), f"{match}, not {len(bad)}")
    at_most(match["mse_readings"], 0.10, "MSE at the readings that were not rejected, (rad/s)\u00b2")
    told = [text for text, in query(database, "SELECT text FROM events WHERE source = 'plant' ORDER BY event")]
    expect(len(told) == min(len(bad), 10), told)
    for value, text in zip(bad, told):
        expect_line(text, f"plant.omega|reading|{value:.6g}|gate|8")
    expect(query(database, "SELECT count(*) FROM outputs WHERE quality != 0") == [(0,)], "a rejected reading counts as a gap")


def test_outliers_are_rejected_by_default():
    """As with a gate. In each mode of pairing, the rejected readings are those that were spoilt. The recording as it was has none."""
    clean = brakes.make_recording(PROGRAM, scratch(), SEEDS[0])
    recording, bad = spoil(clean, 99)
    for measurements in ("lag", "hold", "ahead"):
        for match in ({}, {"between": None, "condition": None}):
            config = edited_config(config_path("motor/lock.json"), {"synchronise": {
                "horizon": {"measurements": measurements}, "match": {"motor.omega": match}}})
            for path, count in ((recording, len(bad)), (clean, 0)):
                rejected = replay_json(config, "--recording", path)["match"]["motor.omega"]["rejected"]
                expect(rejected == count, f"{measurements}, {match}: {rejected} rejected, {count} spoilt")
    database = scratch() / "run.db"
    run_well(["replay", config_path("motor/lock.json"), "--recording", recording, "--db", database])
    told = [text for text, in query(database, "SELECT text FROM events WHERE source = 'plant' ORDER BY event")]
    expect(len(told) == min(len(bad), 10), told)
    for count, (value, text) in enumerate(zip(bad, told), start=1):
        expect_line(text, f"plant.omega|reading|{value:.6g}|outlier|expected|{count} so far")
    kept = replay_json(lock(outliers="keep"), "--recording", recording)["match"]["motor.omega"]
    expect(kept["rejected"] == 0, f"{kept}")


def test_the_bench_as_shipped():
    """As script/studies/shipped."""
    os.environ["TWINLOCK_FMU_PATH"] = str(BUILD / "fmus")
    row = shipped.measure(PROGRAM, "2 % outliers", 1, SimpleNamespace(seconds=30, patch={}))
    expect(not shipped.misses([row]) and row["rejected"] == row["injected"] > 10, f"{row}")


def test_a_run_is_repeated_to_the_bit():
    """A replay of a database repeats the run. With other conditions, it applies them to the raw readings."""
    recording, _ = spoil(brakes.make_recording(PROGRAM, scratch(), SEEDS[1]), 5)
    database, columns = scratch() / "run.db", ("motor.omega", "plant.omega", "motor.d", "J")
    median = lock(median=5)
    for config in lock(low_pass_s=0.02), lock(gate=GATE, low_pass_s=0.02):
        database.unlink(missing_ok=True)
        first = replay_csv(config, "--recording", recording, "--db", database)
        again = replay_csv(config, "--recording", database)
        expect(all(first[name] == again[name] for name in columns), "another run")
        told = [replay_json(config, "--recording", recorded)["match"]["motor.omega"]["mse_readings"] for recorded in (recording, database)]
        expect(abs(told[0] - told[1]) < 0.05 * told[0], f"{told}")
    directly = replay_csv(median, "--recording", recording)
    anew = replay_csv(median, "--recording", database)
    steps = len(anew["time"])  # fewer: the median waits longer, and the database ends with the run
    expect(steps > 1380, f"{steps} steps")
    expect(all(directly[name][:steps] == anew[name] for name in columns), "readings were conditioned twice")


def test_a_step_is_followed_after_three_readings():
    """A plant that jumps, with one message per step: the gate accepts the third message, and also the two before it."""
    path = scratch() / "step.csv"
    path.write_text("t,omega,M_brake\n" + "".join(f"{i * 0.01:.2f},{40 if i < 50 else 80},0\n" for i in range(120)), encoding="utf-8")
    rows = replay_csv(edited_config("motor/lock.json", {"delays": None, "plant": {"omega": {"every_s": 0.01}}, "synchronise": {
        "match": {"motor.omega": {"condition": {"low_pass_s": None, "gate": 5}, "tolerance": 1000}}}}), "--recording", path)
    seen = {round(at / 0.01): value for at, value in zip(rows["time"], rows["plant.omega"])}
    expect([seen[i] for i in (49, 50, 51, 52, 53)] == [40, 40, 80, 80, 80], f"{[seen[i] for i in range(48, 55)]}")


def test_the_shipped_bench_checks():
    page = run_well(["check", config_path("motor/lock.json")])
    expect_line(page, "readings|7 ticks")
    expect_line(page, "lag|i + 8")


if __name__ == "__main__":
    main()
