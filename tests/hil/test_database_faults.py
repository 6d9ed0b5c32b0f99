#!/usr/bin/env python3
"""Faults of a database, at the start and while it is written, in supervised and unsupervised runs.

The twin must stay in step with the plant without help. The file must be handled as config/SPEC.md
("Database") says, and one event and one line of the log must report it. All losses must be counted.
"""
import functools
import os
import shutil
import signal
import subprocess
import time

from attacks import PLAIN_USER, open_to_all, program_for
from bad_databases import FOREIGN, aside, beside, copied, execute, halve, hold, let_go, log_of, names, remove_all, replace, spoil, steps_in
from live_test import (FIRST_GUESS, MADE_UP, OPTIMISED, STOP_TIME, Device, Program, check_replay, committed_steps, end_well, member, query,
                       stop, wait_until)
from test_disk_full import SmallDisk, fill
from tree import OMEGA, Tree, configuration
from twinlock_test import BAD_DATA, NOT_LOCKED, PROGRAM, Skip, expect, expect_line, has_line, main, run, scratch

ENOUGH = 60  # steps
LOCKED_S = 5
LATE_S = 5  # limit for an answer and for a reading
WAYS = True, False  # supervised, unsupervised
DAMAGED = "twin.db.damaged-1"  # parts of the recorder's messages (see has_line())
WAITS, WRITES = "cannot write", "again after"


def bench(device, **changes):
    """As configuration(), but with long time-outs: the device may be late on a busy machine."""
    patient = {"plant": {name: {"stale_s": LATE_S} for name in ("torque", "omega")},
               "sources": {"inverter": {"modbus_tcp": {"port": device.port, "timeout_s": LATE_S}}}}
    return configuration(device.port, **patient, **changes)


# ---- a run ----

class Live(Tree):
    """A run, supervised or not, that another program may start. Its twin must not be restarted."""

    def __init__(self, config, supervised, *args, wrapper=(), program=PROGRAM, state=None):
        self.supervised = supervised
        self.copies = scratch() if wrapper else None  # of a database that another user writes
        self.state = state or scratch() / "state"
        words = ("--supervise", "--state", self.state) if supervised else ()
        command = [*wrapper, program, "run", config, "--json", *words, *args]
        Program.__init__(self, *command[1:], executable=command[0])
        self.twin = None

    def wait_for_steps(self, database, count=ENOUGH):
        """Waits for `count` more steps in that file, which may not exist yet. Steps that were
        caught up do not count."""
        before = self.steps_in(database)
        wait_until(lambda: self.steps_in(database) >= before + count, f"{count} steps in {database}", self.explain)
        if self.twin is None:
            self.twin = member(self, "twin")

    def steps_in(self, database):
        """The number of steps. Reads a copy of another user's database, because SQLite creates
        files beside it."""
        return steps_in(copied(database.parent, database.name, self.copies) if self.copies else database)

    def explain(self):
        expect(self.process.poll() is None, f"it has ended\n{self.log()}")
        return self.log()

    def kill_the_recorder(self):
        before = member(self, "recorder")
        os.kill(before, signal.SIGKILL)
        member(self, "recorder", before)

    def finish(self):
        """Ends the run and returns (--json report, log)."""
        expect(member(self, "twin") == self.twin, f"another twin\n{self.log()}")
        if self.supervised:
            expect(self.account()["starts"] == 1 and self.account()["failures"] == 0, f"{self.account()}\n{self.log()}")
        told, log = end_well(self, signal.SIGTERM)
        expect(told["steps"] + told["skipped"] == told["ticks"] > 0, f"{told}")
        return told, log


def check_said(log, database, *wanted):
    """Checks that the recorder has exactly these events and log lines, in this order. `wanted`: see
    has_line()."""
    lines = [line for line in log.splitlines() if " recorder: " in line]
    texts = [text for (text,) in query(database, "SELECT text FROM events WHERE source = 'recorder' ORDER BY event")]
    expect(len(lines) == len(texts) == len(wanted), f"{len(wanted)} wanted\n{texts}\n{log}")
    expect(all(has_line(text, parts) for parts, text in zip(wanted, texts)), f"{wanted}\n{texts}\n{log}")
    expect(all(text.rstrip() in line for text, line in zip(texts, lines)), f"{texts}\n{log}")


