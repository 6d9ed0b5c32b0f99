"""What can be wrong with a database, for tests that do it to a run, and what is beside one then."""
import os
import shutil
import sqlite3
from contextlib import closing

from live_test import MADE_UP, query
from twinlock_test import scratch

FOREIGN = b"time,omega\n0,1\n"


# ---- what is beside it ----

def beside(path):
    return path.with_name(path.name + ".beside")


def aside(path, number=1):
    return path.with_name(f"{path.name}.damaged-{number}")


def log_of(path):
    return path.with_name(path.name + "-wal")


def names(path):
    """What there is of a database's; not SQLite's."""
    return sorted(entry.name for entry in path.parent.iterdir() if entry.name.startswith(path.name) and not entry.name.endswith(("-shm", "-wal")))


# ---- what is done to it ----

def spoil(path, at, end=None):
    """Bytes that no page has, up to the end."""
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
    """Another program has it for itself."""
    connection = sqlite3.connect(path, timeout=10, isolation_level=None)
    connection.execute("BEGIN EXCLUSIVE")
    return connection


def let_go(connection):
    connection.execute("ROLLBACK")
    connection.close()


def replace(path, content):
    """Under its name there is another file of the same owner."""
    owner, other = path.stat(), path.with_suffix(".other")
    other.write_bytes(content)
    os.chown(other, owner.st_uid, owner.st_gid)
    other.rename(path)


def remove_all(path):
    for name in path.parent.glob(path.name + "*"):
        name.unlink()


# ---- what is in it ----

def steps_in(database):
    """At their own tick; it may be no database yet."""
    try:
        return query(database, "SELECT count(*) FROM steps WHERE outcome <> ?", MADE_UP)[0][0]
    except sqlite3.Error:
        return 0


def copied(folder, name, into=None):
    """A copy of a database that SQLite had better not read in its place: in a file system that other processes have for themselves it would take its
    path for another one."""
    copy = (into or scratch()) / name
    for end in "", "-wal":
        try:
            shutil.copy(f"{folder}/{name}{end}", f"{copy}{end}")
        except FileNotFoundError:
            copy.with_name(copy.name + end).unlink(missing_ok=True)
    return copy
