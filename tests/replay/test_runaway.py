#!/usr/bin/env python3
"""An output that grows without limit ends the lock, and the replay ends with 3. A u that stays at its bound is logged."""
import json
import sqlite3
from contextlib import closing

import keeper_fmu
from twinlock_test import FMUS, NOT_LOCKED, expect, expect_line, has_line, main, run, scratch, write_config


def replay(fmu, seconds, plant, *options, **limits):
    """(exit code, output of --json, events, log) of a twin that follows y = plant(i) at tick i."""
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
    """In the last steps, which are fewer than a window of the lock monitor."""
    code, told, _, err = replay(keeper_fmu.make_runaway(AT=9.95, GROWTH=10), 10, swings)
    expect(code == NOT_LOCKED, f"{code}\n{err}")
    expect_line(err, f"error|output|{told['lock']['ran_away']} steps")
    expect(told["lock"]["state"] == "lost" and told["lock"]["ran_away"] > 0, f"{told['lock']}")


def test_in_the_middle():
    """The FMU is reset, and the twin is in lock again; the end result still counts the steps."""
    code, told, events, err = replay(keeper_fmu.make_runaway(AT=5, GROWTH=10), 9, swings)
    expect(code == NOT_LOCKED and told["lock"]["ran_away"] > 0 and told["lock"]["losses"] == 1, f"{code} {told['lock']}\n{err}")
    expect(any(source == "lock" and has_line(text, "lost|output|1e+09 tolerances") for source, text in events), f"{events}")
    code, _, _, err = replay(keeper_fmu.make_runaway(AT=5, GROWTH=10), 9, swings, "--require-lock", "90")
    expect(code == 0, f"--require-lock sets another criterion\n{err}")


def test_not_at_all():
    code, told, _, err = replay(keeper_fmu.make_runaway(AT=1e9, GROWTH=10), 10, swings)
    expect(code == 0 and told["lock"]["ran_away"] == 0, f"{code} {told['lock']}\n{err}")


def test_at_a_bound():
    """For two minutes y cannot reach the plant because of the bound of u."""
    _, _, events, _ = replay(FMUS / "lag.fmu", 180, lambda i: 3 if i < 12000 else 1, max=2)
    found = [text for source, text in events if source == "twin" and "k.u" in text]
    expect(len(found) == 2 and has_line(found[0], "k.u|bound|100 %") and has_line(found[1], "k.u|bound|20 %"), f"{events}")


if __name__ == "__main__":
    main()