def check_run(told, database, first=0):
    """Checks that the newest run has all ticks and steps from `first` on, and is in lock.

    Returns (run, entries lost, entries removed before).
    """
    number, lost, before = query(database, "SELECT run, entries_lost, removed_before FROM runs ORDER BY run")[-1]
    ticks = [tick for (tick,) in query(database, "SELECT DISTINCT tick FROM samples own WHERE own.run = ? ORDER BY tick", number)]
    steps = query(database, "SELECT step, outcome, stop FROM steps WHERE steps.run = ? ORDER BY step", number)
    first = before if first is None else first
    expect(ticks == list(range(first, told["ticks"] + 1)), f"{ticks[:1]} … {ticks[-1:]}, {len(ticks)} ticks of {told['ticks']}")
    expect([step for step, _, _ in steps] == list(range(steps[0][0], steps[0][0] + len(steps))), "steps are missing")
    expect(steps[0][0] in (first, first - 1, 0) and steps[-1][0] >= told["ticks"] - 2, f"{steps[0]} … {steps[-1]} of {told['ticks']}")
    newest = [outcome for _, outcome, stop_ in steps if outcome != MADE_UP and stop_ != STOP_TIME][-20:]  # with time for a search
    expect(newest.count(FIRST_GUESS) + newest.count(OPTIMISED) >= 18, f"not in lock: {newest}")
    return number, lost, before


def check_whole(config, told, database):
    """Checks that no entry is missing, and that a replay gives the same bits."""
    number, lost, before = check_run(told, database)
    expect(lost == 0 and not before, f"{lost} lost, from tick {before}")
    check_replay(config, database, committed_steps(database, number), number)


def check_rest(told, database, log, fate=None):
    """Checks a run that continued in another file.

    `fate`: a word for what happened to the first file, if its entries are lost. They must be
    counted.
    """
    _, lost, before = check_run(told, database, None)
    if fate is None:
        expect(lost == 0, f"{lost} lost")
        return
    expect_line(log, f"recorder|{fate}|{lost}|samples")
    expect(2 * before - 2 <= lost <= 2 * before + 20, f"{lost} lost, up to tick {before}")


# ---- files ----

@functools.cache
def healthy():
    """The content of a database with a finished run."""
    with Device(OMEGA) as device:
        config, database = bench(device, name="before")
        code, _, log = run(["run", config, "--duration", "0.5"])
        expect(code in (0, NOT_LOCKED), log)
    return database.read_bytes()


# ---- an unprivileged user ----

def own(path):
    if os.geteuid() == 0:
        os.chown(path, PLAIN_USER, PLAIN_USER)
        open_to_all(path)


def plain(*paths):
    """Options that start a program as an unprivileged user, who owns these files."""
    user = PLAIN_USER if os.geteuid() == 0 else os.geteuid()
    temporary, state = scratch(), scratch()
    for path in *paths, temporary, state:
        own(path)
    change = ["setpriv", f"--reuid={user}", f"--regid={user}", "--clear-groups", "--"] if os.geteuid() == 0 else []
    if change and shutil.which("setpriv") is None:
        raise Skip("there is no setpriv here")
    return {"wrapper": [*change, "env", f"TMPDIR={temporary}"], "program": program_for(user), "state": state / "state"}


# ---- at the start ----

def start_with(prepare, supervised, where, finish=lambda live: None, **options):
    """A run with a prepared database. `where` returns the file that it must record into. Returns
    (path, log)."""
    with Device(OMEGA) as device:
        config, path = bench(device)
        path.write_bytes(healthy())
        prepare(path)
        with Live(config, supervised, **options) as live:
            finish(live)
            live.wait_for_steps(where(path))
            told, log = live.finish()
    check_whole(config, told, where(path))
    return path, log


def check_put_aside(prepare):
    for supervised in WAYS:
        spoiled = {}

        def keep(path, spoiled=spoiled):
            prepare(path)
            spoiled["bytes"] = path.read_bytes()
        path, log = start_with(keep, supervised, lambda path: path)
        check_said(log, path, DAMAGED)
        expect(names(path) == ["twin.db", "twin.db.damaged-1"], f"{names(path)}")
        expect(aside(path).read_bytes() == spoiled["bytes"], "the damaged file has changed")


