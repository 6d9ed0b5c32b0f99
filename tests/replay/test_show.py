#!/usr/bin/env python3
"""A recorded replay, its output by `show`, and its replay from the database.

Compares `show` with `replay`, and with the database by Python's SQLite."""
import csv
import json
import math
import re
import sqlite3
import subprocess

from twinlock_test import (PLAIN_LOCK, PROGRAM, SOURCE, edited_config, expect, expect_line, has_line, main, read_table, replay_csv, replay_json, run,
                           run_well, scratch)

CONFIG = PLAIN_LOCK
SAME = ("steps", "optimised_steps", "evaluations", "time_limited", "outcomes")


def recorded():
    """(database, output of `replay --json`)."""
    database = scratch() / "run.db"
    return database, replay_json(CONFIG, "--db", database)


def show_json(database, *options):
    return json.loads(run_well(["show", database, "--json", *options]))


def write(folder, text):
    path = folder / "table.csv"
    path.write_text(text, encoding="utf-8")
    return path


def expect_same_numbers(shown, told):
    """Each number of a match or an adjusted variable has the same bits in both."""
    for kind in ("match", "adjust"):
        expect(sorted(shown[kind]) == sorted(told[kind]), f"{kind}: {sorted(shown[kind])}")
        for name, numbers in told[kind].items():
            for key, value in numbers.items():
                expect(shown[kind][name][key] == value, f"{name} {key}: {shown[kind][name][key]!r}, not {value!r}")


def test_show_has_the_numbers_of_replay():
    database, told = recorded()
    shown = show_json(database)
    for key in SAME:
        expect(shown[key] == told[key], f"{key}: {shown[key]}, not {told[key]}")
    expect_same_numbers(shown, told)
    for part in "components", "total":
        expect(shown["ledger"][part] == told["ledger"][part], f"the ledger's {part}: {shown['ledger'][part]}")
    last = shown["runs"][-1]
    expect(last["ended_reason"] == "end of recording" and last["lost"] == 0, f"{last}")


def events(database):
    return [(event["tick"], event["severity"], event["source"], event["text"])
            for event in show_json(database, "--events")["events"]]


def test_events_of_a_replay():
    """omega is not a number for a while. The events have the ticks of the samples, not those of the steps three ticks before.

    The replay of the database has the same events."""
    lines = (SOURCE / "config" / "motor" / "recording.csv").read_text(encoding="utf-8").splitlines()
    column = lines[0].split(",").index("omega")
    for i in range(101, 151):
        cells = lines[i].split(",")
        cells[column] = "x"
        lines[i] = ",".join(cells)
    broken, database, again = write(scratch(), "\n".join(lines) + "\n"), scratch() / "a.db", scratch() / "b.db"
    config = edited_config(CONFIG, {"synchronise": {"horizon": {"prediction": 3}}})
    run_well(["replay", config, "--recording", broken, "--db", database])
    told = events(database)
    with sqlite3.connect(database) as connection:
        (first, last), = connection.execute("SELECT min(tick), max(tick) FROM v_samples WHERE quality <> 'good' AND"
                                            " name = 'plant.omega'")
    wanted = [(102, "info", "lock", "locked"), (302, "warning", "lock", "locked, but motor.omega|off without corrections since t = 1.5 s"),
              (first, "warning", "plant", "plant.omega|not a number"), (first + 2, "warning", "twin", "matched"),
              (382, "warning", "lock", "free|54 %"), (last + 1, "info", "plant", "plant.omega"), (last + 1, "info", "twin", "matched"),
              (572, "info", "lock", "locked, but|since t = 1.5 s"),
              (722, "info", "lock", "locked, but|since t = 1.5 s")]
    expect([event[:3] for event in told] == [event[:3] for event in wanted], f"{first} to {last}: {told}")
    expect(all(has_line(event[3], one[3]) for event, one in zip(told, wanted)), f"{told}")
    run_well(["replay", config, "--recording", database, "--db", again])
    expect(events(again) == told, f"{events(again)}, not {told}")


