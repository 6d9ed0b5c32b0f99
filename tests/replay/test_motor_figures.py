#!/usr/bin/env python3
"""Limits of the cost and the error of a lock of the motor bench. The product makes the recordings, with its own brake and with
others, and with seeds that were not used for tuning."""
from pathlib import Path

import brakes
import campaign
from truth import true_mse
from twinlock_test import (PROGRAM, at_least, at_most, config_path, edited_config, expect, main, read_table, replay_csv, replay_json,
                           scratch)

STEPS, FEWEST = 1401, 4203
SEEDS = (1001, 1002, 1003)


def check(name, recording, ratio, mse, edits=None):
    """Checks the executions relative to the fewest possible, and the MSE in (rad/s)², of one configuration and recording."""
    result = replay_json(edited_config(f"motor/{name}.json", edits), "--recording", recording)
    what = f"{name}, {(edits or {}).get('synchronise', {}).get('algorithm', 'secant')}, {Path(recording).stem}"
    expect(result["steps"] == STEPS, f"{what}: {result['steps']} steps")
    at_most(result["executions"]["total"] / FEWEST, ratio, f"{what}: executions over the fewest")
    at_most(result["match"]["motor.omega"]["mse"], mse, f"{what}: MSE, (rad/s)\u00b2")


def check_lock(recording, ahead, black_box):
    """T_P = 1 at a tolerance of 1 rad/s. `black_box`: (ratio, MSE) of the solvers that see J only."""
    check("lock", recording, 1.01, 0.05)
    check("ahead", recording, 1.01, ahead)
    for solver in ("nelder-mead", "bobyqa"):
        check("lock", recording, *black_box, {"synchronise": {"algorithm": solver}})


def check_horizons(recording):
    """T_P = 2 and 5."""
    check("e", recording, 1.06, 1.5)
    check("d", recording, 1.45, 1.5)
    check("c", recording, 1.15, 1.5)


def own_recordings():
    return [brakes.make_recording(PROGRAM, scratch(), seed) for seed in SEEDS]


def test_lock():
    recordings = own_recordings()
    expect(len({path.read_bytes() for path in recordings}) == len(SEEDS), "seeds make the same recording")
    for recording in recordings:
        check_lock(recording, 0.25, (1.08, 0.30))


def true_error(recording, truth, edits=None):
    rows = replay_csv(edited_config("motor/lock.json", edits), "--recording", recording)
    return true_mse(rows, "motor.omega", read_table(truth), "omega", 0.01)


def test_the_shipped_lock():
    """All promised limits, with any seed. Against the readings, the error of a perfect twin is their noise, 0.09 (rad/s)\u00b2."""
    truth = read_table(brakes.make_recording(PROGRAM, scratch(), 1, exact=True))
    for seed in range(4001, 4009):
        recording = brakes.make_recording(PROGRAM, scratch(), seed)
        check("lock", recording, 1.01, 0.05)
        match = replay_json(config_path("motor/lock.json"), "--recording", recording)["match"]["motor.omega"]
        at_most(match["mse_readings"], 0.10, f"{seed}: MSE at the readings, (rad/s)\u00b2")
        expect(match["readings"] > 400 and match["rejected"] == 0 and match["left_out"] == 0, f"{seed}: {match}")
        rows = replay_csv(config_path("motor/lock.json"), "--recording", recording)
        at_most(true_mse(rows, "motor.omega", truth, "omega", 0.01), 0.08, f"{seed}: MSE against the true speed, (rad/s)\u00b2")


def test_no_filter_flatters():
    """With a low-pass of a second, the twin is near to its matched signal, but not to the readings."""
    recording = brakes.make_recording(PROGRAM, scratch(), SEEDS[0])
    slow = edited_config("motor/lock.json", {"synchronise": {"match": {"motor.omega": {"condition": {"low_pass_s": 1.0}}}}})
    match = replay_json(slow, "--recording", recording)["match"]["motor.omega"]
    at_most(match["mse"], 0.1, "through a low-pass of 1 s: MSE, (rad/s)\u00b2")
    at_least(match["mse_readings"], 1, "the same at the readings")


def test_the_true_speed():
    """Only a test knows the true speed. The twin gets a message every 25 to 40 ms, with a noise of 0.09 (rad/s)\u00b2."""
    last = {"delays": None, "synchronise": {"match": {"motor.omega": {"between": "last", "condition": None}}}}
    truth = brakes.make_recording(PROGRAM, scratch(), 1, exact=True)
    for recording in own_recordings():
        error = true_error(recording, truth)
        at_most(error, 0.08, "MSE against the true speed, (rad/s)\u00b2")
        at_least(true_error(recording, truth, last) / error, 3, "MSE against the true speed: what holding the last message costs")


def test_horizons():
    for recording in own_recordings():
        check_horizons(recording)


def test_other_brakes():
    """In mode ahead, a twin follows the newest measurement. Its error is at least the change of the plant to the next one.
    A measurement that may be an outlier waits for the next one, which costs a little after a jump."""
    for shape in brakes.SHAPES:
        for seed in SEEDS[:2]:
            recording = brakes.make_recording(PROGRAM, scratch(), seed, shape)
            check_lock(recording, max(0.52, (1.0 + campaign.OWN_PART) * campaign.unrest(recording)), (1.12, 0.36))


main()