def test_damaged_pages_at_the_start():
    check_put_aside(lambda path: spoil(path, 100, 4096))  # the schema
    check_put_aside(lambda path: spoil(path, 2 * 4096))


def test_truncated_at_the_start():
    check_put_aside(halve)


def check_left_alone(prepare, why):
    """A supervised run records into a file beside it, other runs fail. The file must not change."""
    kept = {}

    def keep(path):
        prepare(path)
        kept["bytes"] = path.read_bytes()
    path, log = start_with(keep, True, beside)
    check_said(log, beside(path), f"{path}|{why}")
    expect(path.read_bytes() == kept["bytes"] and names(path) == ["twin.db", "twin.db.beside"], f"touched: {names(path)}")
    with Device(OMEGA) as device:
        config, path = bench(device)
        path.write_bytes(kept["bytes"])
        code, _, log = run(["run", config])
    expect(code == BAD_DATA, f"ended with {code}\n{log}")
    expect_line(log, f"error|{path}|{why}")
    expect(path.read_bytes() == kept["bytes"] and names(path) == ["twin.db"], f"touched: {names(path)}")


def test_an_empty_file_at_the_start():
    check_left_alone(lambda path: os.truncate(path, 0), "0 bytes")


def test_a_foreign_file_at_the_start():
    check_left_alone(lambda path: path.write_bytes(FOREIGN), f"{len(FOREIGN)} bytes")
    check_left_alone(lambda path: path.write_bytes(FOREIGN * 1000), "SQLite")


def test_a_newer_file_at_the_start():
    check_left_alone(lambda path: execute(path, "PRAGMA user_version = 99", "PRAGMA wal_checkpoint(TRUNCATE)"),
                     "format 99")


def start_plain(mode, why):
    """A run with a file that it has no permission to read or write."""
    for supervised in WAYS:
        with Device(OMEGA) as device:
            config, path = bench(device)
            folder = scratch()
            path = folder / "twin.db"
            path.write_bytes(healthy())
            options = plain(folder, path)
            open_to_all(config)
            path.chmod(mode)
            with Live(config, supervised, "--db", path, **options) as live:
                live.wait_for_steps(beside(path))
                told, log = live.finish()
        check_whole(config, told, beside(path))
        check_said(log, beside(path), f"{path}|{why}")
        expect(path.read_bytes() == healthy() and names(path) == ["twin.db", "twin.db.beside"], f"touched: {names(path)}")


def test_a_read_only_file_at_the_start():
    start_plain(0o444, "permissions")


def test_an_unreadable_file_at_the_start():
    start_plain(0, "Permission denied")


def test_a_folder_that_may_not_be_entered_at_the_start():
    """A supervised run waits for it. An unsupervised run fails."""
    with Device(OMEGA) as device:
        config, _ = bench(device)
        folder = scratch()
        path = folder / "twin.db"
        path.write_bytes(healthy())
        options = plain(folder, path)
        open_to_all(config)
        folder.chmod(0)
        with Live(config, False, "--db", path, **options) as live:
            code, _, log = live.end()
        expect(code == 75, f"ended with {code}\n{log}")
        expect_line(log, f"error|{path}|Permission denied")
        with Live(config, True, "--db", path, **options) as live:
            live.wait_for(WAITS)
            live.twin = member(live, "twin")
            time.sleep(1)
            folder.chmod(0o755)
            live.wait_for_steps(path)
            told, log = live.finish()
    check_whole(config, told, path)
    check_said(log, path, WAITS, WRITES)


def test_a_folder_that_is_not_there_at_the_start():
    with Device(OMEGA) as device:
        config, _ = bench(device)
        path = config.parent / "later" / "twin.db"
        with Live(config, True, "--db", path) as live:
            live.wait_for(WAITS)
            time.sleep(1)
            path.parent.mkdir()
            live.wait_for_steps(path)
            told, log = live.finish()
    check_whole(config, told, path)
    check_said(log, path, WAITS, WRITES)


def test_locked_at_the_start():
    for supervised in WAYS:
        held = []

        def free(live, held=held):
            live.wait_for(WAITS)
            time.sleep(LOCKED_S)
            let_go(held[0])
        path, log = start_with(lambda path, held=held: held.append(hold(path)), supervised, lambda path: path, free)
        check_said(log, path, f"{WAITS}|locked", WRITES)


