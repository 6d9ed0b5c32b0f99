#!/usr/bin/env python3
"""A database of format 5 is read as it is, and migrated by the next run that records into it; its rows keep every bit."""
import hashlib
import json
import sqlite3
import struct

from twinlock_test import BAD_DATA, SOURCE, edited_config, expect, expect_line, main, run, run_well, scratch

TEXT = (SOURCE / "tests" / "support" / "format_5.sql").read_text(encoding="utf-8")
TABLES = ("runs", "signals", "samples", "steps", "outputs", "adjustments", "components", "beginnings")
VIEW = "CREATE VIEW mine AS SELECT avg(delta) AS mean, max(u_hat) AS top FROM adjustments"


def made(version=5, extra=""):
    """A database of the recorder of format 5."""
    path = scratch() / "old.db"
    connection = sqlite3.connect(path)
    connection.executescript(f"PRAGMA journal_mode = WAL; PRAGMA application_id = 1953983595;{TEXT}{extra};PRAGMA user_version = {version}")
    connection.close()
    return path


def rows(path):
    """{table: rows of run 1}, with the bits of each number, without columns that are added."""
    connection = sqlite3.connect(path)
    found = {}
    for table in TABLES:
        cursor = connection.execute(f"SELECT * FROM {table} WHERE run = 1")
        kept = [i for i, column in enumerate(cursor.description) if column[0] not in ("start_s", "stop_s", "release_age", "released")]
        found[table] = [tuple(struct.pack("<d", row[i]) if isinstance(row[i], float) else row[i] for i in kept) for row in cursor]
    connection.close()
    return found


def shown(path):
    return [run_well(["show", path, "--csv", table]) for table in ("outputs", "adjustments", "steps", "samples")], json.loads(
        run_well(["show", path, "--json"]))


def test_it_is_read_as_it_is():
    path = made()
    before = hashlib.sha256(path.read_bytes()).digest()
    tables, told = shown(path)
    expect("motor.d applied,motor.d nominal,motor.d correction" in tables[1].splitlines()[0], tables[1][:200])
    expect(len(tables[0].splitlines()) == 22 and told["ledger"]["total"]["repeated"] == 0, f"{told['ledger']}")
    run_well(["show", path, "--report", scratch() / "report.html"])
    run_well(["replay", edited_config("motor/lock.json"), "--recording", path, "--run", "1"], wells=(0, 3))
    expect(hashlib.sha256(path.read_bytes()).digest() == before, "a reader has changed it")


def test_the_next_run_migrates_it():
    path = made(extra=VIEW)
    before, read = rows(path), shown(path)
    run_well(["replay", edited_config("motor/lock.json", {"duration_s": 0.1}), "--db", path], wells=(0, 3))
    connection = sqlite3.connect(path)
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    expect(version == 6, f"format {version}")
    simulated, measured, error = connection.execute("SELECT simulated, measured, error FROM outputs WHERE run = 1 AND step = 9").fetchone()
    applied, nominal, correction = connection.execute("SELECT applied, nominal, correction FROM v_corrections WHERE run = 1 AND step = 4").fetchone()
    expect(error == simulated - measured and correction == applied - nominal != 0, f"{error}, {correction}")
    expect(connection.execute("SELECT top FROM mine").fetchone() == (nominal,), "the user's own view is broken")
    expect(connection.execute("PRAGMA integrity_check").fetchone() == ("ok",), "integrity")
    connection.execute("DROP VIEW mine")
    fresh = scratch() / "fresh.db"
    run_well(["replay", edited_config("motor/lock.json", {"duration_s": 0.1}), "--db", fresh], wells=(0, 3))
    expect(schema(path) == schema(fresh), "another schema than that of a new database")
    expect(rows(path) == before, "rows of the earlier run have changed")
    again = [run_well(["show", path, "--run", "1", "--csv", table]) for table in ("outputs", "adjustments", "steps", "samples")]
    expect(again == read[0], "shown otherwise than before")


def schema(path):
    connection = sqlite3.connect(path)
    columns = {}
    for name, in connection.execute("SELECT name FROM sqlite_schema WHERE type IN ('table', 'view')").fetchall():
        columns[name] = connection.execute(f"SELECT name, type, pk, hidden FROM pragma_table_xinfo('{name}')").fetchall()
    connection.close()
    return columns


def test_a_table_that_cannot_be_migrated_stays():
    """Another program has renamed a column of format 5: the run is refused, and the file keeps all that it has."""
    path = made(extra="ALTER TABLE adjustments RENAME COLUMN u_hat TO mine")
    before = rows(path)
    code, _, err = run(["replay", edited_config("motor/lock.json", {"duration_s": 0.1}), "--db", path])
    expect(code == BAD_DATA and "u_hat" in err, f"{code}\n{err}")
    expect(rows(path) == before, "rows have changed")


def test_older_and_newer_formats_are_refused():
    for version in 4, 7:
        code, _, err = run(["show", made(version)])
        expect(code == BAD_DATA, f"{code}")
        expect_line(err, f"old.db|format {version}")


if __name__ == "__main__":
    main()
