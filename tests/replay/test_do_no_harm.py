#!/usr/bin/env python3
"""A lock over minutes, compared with the *true* speed, which only a test knows.

If the model is right, the free twin keeps the lock from following the noise. If it is wrong, the free twin changes nothing."""
import json
import math
import random
from contextlib import closing
import sqlite3

from brakes import hand, rest
from truth import make_truth, true_mse
from twinlock_test import at_most, config_path, edited_config, expect, expect_line, has_line, main, read_table, run_well, scratch

STEP_S, SECONDS, SAMPLE_S = 0.01, 180, 0.02
NOISE = 0.3  # rad/s, of the bench
SEEDS = (3001, 3002)


def sine(_choice):
    return lambda time: 0.25 * (1.0 - math.cos(2.0 * math.pi * 3.0 * max(0.0, time - 0.5)))


class Bench:
    """Minutes of the motor bench under a brake, by default with a heavy motor: the measurements and the true speed."""

    def __init__(self, shape, seed, inertia=0.05):
        brake = scratch() / "brake.csv"
        torque = shape(random.Random(seed))
        rows = (f"{i * SAMPLE_S:.2f},{torque(i * SAMPLE_S):.4f}\n" for i in range(round((SECONDS + 1) / SAMPLE_S)))
        brake.write_text("t,torque\n" + "".join(rows), encoding="utf-8")
        edits = {"duration_s": SECONDS, "components": {"motor": {"set": {"J": inertia}}}, "recording": {"file": str(brake)}}
        self.recording = scratch() / "recording.csv"
        run_well(["plant", edited_config("motor/plant.json", edits), "--record", self.recording, "--seed", seed])
        self.truth = make_truth("motor/plant.json", edits)
        self.what = f"{shape.__name__}, seed {seed}"

    def follow(self, edits):
        """(true MSE, output of --json, events of the twin) of a twin whose J is 3 % too large."""
        folder = scratch()
        steps, database = folder / "steps.csv", folder / "twin.db"
        config = edited_config("motor/lock.json", {"duration_s": SECONDS - 1, **edits})
        told = json.loads(run_well(["replay", config, "--recording", self.recording, "--json", "--csv", steps, "--db", database]))
        with closing(sqlite3.connect(database)) as opened:
            events = [text for text, in opened.execute("SELECT text FROM events WHERE source = 'twin'")]
        return true_mse(read_table(steps), "motor.omega", self.truth, "omega", STEP_S), told, events

    def alone(self):
        return self.follow({"synchronise": None, "compare": {"motor.omega": {"to": "plant.omega"}}})[0]

    def locked(self, free_twin):
        return self.follow({"synchronise": {"free_twin": free_twin}})

    def ahead(self, free_twin):
        """In this mode no step waits for a reading, so there are no conditions."""
        return self.follow({"synchronise": {"free_twin": free_twin, "horizon": {"measurements": "ahead"},
                                            "match": {"motor.omega": {"between": None, "condition": None}}}})


def test_a_right_model_rests():
    for shape in (rest, sine):
        for seed in SEEDS:
            bench = Bench(shape, seed)
            alone = bench.alone()
            plain, told, _ = bench.locked(False)
            expect("free_twin" not in told and plain > 1.5 * alone, f"{bench.what}: {plain} locked, {alone} alone: here a lock does no harm")
            error, told, events = bench.locked(True)
            at_most(error, max(1.3 * alone, NOISE ** 2 / 9), f"{bench.what}: true MSE, (rad/s)²; {plain:.4f} without a free twin, {alone:.4f} alone")
            beside = told["free_twin"]
            expect(beside["rested_steps"] > 0.7 * told["steps"] and beside["adopted"] >= 1, f"{bench.what}: {beside}")
            at_most(told["executions"]["total"] / (3 * told["steps"]), 1.001, f"{bench.what}: executions over the fewest")
            expect(beside["executions"] == 3 * (2 * told["steps"] - beside["rested_steps"]), f"{bench.what}: {beside}")
            changes = [text for text in events if has_line(text, "u|step")]
            begun, ended = changes[::2], changes[1::2]
            expect(all(has_line(text, "nominal") for text in begun), f"{bench.what}: {changes}")
            expect(len(begun) == beside["rests"] and len(begun) - len(ended) in (0, 1), f"{bench.what}: {events}")
            expect(told["lock"]["state"] == "locked" and told["lock"]["percent"] > 99, f"{bench.what}: {told['lock']}")


def test_ahead_of_the_measurement():
    """In this mode a lock extrapolates the noise, too."""
    bench = Bench(sine, SEEDS[0])
    alone, plain = bench.alone(), bench.ahead(False)[0]
    error, told, _ = bench.ahead(True)
    expect(plain > 2 * alone, f"{plain} locked, {alone} alone")
    at_most(error, max(1.3 * alone, NOISE ** 2 / 9), f"{bench.what}: true MSE, (rad/s)²; {plain:.4f} without a free twin, {alone:.4f} alone")
    expect(told["free_twin"]["rested_steps"] > 0.7 * told["steps"], f"{told['free_twin']}")
    wrong = Bench(hand, SEEDS[0], 0.0015)
    plain, error = wrong.ahead(False)[0], wrong.ahead(True)[0]
    at_most(error, 1.05 * plain, f"{wrong.what}, a light motor: true MSE, (rad/s)²; {plain:.4f} without a free twin")


def test_it_is_as_near_as_the_nearer_one():
    """Either the locked or the free twin may be nearer under such a brake."""
    for seed in SEEDS:
        bench = Bench(hand, seed)
        alone, plain, error = bench.alone(), bench.locked(False)[0], bench.locked(True)[0]
        at_most(error, 1.2 * min(plain, alone), f"{bench.what}: true MSE, (rad/s)²; {plain:.4f} without a free twin, {alone:.4f} alone")


def test_a_wrong_model_that_swings_is_not_left_alone():
    """Between two trials the model error looks like noise."""
    bench = Bench(sine, SEEDS[0], 0.0015)
    plain, (error, told, _) = bench.locked(False)[0], bench.locked(True)
    at_most(error, 1.05 * plain, f"{bench.what}: true MSE, (rad/s)²; {plain:.4f} without a free twin")
    at_most(told["free_twin"]["rested_steps"], 0, "steps at rest")


def test_check_and_summary_have_the_free_twin():
    checked = edited_config("motor/lock.json", {"synchronise": {"free_twin": True}})
    expect_line(run_well(["check", checked]), "free twin|3 executions")
    out = run_well(["check", config_path("motor/lock.json")])
    expect("free twin" not in out, out)
    out = run_well(["replay", checked, "--verbose"])
    expect_line(out, "free twin|0.0 %|0 times")
    expect_line(out, "8406|executions")


if __name__ == "__main__":
    main()