def test_another_twinlock_at_the_start():
    with Device(OMEGA) as device:
        config, path = bench(device)
        other, _ = bench(device, name="another")
        with Live(other, False, "--db", path) as before:
            before.wait_for_steps(path)
            code, _, log = run(["run", config])
            taken = f"{path}|another twinlock|process {member(before, 'recorder')}"
            expect(code == 75, f"ended with {code}\n{log}")
            expect_line(log, taken)
            with Live(config, True) as live:
                live.wait_for(taken)
                live.twin = member(live, "twin")
                time.sleep(1)
                before.finish()
                live.wait_for_steps(path)
                told, log = live.finish()
    check_whole(config, told, path)
    check_said(log, path, WAITS, WRITES)


# ---- while it is written ----

def change_while_written(act, supervised, where, **options):
    """A run whose database `act` changes after some steps. Returns (config, path, --json report,
    log)."""
    with Device(OMEGA) as device:
        config, path = bench(device)
        with Live(config, supervised, **options) as live:
            live.wait_for_steps(path)
            act(live, path)
            live.wait_for_steps(where(path))
            told, log = live.finish()
    return config, path, told, log


def written_back(act):
    """Returns a function that writes the log back into the file, and waits for more commits, before
    `act`."""
    def change(_, path):
        execute(path, "PRAGMA wal_checkpoint")
        time.sleep(0.5)
        act(path)
    return change


def test_truncated_while_written():
    """The recorder notices a truncated file, although it does not read it again."""
    for supervised in WAYS:
        for cut in halve, lambda path: os.truncate(path, 0):
            _, path, told, log = change_while_written(written_back(cut), supervised, lambda path: path)
            check_said(log, path, DAMAGED)
            check_rest(told, path, log)
            expect(names(path) == ["twin.db", "twin.db.damaged-1"], f"{names(path)}")


def test_damaged_pages_while_written():
    """The next recorder finds them, because it reads them."""
    def act(live, path):
        written_back(lambda path: spoil(path, 2 * 4096))(live, path)
        time.sleep(0.5)
        live.kill_the_recorder()
    for supervised in WAYS:
        _, path, told, log = change_while_written(act, supervised, lambda path: path)
        check_said(log, path, DAMAGED)
        check_rest(told, path, log)
        expect(names(path) == ["twin.db", "twin.db.damaged-1"], f"{names(path)}")


def test_overwritten_while_written():
    """In place, by a foreign file. It is not changed, and our log is not written back into it."""
    for supervised in WAYS:
        _, path, told, log = change_while_written(written_back(lambda path: path.write_bytes(FOREIGN)), supervised, beside)
        check_said(log, beside(path), "overwritten|samples")
        check_rest(told, beside(path), log, "overwritten")
        expect(path.read_bytes() == FOREIGN and not log_of(path).exists(), "changed, or our log is beside it")


def test_replaced_while_written():
    """By another twinlock database, which is used and keeps its runs; and by a foreign file, which
    is not changed."""
    for supervised in WAYS:
        _, path, told, log = change_while_written(lambda _, path: replace(path, healthy()), supervised, lambda path: path)
        check_said(log, path, "removed|samples")
        check_rest(told, path, log, "removed")
        expect(query(path, "PRAGMA integrity_check") == [("ok",)], "a mix of both databases")
        expect(query(path, "SELECT name FROM runs WHERE runs.run = 1") == [("before",)], "its first run is gone")
        _, path, told, log = change_while_written(lambda _, path: replace(path, FOREIGN), supervised, beside)
        check_said(log, beside(path), "removed|samples")
        check_rest(told, beside(path), log, "removed")
        expect(path.read_bytes() == FOREIGN, "the foreign file has changed")


def test_deleted_while_written():
    for supervised in WAYS:
        for act in lambda _, path: path.unlink(), lambda _, path: remove_all(path):
            _, path, told, log = change_while_written(act, supervised, lambda path: path)
            check_said(log, path, "removed|samples")
            check_rest(told, path, log, "removed")


