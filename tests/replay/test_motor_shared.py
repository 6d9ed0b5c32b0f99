#!/usr/bin/env python3
"""The figures of the thesis's motor, on the recordings of the motor bench that it was checked with (not
part of the product; skipped where they are absent): the free run's error, and a lock within the
tolerance of 1 rad/s."""
from twinlock_test import at_most, expect, main, replay_json, shared_recording, within

STEPS = 1401


def check_lock(recording):
    result = replay_json("motor/lock.json", "--recording", recording)
    evaluations = result["evaluations"]
    at_most(result["match"]["motor.omega"]["mse"], 0.30, "MSE, locked, (rad/s)\u00b2")
    print(f"    executions {result['executions']['total']} at {evaluations} evaluations")
    expect(result["steps"] == STEPS, f"steps: {result['steps']}")
    expect(result["executions"]["total"] == 3 * (STEPS + evaluations), f"executions: {result['executions']}")
    expect(evaluations >= STEPS, f"only {evaluations} evaluations for {STEPS} steps")


def test_free():
    result = replay_json("motor/free.json", "--recording", shared_recording("thesis_motor_1.csv"))
    match = result["match"]["motor.omega"]
    within(match["mse"], 55.593, 1e-3, "MSE, (rad/s)\u00b2")
    within(match["max"], 27.19, 1e-3, "MAX, rad/s")
    expect(match["unit"] == "rad/s", match["unit"])
    expect(result["steps"] == STEPS, f"steps: {result['steps']}")
    wanted = {"total": 4203, "drive": STEPS, "motor": STEPS, "plant": STEPS}
    expect(result["executions"] == wanted, f"executions: {result['executions']}")


def test_lock_on_recording_1():
    check_lock(shared_recording("thesis_motor_1.csv"))


def test_lock_on_recording_2():
    check_lock(shared_recording("thesis_motor_2.csv"))


main()