def test_windows_are_those_of_the_database():
    database, told = recorded()
    name, numbers = next(iter(show_json(database)["adjust"].items()))
    windows = numbers["windows"]
    expect(len(windows) == 8 and sum(window["steps"] for window in windows) == told["steps"], f"{windows}")
    ends = [window["from_step"] for window in windows[1:]] + [told["steps"]]
    with sqlite3.connect(database) as connection:
        for window, end in zip(windows, ends):
            (mean, count), = connection.execute(
                "SELECT avg(correction), count(*) FROM adjustments JOIN signals USING (run, signal)"
                " WHERE kind = 'adjust' AND name = ? AND step >= ? AND step < ?", (name, window["from_step"], end))
            expect(count == window["steps"], f"{window}: {count} steps")
            expect(math.isclose(mean, window["correction_mean"], rel_tol=1e-9, abs_tol=1e-15), f"{window}: {mean}")


def test_a_recorded_run_replays_to_the_same_bits():
    database, told = recorded()
    again = replay_json(CONFIG, "--recording", database)
    for key in (*SAME, "executions", "match", "adjust"):
        expect(again[key] == told[key], f"{key}: {again[key]}, not {told[key]}")


def test_samples_as_csv_replay_to_the_same_bits():
    database, told = recorded()
    path = write(scratch(), run_well(["show", database, "--csv", "samples"]))
    as_exported = {"csv": {"column": None}}
    config = edited_config(CONFIG, {"recording": {"time_column": None},
                                    "plant": {"torque": as_exported, "omega": as_exported}})
    again = replay_json(config, "--recording", path)
    expect(again["adjust"] == told["adjust"], f"{again['adjust']}, not {told['adjust']}")
    for name, numbers in told["match"].items():
        for key in {*numbers} - {"mse_readings", "readings"}:  # samples are not readings
            expect(again["match"][name][key] == numbers[key], f"{name} {key}: {again['match'][name]}, not {numbers}")


def test_tables_are_those_of_replay():
    database, _ = recorded()
    steps = replay_csv(CONFIG)
    outputs = read_table(write(scratch(), run_well(["show", database, "--csv", "outputs"])))
    adjustments = read_table(write(scratch(), run_well(["show", database, "--csv", "adjustments"])))
    for table in (outputs, adjustments):
        for name in set(table) & set(steps) - {"time"}:
            expect(table[name] == steps[name], f"{name} differs")
    expect("motor.omega" in outputs and "motor.d nominal" in adjustments, f"{list(outputs)} {list(adjustments)}")
    expect(all(math.isclose(a, b) for a, b in zip(outputs["time"], steps["time"])), "time differs")


def test_page():
    database, told = recorded()
    page = run_well(["show", database])
    for parts in ("motor.omega", "motor.d", "end of recording", f"{told['steps']}|0.01 s"):
        expect_line(page, parts)
    expect("\x1b" not in page and page.isascii(), f"not for a pipe:\n{page}")
    expect(page == run_well(["show", database, "--run", "1"]), "the last run is not run 1")


PERIODS = "time run kind name unit count mean least largest spread".split()


def test_minutes_and_hours():
    """The tables are those of the views. The hours of this short run are those of its rows."""
    database, told = recorded()
    with sqlite3.connect(database) as connection:
        for table in ("minutes", "hours"):
            rows = list(csv.reader(run_well(["show", database, "--csv", table]).splitlines()))
            expect(rows[0] == PERIODS, f"{rows[0]}")
            wanted = connection.execute(f"SELECT time_s, run, kind, name, unit, count, mean, least, largest, spread FROM v_{table}")
            wanted = [["" if value is None else value for value in row] for row in wanted]
            found = [[type(value)(cell) for cell, value in zip(row, wanted_row)] for row, wanted_row in zip(rows[1:], wanted)]
            expect(found == wanted and len(rows) == len(wanted) + 1 > 5, f"{table}: {rows}")
        (mean, least, count), = connection.execute("SELECT avg(correction), min(correction), count(*) FROM adjustments")
        (hour,) = connection.execute("SELECT mean, least, count FROM v_hours WHERE kind = 'adjust'")
        expect(math.isclose(mean, hour[0], rel_tol=1e-9) and (least, count) == hour[1:], f"{hour}: {mean}, {least}, {count}")
        steps, = connection.execute("SELECT sum(count) FROM v_minutes WHERE kind = 'outcome'").fetchone()
        expect(steps == told["steps"], f"{steps} steps")


