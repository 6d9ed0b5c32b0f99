#!/usr/bin/env python3
"""The motor of the thesis, with the recordings of the motor bench that it was checked with (not part of the
product; skipped if absent): the error of the free run, and the cost and the error of a lock."""
from twinlock_test import at_most, edited_config, expect, main, replay_json, shared_recording, within

STEPS, FEWEST = 1401, 4203
RECORDINGS = ("thesis_motor_1.csv", "thesis_motor_2.csv")


def check(name, ratio, mse, algorithm="secant"):
    """Checks the executions relative to the fewest possible, and the MSE in (rad/s)², on both recordings."""
    config = edited_config(f"motor/{name}.json", {"synchronise": {"algorithm": algorithm}})
    for recording in RECORDINGS:
        result = replay_json(config, "--recording", shared_recording(recording))
        what = f"{name}, {algorithm}, {recording}"
        expect(result["steps"] == STEPS, f"{what}: {result['steps']} steps")
        at_most(result["executions"]["total"] / FEWEST, ratio, f"{what}: executions over the fewest")
        at_most(result["match"]["motor.omega"]["mse"], mse, f"{what}: MSE, (rad/s)\u00b2")


def test_free():
    result = replay_json("motor/free.json", "--recording", shared_recording("thesis_motor_1.csv"))
    match = result["match"]["motor.omega"]
    within(match["mse"], 55.593, 1e-3, "MSE, (rad/s)\u00b2")
    within(match["max"], 27.19, 1e-3, "MAX, rad/s")
    expect(match["unit"] == "rad/s", match["unit"])
    expect(result["steps"] == STEPS, f"steps: {result['steps']}")
    wanted = {"total": FEWEST, "drive": STEPS, "motor": STEPS, "plant": STEPS}
    expect(result["executions"] == wanted, f"executions: {result['executions']}")


def test_lock():
    check("lock", 1.01, 0.05)


def test_ahead():
    check("ahead", 1.01, 0.25)


def test_lock_by_solvers_that_see_J_only():
    check("lock", 1.08, 0.30, "nelder-mead")
    check("lock", 1.08, 0.30, "bobyqa")


def test_horizons():
    check("e", 1.06, 1.5)
    check("d", 1.45, 1.5)
    check("c", 1.15, 1.5)


main()
