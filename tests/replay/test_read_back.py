#!/usr/bin/env python3
"""`check` loads saved states in another process. It finds FMUs whose states are valid only in the process that saved them."""
import re

import hostile_fmu
import keeper_fmu
from twinlock_test import SANITIZER, SOURCE, edited_config, expect, expect_line, has_line, main, run, run_well

def results(page):
    """{component: result} of the section about saved states."""
    section = re.search(r"^saved states.*\n((?:  \w+  .*\n)+)", page, re.M)
    return dict(line.split(maxsplit=1) for line in section[1].splitlines()) if section else {}


def check(fmu, *options):
    """(result of its state, all warnings in one line, log)."""
    code, page, log = run(["check", keeper_fmu.config(fmu, "state"), *options])
    expect(code == 0, f"ended with {code}\n{page}{log}")
    expect(results(page).keys() == {"keeper0"}, page)
    return results(page)["keeper0"], " ".join(page.partition("\nwarnings\n")[2].split()), log


def test_exact():
    page = run_well(["check", SOURCE / "config" / "motor" / "lock.json"])
    found = results(page)
    expect(found.keys() == {"drive", "motor"} and all(has_line(result, "exactly") for result in found.values()), page)
    last = page.splitlines()[-1]
    expect(has_line(last, "no problem found") and "warning" not in last, page)


def expect_warning(fmu, word, parts, *options):
    """The log has nothing about it, because the lost process is not that of the check."""
    found, warnings, log = check(fmu, *options)
    expect(has_line(found, word) and not has_line(found, "exactly"), found)
    expect_line(warnings, f"components.keeper0|fmi2DeSerializeFMUstate|{parts}")
    expect("signal" not in log and "fmi2DeSerialize" not in log, log)


def test_a_state_that_crashes_the_loading_process():
    expect_warning(hostile_fmu.make("foreign_state"), "process", "process|signal 6|Aborted|FMU keeper0")


def test_loading_hangs():
    expect_warning(hostile_fmu.make("foreign_state", HOW="hangs"), "process", "process|FMU keeper0|2 s", "--call-limit", "2")


def test_a_refused_state():
    expect_warning(hostile_fmu.make("foreign_state", HOW="refuses"), "refused", "process|fmi2Error")


def test_a_state_with_other_results():
    """The first step after it has another value in the other process."""
    found, warnings, _ = check(keeper_fmu.make_false("stranger"))
    expect(has_line(found, "loaded") and not has_line(found, "exactly"), found)
    expect_line(warnings, "components.keeper0|saved state|y|step 1|another process")
    here, there = re.findall(r"\d\.\d{5,}", warnings)
    expect(0 < float(there) - float(here) < 2e-3, warnings)


def test_a_state_that_is_wrong_in_its_own_process():
    """Far from the start a restored state is wrong in the same process, so there is no warning about the other process."""
    found, warnings, _ = check(keeper_fmu.make_later("late", 1500))
    expect(has_line(found, "process") and not has_line(found, "exactly"), found)
    expect_line(warnings, "components.keeper0.rollback|keeper0|y|tolerances|1 step")
    expect("saved state" not in warnings, warnings)


def test_each_component_has_a_result():
    """Also if the state of another one crashes the process."""
    bad, good = str(hostile_fmu.make("foreign_state")), str(hostile_fmu.make("good"))
    for order in ((bad, good), (good, bad), (bad, bad)):
        config = edited_config(keeper_fmu.config(good, "state", len(order)),
                               {"components": {f"keeper{i}": {"fmu": fmu} for i, fmu in enumerate(order)}})
        page = run_well(["check", config])
        words = {bad: "process", good: "exactly"}
        found = results(page)
        expect(found.keys() == {f"keeper{i}" for i in range(len(order))}, page)
        expect(all(has_line(found[f"keeper{i}"], words[fmu]) for i, fmu in enumerate(order)), page)


def test_methods_without_saved_states():
    """With copies of memory or replay there is nothing to load."""
    good = hostile_fmu.make("good")
    for method in ("replay",) if SANITIZER else ("replay", "memory"):
        page = run_well(["check", keeper_fmu.config(good, method)])
        expect(not results(page), page)
        expect_line(page, f"rolled back|{method}")


if __name__ == "__main__":
    main()
