#!/usr/bin/env python3
"""The cylinder on a bench, with the product's own recording and a twin without friction.

Tests the error of its force, its lock, and that the correction is the friction of each direction only.
"""
import filecmp

from diagnosis import mean_where_adjusted
from truth import make_truth, true_mse
from twinlock_test import (SOURCE, at_most, edited_config, expect, main, replay_csv, replay_json, run_well, scratch,
                           within)

BENCH = SOURCE / "config" / "bench_cylinder"
STEPS = 1398
WAIT = 3  # number of missing steps at the end: a step waits so long for the next message
FRICTION = {"out": 9.09, "in": 4.60}  # N, of the true plant
F, P, X = "cylinder.F", "cylinder.p", "cylinder.x"


def test_free():
    """The error of the force is the friction: 9.09\u00b2 N\u00b2 on the way out, 4.60\u00b2 N\u00b2 on the way in."""
    result = replay_json("bench_cylinder/free.json")
    expect(result["steps"] == STEPS, f"steps: {result['steps']}")
    share = ((4 - 0) + (11.2 - 6.8)) / 14  # share of time on the way out
    wanted = share * FRICTION["out"] ** 2 + (1 - share) * FRICTION["in"] ** 2
    within(result["match"][F]["mse"], wanted, 0.03, "force: MSE, N\u00b2")


def test_only_the_friction_is_wrong():
    """With the right friction, the rest of the error is noise and the age of the messages."""
    true = {"friction_out": FRICTION["out"], "friction_in": FRICTION["in"]}
    match = replay_json(edited_config("bench_cylinder/free.json", {"components": {"cylinder": {"set": true}}}))["match"]
    at_most(match[F]["mse"], 0.5, "force: MSE, N\u00b2")
    within(match[P]["mse"], 240**2, 0.3, "pressure: MSE, Pa\u00b2")
    at_most(match[X]["max"], 7e-4, "position: MAX, m")


def test_lock():
    result = replay_json("bench_cylinder/lock.json")
    at_most(result["match"][F]["mse"], 0.01, "force: MSE, N\u00b2")
    at_most(result["match"][F]["max"], 0.2, "force: MAX, N")
    outcomes = result["outcomes"]
    expect(outcomes["first guess"] + outcomes["optimised"] == STEPS - WAIT, f"outcomes: {outcomes}")


def test_the_true_force():
    """The twin interpolates between two messages, so it is nearer to the true force than the last message is."""
    truth = make_truth("bench_cylinder/plant.json")
    last = edited_config("bench_cylinder/lock.json", {"synchronise": {"match": {F: {"between": "last"}}}})
    line, last = (true_mse(replay_csv(config), F, truth, "force", 0.01) for config in ("bench_cylinder/lock.json", last))
    at_most(line, 0.25, "force: MSE against the true one, N\u00b2")
    at_most(line / last, 0.4, "force: MSE against the true one, over that of the last message")


def test_what_is_not_matched_is_as_it_was():
    """Friction acts on the force only."""
    free, locked = (replay_csv(f"bench_cylinder/{name}.json") for name in ("free", "lock"))
    for column in (P, X):
        expect(free[column][:STEPS - WAIT] == locked[column], f"{column} differs between free and locked")


def test_the_friction_of_each_direction():
    rows = replay_csv("bench_cylinder/lock.json")
    for direction, friction in FRICTION.items():
        within(mean_where_adjusted(rows, f"cylinder.friction_{direction}"), friction, 0.02, f"friction {direction}, N")
    both = [1 for out, back in zip(rows["cylinder.friction_out"], rows["cylinder.friction_in"]) if out and back]
    expect(not both, f"in {len(both)} steps the friction of the other direction is adjusted too")


def test_the_recording_is_regenerated():
    """The command in config/bench_cylinder/README.md makes config/bench_cylinder/recording.csv."""
    made = scratch() / "recording.csv"
    run_well(["plant", BENCH / "plant.json", "--record", made, "--seed", "1"])
    expect(filecmp.cmp(made, BENCH / "recording.csv", False), "twinlock plant --seed 1 makes another recording")


main()
