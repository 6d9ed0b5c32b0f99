#!/usr/bin/env python3
"""A lock that is worse than its released twin rests: u stays at nominal, and the twin comes near the plant."""
import csv
import json
import random

from twinlock_test import at_least, at_most, expect, main, run, run_well, scratch

SECONDS, STEP_S, NOISE = 600, 0.1, 0.02
COMMON = {"twinlock": 1, "name": "oscillator", "step_s": STEP_S, "components": {"p": {"fmu": "second_order.fmu", "set": {"T": 1, "d": 0.3, "K": 1}}},
          "connect": [["plant.u", "p.u"]]}


def write(name, document):
    path = scratch() / name
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


def record():
    """Paths of a recording with noise, and of the true output."""
    choice = random.Random(1)
    folder = scratch()
    with open(folder / "commands.csv", "w", encoding="utf-8", newline="") as file:
        file.write("time,u\n")
        time = 0.0
        while time < SECONDS:
            file.write(f"{time:.2f},{choice.uniform(0, 2):.3f}\n")
            time += choice.uniform(5, 15)
    plant = {**COMMON, "duration_s": SECONDS, "plant": {"u": {"unit": "1"}}, "recording": {"file": str(folder / "commands.csv")}}
    paths = []
    for name, noise in (("noisy.csv", NOISE), ("true.csv", 0)):
        paths.append(folder / name)
        config = write("plant.json", {**plant, "emulate": {"columns": {"u": {"from": "plant.u"}, "y": {"from": "p.y", "noise": noise}}}})
        paths[-1].unlink(missing_ok=True)
        run_well(["plant", config, "--record", paths[-1], "--seed", 1])
    return paths


def lock(**synchronise):
    """A horizon of one step of an oscillator: u acts on y only with the next one, so it overshoots."""
    return write("lock.json", {**COMMON, "duration_s": SECONDS - 1, "plant": {"u": {"unit": "1"}, "y": {"unit": "1"}}, "synchronise": {
        "adjust": {"p.u": {"step": 0.5, "min": -10, "max": 10}}, "match": {"p.y": {"to": "plant.y", "tolerance": 0.06}},
        "horizon": {"prediction": 1, "measurements": "ahead"}, **synchronise}})


def replay(config, recording, steps, *more):
    code, out, err = run(["replay", config, "--recording", recording, "--csv", steps, "--json", *more])
    expect(code in (0, 3), err)
    return json.loads(out)


def true_error(steps, true):
    """Mean square of the last half."""
    with open(steps, encoding="utf-8", newline="") as file:
        simulated = {round(float(row["time"]) / STEP_S): float(row["p.y simulated"]) for row in csv.DictReader(file)}
    with open(true, encoding="utf-8", newline="") as file:
        truth = {round(float(row["time"]) / STEP_S): float(row["y"]) for row in csv.DictReader(file)}
    errors = [(value - truth[step]) ** 2 for step, value in simulated.items() if step > SECONDS / STEP_S / 2 and step in truth]
    return sum(errors) / len(errors)


def test_a_harmful_lock_rests():
    noisy, true = record()
    steps = scratch() / "steps.csv"
    searched = replay(lock(rest=False), noisy, steps)
    harm = true_error(steps, true)
    expect(searched["outcomes"].get("nominal", 0) < 100, searched["outcomes"])
    database = scratch() / "run.db"
    told = replay(lock(), noisy, steps, "--db", database)
    at_least(told["outcomes"]["nominal"], 4000, "steps at nominal")
    at_most(true_error(steps, true), 1e-4, "true error at rest")
    at_least(harm, 1e-3, "true error of the lock")
    again = scratch() / "again.csv"
    replay(lock(), database, again)
    expect(steps.read_bytes() == again.read_bytes(), "a replay of the database differs")
    replay(lock(), noisy, again, "--plain")
    expect(steps.read_bytes() == again.read_bytes(), "without saving, the replay differs")
    events = json.loads(run_well(["show", database, "--json", "--events"]))["events"]
    warned = [event for event in events if "do harm" in event["text"]]
    told = [event["text"] for event in events if "nominal" in event["text"]]
    expect(len(told) == 1, f"a rest is told more than once: {told}")
    expect(len(warned) == 1 and warned[0]["severity"] == "warning" and "rests at nominal" in warned[0]["text"], warned)


def test_a_free_twin_decides_itself():
    noisy, _ = record()
    told = replay(lock(free_twin=True), noisy, scratch() / "steps.csv")
    expect(told["free_twin"]["rests"] > 0, "the free twin never let u rest")


if __name__ == "__main__":
    main()
