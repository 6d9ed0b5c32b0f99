#!/usr/bin/env python3
"""`check` looks far from the start whether FMUs come back to where they were, and says in which way one does not."""
import keeper_fmu
from twinlock_test import SANITIZER, Skip, config_path, expect, main, run, run_well

LATE = 2500  # executions: after the dry run of a check


def check(name, way=None):
    code, out, err = run(["check", keeper_fmu.config(keeper_fmu.make_later(name, LATE), way)])
    expect(code == 0 and "no problem found" in out, f"{code}\n{out}{err}")
    return " ".join(out.split())


def expect_said(out, *words):
    expect(all(word in out for word in ("from the start: not exact", "components.keeper0.rollback: keeper0 does not come back to where it was: y was", "1 warning", *words)), out)


def test_what_is_exact():
    out = run_well(["check", config_path("motor/live.json")])
    expect("from the start: exact" in out, out)


def test_words():
    if SANITIZER:
        raise Skip("a sanitizer has an allocator of its own: there is no copy of an FMU's memory")
    expect_said(check("late"), "incomplete state: led back at once it is exact", "it is rolled back by its memory from now on")
    expect_said(check("cold"), "cold solver: so it is if it is led back at once", "it is rolled back by its memory from now on")
    expect_said(check("clock"), "not steady: it goes two ways from one copy of its memory")


def test_without_another_way():
    """It is said all the same, but not why."""
    expect_said(check("late", "state"), "what is committed may be wrong from now on")


if __name__ == "__main__":
    main()
