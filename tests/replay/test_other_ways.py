#!/usr/bin/env python3
"""`check` says by which other method a component comes back that does not do so by the configured one."""
import sys

import keeper_fmu
from twinlock_test import SANITIZER, SKIPPED, expect, main, run, run_well

if SANITIZER:
    print("skipped: a sanitizer has an allocator of its own: there is no copy of an FMU's memory")
    sys.exit(SKIPPED)

FMU_FAILED = 70


def fail(config):
    """What is said of one that does not come back, behind the error."""
    code, out, err = run(["check", config])
    expect(code == FMU_FAILED and out == "", f"{code}\n{out}{err}")
    return [line.removeprefix("twinlock: notice: ") for line in err.splitlines() if line.startswith("twinlock: notice: components.")], err


def test_nothing_to_be_tried():
    code, _, err = run(["check", keeper_fmu.config(keeper_fmu.make(THREAD=2, RESETS=1), "replay")])
    expect(code == 0 and "another way" not in err, err)


def test_another_than_the_named():
    """By its memory; and that is what does it."""
    told, err = fail(keeper_fmu.config(keeper_fmu.make(OWN_STATE=1), "state"))
    expect(len(told) == 1 and told[0].startswith("components.keeper0: comes back exactly by its memory; a save and a restore take ")
           and told[0].endswith(': write "rollback": "memory" in the component'), err)
    run_well(["check", keeper_fmu.config(keeper_fmu.make(OWN_STATE=1), "memory")])


def test_one_that_is_given_again():
    """Which is no way that has a name."""
    told, err = fail(keeper_fmu.config(keeper_fmu.make_false("parameters", OPENS=15), "memory"))
    expect(len(told) == 1 and "comes back exactly by its state, if it is given again what it had been given" in told[0]
           and told[0].endswith('"rollback": "auto" in the component'), err)


def test_by_replay_if_nothing_else():
    told, err = fail(keeper_fmu.config(keeper_fmu.make(THREAD=2, RESETS=1), "memory"))
    expect(told == ['components.keeper0: comes back by replay, within 1000 steps of its beginning only: write "rollback": "replay" in the component'], err)


def test_in_no_way():
    for way in None, "replay":
        told, err = fail(keeper_fmu.config(keeper_fmu.make(THREAD=2), way))
        expect(told == ["components.keeper0: does not come back in another way either"], err)


main()
