#!/usr/bin/env python3
"""Real data: the recording of a TCLab board (not part of the product; skipped if absent), with a twin of three times
the heat capacity. The correction of the locked twin must be the missing heat, or the excess of heat capacity."""
from diagnosis import excess_heat_capacity
from twinlock_test import at_least, edited_config, expect, main, replay_csv, replay_json, shared_recording, within

RECORDING = "tclab_energy_balance.csv"
SENSORS = ("board.T1", "board.T2")
TRUE, WRONG = 2.0, 6.0  # mCp, J/K: fitted to the record, and set in config/tclab


def replay(config):
    result = replay_json(config, "--recording", shared_recording(RECORDING))
    expect(result["steps"] >= 560, f"steps: {result['steps']}")
    return result


def errors(config):
    """Mean squared errors of both sensors, K\u00b2."""
    return [replay(config)["match"][sensor]["mse"] for sensor in SENSORS]


def check_falls(config, first, second):
    for free, locked, factor, sensor in zip(errors("tclab/free.json"), errors(config), (first, second), SENSORS):
        at_least(free / locked, factor, f"{sensor}: MSE falls by")


def test_free():
    for found, wanted, sensor in zip(errors("tclab/free.json"), (109, 58), SENSORS):
        within(found, wanted, 0.02, f"{sensor}: MSE, K\u00b2")


def test_the_model_with_what_was_fitted():
    fitted = {"mCp": TRUE, "T1_start": 293.98, "T2_start": 293.08}
    config = edited_config("tclab/free.json", {"components": {"board": {"set": fitted}}})
    for found, wanted, sensor in zip(errors(config), (0.17, 0.61), SENSORS):
        within(found, wanted, 0.05, f"{sensor}: MSE, K\u00b2")


def test_lock_by_the_surroundings():
    check_falls("tclab/ambient.json", 5, 5)


def test_lock_by_heat():
    check_falls("tclab/lock.json", 5000, 2000)


def test_the_heat_is_what_the_excess_takes_up():
    rows = replay_csv("tclab/lock.json", "--recording", shared_recording(RECORDING))
    for heater in "12":
        within(excess_heat_capacity(rows, heater), WRONG - TRUE, 0.05, f"heater {heater}: excess heat capacity, J/K")


def test_lock_by_capacity():
    check_falls("tclab/capacity.json", 100, 40)
    found = replay("tclab/capacity.json")["adjust"]["board.mCp"]
    within(found["mean"], TRUE, 0.05, "mean heat capacity, J/K")


main()