def test_corrections_outlive_their_steps():
    """Hours before the first step are on the page and in the report."""
    database, _ = recorded()
    with sqlite3.connect(database) as connection:
        connection.executescript("""
            UPDATE steps SET step = step + 40000000;
            UPDATE outputs SET step = step + 40000000;
            UPDATE adjustments SET step = step + 40000000;
            DELETE FROM periods;
            INSERT INTO periods SELECT 3600, 1, value, 'adjust', 0, 10, value, value - 1, value + 1, 0.5
              FROM json_each('[0, 1, 2, 3, 5, 8, 60]');""")
    page = run_well(["show", database])
    expect_line(page, "motor.d: correction from|+60")
    report = scratch() / "report.html"
    run_well(["show", database, "--report", report])
    data = json.loads(re.search(r'id="data">(.*?)</script>', report.read_text(encoding="utf-8"), re.S)[1])
    trend = data["adjust"][0]["trend"]
    wanted = [[hour - 0.5, hour, hour + 0.5] if hour in (0, 1, 2, 3, 5, 8, 60) else [None] * 3 for hour in range(61)]
    expect(trend == wanted and data["trend"] == {"from": 0, "width": 3600000}, f"{data['trend']}, {trend}")


def test_the_newest_part_of_a_long_run():
    """Of more than two million rows only the newest steps are shown, unless a time is given."""
    database, _ = recorded()
    with sqlite3.connect(database) as connection:
        first, = connection.execute("SELECT max(step) + 1 FROM steps").fetchone()
        connection.execute("""
            WITH RECURSIVE more (step) AS (SELECT max(step) + 1 FROM steps UNION ALL SELECT step + 1 FROM more LIMIT 1000000)
            INSERT INTO steps SELECT 1, more.step, 10000000 * (more.step + 1), outcome, stop, J, J_nominal, evaluations, executions,
              used_ns, predicted, flags, held, release_age FROM more, steps s WHERE s.run = 1 AND s.step = 100""")
    last = first + 999999
    shown = show_json(database)
    matches, adjusts = len(shown["match"]), len(shown["adjust"])
    expect(shown["first_step"] == last + 1 - 2000000 // (1 + matches + adjusts), f"{shown['first_step']} to {shown['last_step']}")
    expect_line(run_well(["show", database]), f"since step {shown['first_step']}|--since")
    expect(show_json(database, "--since", "30d")["first_step"] == 0, "not all is shown")


def test_a_pager_does_not_pause_the_recorder():
    """While its output is not read, no transaction is open that keeps the recorder from writing its log back."""
    database, _ = recorded()
    connection = sqlite3.connect(database, isolation_level=None)
    connection.execute("PRAGMA journal_mode = WAL")
    run = connection.execute("SELECT run FROM runs").fetchone()[0]
    rows = [(run, "2026-11-30T00:00:00.000Z", "x" * 300)] * 5000
    connection.execute("BEGIN")
    connection.executemany("INSERT INTO events (run, at, severity, source, text) VALUES (?, ?, 0, 'test', ?)", rows)
    connection.execute("COMMIT")
    for options, least in (("--csv", "samples"), 1), (("--csv", "outputs"), 1), (("--csv", "events"), 5000), (("--events",), 5000):
        show = subprocess.Popen([PROGRAM, "show", database, *options], stdout=subprocess.PIPE, text=True)
        show.stdout.read(1)  # it has begun, and now waits for its reader
        connection.execute("UPDATE events SET text = text || 'y' WHERE text LIKE 'x%'")
        busy, _, _ = connection.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()
        expect(show.poll() is None, f"{options}: its output fits into a pipe")
        expect(busy == 0, f"{options}: the log cannot be written back")
        lines = show.stdout.read().count("\n")
        expect(show.wait() == 0 and lines > least, f"{options}: {lines} lines, exit code {show.returncode}")
    connection.close()


def test_exit_codes():
    database, _ = recorded()
    other = scratch() / "other.db"
    with sqlite3.connect(other) as connection:
        connection.execute("CREATE TABLE mine (x)")
    for wanted, args in ((2, []), (2, [database, "--csv", "everything"]), (65, [other]), (65, [scratch() / "none.db"]),
                         (65, [database, "--run", "9"]), (2, [database, "--since", "2026-11-21"])):
        code, out, err = run(["show", *args])
        expect(code == wanted and not out and err, f"show {args}: {code}, {out!r}, {err!r}")


main()
