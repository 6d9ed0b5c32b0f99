#!/usr/bin/env python3
"""Real data: the recording of the positioning system EMPS (not part of the product; skipped if absent), with a
model three times too heavy. Only the position is matched. The velocity must become right, too, and the correction must be the
force that the excess of mass needs."""
import functools

from twinlock_test import at_least, edited_config, expect, main, replay_csv, replay_json, shared_recording, within

STEP_S = 0.01
MASS_ERROR = 273.99 - 91.33  # kg; config/emps against the fitted mass


@functools.cache
def errors(configuration):
    """Mean squared errors of position and velocity, in m\u00b2 and (m/s)\u00b2."""
    result = replay_json(f"emps/{configuration}.json", "--recording", shared_recording("emps_train.csv"))
    expect(result["steps"] >= 2480, f"steps: {result['steps']}")
    return [result["match"][variable]["mse"] for variable in ("emps.q", "emps.v")]


def check_falls(configuration, position, velocity):
    free, locked = errors("free"), errors(configuration)
    print(f"    MSE {locked[0]:.4g} m\u00b2, {locked[1]:.4g} (m/s)\u00b2")
    at_least(free[0] / locked[0], position, "position: MSE falls by")
    at_least(free[1] / locked[1], velocity, "velocity, not matched: MSE falls by")


def slope(x, y):
    """Slope of the regression line of y on x."""
    mean_x, mean_y = sum(x) / len(x), sum(y) / len(y)
    covariance = sum((a - mean_x) * (b - mean_y) for a, b in zip(x, y))
    return covariance / sum((a - mean_x) ** 2 for a in x)


def test_free():
    position, velocity = errors("free")
    within(position, 1.5e-3, 0.1, "position: MSE, m\u00b2")
    within(velocity, 1.6e-3, 0.1, "velocity: MSE, (m/s)\u00b2")


def test_lag():
    check_falls("lock", 1e4, 1e3)


def test_each_step_from_1_to_10_ms():
    """Stamps of the recording are up to 32 ns late. With a multiple of its step, some samples would be a whole step too old."""
    for milliseconds in range(1, 11):
        free, locked = (replay_json(edited_config(f"emps/{name}.json", {"step_s": milliseconds / 1000}), "--recording",
                                    shared_recording("emps_train.csv"))["match"]["emps.v"]["mse"] for name in ("free", "lock"))
        at_least(free / locked, 1000, f"step of {milliseconds} ms: velocity, not matched: MSE falls by")


def test_ahead():
    check_falls("ahead", 1e3, 50)


def test_correction_is_the_mass_error():
    """Row i holds the u that acted from t_i to t_(i+1) and the plant at t_(i+1)."""
    rows = replay_csv("emps/lock.json", "--recording", shared_recording("emps_train.csv"))
    velocity = rows["plant.velocity"]
    acceleration = [(after - before) / STEP_S for before, after in zip(velocity, velocity[1:])]
    correction = [u - nominal for u, nominal in zip(rows["emps.F"], rows["emps.F nominal"])]
    within(slope(acceleration, correction[1:]), MASS_ERROR, 0.1, "correction per acceleration, kg")


main()