def test_renamed_while_written():
    """The moved file stays whole, and can be replayed."""
    moved = "moved.db"
    for supervised in WAYS:
        config, path, told, log = change_while_written(lambda _, path: path.rename(path.with_name(moved)), supervised, lambda path: path)
        check_said(log, path, "moved|samples")
        check_rest(told, path, log)
        before = query(path, "SELECT removed_before FROM runs")[0][0]
        kept = path.with_name(moved)
        ticks, newest = query(kept, "SELECT count(DISTINCT tick), max(tick) FROM samples")[0]
        expect(ticks == newest + 1 == before, f"{ticks} ticks up to {newest} in the one, from {before} in the other")
        check_replay(config, kept, query(kept, "SELECT count(*) FROM steps")[0][0])


def test_a_new_folder_while_written():
    """The recorder may write to the new folder: its permissions are those of its start."""
    for supervised in WAYS:
        with Device(OMEGA) as device:
            config, _ = bench(device)
            path = scratch() / "data" / "twin.db"
            path.parent.mkdir()
            with Live(config, supervised, "--db", path) as live:
                live.wait_for_steps(path)
                shutil.rmtree(path.parent)
                time.sleep(1)
                path.parent.mkdir()
                live.wait_for_steps(path)
                told, log = live.finish()
        check_rest(told, path, log, "removed")


def when_nobody_writes(act):
    """Returns a function that stops the recorder before `act`, and kills it afterwards."""
    def change(live, path):
        recorder = member(live, "recorder")
        stop(recorder)
        act(live, path)
        os.kill(recorder, signal.SIGKILL)
    return change


def damaged():
    """The content of a database with damaged pages."""
    path = scratch() / "damaged.db"
    path.write_bytes(healthy())
    spoil(path, 2 * 4096)
    return path.read_bytes()


def test_deleted_and_killed():
    """The next file gets the queued entries. The entries of the first file are counted as lost."""
    for supervised in WAYS:
        for act in lambda _, path: path.unlink(), lambda _, path: remove_all(path):
            _, path, told, log = change_while_written(when_nobody_writes(act), supervised, lambda path: path)
            check_said(log, path, "gone|samples")
            check_rest(told, path, log, "gone")


def test_replaced_and_killed():
    """Our log is not written back into the new file."""
    for supervised in WAYS:
        act = when_nobody_writes(lambda _, path: replace(path, healthy()))
        _, path, told, log = change_while_written(act, supervised, lambda path: path)
        check_said(log, path, "gone|samples")
        check_rest(told, path, log, "gone")
        expect(query(path, "PRAGMA integrity_check") == [("ok",)], "a mix of both databases")
        expect(query(path, "SELECT name FROM runs WHERE runs.run = 1") == [("before",)], "its first run is gone")
        act = when_nobody_writes(lambda _, path: replace(path, damaged()))
        _, path, told, log = change_while_written(act, supervised, lambda path: path)
        check_said(log, path, f"gone|samples|{DAMAGED}")
        check_rest(told, path, log, "gone")
        expect(aside(path).read_bytes() == damaged(), "the damaged file has changed")
        act = when_nobody_writes(lambda _, path: replace(path, FOREIGN))
        _, path, told, log = change_while_written(act, supervised, beside)
        check_said(log, beside(path), "gone|samples")
        check_rest(told, beside(path), log, "gone")
        expect(path.read_bytes() == FOREIGN and not log_of(path).exists(), "changed, or our log is beside it")


def lock_for_a_while(live, path):
    connection = hold(path)
    live.wait_for(WAITS)
    time.sleep(LOCKED_S)
    let_go(connection)


def test_locked_while_written():
    for supervised in WAYS:
        config, path, told, log = change_while_written(lock_for_a_while, supervised, lambda path: path)
        check_said(log, path, f"{WAITS}|locked", WRITES)
        check_whole(config, told, path)


def test_a_log_that_is_removed_while_written():
    """All committed entries are in a named file again, so a power cut does not lose more than
    usual."""
    def act(live, path):
        log_of(path).unlink()
        live.wait_for(f"{path}|-wal|removed")
        live.wait_for_steps(path)
        copy = scratch() / "twin.db"
        for end in "", "-wal":
            shutil.copy(f"{path}{end}", f"{copy}{end}")
        ticks, newest = query(copy, "SELECT count(DISTINCT tick), max(tick) FROM samples")[0]
        expect(ticks == newest + 1 > ENOUGH, f"{ticks} ticks up to {newest} are in the files")
    for supervised in WAYS:
        config, path, told, log = change_while_written(act, supervised, lambda path: path)
        check_said(log, path, "-wal|removed")
        check_whole(config, told, path)


