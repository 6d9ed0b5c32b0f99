#!/usr/bin/env python3
"""A database of an earlier program lacks tables and columns: it is read as it is, and the next run that records into it adds them."""
import hashlib
import json
import sqlite3
import struct

from twinlock_test import BAD_DATA, edited_config, expect, expect_line, main, run, run_well, scratch

CONFIG = edited_config("motor/lock.json", {"duration_s": 0.3})
ADDED = {"periods": None, "findings": None, "learned": None, "runs": ("start_s", "stop_s"), "steps": ("release_age",), "outputs": ("released",)}
KEPT = ("runs", "signals", "samples", "steps", "outputs", "adjustments", "components", "beginnings")
SHOWN = ("outputs", "adjustments", "steps", "samples")


def recorded():
    path = scratch() / "run.db"
    run_well(["replay", CONFIG, "--db", path], wells=(0, 3))
    return path


def older(extra=""):
    """A database without all that later programs have added."""
    path = recorded()
    connection = sqlite3.connect(path)
    for name, in connection.execute("SELECT name FROM sqlite_schema WHERE type = 'view'").fetchall():
        connection.execute(f"DROP VIEW {name}")
    for table, columns in ADDED.items():
        for column in columns or ():
            connection.execute(f"ALTER TABLE {table} DROP COLUMN {column}")
        if columns is None:
            connection.execute(f"DROP TABLE {table}")
    connection.executescript(extra)
    connection.close()
    return path


def rows(path):
    """{table: rows of run 1}, with the bits of each number, without columns that are added."""
    connection = sqlite3.connect(path)
    found = {}
    for table in KEPT:
        cursor = connection.execute(f"SELECT * FROM {table} WHERE run = 1")
        kept = [i for i, column in enumerate(cursor.description) if column[0] not in (ADDED.get(table) or ())]
        found[table] = [tuple(struct.pack("<d", row[i]) if isinstance(row[i], float) else row[i] for i in kept) for row in cursor]
    connection.close()
    return found


def schema(path):
    connection = sqlite3.connect(path)
    columns = {}
    for name, in connection.execute("SELECT name FROM sqlite_schema WHERE type IN ('table', 'view')").fetchall():
        columns[name] = connection.execute(f"SELECT name, type, pk, hidden FROM pragma_table_xinfo('{name}')").fetchall()
    connection.close()
    return columns


def test_it_is_read_as_it_is():
    path = older()
    before = hashlib.sha256(path.read_bytes()).digest()
    for table in SHOWN:
        expect(len(run_well(["show", path, "--csv", table]).splitlines()) > 20, table)
    expect(len(run_well(["show", path, "--csv", "hours"]).splitlines()) == 1, "there are hours")
    expect(json.loads(run_well(["show", path, "--json"]))["ledger"]["total"]["executions"] > 20, "no ledger")
    run_well(["show", path, "--report", scratch() / "report.html"])
    run_well(["replay", CONFIG, "--recording", path, "--run", "1"], wells=(0, 3))
    expect(hashlib.sha256(path.read_bytes()).digest() == before, "a reader has changed it")


def test_the_next_run_adds_what_is_missing():
    path = older("CREATE VIEW mine AS SELECT avg(correction) AS mean, max(nominal) AS top FROM adjustments")
    before, shown = rows(path), [run_well(["show", path, "--csv", table]) for table in SHOWN]
    run_well(["replay", CONFIG, "--db", path], wells=(0, 3))
    connection = sqlite3.connect(path)
    (top,), (nominal,) = (connection.execute(f"SELECT {what}").fetchone() for what in ("top FROM mine", "max(nominal) FROM adjustments"))
    expect(top == nominal, "the user's own view is broken")
    expect(connection.execute("PRAGMA integrity_check").fetchone() == ("ok",), "integrity")
    connection.execute("DROP VIEW mine")
    expect(schema(path) == schema(recorded()), "another schema than that of a new database")
    expect(rows(path) == before, "rows of the earlier run have changed")
    again = [run_well(["show", path, "--run", "1", "--csv", table]) for table in SHOWN]
    expect(again == shown, "shown otherwise than before")


def test_another_schema_stays():
    """Another program has renamed a column: the run is refused, and the file keeps all that it has."""
    path = older("ALTER TABLE adjustments RENAME COLUMN nominal TO mine")
    before = rows(path)
    code, _, err = run(["replay", CONFIG, "--db", path])
    expect(code == BAD_DATA and "nominal" in err, f"{code}\n{err}")
    expect(rows(path) == before, "rows have changed")


def test_other_formats_are_refused():
    for version in 5, 7:
        path = older(f"PRAGMA user_version = {version}")
        code, _, err = run(["show", path])
        expect(code == BAD_DATA, f"{code}")
        expect_line(err, f"run.db|format {version}")


if __name__ == "__main__":
    main()
