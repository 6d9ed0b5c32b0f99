#!/usr/bin/env python3
"""Table 5.17 of the dissertation: the gain of pairing values of the same command, for the chain of table 5.16.

Clock phases are random: 20 here, 400 in script/studies/delays."""
import os
from pathlib import Path

import delays
from twinlock_test import PROGRAM, SOURCE, at_most, edited_config, expect, expect_line, main, replay_json, run_well, within

PHASES = int(os.environ.get("TL_TEST_PHASES", "20"))


def test_compensation_lowers_the_error_as_in_the_dissertation():
    found = delays.figures(delays.measure(Path(PROGRAM), PHASES, 1))
    within(found["without"]["mse"], 0.00174, 0.12, "MSE without compensation")
    within(found["with"]["mse"], 0.00037, 0.15, "MSE with compensation")
    within(found["factor"], 5.5, 0.18, "factor of the means")
    within(found["mean_factor"], 5.5, 0.18, "mean of the factors")
    at_most(found["newest"]["mse"], found["with"]["mse"] / 3, "MSE with the newest value in place of the next")
    at_most(found["both"]["mse"], found["with"]["mse"] / 3, "MSE with inputs shifted as well")


def test_table_516_in_the_output_of_check():
    page = run_well(["check", SOURCE / "config" / "second_order" / "with.json"])
    for parts in ("output|\u0394o = 8 ms|16 ms|simulation|8 ms of", "plant      bus \u2192 plant \u2192 bus",
                  "simulation bus \u2192 acquisition = simulation = simulation", "y at t|\u0177|8 ms before", "waits 8 ms"):
        expect_line(page, parts)


def test_seconds_are_as_good_as_chains():
    """Only the time that a step waits for the next value is known from chains alone. Here it is 8 ms."""
    config = edited_config("second_order/newest.json", {"delays": None})
    given = edited_config(config, {"delays": {"output": 0.008, "take": "newest"}})
    wanted = replay_json("second_order/newest.json")["match"]
    expect(replay_json(given)["match"] == wanted, f"found {replay_json(given)['match']}, wanted {wanted}")


def test_the_recording_of_the_configurations():
    before, after = (replay_json(f"second_order/{name}.json")["match"]["sensor.y"] for name in ("without", "with"))
    at_most(after["mse"], before["mse"] / 3, "MSE")
    expect(after["pairs"] > 240 and before["pairs"] > 240, f"{before} {after}")


if __name__ == "__main__":
    main()
