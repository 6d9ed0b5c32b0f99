#!/usr/bin/env python3
"""FMUs that change state of their process, such as the rounding mode: it does not affect other computations, reads and writes."""
import os
import stat

import hostile_fmu
from comma_locale import comma_locale
from twinlock_test import NOT_LOCKED, expect, finish, has_line, main, scratch, start

NOWHERE = "nowhere"
KINDS = {"ROUNDING": 0, "FOLDER": 1, "UMASK": 2, "LOCALE": 3, "PROCESSORS": 4, "SLACK": 5, "LIMITS": 6}


def replay(at, kind, changes=None):
    """(folder, log) of a replay that writes its steps into the current folder."""
    fmu = hostile_fmu.make("meddle", AT=at, CHANGE=KINDS[kind])
    folder = scratch()
    started = start(["replay", hostile_fmu.config(fmu, changes), "--csv", "steps.csv"], cwd=folder)
    code, _, messages = finish(started)
    expect(code in (0, NOT_LOCKED), f"{at}, {kind}: ended with {code}\n{messages}")
    return folder, messages


def expect_same_steps(at, kind, changes=None):
    plain, _ = replay(NOWHERE, kind, changes)
    folder, messages = replay(at, kind, changes)
    expect((folder / "steps.csv").read_bytes() == (plain / "steps.csv").read_bytes(), f"{at}, {kind}: other values")
    return folder, messages


def expect_notice(messages, kind, at):
    found = [line for line in messages.splitlines() if has_line(line, "warning|FMU") or has_line(line, "FMU|process")]
    expect(len(found) == 1 and has_line(found[0], f"notice|process|{kind}|{at}"), f"expected one notice of {kind} in {at}:\n{messages}")


def test_rounding_mode():
    for changes in (None, hostile_fmu.LOCKED):
        _, messages = expect_same_steps("fmi2GetReal", "ROUNDING", changes)
        expect_notice(messages, "floating-point control", "fmi2GetReal")
        _, messages = expect_same_steps("fmi2Instantiate", "ROUNDING", changes)
        expect_notice(messages, "floating-point control", "fmi2Instantiate")
        _, messages = expect_same_steps("load", "ROUNDING", changes)
        expect_notice(messages, "floating-point control", "library")


def test_current_folder():
    for at in ("load", "fmi2Instantiate", "fmi2ExitInitializationMode", "fmi2FreeInstance"):
        _, messages = expect_same_steps(at, "FOLDER")
        expect_notice(messages, "current folder", "library" if at == "load" else at)


def test_locale():
    with comma_locale():
        for changes in (None, hostile_fmu.LOCKED):
            _, messages = expect_same_steps("fmi2DoStep", "LOCALE", changes)
            expect_notice(messages, "locale", "step")
        _, messages = expect_same_steps("fmi2GetFMUstate", "LOCALE", hostile_fmu.LOCKED)
        expect_notice(messages, "locale", "fmi2GetFMUstate")


def test_umask():
    plain, _ = replay(NOWHERE, "UMASK")
    folder, messages = expect_same_steps("fmi2Instantiate", "UMASK")
    expect_notice(messages, "umask", "fmi2Instantiate")
    modes = [stat.S_IMODE((place / "steps.csv").stat().st_mode) for place in (plain, folder)]
    expect(modes[0] == modes[1], f"the file has mode {modes[1]:o}, not {modes[0]:o}")


def test_what_the_kernel_holds():
    names = {"SLACK": "timer slack", "LIMITS": "limits"}
    if len(os.sched_getaffinity(0)) > 1:
        names["PROCESSORS"] = "processors"
    for kind, name in names.items():
        _, messages = expect_same_steps("fmi2Instantiate", kind)
        expect_notice(messages, name, "fmi2Instantiate")


main()
