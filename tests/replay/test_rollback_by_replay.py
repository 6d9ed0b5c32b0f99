#!/usr/bin/env python3
"""What nothing else takes back is reset and given its inputs again: to the bit what it is by another way, for as many steps as it may, and then it runs free and says so."""
import json
import sqlite3
from contextlib import closing

import keeper_fmu
from twinlock_test import NOT_LOCKED, SANITIZER, Skip, config_path, edited_config, expect, main, read_config, run, run_well, scratch

FMU_FAILED = 70


def steps_of(config, *options):
    steps = scratch() / "steps.csv"
    run_well(["replay", config, "--csv", steps, *options], wells=(0, NOT_LOCKED))
    return steps.read_text(encoding="utf-8")


def keeper(way, replay_steps=None, unconfined=False, **macros):
    config = keeper_fmu.config(keeper_fmu.make(**macros), way)
    content = json.loads(config.read_text(encoding="utf-8"))
    content["components"]["keeper0"]["unconfined"] = unconfined
    if replay_steps is not None:
        content["components"]["keeper0"]["replay_steps"] = replay_steps
    config.write_text(json.dumps(content), encoding="utf-8")
    return config


def test_however_it_begins_anew():
    """By fmi2Reset, or freed and instantiated; with and without what is saved; and as by its memory."""
    ways = [keeper("replay", RESETS=1), keeper("replay", RESETS=2)] + ([] if SANITIZER else [keeper("memory", RESETS=1)])
    found = {steps_of(way, *options) for way in ways for options in ((), ("--plain",))}
    expect(len(found) == 1 and found.pop().count("\n") > 90, "other values by another way")


def test_what_no_copy_takes_back():
    """Its own thread, file, memory and child: found, told, and led back by replay, with the values of one that has none of them."""
    expected = steps_of(keeper("replay", RESETS=1))
    for macros, said in (({"THREAD": 2}, "a thread"), ({"FILE_OPEN": 2}, "keeper.txt"), ({"MAPPED": 2}, "memory elsewhere"), ({"CHILD": 2}, "a process")):
        for resets in 1, 2:
            config = keeper(None, unconfined="CHILD" in macros, RESETS=resets, **macros)
            expect(steps_of(config) == expected, f"{macros}: other values than without")
        code, out, err = run(["check", config])
        expect(code == 0 and "rolled back by replay" in out, f"{macros}: {code}\n{out}{err}")
        expect(SANITIZER or (said in err and "error:" not in err and "called replay" in err), f"{macros}: {err}")


def test_two_that_no_copy_takes_back():
    """Each is led back by replay, also if the other one is the first to be found."""
    fmu = keeper_fmu.make_false("parameters", OPENS=15)
    expected = steps_of(keeper_fmu.config(fmu, "replay", 2))
    config = keeper_fmu.config(fmu, components=2)
    expect(steps_of(config) == expected, "other values than by replay from the beginning")


def test_wrong_states():
    """Without a copy of its memory the own states of an FMU are followed by replay."""
    if not SANITIZER:
        raise Skip("it goes by its memory")
    config = keeper("auto", RESETS=1, OWN_STATE=1)
    code, out, err = run(["check", config])
    expect(code == 0 and "rolled back by replay" in out and "called replay" in err, f"{code}\n{out}{err}")
    expect(steps_of(config) == steps_of(keeper("replay", RESETS=1)), "other values than by replay from the beginning")


def test_what_does_not_begin_anew():
    """One that keeps something beyond its reset is found by the proof, as ever."""
    code, out, err = run(["replay", keeper("replay")])
    expect(code == FMU_FAILED and "is not the same after restoring" in err, f"{code}\n{out}{err}")


def test_its_end():
    """Locked as it is with more steps, and then free at nominal; told on the log, in the records, and by check."""
    config = keeper("replay", replay_steps=60, RESETS=1)
    steps, database = scratch() / "steps.csv", scratch() / "run.db"
    code, out, err = run(["replay", config, "--csv", steps, "--db", database, "--json"])
    told = json.loads(out)
    expect(code in (0, NOT_LOCKED) and "from t = 0.58 s on the twin runs free, with nominal u: keeper0 is rolled back by replay" in err, f"{code}\n{err}")
    expect(told["lock"]["state"] != "locked", f"{told['lock']}")
    longer = steps_of(keeper("replay", RESETS=1)).splitlines()
    found = steps.read_text(encoding="utf-8").splitlines()
    expect(len(found) == len(longer) and found[:59] == longer[:59] and found[59:] != longer[59:], "not as before its end, or as before after it")
    with closing(sqlite3.connect(database)) as opened:
        events = [text for text, in opened.execute("SELECT text FROM events WHERE source = 'twin'") if "runs free" in text]
        outcomes = opened.execute("SELECT step, outcome FROM v_steps WHERE outcome = 'free run' ORDER BY step").fetchall()
    expect(len(events) == 1 and "runs free from step 58" in events[0], f"{events}")
    expect([step for step, _ in outcomes] == list(range(58, 58 + len(outcomes))) and len(outcomes) > 30, f"{outcomes}")
    code, out, err = run(["check", config])
    expect(code == 0 and "within 60 steps of its beginning, 0.6 s of plant time, and runs free" in out, f"{code}\n{out}{err}")


def test_no_steps_between():
    code, out, err = run(["check", keeper("replay", replay_steps=0, RESETS=1)])
    expect(code == 65 and "replay_steps" in err, f"{code}\n{out}{err}")


def test_ours_are_the_same():
    """To the bit what they are by their own states, and so is every count of an execution; with an event horizon, too."""
    for name, duration in (("motor/lock.json", 2), ("cylinder/lock.json", 4)):
        components = read_config(name)["components"]
        changes = {"components": {component: {"rollback": "replay", "replay_steps": 3000} for component in components}}
        by_state, by_replay = (edited_config(name, {"duration_s": duration, **more}) for more in ({}, changes))
        expect(steps_of(by_replay) == steps_of(by_state), f"{name}: other values by replay")
        out = run_well(["check", by_replay])
        expect(("synchronise.free_twin: there is none" in out) == (name == "motor/lock.json"), out)
        ledgers = [json.loads(run(["replay", config, "--json"])[1])["ledger"] for config in (by_replay, by_state)]
        expect(ledgers[0] == ledgers[1], f"{name}: {ledgers}")
        replayed = [json.loads(run(["replay", config, "--json"])[1])["replayed"] for config in (by_replay, by_state)]
        expect(replayed[0] > 0 and replayed[1] == 0, f"{name}: {replayed}")


main()
