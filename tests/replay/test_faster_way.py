#!/usr/bin/env python3
"""Of two exact ways an FMU is led back by the faster one: a copy of its memory, if its own states take far longer. What it gives is the same to the bit."""
import json
import sqlite3
from contextlib import closing

import keeper_fmu
from twinlock_test import NOT_LOCKED, SANITIZER, SKIPPED, at_least, config_path, expect, main, run, run_well, scratch

if SANITIZER:
    print("skipped: a sanitizer has an allocator of its own: there is no copy of an FMU's memory")
    raise SystemExit(SKIPPED)

FMU_FAILED = 70
SLOWER = "rolled back by its memory,\n               which takes "
BACK = "does not come back to where it was by its memory"


def replay(config, *options):
    """(what a replay tells, the bits of its steps, what it says)"""
    steps = scratch() / "steps.csv"
    code, out, err = run(["replay", config, "--json", "--csv", steps, *options])
    expect(code in (0, NOT_LOCKED), f"{code}\n{out}{err}")
    return json.loads(out), steps.read_text(encoding="utf-8"), err


def test_slow_states():
    fmu = keeper_fmu.make_slow()
    out = run_well(["check", keeper_fmu.config(fmu)])
    expect(SLOWER in out and " µs with a step, and by its state " in out and "no problem found\n" in out, out)
    told, chosen, err = replay(keeper_fmu.config(fmu))
    expect(err == "", err)
    for way, options in ("state", ()), ("memory", ()), (None, ("--plain",)):
        other, steps, _ = replay(keeper_fmu.config(fmu, way), *options)
        expect(steps == chosen, f"{way} {options}: other values")
        expect(options or other["executions"] == told["executions"], f"{way}: {other['executions']} and {told['executions']}")


def test_each_of_several():
    chosen = replay(keeper_fmu.config(keeper_fmu.make_slow(), components=2))[1]
    expect(chosen == replay(keeper_fmu.config(keeper_fmu.make_slow(), "state", 2))[1], "other values")


def test_states_that_are_fast():
    out = run_well(["check", config_path("motor/lock.json")])
    expect("can save its state" in out and SLOWER not in out, out)


def test_asked_for_by_name():
    out = run_well(["check", keeper_fmu.config(keeper_fmu.make_slow(), "state")])
    expect("can save its state" in out and SLOWER not in out, out)


def test_a_copy_that_is_not_exact():
    """It is faster, and found out before the first step."""
    fmu = keeper_fmu.make_slow(OUTSIDE=1)
    code, out, err = run(["check", keeper_fmu.config(fmu)])
    expect(code == 0 and BACK in err and "it is rolled back by its own states, which are slower" in err, f"{code}\n{out}{err}")
    expect("can save its state" in out and SLOWER not in out, out)
    _, chosen, _ = replay(keeper_fmu.config(fmu))
    expect(chosen == replay(keeper_fmu.config(fmu, "state"))[1], "other values than by its states from the beginning")


def test_a_copy_that_is_not_exact_later():
    config, database = keeper_fmu.config(keeper_fmu.make_slow(OUTSIDE=300)), scratch() / "run.db"
    content = json.loads(config.read_text(encoding="utf-8"))
    content["synchronise"]["verify_every"] = 10
    config.write_text(json.dumps(content), encoding="utf-8")
    told, _, err = replay(config, "--db", database)
    expect("it is rolled back by its own states from now on" in err and told["verified"]["differed"] == 1, f"{told['verified']}\n{err}")
    at_least(told["verified"]["times"], 5, "looked, and further on")
    with closing(sqlite3.connect(database)) as found:
        events = [text for (text,) in found.execute("SELECT text FROM events WHERE source = 'twin'")]
    expect(any("by its own states from now on" in text for text in events), f"{events}")


def test_what_a_copy_does_not_take_back_comes_later():
    """It was exact, and is not any more; there is no state of its own to go back to. By its states it goes on."""
    fmu = keeper_fmu.make_slow(MAPS=300)
    code, _, err = run(["replay", keeper_fmu.config(fmu)])
    expect(code == FMU_FAILED and 'which no copy of its memory takes back; its own states may: "rollback": "state"' in err, f"{code}\n{err}")
    replay(keeper_fmu.config(fmu, "state"))


def test_what_a_copy_does_not_take_back_is_there():
    """Its states do, and so they are what it goes by."""
    for step in 3, 60:
        config = keeper_fmu.config(keeper_fmu.make_slow(MAPS=step))
        out = run_well(["check", config])
        expect(SLOWER not in out and "state" in out, out)
        _, steps, err = replay(config)
        expect(steps == replay(keeper_fmu.config(keeper_fmu.make_slow(MAPS=step), "state"))[1], f"{step}: other values than by its states")
        expect("error" not in err, err)


def test_its_states_are_bytes_all_the_same():
    """For a checkpoint: made of a copy, and read by another process."""
    out = run_well(["check", keeper_fmu.config(keeper_fmu.make_slow())])
    expect(SLOWER in out and "read back exactly" in out, out)


if __name__ == "__main__":
    main()
