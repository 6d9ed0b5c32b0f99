#!/usr/bin/env python3
"""FMUs with wrong states of several kinds: the program finds each before the first step and names the kind."""
import json
import platform
import sys

import keeper_fmu
from twinlock_test import (FMUS, NOT_LOCKED, SANITIZER, Skip, expect, expect_line, expect_no_line, has_line, main, run, run_well, scratch,
                           write_config)

FMU_FAILED = 70
KINDS = {"parameters": "parameters", "events": "events", "one": "handle", "late": "late"}  # lie of the FMU: word in the message
FIRST_ERROR = {"parameters": "keeper0.y|1|step", "events": "keeper0.y|1|step", "one": "fmi2DoStep|fmi2Error", "late": "fmi2GetFMUstate|fmi2Error|late"}


def steps_of(config, *options):
    steps = scratch() / "steps.csv"
    run_well(["replay", config, "--csv", steps, *options], wells=(0, NOT_LOCKED))
    return steps.read_text(encoding="utf-8")


def test_by_its_states_alone():
    """The configuration permits no other method, so nothing is synchronised."""
    for lie, parts in FIRST_ERROR.items():
        for verb in "check", "replay":
            code, out, err = run([verb, keeper_fmu.config(keeper_fmu.make_false(lie), "state")])
            expect(code == FMU_FAILED, f"{verb} {lie}: {code}\n{out}{err}")
            expect_line(err, f"error|{parts}")
            expect_no_line(out, "no problem found")


def expect_same(fmu, method, what):
    chosen = steps_of(keeper_fmu.config(fmu))
    expect(chosen == steps_of(keeper_fmu.config(fmu, method)), f"{what}: other values than with \"rollback\": \"{method}\"")
    expect(chosen == steps_of(keeper_fmu.config(fmu), "--plain"), f"{what}: other values without savings")


def test_memory_copies_instead():
    """The program changes to copies of memory. The values are those of a run with "rollback": "memory"."""
    if SANITIZER:
        raise Skip("a sanitizer replaces the allocator: no copies of FMU memory")
    for lie, kind in KINDS.items():
        fmu = keeper_fmu.make_false(lie)
        code, out, err = run(["check", keeper_fmu.config(fmu)])
        expect(code == 0, f"{lie}: {code}\n{out}{err}")
        expect_line(err, f"notice|FMU lag|own states|{kind}|memory")
        expect_line(out, "rolled back|memory")
        expect_same(fmu, "memory", lie)


def test_states_and_given_values_or_replay_instead():
    """An open file prevents copies of memory. If the states lack only values that were set, these are set again; else the
    program resets the FMU and replays its inputs."""
    for lie in "parameters", "one", "late":
        fmu = keeper_fmu.make_false(lie, OPENS=15)
        code, out, err = run(["check", keeper_fmu.config(fmu)])
        expect(code == 0, f"{lie}: {code}\n{out}{err}")
        if not SANITIZER:  # which has no copies of memory that the file could prevent
            expect_line(err, "warning|FMU lag|states.txt")
        by_states = lie == "parameters"
        expect(has_line(err, "notice|FMU lag|own states|parameters") == by_states, f"{lie}: {err}")
        expect(has_line(err, "warning|FMU lag|reset|replay") != by_states, f"{lie}: {err}")
        expect_line(out, f"rolled back|{'state' if by_states else 'replay'}")
        expect_same(fmu, "replay", lie)


def test_a_mode_that_only_trials_enter():
    """The states lack it. If an excursion of the proof enters the mode, the program finds that they are wrong, also if they
    would be far faster. If only the search goes so far, copies of memory are right from the beginning."""
    for limit, pages in (1.3, 0), (1.3, keeper_fmu.PAGES), (5, 0):
        fmu = keeper_fmu.make_mode(limit, pages)
        if limit < 2:
            code, out, err = run(["replay", keeper_fmu.config(fmu, "state")])
            expect(code == FMU_FAILED, f"{limit}: {code}\n{out}{err}")
            expect_line(err, "error|keeper0.y")
        if SANITIZER:
            continue
        chosen = steps_of(keeper_fmu.config(fmu))
        expect(chosen == steps_of(keeper_fmu.config(fmu, "memory")), f"{limit}: other values than with \"rollback\": \"memory\"")
        expect(chosen == steps_of(keeper_fmu.config(fmu), "--plain"), f"{limit}: other values without savings")


