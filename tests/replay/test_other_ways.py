#!/usr/bin/env python3
"""If the configured rollback method of a component is not exact, `check` suggests another one."""
import sys

import keeper_fmu
from twinlock_test import SANITIZER, SKIPPED, expect, has_line, main, run, run_well

if SANITIZER:
    print("skipped: a sanitizer replaces the allocator: no copies of FMU memory")
    sys.exit(SKIPPED)

FMU_FAILED = 70


def advice_of(config):
    """(notices about components, log) of a `check` that fails."""
    code, out, err = run(["check", config])
    expect(code == FMU_FAILED and out == "", f"{code}\n{out}{err}")
    return advice_in(err), err


def advice_in(log):
    return [line for line in log.splitlines() if line.startswith("twinlock: notice: components.")]


def test_no_advice_if_the_method_is_exact():
    code, _, err = run(["check", keeper_fmu.config(keeper_fmu.make(THREAD=2, RESETS=1), "replay")])
    expect(code == 0 and not advice_in(err), err)


def test_memory_instead_of_state():
    """The advice works."""
    advice, err = advice_of(keeper_fmu.config(keeper_fmu.make(OWN_STATE=1), "state"))
    expect(len(advice) == 1 and has_line(advice[0], 'components.keeper0|µs|KiB|"rollback": "memory"'), err)
    run_well(["check", keeper_fmu.config(keeper_fmu.make(OWN_STATE=1), "memory")])


def test_states_with_given_values():
    """This method has no name in the configuration, so the advice is "auto"."""
    advice, err = advice_of(keeper_fmu.config(keeper_fmu.make_false("parameters", OPENS=15), "memory"))
    expect(len(advice) == 1 and has_line(advice[0], 'components.keeper0|state|µs|KiB|"rollback": "auto"'), err)


def test_replay_if_no_other_is_exact():
    advice, err = advice_of(keeper_fmu.config(keeper_fmu.make(THREAD=2, RESETS=1), "memory"))
    expect(len(advice) == 1 and has_line(advice[0], 'components.keeper0|1000 steps|"rollback": "replay"'), err)


def test_no_method_is_exact():
    for method in None, "replay":
        advice, err = advice_of(keeper_fmu.config(keeper_fmu.make(THREAD=2), method))
        expect(len(advice) == 1 and has_line(advice[0], "components.keeper0") and '"rollback"' not in advice[0], err)


main()
