#!/usr/bin/env python3
"""Of two exact rollback methods the program chooses copies of memory, unless the FMU's own states are far faster.

The results have the same bits."""
import json
import sqlite3
from contextlib import closing

import keeper_fmu
from twinlock_test import NOT_LOCKED, SANITIZER, SKIPPED, at_least, config_path, expect, expect_line, expect_no_line, has_line, main, run, run_well, scratch

if SANITIZER:
    print("skipped: a sanitizer replaces the allocator: no copies of FMU memory")
    raise SystemExit(SKIPPED)

FMU_FAILED = 70
BY_MEMORY = "rolled back|memory"  # of a component, in the output of check
BY_STATE = "can save|state"


def replay(config, *options):
    """(output of --json, text of --csv, log) of a replay."""
    steps = scratch() / "steps.csv"
    code, out, err = run(["replay", config, "--json", "--csv", steps, *options])
    expect(code in (0, NOT_LOCKED), f"{code}\n{out}{err}")
    return json.loads(out), steps.read_text(encoding="utf-8"), err


def test_slow_states():
    fmu = keeper_fmu.make_slow()
    out = run_well(["check", keeper_fmu.config(fmu)])
    expect_line(out, f"keeper0|{fmu}")
    expect_line(out, BY_MEMORY)
    expect_line(out, "µs|state")
    last = out.splitlines()[-1]
    expect(has_line(last, "no problem found") and "warning" not in last, out)
    told, chosen, err = replay(keeper_fmu.config(fmu))
    expect(err == "", err)
    for method, options in ("state", ()), ("memory", ()), (None, ("--plain",)):
        other, steps, _ = replay(keeper_fmu.config(fmu, method), *options)
        expect(steps == chosen, f"{method} {options}: other values")
        expect(options or other["executions"] == told["executions"], f"{method}: {other['executions']} and {told['executions']}")


def test_each_of_several():
    chosen = replay(keeper_fmu.config(keeper_fmu.make_slow(), components=2))[1]
    expect(chosen == replay(keeper_fmu.config(keeper_fmu.make_slow(), "state", 2))[1], "other values")


def test_states_that_are_fast():
    """They are used only if they are far faster than copies."""
    out = run_well(["check", config_path("motor/lock.json")])
    expect_line(out, f"motor|{BY_MEMORY}")
    expect_no_line(out, BY_STATE)
    out = run_well(["check", keeper_fmu.config(keeper_fmu.make_later("late", 1 << 30))])
    expect_line(out, BY_STATE)
    expect_no_line(out, BY_MEMORY)


def test_fast_states_that_lack_memory():
    """The first 0.3 s do not depend on the delay line that the states lack."""
    fmu = keeper_fmu.make_later("ring", 0)
    out = run_well(["check", keeper_fmu.config(fmu)])
    expect_line(out, BY_MEMORY)
    expect_line(out, "µs|state")
    chosen = replay(keeper_fmu.config(fmu))[1]
    for method, options in ("memory", ()), (None, ("--plain",)):
        expect(replay(keeper_fmu.config(fmu, method), *options)[1] == chosen, f"{method} {options}: other values")


def test_configured_states():
    out = run_well(["check", keeper_fmu.config(keeper_fmu.make_slow(), "state")])
    expect_line(out, BY_STATE)
    expect_no_line(out, BY_MEMORY)


def test_a_copy_that_is_not_exact():
    """The copy is faster, but the program sees before the first step that it is wrong."""
    fmu = keeper_fmu.make_slow(OUTSIDE=1)
    code, out, err = run(["check", keeper_fmu.config(fmu)])
    expect(code == 0, f"{code}\n{out}{err}")
    expect_line(err, "notice|FMU lag|by its memory|own states")
    expect_line(out, BY_STATE)
    expect_no_line(out, BY_MEMORY)
    _, chosen, _ = replay(keeper_fmu.config(fmu))
    expect(chosen == replay(keeper_fmu.config(fmu, "state"))[1], "other values than with \"rollback\": \"state\"")


CHANGED = "keeper0|y|tolerances|1 step|own states"


def test_a_copy_that_is_not_exact_later():
    config, database = keeper_fmu.config(keeper_fmu.make_slow(OUTSIDE=300)), scratch() / "run.db"
    content = json.loads(config.read_text(encoding="utf-8"))
    content["synchronise"]["verify_every"] = 10
    config.write_text(json.dumps(content), encoding="utf-8")
    told, _, err = replay(config, "--db", database)
    expect(told["verified"]["differed"] == 1, f"{told['verified']}\n{err}")
    expect_line(err, CHANGED)
    at_least(told["verified"]["times"], 5, "checks, also after the change")
    with closing(sqlite3.connect(database)) as found:
        events = [text for (text,) in found.execute("SELECT text FROM events WHERE source = 'twin'")]
    expect(any(has_line(text, CHANGED) for text in events), f"{events}")


def test_memory_outside_the_heap_appears_late():
    """A copy would miss this memory, and there is no earlier own state. With "rollback": "state" the run completes."""
    fmu = keeper_fmu.make_slow(MAPS=300)
    code, _, err = run(["replay", keeper_fmu.config(fmu)])
    expect(code == FMU_FAILED, f"{code}\n{err}")
    expect_line(err, 'FMU lag|heap|"rollback": "state"')
    replay(keeper_fmu.config(fmu, "state"))


def test_memory_outside_the_heap_appears_early():
    """The program finds it before the first step and uses the states."""
    for step in 3, 60:
        config = keeper_fmu.config(keeper_fmu.make_slow(MAPS=step))
        out = run_well(["check", config])
        expect_line(out, BY_STATE)
        expect_no_line(out, BY_MEMORY)
        _, steps, err = replay(config)
        expect(steps == replay(keeper_fmu.config(keeper_fmu.make_slow(MAPS=step), "state"))[1], f"{step}: other values than with its states")
        expect("error" not in err, err)


def test_its_states_can_be_serialised():
    """A checkpoint is made of a copy, and another process loads it."""
    out = run_well(["check", keeper_fmu.config(keeper_fmu.make_slow())])
    expect_line(out, BY_MEMORY)
    expect_line(out, "keeper0|exactly")


if __name__ == "__main__":
    main()
