#!/usr/bin/env python3
"""Table 5.17 of the dissertation: what is gained by pairing values of the same command, on the chain of table 5.16 with random
clock phases. A few of them here; script/studies/delays takes 400."""
import os
from pathlib import Path

import delays
from twinlock_test import PROGRAM, SOURCE, at_most, edited_config, expect, main, replay_json, run_well, within

PHASES = int(os.environ.get("TL_TEST_PHASES", "20"))


def test_compensation_lowers_the_error_as_in_the_dissertation():
    found = delays.figures(delays.measure(Path(PROGRAM), PHASES, 1))
    within(found["without"]["mse"], 0.00174, 0.12, "MSE without compensation")
    within(found["with"]["mse"], 0.00037, 0.15, "MSE with compensation")
    within(found["factor"], 5.5, 0.18, "factor of the means")
    within(found["mean_factor"], 5.5, 0.18, "mean of the factors")
    at_most(found["newest"]["mse"], found["with"]["mse"] / 3, "MSE with the newest value in place of the next")
    at_most(found["both"]["mse"], found["with"]["mse"] / 3, "MSE with inputs shifted as well")


def test_table_516_as_check_tells_it():
    page = run_well(["check", SOURCE / "config" / "second_order" / "with.json"])
    for line in ("  output  \u0394o = 8 ms: modes 16 ms of the simulation, 8 ms of the plant\n",
                 "    plant      bus \u2192 plant \u2192 bus\n",
                 "    simulation bus \u2192 acquisition = simulation = simulation\n",
                 "          y at t is paired with the \u0177 seen 8 ms before,\n",
                 "          or with the next one, for which a step waits 8 ms\n"):
        expect(line in page, f"there is no line {line!r} in\n{page}")


def test_seconds_are_as_good_as_chains():
    """But for how long a step waits for the next value, which the chains know and a number does not: 8 ms here."""
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
