#!/usr/bin/env python3
"""A twin must stay in lock for a long time. Its drive integrates the speed: if the twin follows every noisy measurement,
the integrator drifts, slowly at first, and then without limit."""
import math
import random

from twinlock_test import (at_most, edited_config, expect, main, read_config, read_table, replay_csv, replay_json, run_well, scratch,
                           write_config)

SECONDS, NOISE, LEFT_ALONE = 1000, 0.3, 0.0031


def make_recording(name, torque):
    """The motor bench with the right inertia under that torque, its speed measured every 10 ms with noise in rad/s."""
    folder, chance = scratch(), random.Random(name)
    brake, truth, noisy = (folder / f"{name}-{part}.csv" for part in ("brake", "truth", "noisy"))
    with open(brake, "w", encoding="utf-8") as file:
        file.write("t,M_brake,omega\n")
        file.writelines(f"{i / 100:.2f},{torque(i / 100):.6f},60\n" for i in range(SECONDS * 100))
    document = read_config("motor/free.json")
    document.pop("duration_s")
    document["components"]["motor"].pop("set")
    document["recording"]["file"] = str(brake)
    run_well(["replay", write_config(document), "--csv", truth])
    rows = read_table(truth)
    with open(noisy, "w", encoding="utf-8") as file:
        file.write("t,M_brake,omega\n")
        for time, omega in zip(rows["time"], rows["motor.omega"]):
            file.write(f"{time:.2f},{torque(time):.6f},{omega + chance.gauss(0, NOISE)!r}\n")
    return noisy


def check(name, recording, mse, algorithm="secant"):
    """Checks the MSE of the whole run in (rad/s)², and the mean friction at its end. Plant and twin have the same friction."""
    steps = scratch() / "steps.csv"
    edits = {"duration_s": SECONDS - 1, "synchronise": {"algorithm": algorithm}}
    result = replay_json(edited_config(f"motor/{name}.json", edits), "--recording", recording, "--csv", steps)
    what = f"{name}, {algorithm}, {recording.stem}"
    at_most(result["match"]["motor.omega"]["mse"], mse, f"{what}: MSE, (rad/s)\u00b2")
    friction = read_table(steps)["motor.d"][-10000:]
    expect(all(map(math.isfinite, friction)), f"{what}: {friction[-1]}")
    at_most(abs(sum(friction) / len(friction) - LEFT_ALONE), 0.05, f"{what}: mean friction beside nominal, N.m.s/rad")


def check_all(recording):
    """lock.json has a low-pass, so it follows the noise less: its MSE against the measurement is that of the noise."""
    check("lock", recording, NOISE**2)
    check("ahead", recording, 0.5)
    for name in ("c", "d", "e"):
        check(name, recording, 1.5)


def test_black_box_solvers():
    """They keep a u as long as it is good enough. This twin is right, so they must return to nominal."""
    recording = make_recording("sine", lambda time: 1.0 + math.sin(0.7 * time))
    for name in ("d", "e"):
        check(name, recording, 1.5, "bobyqa")
        config = edited_config(f"motor/{name}.json", {"duration_s": SECONDS - 1, "synchronise": {"algorithm": "bobyqa"}})
        friction = replay_csv(config, "--recording", recording)["motor.d"]
        corrected = sum(abs(d - LEFT_ALONE) > 1e-9 for d in friction) / len(friction)
        at_most(corrected, 0.01, f"{name}, bobyqa: steps that were corrected, of all")


def test_at_rest():
    check_all(make_recording("rest", lambda time: 0.0))


def test_under_a_sine():
    check_all(make_recording("sine", lambda time: 1.0 + math.sin(0.7 * time)))


main()
