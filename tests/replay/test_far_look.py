#!/usr/bin/env python3
"""`check` also tests rollback far from the start, and names the kind of error."""
import keeper_fmu
from twinlock_test import SANITIZER, Skip, config_path, expect, expect_line, expect_no_line, main, run, run_well

LATE = 6000  # executions; the dry run of a check has fewer


def expect_found(parts, name, method=None):
    """`check` of FMU `name` prints one warning, with `parts`. Returns the warning. There are few evaluations, because a search
    that may take too long would be a warning, too."""
    code, out, err = run(["check", keeper_fmu.config(keeper_fmu.make_later(name, LATE), method, evaluations=10)])
    expect(code == 0, f"{code}\n{out}{err}")
    expect_line(out, "no problem found|1 warning")
    expect_line(out, "\u2026|s|not exact")
    warning = " ".join(out.partition("\nwarnings\n")[2].partition("\ndeterminism\n")[0].split())
    expect_line(warning, f"components.keeper0.rollback|keeper0|y|tolerances|1 step|{parts}")
    return warning


def test_what_is_exact():
    out = run_well(["check", config_path("motor/live.json")])
    expect_line(out, "\u2026|s|exact")
    expect_no_line(out, "not exact")


def test_kinds_of_errors():
    if SANITIZER:
        raise Skip("a sanitizer replaces the allocator: no copies of FMU memory")
    expect_found("incomplete state|by its memory", "late")
    expect_found("cold solver|by its memory", "cold")
    expect_found("not steady", "clock")


def test_without_another_method():
    """The warning has the difference, but no kind."""
    warning = expect_found("wrong", "late", "state")
    expect_no_line(warning, "incomplete state")
    expect_no_line(warning, "by its memory")


if __name__ == "__main__":
    main()
