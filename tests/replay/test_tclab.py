#!/usr/bin/env python3
"""TCLab with the product's own recording and a twin of three times the heat capacity. Tests its error, its lock, and
that the correction is the missing heat, or the excess of heat capacity."""
import filecmp

from diagnosis import excess_heat_capacity
from truth import make_truth, true_mse
from twinlock_test import (SOURCE, at_least, at_most, edited_config, expect, main, replay_csv, replay_json, run_well,
                           scratch, within)

BENCH = SOURCE / "config" / "tclab"
SENSORS = ("board.T1", "board.T2")
NOISE = 0.05  # K
TRUE, WRONG = 2.0, 6.0  # mCp, J/K


def errors(config):
    """Mean squared errors of both sensors, K\u00b2."""
    result = replay_json(config)
    return [result["match"][sensor]["mse"] for sensor in SENSORS]


def test_free():
    for found, wanted, sensor in zip(errors("tclab/free.json"), (105.9, 55.3), SENSORS):
        within(found, wanted, 0.01, f"{sensor}: MSE, K\u00b2")


def test_only_the_heat_capacity_is_wrong():
    """With the right heat capacity, the rest of the error is noise and the age of the messages."""
    right = edited_config("tclab/free.json", {"components": {"board": {"set": {"mCp": TRUE}}}})
    for found, sensor in zip(errors(right), SENSORS):
        within(found, NOISE**2, 0.25, f"{sensor}: MSE with the true heat capacity, K\u00b2")


def test_lock_by_heat():
    result = replay_json("tclab/lock.json")
    for free, sensor in zip(errors("tclab/free.json"), SENSORS):
        at_least(free / result["match"][sensor]["mse"], 5000, f"{sensor}: MSE falls by")
        at_most(result["match"][sensor]["max"], 0.5, f"{sensor}: MAX, K")
    at_most(result["evaluations"] / result["steps"], 1.05, "evaluations for a step")


def test_the_true_temperatures():
    truth = make_truth("tclab/plant.json")
    rows = replay_csv("tclab/lock.json")
    for sensor, column in zip(SENSORS, ("T1", "T2")):
        at_most(true_mse(rows, sensor, truth, column, 1), 0.01, f"{sensor}: MSE against the true one, K\u00b2")


def test_the_heat_is_what_the_excess_takes_up():
    rows = replay_csv("tclab/lock.json")
    for heater in "12":
        within(excess_heat_capacity(rows, heater), WRONG - TRUE, 0.05, f"heater {heater}: excess heat capacity, J/K")


def test_lock_by_capacity():
    """If the heat capacity is adjusted, its true value is found and does not change any more."""
    result = replay_json("tclab/capacity.json")
    for free, sensor in zip(errors("tclab/free.json"), SENSORS):
        at_least(free / result["match"][sensor]["mse"], 5000, f"{sensor}: MSE falls by")
    within(result["adjust"]["board.mCp"]["mean"], TRUE, 0.03, "mean heat capacity, J/K")
    within(result["adjust"]["board.mCp"]["last"], TRUE, 0.05, "last heat capacity, J/K")


def test_lock_by_the_surroundings():
    """One variable for two heaters: better than a free twin, but not exact."""
    for free, locked, sensor in zip(errors("tclab/free.json"), errors("tclab/ambient.json"), SENSORS):
        at_least(free / locked, 5, f"{sensor}: MSE falls by")


def test_what_cannot_be_at_fault_does_not_lock():
    """Heat loss alone: it has no effect if the heaters are as warm as the air, and each heater needs another value."""
    adjust = {"board.Q1": None, "board.Q2": None, "board.U": {"step": 2, "min": -100, "max": 200}}
    config = edited_config("tclab/lock.json", {"synchronise": {"adjust": adjust}})
    result = replay_json(config)
    at_least(max(result["match"][sensor]["mse"] for sensor in SENSORS), 10, "U adjusted: larger MSE, K\u00b2")
    at_least(result["outcomes"]["nominal"], 100, "U adjusted: steps that nothing better was found for")


def test_the_recording_is_regenerated():
    """The command in config/tclab/README.md makes config/tclab/recording.csv."""
    made = scratch() / "recording.csv"
    run_well(["plant", BENCH / "plant.json", "--record", made, "--seed", "1"])
    expect(filecmp.cmp(made, BENCH / "recording.csv", False), "twinlock plant --seed 1 makes another recording")


main()
