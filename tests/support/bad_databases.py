"""Faults of a database that tests cause during a run, and the files beside it."""
import os
import shutil
import sqlite3
from contextlib import closing

from live_test import MADE_UP, query
from twinlock_test import scratch

FOREIGN = b"time,omega\n0,1\n"


# ---- files beside it ----

def beside(path):
    return path.with_name(path.name + ".beside")


def aside(path, number=1):
    return path.with_name(f"{path.name}.damaged-{number}")


def log_of(path):
    return path.with_name(path.name + "-wal")


def names(path):
    """Returns the names of the database and the files beside it, without those of SQLite."""
    return sorted(entry.name for entry in path.parent.iterdir() if entry.name.startswith(path.name) and not entry.name.endswith(("-shm", "-wal")))


# ---- faults ----

def spoil(path, at, end=None):
    """Overwrites the bytes from `at` to `end`; None: end of the file."""
    with open(path, "r+b") as file:
        size = file.seek(0, os.SEEK_END) if end is None else end
        file.seek(at)
        file.write(b"\xa5" * (size - at))


def halve(path):
    os.truncate(path, os.path.getsize(path) // 2 // 4096 * 4096)


def execute(path, *statements):
    with closing(sqlite3.connect(path, timeout=10, isolation_level=None)) as connection:
        for statement in statements:
            connection.execute(statement).fetchall()


def hold(path):
    """Locks the database as another program would."""
    connection = sqlite3.connect(path, timeout=10, isolation_level=None)
    connection.execute("BEGIN EXCLUSIVE")
    return connection


def let_go(connection):
    connection.execute("ROLLBACK")
    connection.close()


def replace(path, content):
    """Replaces the file by another one of the same owner."""
    owner, other = path.stat(), path.with_suffix(".other")
    other.write_bytes(content)
    os.chown(other, owner.st_uid, owner.st_gid)
    other.rename(path)


def remove_all(path):
    for name in path.parent.glob(path.name + "*"):
        name.unlink()


# ---- content ----

def steps_in(database):
    """Returns the number of computed steps; 0 if the file is not a database."""
    try:
        return query(database, "SELECT count(*) FROM steps WHERE outcome <> ?", MADE_UP)[0][0]
    except sqlite3.Error:
        return 0


def copied(folder, name, into=None):
    """Copies a database and returns the path of the copy. SQLite cannot open a path inside another process's mount namespace."""
    copy = (into or scratch()) / name
    for end in "", "-wal":
        try:
            shutil.copy(f"{folder}/{name}{end}", f"{copy}{end}")
        except FileNotFoundError:
            copy.with_name(copy.name + end).unlink(missing_ok=True)
    return copy
