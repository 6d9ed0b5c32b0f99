#!/usr/bin/env python3
"""Δo measured from recordings of the chain of table 5.16: with noise, without movement, with a drift.

Tests its use, its events, and that a replay of a database repeats it."""
import json
import math
import os
import random
import re

import delays
from twinlock_test import (at_most, config_path, edited_config, expect, expect_line, has_line, main, replay_json, run_well, scratch)

SECOND, MS = 10**9, 10**6
SEEDS = int(os.environ.get("TL_TEST_SEEDS", "12"))
MEASURE = "second_order/measure.json"


def chain(seed, noise=0.05, seconds=9, **options):
    """(path, true delay in s) of a recording in which a command switches every second."""
    path = scratch() / "recording.csv"
    commands = [SECOND * (i + 1) for i in range(seconds - 1)]
    rows, delay = delays.make_chain(random.Random(seed), noise, commands, seconds * SECOND, **options)
    delays.write_recording(path, rows)
    return path, delay / 1e9


def events_of(config, path):
    """(severity, text) of the events about the delay, in order."""
    database = scratch() / "run.db"
    run_well(["replay", config_path(config), "--recording", path, "--db", database])
    told = json.loads(run_well(["show", database, "--events", "--json"]))["events"]
    return [(event["severity"], event["text"]) for event in told if event["text"].startswith("delay: ")]


def test_within_one_cycle_at_noise_of_a_twentieth_of_the_step():
    squares = 0.0
    for seed in range(SEEDS):
        path, true = chain(seed)
        found = replay_json(MEASURE, "--recording", path)["delays"]
        expect(found["state"] == "known" and 0.7 <= found["confidence"] <= 1, f"seed {seed}: {found}")
        expect(abs(found["measured_s"] - true) <= 0.004, f"seed {seed}: found {found['measured_s']}, is {true}")
        squares += (found["measured_s"] - true) ** 2
    at_most(math.sqrt(squares / SEEDS) * 1e3, 2, f"error of {SEEDS} recordings, ms (root of the mean square)")


def test_the_measured_delay_is_used():
    """The sensor is late, so y is paired with a later ŷ, and a step waits for it."""
    path, true = chain(3, 0.0, later=(0, 50 * MS))
    config = edited_config(MEASURE, {"delays": {"measure": {"range_s": 0.1}, "take": "newest"}})
    plain, told = (replay_json(name, "--recording", path) for name in ("second_order/plain.json", config))
    found = told["delays"]["measured_s"]
    expect(abs(found - (true - 0.05)) < 0.002, f"found {found}, is {true - 0.05}")
    at_most(told["match"]["sensor.y"]["mse"], plain["match"]["sensor.y"]["mse"] / 5, "MSE with the delay measured")


def test_without_movement_no_delay_is_found():
    path = scratch() / "recording.csv"
    chance = random.Random(1)
    rows = {i * 4 * MS: [0.0, chance.gauss(0, 0.05)] for i in range(2000)}
    delays.write_recording(path, rows)
    found = replay_json(MEASURE, "--recording", path)["delays"]
    expect(found["state"] == "unknown" and found["measured_s"] is None, f"{found}")
    expect(events_of(MEASURE, path) == [], "an event")


def test_noise_instead_of_the_plant_has_no_delay():
    path, chance = scratch() / "recording.csv", random.Random(2)
    rows, _ = delays.make_chain(random.Random(3), 0.0, [SECOND * i for i in range(1, 9)], 9 * SECOND)
    for row in rows.values():
        row[1] = None if row[1] is None else chance.gauss(0, 1)
    delays.write_recording(path, rows)
    found = replay_json(MEASURE, "--recording", path)["delays"]
    expect(found["state"] == "unknown", f"{found}")


def test_a_drift_is_followed_and_logged():
    path, true = chain(5, 0.02, 24, later=(12 * SECOND, 24 * MS))
    found = replay_json(MEASURE, "--recording", path)["delays"]
    expect(abs(found["measured_s"] - (true - 0.024)) <= 0.004, f"{found}, is {true - 0.024}")
    told = events_of(MEASURE, path)
    print("    " + "\n    ".join(f"{severity}: {text}" for severity, text in told))
    first = re.search("\u0394o = (\\S+ ms)", told[0][1])
    expect(told[0][0] == "info" and first, f"{told}")
    expect(told[1][0] == "warning" and has_line(told[1][1], f"\u0394o|{first[1]}"), f"{told}")


