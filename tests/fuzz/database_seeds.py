#!/usr/bin/env python3
"""Makes the seeds of fuzz_database: a short replay of the motor bench, recorded, and what is left of it without views and on small
pages. Anew after a change of the format: TWINLOCK=build/host/bin/twinlock tests/fuzz/database_seeds.py"""
import json
import os
import sqlite3
import subprocess
import tempfile
from pathlib import Path

SOURCE = Path(__file__).resolve().parents[2]
SEEDS = SOURCE / "tests" / "fuzz" / "seeds" / "database"


def record(folder):
    config = json.loads((SOURCE / "config" / "motor" / "lock.json").read_text(encoding="utf-8"))
    config["duration_s"] = 0.1
    config["recording"]["file"] = str(SOURCE / "config" / "motor" / "recording.csv")
    path, database = folder / "seed.json", folder / "seed.db"
    path.write_text(json.dumps(config), encoding="utf-8")
    subprocess.run([os.environ["TWINLOCK"], "replay", path, "--db", database], check=True, stdout=subprocess.DEVNULL)
    return database


def shrink(database, seed, page, extra=""):
    """With all that only people read left out, and nothing of this machine."""
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "copy.db"
        copy.write_bytes(database.read_bytes())
        connection = sqlite3.connect(copy, isolation_level=None)
        for (view,) in connection.execute("SELECT name FROM sqlite_schema WHERE type = 'view'").fetchall():
            connection.execute(f"DROP VIEW {view}")
        connection.executescript(
            "UPDATE configurations SET text = '{}'; UPDATE beginnings SET boot = 'boot', fmus = 'fmus';"
            "UPDATE runs SET started = '2026-11-22T10:00:00.000Z', ended = '2026-11-22T10:00:01.000Z',"
            " committed = '2026-11-22T10:00:01.000Z', version = '1.0'; DELETE FROM events;"
            "INSERT INTO events (run, at, tick, severity, source, text)"
            " VALUES (1, '2026-11-22T10:00:00.500Z', 5, 1, 'cycle', 'late');"
            "UPDATE runs SET events_written = 1;"
            "INSERT INTO checkpoints VALUES (1, 4, 'format', 'hash', x'00010203');"
            f"DELETE FROM outcomes; DELETE FROM stops; DELETE FROM qualities; {extra}"
            f"PRAGMA journal_mode = DELETE; PRAGMA page_size = {page}; VACUUM;")
        connection.close()
        seed.write_bytes(copy.read_bytes())


def main():
    SEEDS.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        database = record(Path(folder))
        shrink(database, SEEDS / "small_pages.db", 512)
        shrink(database, SEEDS / "live.db", 512, "UPDATE runs SET verb = 'run', ended = NULL, ended_reason = NULL;")


if __name__ == "__main__":
    main()
