#!/usr/bin/env python3
"""Trials that an FMU rejects, and outputs that are not finite for a while.

Search and run continue, and no FMU gets such a value.
"""
import json
import math
import sqlite3
from contextlib import closing

import keeper_fmu
from twinlock_test import FMUS, NOT_LOCKED, expect, expect_line, has_line, main, run, scratch, write_config

OK, DISCARD, ERROR = 0, 2, 3  # fmi2Status


def configure(fmu, plant, *, seconds=5, base=None, **adjust):
    """A twin that follows y = plant(t)."""
    folder = scratch()
    rows = [f"{i / 100},{plant(i / 100)}\n" for i in range(100 * seconds)]
    (folder / "plant.csv").write_text("time,y\n" + "".join(rows), encoding="utf-8")
    return write_config({
        "twinlock": 1, "name": "limits", "step_s": 0.01,
        "components": {"k": {"fmu": str(fmu)}},
        "plant": {"y": {"csv": {"column": "y"}}}, "recording": {"file": str(folder / "plant.csv")},
        "synchronise": {"adjust": {"k.u": {"step": 6, "nominal": 0, "min": -100, "max": 100, **adjust}},
                        "match": {"k.y": {"to": "plant.y", "tolerance": 0.05}}}, **(base or {})})


def replay(config, *options):
    """(exit code, output of --json, database, log)."""
    database = scratch() / "run.db"
    code, out, err = run(["replay", config, "--json", "--db", database, *options])
    return code, json.loads(out) if out else None, database, err


def query(database, text):
    with closing(sqlite3.connect(database)) as connection:
        return connection.execute(text).fetchall()


def rises(t):
    return 3.5 * (1 - math.exp(-t))


def test_refused_trials():
    """The plant needs 3.5, the FMU rejects more than 4, and the first step of the search is 6."""
    for status in (DISCARD, ERROR, OK):
        code, told, database, err = replay(configure(keeper_fmu.make_limits(LIMIT=4, REFUSES=status), rises))
        expect(code == 0 and told["lock"]["percent"] == 100, f"{status}: {code} {told}\n{err}")
        expect(0 < told["refused_steps"] <= told["refused_trials"] < 20, f"{status}: {told}")
        events = [text for text, in query(database, "SELECT text FROM events") if has_line(text, "k.u = 6|trial")]
        expect(len(events) == 1 and has_line(events[0], "max|k.u"), f"{status}: {events}")
        (flagged,), = query(database, "SELECT count(*) FROM v_steps WHERE flags LIKE '%refused%'")
        expect(flagged == told["refused_steps"], f"{flagged} {told}")
        code, out, err = run(["show", database, "--json"])
        expect(code == 0 and json.loads(out)["refused_steps"] == flagged, f"{out}{err}")
        code, out, err = run(["show", database])
        expect_line(out, f"refused in {flagged} of them")


def test_refused_on_both_sides():
    """Only search steps below 1 are possible in either direction."""
    code, told, _, err = replay(
        configure(keeper_fmu.make_limits(LIMIT=0.9, REFUSES=DISCARD), lambda t: 0.8 * (1 - math.exp(-t)), min=0))
    expect(code == 0 and told["lock"]["percent"] == 100, f"{code} {told}\n{err}")


def test_nothing_refused():
    code, told, _, err = replay(configure(keeper_fmu.make_limits(), rises))
    expect(code == 0 and told["refused_trials"] == 0 and told["refused_steps"] == 0, f"{code} {told}\n{err}")


def test_refused_in_the_table():
    code, out, err = run(["replay", configure(keeper_fmu.make_limits(LIMIT=4, REFUSES=DISCARD), rises), "--verbose"])
    expect(code == 0, err)
    expect_line(out, "refused|trials|steps")


def swings(t):
    return 2 * math.sin(t)


def events_of(database):
    return query(database, "SELECT tick, source, text FROM events ORDER BY event")


def test_not_finite_for_a_moment():
    """Four steps: no value in the database, left out of the errors, reported once, and still in lock."""
    code, told, database, err = replay(configure(keeper_fmu.make_limits(NAN_FROM=2.005, NAN_TO=2.045), swings))
    expect(code == 0 and told["lock"]["percent"] == 100, f"{code} {told}\n{err}")
    expect(told["match"]["k.y"]["left_out"] == 4 and told["match"]["k.y"]["max"] < 0.05, f"{told['match']}")
    steps = query(database, "SELECT step FROM outputs WHERE simulated IS NULL AND measured IS NOT NULL")
    expect(steps == [(200,), (201,), (202,), (203,)], f"{steps}")
    expect(query(database, "SELECT step FROM v_steps WHERE flags LIKE '%not finite%'") == steps, "flags")
    found = [text for _, source, text in events_of(database) if "k.y" in text and source != "lock"]
    expect(len(found) == 1 and has_line(found[0], "finite|2 s|2.01 s"), f"{found}")
    code, again, _, err = replay(configure(keeper_fmu.make_limits(NAN_FROM=2.005, NAN_TO=2.045), swings), "--recording", database)
    expect(code == 0 and again["match"] == told["match"] and again["adjust"] == told["adjust"], f"{code} {again}\n{err}")