def test_a_lost_delay_is_logged_and_stays():
    path, chance = scratch() / "recording.csv", random.Random(6)
    rows, true = delays.make_chain(chance, 0.02, [SECOND * i for i in range(1, 30)], 30 * SECOND)
    for stamp, row in rows.items():
        row[1] = chance.gauss(0, 1) if row[1] is not None and stamp > 10 * SECOND else row[1]
    delays.write_recording(path, rows)
    found = replay_json(MEASURE, "--recording", path)["delays"]
    expect(found["state"] == "lost" and found["confidence"] < 0.4, f"{found}")
    expect(abs(found["measured_s"] - true / 1e9) <= 0.004, f"{found}, was {true / 1e9}")
    told = events_of(MEASURE, path)
    expect(len(told) > 1 and told[-1][0] == "warning" and has_line(told[-1][1], f"\u0394o = {found['measured_s'] * 1e3:.3f} ms"), f"{told}")


def steps_of(config, recording, *options):
    path = scratch() / "steps.csv"
    run_well(["replay", config_path(config), "--csv", path, "--recording", recording, *options])
    return path.read_bytes()


def test_a_database_repeats_the_measurement():
    for config in (MEASURE, edited_config("second_order/both.json", {"delays": {"measure": {"range_s": 0.06}}})):
        path, _ = chain(7, 0.02, later=(5 * SECOND, 12 * MS))
        database = scratch() / "run.db"
        wanted = steps_of(config, path, "--db", database)
        told, again = (replay_json(config, "--recording", source)["delays"] for source in (path, database))
        expect(told["state"] == "known", f"{told}")
        expect(told == again, f"{told}\n{again}")
        expect(wanted == steps_of(config, database), "the steps differ")


def test_chains_give_the_initial_delay():
    path, _ = chain(8, 0.0, 2)
    quiet = scratch() / "quiet.csv"
    quiet.write_text("".join(path.read_text(encoding="utf-8").splitlines(True)[:60]), encoding="utf-8")
    config = edited_config("second_order/with.json", {"delays": {"measure": True}})
    found = replay_json(config, "--recording", quiet)["delays"]
    expect(found == {"input_s": None, "output_s": 0.008, "measured_s": None, "state": "unknown", "confidence": 0},
           f"{found}")


def test_inputs_are_shifted_by_the_chains():
    """Only the rest of Δo is measured; the output has all of Δo."""
    path, true = chain(9, 0.01)
    config = edited_config("second_order/both.json", {"delays": {"measure": True}})
    found = replay_json(config, "--recording", path)["delays"]
    # u has a row every 4 ms on the ticks: a shift by 11.9 ms means one by 8 ms
    expect(abs(found["measured_s"] - (true - 0.008 + 0.0119)) <= 0.004, f"{found}, is {true + 0.0039}")


def test_a_corrected_twin_measures_no_wrong_delay():
    """Corrected steps follow ŷ with the delay in use, so only steps of released twins count."""
    path, true = chain(10, 0.01, 12)
    changes = {"compare": None, "delays": {"measure": {"range_s": 0.1}},
               "synchronise": {"adjust": {"process.K": {"step": 0.1}}, "match": {"sensor.y": {"to": "plant.y", "tolerance": 0.05}}}}
    config = edited_config("second_order/plain.json", changes)
    told = replay_json(config, "--recording", path)
    found = told["delays"]
    print(f"    {found}, {told['optimised_steps']} steps searched; true {true}")
    expect(found["state"] == "unknown" or abs(found["measured_s"] - true) <= 0.004, f"{found}, is {true}")
    expect(told["ledger"]["total"]["difference"] <= 0, f"{told['ledger']}")
    changes["synchronise"]["release_s"] = 0
    for name, is_warned in ((config, False), (edited_config("second_order/plain.json", changes), True)):
        warnings = " ".join(run_well(["check", name]).partition("\nwarnings\n")[2].split())
        expect(has_line(warnings, 'delays.measure|correction|synchronise.release_s|"compare"|chains') == is_warned, warnings)


def test_the_page_of_check():
    page = run_well(["check", config_path(MEASURE)])
    expect_line(page, "measure|\u0394o|62 ms")
    expect(max(map(len, page.splitlines()[1:])) <= 80, page)
    table = run_well(["replay", config_path(MEASURE), "--recording", chain(1)[0]])
    expect_line(table, "delay|\u0394o =|ms|confidence")
    table = run_well(["replay", config_path(MEASURE)])
    expect_line(table, "delay|confidence")


if __name__ == "__main__":
    main()
