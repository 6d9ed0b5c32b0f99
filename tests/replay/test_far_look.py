#!/usr/bin/env python3
"""`check` also tests rollback far from the start and at the bounds of u, and names the kind of error."""
import json
import re

import keeper_fmu
from twinlock_test import SANITIZER, Skip, config_path, expect, expect_line, expect_no_line, has_line, main, run, run_well, write_config

LATE = 1500  # inner steps of 1 ms; the dry run of a check has fewer


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


LIMIT = 15  # of an input; the bounds of its search are -20 and 20, and a step of it is 0.1


def warnings(fmu, method=None, **adjust):
    """The warnings of `check` about values of u, in one line each. `adjust`: other bounds; None: no bound."""
    path = keeper_fmu.config(fmu, method, evaluations=10)
    config = json.loads(path.read_text(encoding="utf-8"))
    entry = {**config["synchronise"]["adjust"]["keeper0.u"], **adjust}
    config["synchronise"]["adjust"]["keeper0.u"] = {key: value for key, value in entry.items() if value is not None}
    out = run_well(["check", write_config(config)])
    found = re.split(r"\n  (?! )", out.partition("\nwarnings")[2].partition("\ndeterminism\n")[0])
    lines = [" ".join(text.split()) for text in found]
    return [line for line in lines if line.startswith("synchronise.adjust.") or ".rollback:" in line]


def expect_warning(found, parts):
    expect(len(found) == 1 and has_line(found[0], parts), f"expected one warning with {parts}:\n{found}")


def test_an_fmu_fails_at_a_bound():
    """The search never gets there, because the first steps of `check` move u by 0.1."""
    where = "synchronise.adjust.keeper0.u|20|bound|keeper0"
    expect_warning(warnings(keeper_fmu.make_limits(LIMIT=LIMIT)), f"{where}|y|NaN")
    fatal = () if SANITIZER else ((4, "fmi2Fatal"),)  # by FMI, such an instance is never freed: a sanitizer finds the leak
    for status, name in ((2, "fmi2Discard"), (3, "fmi2Error"), *fatal):
        expect_warning(warnings(keeper_fmu.make_limits(LIMIT=LIMIT, REFUSES=status)), f"{where}|fmi2DoStep|{name}")


def test_an_fmu_fails_within_the_bounds_only():
    expect(warnings(keeper_fmu.make_limits(LIMIT=LIMIT), max=LIMIT) == [], "u does not exceed its limit")


def test_a_step_that_is_larger_than_the_bounds_permit():
    """The response is measured within the bounds, and printed for one step."""
    path = keeper_fmu.config(keeper_fmu.make_limits(LIMIT=LIMIT, REFUSES=3), None, evaluations=10)
    config = json.loads(path.read_text(encoding="utf-8"))
    config["synchronise"]["adjust"]["keeper0.u"] |= {"min": -10, "max": 12, "step": 16}
    out = run_well(["check", write_config(config)])
    expect_line(out, "which moves keeper0.y|within T_P")
    expect_line(out, "no problem found")


def test_without_bounds():
    """64 steps from nominal, which is 1. Another warning asks for bounds."""
    fails, *others = warnings(keeper_fmu.make_limits(LIMIT=5), min=None, max=None)
    expect_warning([fails], "synchronise.adjust.keeper0.u|7.4|keeper0|y|NaN")
    expect_no_line(fails, "bound")
    expect_warning(others, "synchronise.adjust.keeper0.u|configuration|min|max")


def test_a_state_forgets_what_a_bound_has_changed():
    expect_warning(warnings(keeper_fmu.make_mode(LIMIT), "state"), "components.keeper0.rollback|y|20|keeper0.u|memory")
    if not SANITIZER:
        expect(warnings(keeper_fmu.make_mode(LIMIT), "memory") == [], "a copy of its memory contains the mode")


if __name__ == "__main__":
    main()
