#!/usr/bin/env python3
"""The figures of the thesis's cylinder on the recording that it was checked with (not part of the product;
skipped where it is absent): when a twin with the wrong throttle arrives, and one with the right throttle."""
from twinlock_test import edited_config, expect, main, replay_json, shared_recording, within

RECORDING = "thesis_cylinder.csv"
STEPS, NOISE = 600, 0.03  # l/s


def match(throttle):
    config = edited_config("cylinder/free.json", {"components": {"cylinder": {"set": {"throttle_extend": throttle}}}})
    result = replay_json(config, "--recording", shared_recording(RECORDING))
    expect(result["steps"] == STEPS, f"steps: {result['steps']}")
    return result["match"]


def test_free():
    found = match(0.01)
    within(found["cylinder.extend_signal"]["mse"], 0.083, 0.01, "extended: MSE")
    within(found["cylinder.airflow"]["mse"], 0.1046, 0.01, "airflow: MSE, (l/s)\u00b2")


def test_the_true_throttle():
    found = match(0.023)
    expect(found["cylinder.extend_signal"]["mse"] == 0, f"extended: {found['cylinder.extend_signal']}")
    within(found["cylinder.airflow"]["mse"], NOISE**2, 0.1, "airflow: MSE, (l/s)\u00b2")


main()
