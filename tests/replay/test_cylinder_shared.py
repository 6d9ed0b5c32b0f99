#!/usr/bin/env python3
"""The cylinder of the thesis, with the recording that it was checked with (not part of the product; skipped if absent):
when a twin with the wrong throttle arrives, and one with the right throttle."""
from twinlock_test import at_most, edited_config, expect, main, replay_json, shared_recording, within

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


def test_locked_from_any_first_step():
    """The dissertation's MSE is 0.014, with history not rewritten, from the one step that it tried."""
    for step in (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1):
        for measurements, late in (("lag", 8), ("hold", 0)):
            config = edited_config("cylinder/lock.json", {"synchronise": {
                "adjust": {"cylinder.throttle_extend": {"step": step}}, "horizon": {"measurements": measurements}}})
            result = replay_json(config, "--recording", shared_recording(RECORDING))
            within(result["adjust"]["cylinder.throttle_extend"]["last"], 0.023, 0.002 / 0.023, "throttle")
            at_most(result["match"]["cylinder.extend_signal"]["mse"], late / (STEPS - 1), "extended: MSE")


main()
