#!/usr/bin/env python3
"""Saved states, loaded by another process: what `check` finds of FMUs that make something of them only where they were saved."""
import re

import hostile_fmu
import keeper_fmu
from twinlock_test import SANITIZER, SOURCE, edited_config, expect, main, run, run_well

WORDS = "saved states, loaded by another process\n"


def check(fmu, *options):
    """What is said of its state, and of the whole page the warnings in one line."""
    code, page, log = run(["check", keeper_fmu.config(fmu, "state"), *options])
    expect(code == 0, f"ended with {code}\n{page}{log}")
    found = re.search(re.escape(WORDS) + r"  keeper0 +(.*)\n", page)
    expect(found is not None, page)
    warnings = " ".join(page[page.index("warnings\n"):].split()) if "warnings\n" in page else ""
    return found[1], warnings, log


def test_exact():
    page = run_well(["check", SOURCE / "config" / "motor" / "lock.json"])
    expect(WORDS + "  drive        read back exactly\n  motor        read back exactly\n" in page and page.endswith("no problem found\n"), page)


def expect_warning(fmu, said, does, why, *options):
    """The log says nothing of it: the process that was lost is not that of the check."""
    found, warnings, log = check(fmu, *options)
    expect(found == said, found)
    expect(f"components.keeper0: a saved state of it {does} (" in warnings and why in warnings, f"{warnings}")
    expect("signal" not in log and "fmi2DeSerialize" not in log, log)


def test_it_ends_the_process_that_loads_it():
    expect_warning(hostile_fmu.make("foreign_state"), "ends the process that loads it", "ends the process that loads it",
                   "was ended by signal 6 (Aborted), in fmi2DeSerializeFMUstate of FMU keeper0)")


def test_it_hangs():
    expect_warning(hostile_fmu.make("foreign_state", HOW="hangs"), "ends the process that loads it", "ends the process that loads it",
                   "has not returned from fmi2DeSerializeFMUstate for 2 s", "--call-limit", "2")


def test_it_is_refused():
    expect_warning(hostile_fmu.make("foreign_state", HOW="refuses"), "refused", "cannot be loaded by another process",
                   "fmi2DeSerializeFMUstate failed (fmi2Error)")


def test_it_goes_on_otherwise():
    found, warnings, _ = check(keeper_fmu.make_false("stranger"))
    expect(found == "loaded, and goes on otherwise", found)
    told = re.search(r"goes on otherwise in another process \(y is (\S+) in step 1 after it, and (\S+) in the other process\)", warnings)
    expect(told is not None and 0 < float(told[2]) - float(told[1]) < 2e-3, warnings)


def test_it_is_no_fault_of_the_bytes():
    """It does not come back in its own process either, some time after its start."""
    found, warnings, _ = check(keeper_fmu.make_later("late", 2000))
    expect(found == "goes on otherwise, and so it does in the process that has saved it", found)
    expect("saved state" not in warnings and "does not come back to where it was" in warnings, warnings)


def test_one_does_not_hide_the_others():
    """Each is told of, whichever ends its process."""
    bad, good = str(hostile_fmu.make("foreign_state")), str(hostile_fmu.make("good"))
    for order in ((bad, good), (good, bad), (bad, bad)):
        config = edited_config(keeper_fmu.config(good, "state", len(order)),
                               {"components": {f"keeper{i}": {"fmu": fmu} for i, fmu in enumerate(order)}})
        page = run_well(["check", config])
        words = {bad: "ends the process that loads it", good: "read back exactly"}
        expect(WORDS + "".join(f"  keeper{i}      {words[fmu]}\n" for i, fmu in enumerate(order)) in page, page)


def test_none_is_saved():
    """By its memory, or by replay, there is nothing to load."""
    good = hostile_fmu.make("good")
    for way in ("replay",) if SANITIZER else ("replay", "memory"):
        page = run_well(["check", keeper_fmu.config(good, way)])
        expect(WORDS not in page and f"rolled back by {'replay' if way == 'replay' else 'its memory'}" in page, page)


if __name__ == "__main__":
    main()
