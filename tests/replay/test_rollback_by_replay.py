#!/usr/bin/env python3
"""Rollback by replay: an FMU is reset and gets its inputs again. The results have the bits of other methods.

After "replay_steps" the twin runs free, with a warning."""
import json
import sqlite3
from contextlib import closing

import keeper_fmu
from twinlock_test import IN_LOCK, NOT_LOCKED, SANITIZER, Skip, edited_config, expect, expect_line, has_line, main, read_config, run, run_well, scratch

FMU_FAILED = 70


def steps_of(config, *options):
    steps = scratch() / "steps.csv"
    run_well(["replay", config, "--csv", steps, *options], wells=(0, NOT_LOCKED))
    return steps.read_text(encoding="utf-8")


def keeper(method, replay_steps=None, unconfined=False, **macros):
    config = keeper_fmu.config(keeper_fmu.make(**macros), method)
    content = json.loads(config.read_text(encoding="utf-8"))
    content["components"]["keeper0"]["unconfined"] = unconfined
    if replay_steps is not None:
        content["components"]["keeper0"]["replay_steps"] = replay_steps
    config.write_text(json.dumps(content), encoding="utf-8")
    return config


def test_both_kinds_of_reset():
    """By fmi2Reset, or freed and instantiated again; with and without savings; the results equal those with memory copies."""
    configs = [keeper("replay", RESETS=1), keeper("replay", RESETS=2)] + ([] if SANITIZER else [keeper("memory", RESETS=1)])
    found = {steps_of(config, *options) for config in configs for options in ((), ("--plain",))}
    expect(len(found) == 1 and found.pop().count("\n") > 90, "other values with another method")


def test_resources_that_no_copy_restores():
    """A thread, a file, mapped memory and a child: the program names the resource and uses replay. The results do not change."""
    expected = steps_of(keeper("replay", RESETS=1))
    for macros, resource in (({"THREAD": 2}, "thread"), ({"FILE_OPEN": 2}, "keeper.txt"), ({"MAPPED": 2}, "heap"), ({"CHILD": 2}, "process")):
        for resets in 1, 2:
            config = keeper(None, unconfined="CHILD" in macros, RESETS=resets, **macros)
            expect(steps_of(config) == expected, f"{macros}: other values than without")
        code, out, err = run(["check", config])
        expect(code == 0, f"{macros}: {code}\n{out}{err}")
        expect_line(out, "replay|keeper0|1000 steps")
        if not SANITIZER:
            expect_line(err, f"warning|FMU lag|{resource}|memory")
            expect_line(err, "warning|FMU lag|reset|replay")
            expect("error:" not in err, f"{macros}: {err}")


def test_two_components_with_such_resources():
    """Both are rolled back by replay, whichever is found first."""
    fmu = keeper_fmu.make_false("parameters", OPENS=15)
    expected = steps_of(keeper_fmu.config(fmu, "replay", 2))
    config = keeper_fmu.config(fmu, components=2)
    expect(steps_of(config) == expected, "other values than with \"rollback\": \"replay\"")


def test_wrong_states():
    """Without copies of memory, the program changes from wrong states to replay."""
    if not SANITIZER:
        raise Skip("without a sanitizer there are copies of memory")
    config = keeper("auto", RESETS=1, OWN_STATE=1)
    code, out, err = run(["check", config])
    expect(code == 0, f"{code}\n{out}{err}")
    expect_line(out, "replay|keeper0|1000 steps")
    expect_line(err, "warning|FMU lag|reset|replay")
    expect(steps_of(config) == steps_of(keeper("replay", RESETS=1)), "other values than with \"rollback\": \"replay\"")


def test_an_incomplete_reset():
    """An FMU that keeps state over a reset fails the test before the first step."""
    code, out, err = run(["replay", keeper("replay")])
    expect(code == FMU_FAILED, f"{code}\n{out}{err}")
    expect_line(err, 'error|keeper0.y|1|step|"rollback"')


def test_after_replay_steps():
    """Until then the results are those with more steps; afterwards the twin runs free at nominal u. The log, the database and
    check have it."""
    config = keeper("replay", replay_steps=60, RESETS=1)
    steps, database = scratch() / "steps.csv", scratch() / "run.db"
    code, out, err = run(["replay", config, "--csv", steps, "--db", database, "--json"])
    told = json.loads(out)
    expect(code in (0, NOT_LOCKED), f"{code}\n{err}")
    expect_line(err, 'warning|0.58 s|nominal|keeper0|replay|"replay_steps"')
    expect(told["lock"]["state"] not in IN_LOCK, f"{told['lock']}")
    longer = steps_of(keeper("replay", RESETS=1)).splitlines()
    found = steps.read_text(encoding="utf-8").splitlines()
    expect(len(found) == len(longer) and found[:59] == longer[:59] and found[59:] != longer[59:], "a difference before step 58, or none after it")
    with closing(sqlite3.connect(database)) as opened:
        events = [text for text, in opened.execute("SELECT text FROM events WHERE source = 'twin'") if has_line(text, "step 58")]
        outcomes = opened.execute("SELECT step, outcome FROM v_steps WHERE outcome = 'free run' ORDER BY step").fetchall()
    expect(len(events) == 1 and has_line(events[0], "replay|replay_steps"), f"{events}")
    expect([step for step, _ in outcomes] == list(range(58, 58 + len(outcomes))) and len(outcomes) > 30, f"{outcomes}")
    code, out, err = run(["check", config])
    expect(code == 0, f"{code}\n{out}{err}")
    expect_line(out, "replay|keeper0|60 steps")
    expect_line(out, "0.6 s|plant time")


def test_a_wrong_number_of_steps():
    code, out, err = run(["check", keeper("replay", replay_steps=0, RESETS=1)])
    expect(code == 65, f"{code}\n{out}{err}")
    expect_line(err, "components.keeper0.replay_steps|0|1|100000")


def test_ours_are_the_same():
    """Replay and own states give the same bits and the same number of executions, also with an event horizon."""
    for name, duration, free_twin in (("motor/lock.json", 2, {"synchronise": {"free_twin": True}}), ("cylinder/lock.json", 4, {})):
        components = read_config(name)["components"]
        changes = {"components": {component: {"rollback": "replay", "replay_steps": 3000} for component in components}}
        by_state, by_replay = (edited_config(name, {"duration_s": duration, **free_twin, **more}) for more in ({}, changes))
        expect(steps_of(by_replay) == steps_of(by_state), f"{name}: other values by replay")
        out = run_well(["check", by_replay])
        expect(has_line(out, "synchronise.free_twin") == (free_twin != {}), out)
        ledgers = [json.loads(run(["replay", config, "--json"])[1])["ledger"] for config in (by_replay, by_state)]
        expect(ledgers[0] == ledgers[1], f"{name}: {ledgers}")
        replayed = [json.loads(run(["replay", config, "--json"])[1])["replayed"] for config in (by_replay, by_state)]
        expect(replayed[0] > 0 and replayed[1] == 0, f"{name}: {replayed}")


main()