def test_a_limit_hides_the_difference():
    """While the output is at its limit, only an internal variable shows that the restored states are wrong."""
    for pages in 0, keeper_fmu.PAGES:
        fmu = keeper_fmu.make_masked(0.5, pages)
        code, out, err = run(["replay", keeper_fmu.config(fmu, "state")])
        expect(code == FMU_FAILED, f"{code}\n{out}{err}")
        expect_line(err, "error|keeper0|internal variable|rollback")
        if SANITIZER:
            continue
        code, out, err = run(["check", keeper_fmu.config(fmu)])
        expect(code == 0, f"{code}\n{out}{err}")
        expect_line(err, "notice|own states|memory")
        expect_same(fmu, "memory", f"{pages} pages")


def test_a_library_that_the_first_step_opens_by_name():
    """A rollback of the proof resets its variables, too. The results are those of an FMU without a library. The last FMU closes
    it in each step."""
    if SANITIZER:
        raise Skip("a sanitizer replaces the allocator: no copies of FMU memory")
    for searched in (".",), ("further",), (".", "-DCLOSES=1"):
        fmu = keeper_fmu.make_by_name(*searched)
        chosen = steps_of(keeper_fmu.config(fmu, "memory"))
        expect(chosen == steps_of(keeper_fmu.config(keeper_fmu.make_late(10**6), "memory")), f"{searched}: steps of the proof are counted")
        expect(chosen == steps_of(keeper_fmu.config(fmu, "memory"), "--plain"), f"{searched}: other values without savings")


def test_a_library_outside_of_the_fmu():
    """Its variables belong to the states of the only FMU that uses it. If several use it, they belong to none, and the
    proof finds that."""
    if SANITIZER:
        raise Skip("a sanitizer replaces the allocator: no copies of FMU memory")
    fmu, library = keeper_fmu.make_needed()
    path = keeper_fmu.config(fmu, "memory")
    document = json.loads(path.read_text(encoding="utf-8"))
    document["components"]["keeper0"]["libraries"] = [str(library)]
    one = steps_of(write_config(document))
    expect(one == steps_of(keeper_fmu.config(keeper_fmu.make_late(10**6), "memory")), "other values than without a library")
    document["components"]["other"] = {"fmu": str(FMUS / "lag.fmu"), "rollback": "state", "set": {"u": 0}, "libraries": [str(library)]}
    code, _, err = run(["replay", write_config(document)])
    expect(code == FMU_FAILED, f"{code}\n{err}")
    expect_line(err, 'error|keeper0.y|step|"rollback"')


def test_the_global_locale_of_cpp():
    """libstdc++ has its address, in the heap of the FMU. If only this FMU uses libstdc++, its data is part of the states."""
    if SANITIZER:
        raise Skip("a sanitizer replaces the allocator: no copies of FMU memory")
    if platform.machine() not in ("x86_64", "armv7l"):
        raise Skip("the FMU calls C++ as C, which these machines allow")
    fmu = keeper_fmu.make_cpp_locale()
    expected = steps_of(keeper_fmu.config(keeper_fmu.make_late(10**6), "memory"))
    for method in ("memory", "replay"):
        expect(steps_of(keeper_fmu.config(fmu, method)) == expected, f"{method}: other values than without the locale")


def test_results_that_depend_on_addresses():
    """An FMU gets the same addresses in each run."""
    if SANITIZER or sys.maxsize < 2**32:
        raise Skip("a heap with chosen addresses needs 64 bits and the program's allocator")
    config = keeper_fmu.config(keeper_fmu.make_address(), "memory")
    expect(steps_of(config) == steps_of(config), "other values in the second run")


def test_no_method():
    """The library keeps its state over a reset and for all instances, so no method is exact. The program ends before a step."""
    for verb in "check", "replay":
        code, out, err = run([verb, keeper_fmu.config(keeper_fmu.make_false("events", OPENS=15))])
        expect(code == FMU_FAILED, f"{verb}: {code}\n{out}{err}")
        expect_line(err, 'error|keeper0.y|1|step|"rollback"')


if __name__ == "__main__":
    main()
