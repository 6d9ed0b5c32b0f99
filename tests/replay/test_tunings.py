#!/usr/bin/env python3
"""Tunings in a database: a replay with the run's own configuration applies them at their ticks, another one does not.

If a tuning cannot be applied, the replay ends with a message."""
import hashlib
import json
import sqlite3
from contextlib import closing
from pathlib import Path

from live_test import bits, query
from twinlock_test import PLAIN_LOCK, edited_config, expect, expect_line, main, run, run_well, scratch

STEPS = "SELECT step, applied, nominal, simulated, J, outcome, evaluations FROM adjustments JOIN outputs USING (run, step, signal) JOIN steps USING (run, step) WHERE run = 1 ORDER BY step"
AT = 300


def recorded():
    """(configuration, database with its replay)."""
    config = edited_config(PLAIN_LOCK, {"duration_s": 6})
    database = scratch() / "run.db"
    run_well(["replay", config, "--db", database])
    return config, database


def text_of(config, **match):
    document = json.loads(config.read_text(encoding="utf-8"))
    document["synchronise"]["match"]["motor.omega"].update(match)
    document["synchronise"]["adjust"]["motor.d"]["nominal"] = 0.05
    return json.dumps(document)


def hash_of(text):
    return hashlib.sha256(text.encode()).hexdigest()


def take(database, tick, text):
    name = hash_of(text)
    with closing(sqlite3.connect(database)) as file, file:
        file.execute("INSERT OR IGNORE INTO configurations VALUES (?, ?)", (name, text))
        file.execute("INSERT INTO tunings VALUES (1, ?, ?, '2026-11-23T10:00:00.000Z', 'ann', 'test', 'why')", (tick, name))


def replay(config, database, *options):
    again = scratch() / "again.db"
    told = json.loads(run_well(["replay", config, "--recording", database, "--db", again, "--json", *options], wells=(0, 3)))
    return told, again


def delete(database, table, where):
    with closing(sqlite3.connect(database)) as file, file:
        file.execute(f"DELETE FROM {table} WHERE {where}")


def expect_refused(config, database, parts):
    code, out, err = run(["replay", config, "--recording", database])
    expect(code == 65, f"ended with {code}: {out}{err}")
    expect_line(err, f"error|{database}|{parts}")


def test_followed():
    config, database = recorded()
    plain, untouched = replay(config, database)
    expect("tunings" not in plain, f"{plain}")
    take(database, AT, text_of(config, tolerance=0.3))
    take(database, AT + 100, config.read_text(encoding="utf-8"))
    told, again = replay(config, database)
    expect(told["tunings"] == {"recorded": 2, "applied": 2}, f"{told['tunings']}")
    before, after = query(untouched, STEPS), query(again, STEPS)
    # Step i is computed at tick i + 1.
    expect([bits(row) for row in before[:AT - 1]] == [bits(row) for row in after[:AT - 1]], "another step before the tick")
    nominal = [row[0] for row in after if row[2] == 0.05]
    expect(nominal == list(range(AT - 1, AT + 99)), f"nominal from {nominal[:1]} to {nominal[-1:]}")
    within = max(abs(row[3] - measured) for row, (measured,) in zip(after, query(again, "SELECT measured FROM outputs ORDER BY step")) if AT <= row[0] < AT + 99)
    expect(within <= 0.3, f"off by {within} with a tolerance of 0.3")
    rows = "SELECT tick, configuration, at, who, origin, why FROM tunings ORDER BY tick"
    expect(query(again, rows) == query(database, rows), "the replay recorded other tunings")
    told = query(again, "SELECT tick, text FROM events WHERE source = 'retune' ORDER BY event")
    expect([tick for tick, _ in told] == [AT, AT + 100], f"{told}")
    third = replay(config, again)[1]
    expect([bits(row) for row in query(third, STEPS)] == [bits(row) for row in after], "the replay of the replay differs")


def test_not_followed_with_another_configuration():
    config, database = recorded()
    other = config.parent / "other.json"
    other.write_text(text_of(config, tolerance=0.5), encoding="utf-8")
    before = replay(other, database)[1]
    take(database, AT, text_of(config, tolerance=0.3))
    told, again = replay(other, database)
    expect(told["tunings"] == {"recorded": 1, "applied": 0}, f"{told['tunings']}")
    expect([bits(row) for row in query(before, STEPS)] == [bits(row) for row in query(again, STEPS)], "it was followed")
    expect(query(again, "SELECT count(*) FROM tunings") == [(0,)], "it was recorded")


def test_tunings_that_cannot_be_applied():
    config, database = recorded()
    copy = Path(database.parent / "copy.db")

    def with_text(text):
        copy.write_bytes(database.read_bytes())
        take(copy, AT, text)
        return copy
    for text in "no JSON", text_of(config, weight=0.0, to="plant.omega"):
        expect_refused(config, with_text(text), f"run 1|{hash_of(text)[:12]}|tick 300|text")
    document = json.loads(text_of(config))
    document["synchronise"]["match"]["motor.i"] = {"to": "plant.torque", "tolerance": 1}
    text = json.dumps(document)
    expect_refused(config, with_text(text), f"run 1|{hash_of(text)[:12]}|tick 300|2 matches|1 adjusted")
    text = text_of(config, tolerance=0.25)
    take(copy, AT + 1, text)
    delete(copy, "tunings", f"tick = {AT}")
    delete(copy, "configurations", f"hash = '{hash_of(text)}'")
    expect_refused(config, copy, f"{hash_of(text)[:12]}|missing")
    copy.write_bytes(database.read_bytes())
    with closing(sqlite3.connect(copy)) as file, file:
        name = query(copy, "SELECT hash FROM configurations")[0][0]
        file.executemany("INSERT INTO tunings VALUES (1, ?, ?, '2026-11-23T10:00:00.000Z', '', '', '')", ((tick, name) for tick in range(4097)))
    expect_refused(config, copy, "run 1|4097|4096")
    delete(copy, "tunings", "tick = 0")
    run_well(["replay", config, "--recording", copy])


if __name__ == "__main__":
    main()
