#!/usr/bin/env python3
"""Start values from the plant, with an FMU whose true start only the test knows: a position that is measured, and a rate that
is not."""
import json
import sqlite3
from contextlib import closing

from twinlock_test import expect, main, read_table, run_well, scratch, write_config

X_START, V_START = 2.0, -3.0
TOLERANCE = 0.05
PROCESS = {"fmu": "second_order.fmu", "set": {"T": 0.125, "d": 0.225, "K": 1}}
SEEDS = (11, 12, 13)


def process(start):
    return {"process": {**PROCESS, "set": {**PROCESS["set"], **start}}}


def make_recording(seed):
    folder = scratch()
    inputs = folder / "u.csv"
    inputs.write_text("t,u\n" + "".join(f"{i * 0.01:.2f},{1 if i % 200 < 100 else 0}\n" for i in range(1001)), encoding="utf-8")
    plant = write_config({
        "twinlock": 1, "name": "true plant", "step_s": 0.004, "duration_s": 10,
        "components": process({"x_start": X_START, "v_start": V_START}),
        "plant": {"u": {}}, "recording": {"file": str(inputs), "time_column": "t"},
        "connect": [["plant.u", "process.u"]],
        "emulate": {"columns": {"y": {"from": "process.y", "noise": 0.005}, "u": {"from": "plant.u"}}},
    })
    recording = folder / "recording.csv"
    run_well(["plant", plant, "--record", recording, "--seed", seed])
    return recording


def make_twin(start, find):
    return write_config({
        "twinlock": 1, "name": "twin", "step_s": 0.004,
        "components": process(start),
        "recording": {"time_column": "t"},
        "plant": {"u": {"unit": "1"}, "y": {"unit": "1"}},
        "connect": [["plant.u", "process.u"]],
        "synchronise": {
            "adjust": {"process.u": {"step": 0.1, "min": -5, "max": 5}},
            "match": {"process.y": {"to": "plant.y", "tolerance": TOLERANCE}},
            "horizon": {"prediction": 20}, "rest": False,
            **({"start": {"over_s": 0.4, "find": {"process.v_start": {"min": -50, "max": 50}}}} if find else {}),
        },
    })


def replay(config, recording, *options):
    steps = scratch() / "steps.csv"
    done = json.loads(run_well(["replay", config, "--recording", recording, "--json", "--csv", steps, *options]))
    return done, read_table(steps)


def worst(table, first, last):
    return max(abs(a - b) for a, b in list(zip(table["process.y"], table["plant.y"]))[first:last])


def found_in(database):
    with closing(sqlite3.connect(database)) as opened:
        texts = [text for text, in opened.execute("SELECT text FROM events WHERE text LIKE 'start value found%'")]
        flags = [flags for flags, in opened.execute("SELECT flags FROM steps WHERE flags & 4096")]
    expect(len(texts) == 1 and "process.v_start" in texts[0], texts)
    expect(flags and all(flag & 32 for flag in flags), flags)
    return float(texts[0].split(" = ")[1].split()[0])


def test_a_measured_value_is_copied():
    recording = make_recording(SEEDS[0])
    _, wrong = replay(make_twin({}, False), recording)
    _, copied = replay(make_twin({"x_start": "plant.y"}, False), recording)
    expect(worst(wrong, 0, 5) > 1.5, worst(wrong, 0, 5))
    expect(worst(copied, 0, 5) < 0.3, worst(copied, 0, 5))


def test_a_hidden_value_is_found():
    for seed in SEEDS:
        recording, database = make_recording(seed), scratch() / "twin.db"
        config = make_twin({"x_start": "plant.y"}, True)
        done, table = replay(config, recording, "--db", database)
        value = found_in(database)
        expect(abs(value - V_START) < 0.3, f"seed {seed}: {value}")
        expect(worst(table, 110, 2000) < TOLERANCE, worst(table, 110, 2000))
        expect(done["lock"]["state"] == "locked", done["lock"])
        again, same = replay(config, database)
        expect(same["process.y"] == table["process.y"], "a replay of the recorded run differs")
        _, plain = replay(config, recording, "--plain")
        expect(plain["process.y"] == table["process.y"], "--plain differs")
        expect(again["steps"] == done["steps"], (again["steps"], done["steps"]))


def test_check_shows_both():
    page = run_well(["check", make_twin({"x_start": "plant.y"}, True)])
    expect("plant.y → process.x_start" in page, page)
    expect("process.v_start: found" in page, page)


if __name__ == "__main__":
    main()
