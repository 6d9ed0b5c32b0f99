#!/usr/bin/env python3
"""Mistakes of script/studies/mistakes that need no device: none is silent, and most messages name cause and cure."""
import os
from pathlib import Path

import mistakes
from twinlock_test import EMULATED, FMUS, PROGRAM, SANITIZER, Skip, expect, main

LISTED = [mistake for mistake in mistakes.MISTAKES if not mistake.needs_device]
BELOW = {"recordings and files": 1, "the lock": 2}  # mistakes without cause and cure, by group


def measure(group):
    if EMULATED or SANITIZER:
        raise Skip("its commands are the same in the plain build")
    rows = [mistakes.measure(Path(PROGRAM), FMUS, mistake) for mistake in LISTED if mistake.group == group]
    below = [f"{row['verdict']}: {row['name']}\n{row['output']}" for row in rows if row["verdict"] != "cure"]
    expect(not any(row["verdict"] == "silent" for row in rows), "\n".join(below))
    expect(rows and len(below) <= BELOW.get(group, 0), f"{len(below)} without cause and cure:\n" + "\n".join(below))
    expect(all(row["code"] >= 0 for row in rows), f"{[(row['name'], row['code']) for row in rows]}")
    print(f"    {group}: {len(rows)} mistakes, {len(rows) - len(below)} with cause and cure")


def test_json_and_keys():
    measure("JSON and keys")


def test_fmus():
    measure("FMU")


def test_recordings():
    measure("recordings and files")


def test_the_lock():
    measure("the lock")


def test_operation():
    measure("operation")


def test_a_right_configuration():
    weak = mistakes.find_weak(Path(PROGRAM), FMUS, LISTED)
    expect(not weak, f"found in the output of a right configuration: {weak}")


os.environ["TWINLOCK_FMU_PATH"] = str(FMUS)
main()
