#!/usr/bin/env python3
"""An output that grows beyond all measure is no lock, whenever it does so, and a replay of it does not end well; a u that stays at its bound is told."""
import json
import sqlite3
from contextlib import closing

import keeper_fmu
from twinlock_test import FMUS, NOT_LOCKED, expect, main, run, scratch, write_config


def replay(fmu, seconds, plant, *options, **limits):
    """(exit code, what --json told, events, stderr) of one that follows y = `plant`."""
    folder = scratch()
    (folder / "plant.csv").write_text("time,y\n" + "".join(f"{i / 100},{plant(i)}\n" for i in range(100 * seconds + 1)), encoding="utf-8")
    config = write_config({
        "twinlock": 1, "name": "runaway", "step_s": 0.01,
        "components": {"k": {"fmu": str(fmu)}},
        "plant": {"y": {"csv": {"column": "y"}}}, "recording": {"file": str(folder / "plant.csv")},
        "synchronise": {"adjust": {"k.u": {"step": 0.1, "nominal": 1, "min": -20, "max": 20, **limits}},
                        "match": {"k.y": {"to": "plant.y", "tolerance": 0.05}}}})
    code, out, err = run(["replay", config, "--json", "--db", folder / "run.db", *options])
    with closing(sqlite3.connect(folder / "run.db")) as connection:
        events = connection.execute("SELECT source, text FROM events ORDER BY event").fetchall()
    return code, json.loads(out) if out else None, events, err


def swings(i):
    return 0.5 + 0.3 * (i % 20) / 20


def test_at_the_end():
    """In the last two steps, too few for a window."""
    code, told, _, err = replay(keeper_fmu.make_runaway(AT=9.95, GROWTH=10), 10, swings)
    expect(code == NOT_LOCKED and "has run away" in err, f"{code}\n{err}")
    expect(told["lock"]["state"] == "lost" and told["lock"]["ran_away"] > 0, f"{told['lock']}")


def test_in_the_middle():
    """Its FMU begins anew, and is in lock again; but what it went through is told."""
    code, told, events, err = replay(keeper_fmu.make_runaway(AT=5, GROWTH=10), 9, swings)
    expect(code == NOT_LOCKED and told["lock"]["ran_away"] > 0 and told["lock"]["losses"] == 1, f"{code} {told['lock']}\n{err}")
    expect(any(source == "lock" and "has run away" in text for source, text in events), f"{events}")
    code, _, _, err = replay(keeper_fmu.make_runaway(AT=5, GROWTH=10), 9, swings, "--require-lock", "90")
    expect(code == 0, f"who says what is enough is asked for that\n{err}")


def test_not_at_all():
    code, told, _, err = replay(keeper_fmu.make_runaway(AT=1e9, GROWTH=10), 10, swings)
    expect(code == 0 and told["lock"]["ran_away"] == 0, f"{code} {told['lock']}\n{err}")


def test_at_a_bound():
    """y cannot get further than u may; for two minutes in a row."""
    _, _, events, _ = replay(FMUS / "lag.fmu", 180, lambda i: 3 if i < 12000 else 1, max=2)
    found = [text for source, text in events if source == "twin" and "k.u" in text]
    expect(len(found) == 2 and "was at a bound in 100 % of the last minute" in found[0] and "is off its bounds again" in found[1], f"{events}")


if __name__ == "__main__":
    main()