def test_a_newer_schema_while_written():
    """The next recorder finds it when it opens the file."""
    def act(live, path):
        execute(path, "PRAGMA user_version = 99")
        live.kill_the_recorder()
    for supervised in WAYS:
        _, path, told, log = change_while_written(act, supervised, beside)
        check_said(log, beside(path), f"{path}|format 99")
        check_rest(told, beside(path), log)


def plain_while_written(act, where):
    """As change_while_written(), as an unprivileged user. Yields (config, path, --json report, log)
    for each way."""
    for supervised in WAYS:
        with Device(OMEGA) as device:
            config, _ = bench(device)
            path = scratch() / "twin.db"
            options = plain(path.parent)
            open_to_all(config)
            with Live(config, supervised, "--db", path, **options) as live:
                live.wait_for_steps(path)
                act(live, path)
                live.wait_for_steps(where(path))
                told, log = live.finish()
        yield config, path, told, log


def test_read_only_while_written():
    def act(live, path):
        path.chmod(0o444)
        live.kill_the_recorder()
    for _, path, told, log in plain_while_written(act, beside):
        check_said(log, beside(path), f"{path}|permissions")
        check_rest(told, beside(path), log)


def test_a_folder_that_is_closed_while_written():
    """The open file still works, so there is no message."""
    def act(_, path):
        path.parent.chmod(0)
        time.sleep(2)
        path.parent.chmod(0o755)
    for config, path, told, log in plain_while_written(act, lambda path: path):
        check_said(log, path)
        check_whole(config, told, path)


# ---- a full disk ----

FULL = 'mount -t tmpfs -o size=16m none "$0" && { head -c 20M /dev/zero >"$0/ballast" 2>/dev/null; exec "$@"; }'


class Disk:
    """The folder of a run with a file system of its own, as seen from outside."""

    def __init__(self, live, folder):
        self.folder = os.open(f"/proc/{live.pid}/root{folder}", os.O_RDONLY)  # valid after the program's end

    def copied(self):
        return copied(f"/proc/self/fd/{self.folder}", "twin.db")

    def wait_for_steps(self, live):
        before = steps_in(self.copied())
        wait_until(lambda: steps_in(self.copied()) >= before + ENOUGH, "steps on the disk", live.explain)

    def fill(self):
        with open(os.open("ballast", os.O_WRONLY | os.O_CREAT, dir_fd=self.folder), "wb", buffering=0) as ballast:
            fill(ballast.fileno())

    def make_room(self):
        os.truncate(f"/proc/self/fd/{self.folder}/ballast", 0)


def on_a_small_disk(supervised, script, act):
    trial = ["unshare", "-Urm", "sh", "-c", SmallDisk.MOUNT, scratch(), "true"]
    if shutil.which("unshare") is None or subprocess.run(trial, capture_output=True, check=False).returncode != 0:
        raise Skip("a file system of its own is not permitted here")
    folder = scratch()
    with Device(OMEGA) as device:
        config, _ = bench(device)
        with Live(config, supervised, "--db", folder / "twin.db", wrapper=["unshare", "-Urm", "sh", "-c", script, folder]) as live:
            live.wait_for("connected")
            disk = Disk(live, folder)
            live.twin = member(live, "twin")
            act(live, disk)
            live.wait_for(WAITS)
            time.sleep(1)
            disk.make_room()
            live.wait_for(WRITES)
            disk.wait_for_steps(live)
            told, log = live.finish()
    copy = disk.copied()
    check_whole(config, told, copy)
    check_said(log, copy, WAITS, WRITES)
    os.close(disk.folder)


def test_full_at_the_start():
    for supervised in WAYS:
        on_a_small_disk(supervised, FULL, lambda live, disk: None)


def test_full_while_written():
    def act(live, disk):
        disk.wait_for_steps(live)
        disk.fill()
    for supervised in WAYS:
        on_a_small_disk(supervised, SmallDisk.MOUNT, act)


if __name__ == "__main__":
    main()
