#!/usr/bin/env python3
"""docs/add-a-solver.md and docs/add-a-driver.md are carried out in a copy of the tree, each file and each command. Nothing else
names a driver: the new one is validated, retuned and refused as the others are."""
import re
import shutil
import subprocess

import twinlock_test
from retuned import Retuned, tolerance
from supervised import end_orderly, wait_for_run
from tree import OMEGA
from twinlock_test import BAD_DATA, FORBIDDEN, PLAIN_LIVE, SOURCE, edited_config, expect, expect_line, main, run, scratch

# What the pages call, in a copy that has no clone of git: only what the pages need is built.
BUILD = """#!/bin/bash -e
[[ -e build/host ]] || cmake --preset host -DTL_CHECKS=OFF
cmake --build build/host --target twinlock
"""
TEST = """#!/bin/bash -e
names=$(grep -oE '[a-z_]+' <<<"$2" | grep -v '^test_$' | sed 's/^/test_/')
cmake --build build/host --target $names
ctest --test-dir build/host -R "$2" --no-tests=error --output-on-failure
"""
_copy = None


def copy():
    """A copy of the tree, the same for both pages."""
    global _copy
    if _copy is None:
        _copy = scratch() / "tree"
        shutil.copytree(SOURCE, _copy, symlinks=True, ignore=lambda folder, names: (
            {".git", ".deps", "build"} if folder == str(SOURCE) else {"__pycache__"}) & set(names))
        (_copy / ".deps").symlink_to((SOURCE / ".deps").resolve())
        for name, text in (("build", BUILD), ("test", TEST)):
            (_copy / "script" / name).write_text(text, encoding="utf-8")
    return _copy


def carry_out(page):
    """What the commands of a page print. "Create `path`" before a block is a file; blocks of sh are run, in their order."""
    text = (SOURCE / "docs" / page).read_text(encoding="utf-8")
    printed = ""
    for before, language, block in re.findall(r"([^\n]*)\n\n```(\w+)\n(.*?)^```$", text, re.M | re.S):
        if language == "sh":
            done = subprocess.run(["bash", "-euo", "pipefail", "-c", block], cwd=copy(), env=twinlock_test.environment(scratch()), stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                                  stderr=subprocess.STDOUT, encoding="utf-8", check=False)
            expect(done.returncode == 0, f"{page}: {done.returncode}\n{block}\n{done.stdout[-4000:]}")
            printed += done.stdout
        else:
            path = copy() / re.search(r"Create `([^`]+)`", before)[1]
            path.parent.mkdir(exist_ok=True)
            path.write_text(block, encoding="utf-8")
    return printed


def test_add_a_solver():
    printed = carry_out("add-a-solver.md")
    expect_line(printed, "in lock|100.0 %")
    expect(re.search(r"100% tests passed, 0 tests failed out of [4-9]", printed), printed[-2000:])


def steady(**values):
    """The motor bench at a constant speed."""
    return edited_config(PLAIN_LIVE, {
        "duration_s": None, "record": {"commit_s": 0.1}, "sources": {"inverter": None, "bench": {"steady": {"period_s": 0.005}}},
        "plant": {name: {"modbus": None, "steady": {"source": "bench", "value": value}} for name, value in values.items()}})


def test_add_a_driver():
    expect_line(carry_out("add-a-driver.md"), "real time|ticks")
    twinlock_test.PROGRAM = str(copy() / "build/host/bin/twinlock")
    config = steady(torque=0, omega=OMEGA)
    code, out, err = run(["check", config])
    expect(code == 0, f"check ends with {code}\n{out}{err}")
    code, _, err = run(["check", steady(torque=0, omega="fast")])
    expect(code == BAD_DATA and "plant.omega.steady.value" in err, f"check ends with {code}\n{err}")
    code, out, err = run(["plant", config, "--for", config])
    expect("that are steady" in err, f"{code}\n{out}{err}")
    with Retuned(None, config=config) as live:
        wait_for_run(live, live.database, 1)
        code, out, err = live.reload(live.edited(tolerance(0.5)), "--why", "too wide", "--wait", "--probation", "2")
        expect(code == 0 and "(in place)" in out, f"{code}\n{out}{err}{live.log()}")
        other = live.edited(lambda document: document["plant"]["omega"]["steady"].update(value=2))
        code, out, err = live.reload(other, "--restart", "--no-activate", "--right", "retune")
        expect(code == FORBIDDEN and "commission" in out + err, f"{code}\n{out}{err}")
        end_orderly(live)


if __name__ == "__main__":
    main()
