#!/usr/bin/env python3
"""Recordings that the public program of the Tennessee Eastman plant has made (not part of the product; skipped if absent).
The plant of config/tennessee has the same means and noise, with other random numbers, and the twin finds what changed."""
import functools
import lzma
from statistics import fmean, pstdev

from twinlock_test import at_least, at_most, edited_config, expect, main, read_config, read_table, replay_json, run_well, scratch, shared_recording, within

FAULT, SEEN = 18000, 61  # s: a finding has the time of its step, which uses readings up to that much later
VALVES = {"D_feed": "D_feed_valve", "E_feed": "E_feed_valve", "A_feed": "A_feed_valve", "AC_feed": "AC_feed_valve"}
MEANS = {  # column: relative difference; the slow wander of composition is not the same
    "D_feed": 0.01, "E_feed": 0.01, "AC_feed": 0.01, "recycle_valve": 0.03, "separator_valve": 0.01, "stripper_valve": 0.01,
    "reactor_cooling_valve": 0.01, "condenser_cooling_valve": 0.01, "reactor_cooling_outlet_T": 0.002, "condenser_cooling_outlet_T": 0.005,
    "reactor_T": 1e-4, "reactor_p": 0.005, "reactor_level": 0.002, "separator_T": 0.005, "separator_level": 0.002, "stripper_level": 0.002}


@functools.cache
def shared(name):
    path = scratch() / f"{name}.csv"
    path.write_bytes(lzma.decompress(shared_recording(f"tep/{name}.csv.xz").read_bytes()))
    return path


@functools.cache
def ours(number):
    """The columns of our plant; `number` of the disturbance from FAULT on, or 0."""
    names = list(read_config("tennessee/plant.json")["plant"])
    path = scratch() / "schedule.csv"
    rows = [[time, *(int(name == "fault_gain" or (time > 0 and name == f"IDV{number}")) for name in names)] for time in (0, FAULT, 2 * FAULT)]
    path.write_text("\n".join(",".join(map(str, row)) for row in [["time", *names], *rows]) + "\n", encoding="utf-8")
    recording = scratch() / "recording.csv"
    run_well(["plant", edited_config("tennessee/plant.json"), "--recording", path, "--record", recording])
    return read_table(recording)


def column(rows, name, first=FAULT + 2000):
    return rows[name][first:2 * FAULT]


def noise(values):
    return pstdev(b - a for a, b in zip(values, values[1:]))


def test_normal_operation():
    theirs = read_table(shared("quiet_1"))
    for name, relative in MEANS.items():
        there, here = column(theirs, name), column(ours(0), VALVES.get(name, name))
        within(fmean(here), fmean(there), relative, f"{name}: mean")
        within(noise(here), noise(there), 0.06, f"{name}: noise")


def test_warm_cooling_water_moves_the_valve():
    for rows, valve in ((read_table(shared("fault_4")), "theirs"), (ours(4), "ours")):
        within(fmean(column(rows, "reactor_cooling_valve")), 44.9, 0.01, f"{valve}: cooling valve of the reactor, %")


def test_sticking_valve():
    theirs, here = column(read_table(shared("fault_14")), "reactor_cooling_outlet_T"), column(ours(14), "reactor_cooling_outlet_T")
    within(pstdev(here), pstdev(theirs), 0.1, "spread of the cooling water, \u00b0C")


def twin():
    """The twin of config/tennessee, with the columns that these recordings have."""
    document = read_config("tennessee/lock.json")
    known = set(read_table(shared("quiet_1")))
    plant = {name: {"csv": {"column": theirs}} for theirs, name in VALVES.items()}
    missing = [name for name in document["plant"] if name not in known and name not in plant or name in VALVES]
    match = {f"process.{name}": None for name in missing}
    return edited_config("tennessee/lock.json", {"plant": {**plant, **{name: None for name in missing}}, "synchronise": {"match": match}})


def test_twin_of_their_plant():
    """It is in lock, and finds nothing in normal operation. It finds the warm water as 5 K. A sticking valve changes only the
    scatter here, which is no finding yet."""
    result = replay_json(twin(), "--recording", shared("quiet_1"))
    at_least(result["lock"]["percent"], 99, "in lock, %")
    expect(result["findings"] == [], f"found in normal operation: {result['findings']}")
    result = replay_json(twin(), "--recording", shared("fault_4"))
    first, *_ = result["findings"]
    expect(first["variable"] == "process.reactor_cooling_inlet_T" and first["found"] >= FAULT - SEEN, f"found {result['findings']}")
    at_most(first["found"] - FAULT, 200, "found after, s")
    within(first["percent"], 100 * 5 / 35, 0.02, "correction, %")


main()
