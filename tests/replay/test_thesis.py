#!/usr/bin/env python3
"""script/studies/thesis measures and prints the tables of chapter 5. Our figures must be better than the dissertation's,
except those that cannot be. Other tests have tables 5.5 and 5.6 (test_scenarios.py) and 5.17 (test_delay_figures.py)."""
import contextlib
import io
from pathlib import Path

import thesis
from twinlock_test import PROGRAM, at_most, expect, main, scratch, within

thesis.PROGRAM = Path(PROGRAM)


def measure(*names, recordings=None):
    laboratory = thesis.Laboratory(scratch(), recordings, 2, thesis.Progress(0))
    found = thesis.measure(names, laboratory)
    expect(all(set(used) <= {"our own"} for used in laboratory.sources.values()), f"{laboratory.sources}")
    return found


def page(found):
    with contextlib.redirect_stdout(io.StringIO()) as told:
        thesis.show(found, {name: ["our own"] for name in found})
    return told.getvalue()


def test_the_transport_system():
    found = measure("5.11")
    free, slow = found["5.11"]["free"], found["5.11"]["slow"]
    at_most(slow["ours"][0] / free["ours"][0], slow["thesis"][0] / free["thesis"][0], "MSE over that of the free twin")
    at_most(slow["ours"][1] / free["ours"][1], slow["thesis"][1] / free["thesis"][1], "MAX over that of the free twin")
    at_most(slow["most_evaluations"], 2, "evaluations in a step")
    at_most(found["5.11"]["fast"]["ours"][0], 2, "fast belt: MSE, mm\u00b2")
    expect("At most 2 evaluations a step" in page(found), page(found))


def test_the_cylinder():
    found = measure("5.15")["5.15"]
    at_most(found["lock"]["ours"]["extended"][0], 0.014, "extended: MSE")
    at_most(found["hold"]["ours"]["extended"][0], 0, "extended, mode hold: MSE")
    for name in ("lock", "hold"):
        within(found[name]["throttle"], 0.023, 0.02, f"{name}: throttle")
        at_most(found[name]["ours"]["airflow"][0], found["free"]["ours"]["airflow"][0] / 3, f"{name}: airflow, MSE")
    expect("Throttle found: 0.0231" in page({"5.15": found}), page({"5.15": found}))


def test_plants_of_others():
    found = measure("others")
    for plant, one in found["others"].items():
        expect(one["recording"] == "stand-in" and one["outputs"], f"{plant}: {one}")
        for output, (free, locked, _) in one["outputs"].items():
            at_most(locked, free / 5, f"{plant}, {output}: locked MSE")
    expect("Stand-ins are models" in page(found) and "Recordings: our own." in page(found), page(found))


def test_a_folder_without_recordings():
    try:
        thesis.check_recordings(scratch())
    except thesis.Trouble as trouble:
        expect("has none of thesis_motor_1.csv" in str(trouble), str(trouble))
    else:
        expect(False, "an empty folder is taken for recordings")


def test_time():
    found = measure("5.17")
    expect(found["5.17"]["phases"] == 2 and "Means over 2 clock phases" in page(found), page(found))


if __name__ == "__main__":
    main()
