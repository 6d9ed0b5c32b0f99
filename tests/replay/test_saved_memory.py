#!/usr/bin/env python3
"""Memory of saved states: within the figure of `check` and within "memory_mb", which does not change the results."""
import os
import re

import hostile_fmu
from twinlock_test import NOT_LOCKED, SANITIZER, Skip, at_most, expect, expect_line, finish, main, merge, scratch, start

BALLAST = 10 << 20  # bytes of each state
KIB = 1024
SLACK = 4 << 20  # bytes that may differ between two runs
SEARCHING = {"horizon": {"prediction": 2}, "algorithm": "nelder-mead", "match": {"hostile.y": {"tolerance": 1e-9}}}


def config(ballast, memory_mb):
    fmu = hostile_fmu.make("good", BALLAST=ballast)
    saving = {} if memory_mb is None else {"saving": {"memory_mb": memory_mb}}
    return hostile_fmu.config(fmu, merge(hostile_fmu.LOCKED, {"components": {"hostile": {"rollback": "state"}},
                                                              "synchronise": {**SEARCHING, **saving}}))


def replay(ballast, memory_mb=None):
    """(text of --csv, largest resident size of the program in bytes)."""
    steps = scratch() / "steps.csv"
    process = start(["replay", config(ballast, memory_mb), "--csv", steps])
    out, err = process.stdout.read(), process.stderr.read()
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    expect(process.returncode in (0, NOT_LOCKED), f"replay ended with {process.returncode}\n{out}{err}")
    return steps.read_text(encoding="utf-8"), usage.ru_maxrss * KIB


def told(memory_mb=None):
    """The figure of `check` for the states, bytes."""
    code, out, err = finish(start(["check", config(BALLAST, memory_mb)]))
    found = re.search(r"^  states +([0-9.]+) MiB", out, re.MULTILINE)
    expect(code == 0 and found, f"check ended with {code}\n{out}{err}")
    expect_line(" ".join(out.partition("\nwarnings\n")[2].split()), "synchronise.saving.memory_mb|states|hostile|KiB")
    return float(found[1]) * KIB * KIB


def test_states_take_no_more_than_check_says():
    if SANITIZER:
        raise Skip("a sanitizer keeps memory that was freed")
    steps, light = replay(0)
    for memory_mb in (None, 50):
        heavy_steps, heavy = replay(BALLAST, memory_mb)
        at_most(heavy - light, told(memory_mb) + SLACK, f"bytes of the states, memory_mb {memory_mb}")
        expect(heavy_steps == steps, f"memory_mb {memory_mb}: other values")
    at_most(told(50), 60 << 20, "bytes of the states, by check")


main()
