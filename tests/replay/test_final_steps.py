#!/usr/bin/env python3
"""An FMU that goes by whether a step is said to be final: a trial is not, a free run's steps are. It is led back in a way that it cannot know of, and each step is final for it."""
import keeper_fmu
from twinlock_test import NOT_LOCKED, SANITIZER, expect, main, run, run_well, scratch


def steps_of(way, *options):
    steps = scratch() / "steps.csv"
    run_well(["replay", keeper_fmu.config(keeper_fmu.make_final(), way), "--csv", steps, *options], wells=(0, NOT_LOCKED))
    return steps.read_text(encoding="utf-8")


def test_each_way_that_it_does_not_know_of():
    """What is committed is what a twin commits that executes everything again."""
    right = steps_of("replay", "--plain")
    ways = ("replay",) if SANITIZER else ("replay", "memory", None)
    for way in ways:
        for options in (), ("--plain",):
            expect(steps_of(way, *options) == right, f"{way} {options}: other values")


def test_by_its_states_it_would_be_wrong():
    """Nobody can say of a trial that it is final."""
    expect(steps_of("state") != steps_of("state", "--plain"), "it does not go by that")


def test_it_is_found_out():
    code, out, err = run(["check", keeper_fmu.config(keeper_fmu.make_final())])
    found = "by its own states (final steps: so it is if it is told that no earlier state will be restored): it is rolled back by its memory instead" in err
    expect(code == 0 and found == (not SANITIZER) and ("rolled back by its memory" in out) == (not SANITIZER), f"{code}\n{out}{err}")


if __name__ == "__main__":
    main()
