#!/usr/bin/env python3
"""Trials that an FMU refuses, and outputs that are not finite for a while: the search, the other FMUs and the run go on."""
import json
import math
import sqlite3
from contextlib import closing

import keeper_fmu
from twinlock_test import expect, expect_line, has_line, main, run, scratch, write_config

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
    """The plant needs 3.5, the FMU refuses more than 4, and the first step of the search is 6."""
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
    """Only steps of the search below one are possible in either direction."""
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


if __name__ == "__main__":
    main()
