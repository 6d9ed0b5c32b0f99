#!/usr/bin/env python3
"""script/studies/days and systems: in each minute a lock keeps its limit of the true error.

A few minutes of each plant here; the studies take a day.
"""
import json
import subprocess
import sys

from minutes import figures_of
from twinlock_test import BUILD, EMULATED, HUNG_S, SKIPPED, SOURCE, at_most, expect, main

if BUILD != SOURCE / "build" / "host" or EMULATED:
    print("skipped: the studies are those of build/host")
    sys.exit(SKIPPED)

TROUBLE = 65


def study(name, *arguments):
    return subprocess.run([sys.executable, SOURCE / "script" / "studies" / f"{name}.py", *arguments], capture_output=True, text=True, timeout=HUNG_S, check=False)


def measured(name, *arguments):
    done = study(name, *arguments, "--json")
    expect(done.returncode == 0, f"{done.returncode}\n{done.stdout}{done.stderr}")
    rows = json.loads(done.stdout)
    for of, row in rows.items():
        expect(row["bad"] == 0 and row["minutes"] > 0, f"{of}: {row}")
    return rows


def test_the_motor_bench():
    rows = measured("days", "--hours", "0.25", "--only", "lag secant")
    at_most(rows["lag secant"]["mean"], 0.01, "true MSE")


def test_the_other_systems():
    rows = measured("systems", "--hours", "0.1")
    for name in "cylinder.F", "cylinder.extend_signal", "board.T1", "board.T2":
        at_most(rows[f"{name} locked"]["mean"], 0.1 * rows[f"{name} left alone"]["mean"], f"true MSE of {name}")


def test_what_does_not_exist():
    for name in "days", "systems":
        done = study(name, "--only", "nothing")
        expect(done.returncode == TROUBLE and 'found "nothing", expected one of ' in done.stderr, f"{done.returncode}\n{done.stderr}")


def test_numbers_that_mean_nothing():
    for name, option, value in (("days", "--hours", "nan"), ("days", "--hours", "0.01"), ("systems", "--hours", "inf"), ("systems", "--hours", "-1"),
                                ("days", "--noise", "0"), ("days", "--inertia", "0")):
        done = study(name, option, value)
        expect(done.returncode == TROUBLE and f"{name}: {option}: found " in done.stderr, f"{name} {option} {value}: {done.returncode}\n{done.stderr}")


def test_a_bad_minute_is_told():
    told = {"steps": 10, "executions": {"total": 30, "motor": 20, "plant": 10}}
    row = figures_of(told, [1.0, 2.0, 0.5], alone=[1.0, 1.5, 0.1], allowed=0.6)
    expect((row["bad"], row["minutes"], row["worst"], row["executions"]) == (1, 3, 2.0, 1.5), f"{row}")
    at_most(abs(row["worst_of_limit"] - 2.0 / 1.8), 1e-12, "worst of its limit")
    row = figures_of(told, [0.0, 1e-9], alone=[0.0, 0.0], allowed=0.0)
    expect((row["bad"], row["worst_of_limit"]) == (1, 0.0), f"{row}")


if __name__ == "__main__":
    main()