def test_reset_after_ten_steps():
    """The FMU's own time restarts with each reset. A replay of the run resets at the same steps."""
    config = configure(keeper_fmu.make_limits(NAN_FROM=2.005, NAN_TO=2.305), swings)
    _, _, database, err = replay(config)
    resets = query(database, "SELECT step FROM v_steps WHERE flags LIKE '%reset%'")
    expect(resets == [(210,), (420,)], f"{resets}\n{err}")
    expect(any(source == "lock" and has_line(text, "reset|210|finite|10 steps") for _, source, text in events_of(database)), f"{events_of(database)}")
    _, _, again, _ = replay(config, "--recording", database)
    expect(query(again, "SELECT step, simulated FROM outputs") == query(database, "SELECT step, simulated FROM outputs"), "the replay differs")


def chain(fmu, **saving):
    """The output that is not finite for a while drives a second FMU with a matched output."""
    return configure(fmu, swings, base={
        "components": {"k": {"fmu": str(fmu)}, "next": {"fmu": str(FMUS / "lag.fmu"), "set": {"T": 0.05}}},
        "connect": [["k.y", "next.u"]],
        "synchronise": {"adjust": {"k.u": {"step": 1, "nominal": 0, "min": -100, "max": 100}},
                        "match": {"next.y": {"to": "plant.y", "tolerance": 0.05}}, "horizon": {"prediction": 4}, **saving}})


def test_never_handed_on():
    """The second FMU keeps its input; saved executions change nothing, also if a trial makes the output bad."""
    for limits in ({"NAN_FROM": 2.005, "NAN_TO": 2.085}, {"LIMIT": 1.5}):
        fmu = keeper_fmu.make_limits(**limits)
        results = []
        for saving in ({}, {"saving": {"structure": False, "sequences": False}}):
            code, told, database, err = replay(chain(fmu, **saving))
            expect(code == 0 and told["verified"]["differed"] == 0, f"{code} {told}\n{err}")
            expect(any(has_line(text, "k.y|finite|keep") for _, _, text in events_of(database)), f"{events_of(database)}")
            expect(query(database, "SELECT count(*) FROM outputs WHERE simulated IS NULL") == [(0,)], "next.y")
            results.append(query(database, "SELECT o.step, simulated, applied FROM outputs o JOIN adjustments a ON o.step = a.step"))
        expect(results[0] == results[1], f"{limits}: saved executions differ")


def test_one_of_two_outputs():
    """J leaves out the output that is not finite; the other one keeps the twin in lock."""
    def add(text):
        return text | {"match": text["match"] | {"k.y": {"to": "plant.y", "tolerance": 0.5}}}
    path = chain(keeper_fmu.make_limits(NAN_FROM=2.005, NAN_TO=2.045))
    config = json.loads(path.read_text(encoding="utf-8"))
    config["synchronise"] = add(config["synchronise"])
    code, told, database, err = replay(write_config(config))
    expect(code == 0 and told["lock"]["percent"] == 100, f"{code} {told}\n{err}")
    expect(told["match"]["k.y"]["left_out"] == 4 and told["match"]["next.y"]["left_out"] == 0, f"{told['match']}")
    objectives = query(database, "SELECT count(*) FROM steps WHERE J IS NULL AND step BETWEEN 200 AND 203")
    expect(objectives == [(0,)], f"{objectives}")


def test_check_names_the_output():
    for limits, step in ({"NAN_FROM": -1, "NAN_TO": 0.005}, 0), ({"NAN_FROM": 0.095}, 9):
        config = configure(keeper_fmu.make_limits(**limits), swings)
        code, out, err = run(["check", config])
        text = " ".join(out.split())
        expect(code == 0 and has_line(text, f"k.y: not finite|step {step} |1 warning"), f"{code}\n{out}{err}")
        expect("initial\"" not in text, f"{out}")
        code, told, database, err = replay(config, "--require-lock", "0.1") if step == 0 else (0, None, None, "")
        expect(code == 0, err)


def test_never_finite():
    code, _, database, err = replay(configure(keeper_fmu.make_limits(NAN_FROM=-1), swings))
    expect(code == NOT_LOCKED, f"{code}\n{err}")
    expect_line(err, "error|never in lock")
    expect(query(database, "SELECT count(*) FROM outputs WHERE simulated IS NOT NULL") == [(0,)], "values")


if __name__ == "__main__":
    main()
