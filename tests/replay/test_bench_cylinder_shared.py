#!/usr/bin/env python3
"""Real data: a pneumatic cylinder on a test bench (not part of the product; skipped if absent), with a twin without
friction. The correction of the locked twin must be the friction that the recording shows in each direction."""
import functools
import math

from diagnosis import mean_where_adjusted
from twinlock_test import at_least, expect, main, read_table, replay_csv, replay_json, shared_recording, within

RECORDING = "pneu_cylinder_oring257_5bar.csv"
AREA = math.pi / 4 * 0.0257**2  # m\u00b2


@functools.cache
def match(name):
    result = replay_json(f"bench_cylinder/{name}.json", "--recording", shared_recording(RECORDING))
    expect(result["steps"] >= 7280, f"steps: {result['steps']}")
    return result["match"]


def measured_friction(going_out):
    """Mean of force less pressure times area, positive against the motion, N."""
    table = read_table(shared_recording(RECORDING))
    found = [force - pressure * AREA for force, pressure, out in
             zip(table["force"], table["pressure"], table["dir_out"]) if (out == 1) == going_out]
    return (1 if going_out else -1) * sum(found) / len(found)


def test_free():
    within(match("free")["cylinder.F"]["mse"], 59.8, 0.02, "force: MSE, N\u00b2")
    within(math.sqrt(match("free")["cylinder.x"]["mse"]), 8e-4, 0.1, "position: root mean square error, m")


def test_lock():
    at_least(match("free")["cylinder.F"]["mse"] / match("lock")["cylinder.F"]["mse"], 5000, "force: MSE falls by")


def test_what_is_not_matched_is_as_it_was():
    free, locked = (replay_csv(f"bench_cylinder/{name}.json", "--recording", shared_recording(RECORDING))
                    for name in ("free", "lock"))
    for variable in ("cylinder.p", "cylinder.x"):
        expect(free[variable][:len(locked[variable])] == locked[variable], f"{variable} differs between free and locked")


def test_the_friction_of_each_direction():
    rows = replay_csv("bench_cylinder/lock.json", "--recording", shared_recording(RECORDING))
    for direction in ("out", "in"):
        found = mean_where_adjusted(rows, f"cylinder.friction_{direction}")
        within(found, measured_friction(direction == "out"), 0.03, f"friction {direction}, N")


main()
