#!/usr/bin/env python3
"""An FMU whose result depends on noSetFMUStatePriorToCurrentPoint: false in a trial, true in a free run.

The program uses a rollback method that the FMU does not see, and tells it that each step is final."""
import keeper_fmu
from twinlock_test import NOT_LOCKED, SANITIZER, expect, has_line, main, run, run_well, scratch


def steps_of(method, *options):
    steps = scratch() / "steps.csv"
    run_well(["replay", keeper_fmu.config(keeper_fmu.make_final(), method), "--csv", steps, *options], wells=(0, NOT_LOCKED))
    return steps.read_text(encoding="utf-8")


def test_methods_from_outside():
    """The results equal those of a twin that executes everything again."""
    right = steps_of("replay", "--plain")
    methods = ("replay",) if SANITIZER else ("replay", "memory", None)
    for method in methods:
        for options in (), ("--plain",):
            expect(steps_of(method, *options) == right, f"{method} {options}: other values")


def test_its_states_are_wrong():
    """With its own states a trial is not final, so the results differ."""
    expect(steps_of("state") != steps_of("state", "--plain"), "the FMU ignores whether a step is final")


def test_check_finds_it():
    code, out, err = run(["check", keeper_fmu.config(keeper_fmu.make_final())])
    found = has_line(err, "notice|FMU lag|own states|final steps|memory")
    expect(code == 0 and found == (not SANITIZER) and has_line(out, "rolled back|memory") == (not SANITIZER), f"{code}\n{out}{err}")


if __name__ == "__main__":
    main()
