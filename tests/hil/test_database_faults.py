#!/usr/bin/env python3
"""Everything that can be wrong with a database, at the start and while it is written, of a supervised run and of one alone: the twin goes on
in step with the plant, nobody has to do anything, what is to become of the file becomes of it (config/SPEC.md, "Database"), one event and one
line of the log say it, and nothing is lost that is not counted.
"""
import functools
import os
import shutil
import signal
import subprocess
import time

from attacks import PLAIN_USER, open_to_all, program_for
from bad_databases import FOREIGN, aside, beside, copied, execute, halve, hold, let_go, log_of, names, remove_all, replace, spoil, steps_in
from live_test import FIRST_GUESS, MADE_UP, OPTIMISED, STOP_TIME, Device, Program, check_replay, end_well, member, query, stop, wait_until
from test_disk_full import SmallDisk, fill
from tree import OMEGA, Tree, configuration
from twinlock_test import PROGRAM, Skip, expect, main, run, scratch

ENOUGH = 60  # steps
LOCKED_S = 5
LATE_S = 5  # of an answer and of a reading
WAYS = True, False  # supervised, alone


def bench(device, **changes):
    """As configuration(). The device shares a busy machine with all else: that it is late is no fault of a database."""
    patient = {"plant": {name: {"stale_s": LATE_S} for name in ("torque", "omega")},
               "sources": {"inverter": {"modbus_tcp": {"port": device.port, "timeout_s": LATE_S}}}}
    return configuration(device.port, **patient, **changes)


# ---- a run ----

class Live(Tree):
    """A run, supervised or alone, that may be begun by another program. Its twin must be the same all the time."""

    def __init__(self, config, supervised, *args, wrapper=(), program=PROGRAM, state=None):
        self.supervised = supervised
        self.copies = scratch() if wrapper else None  # of what another user writes
        self.state = state or scratch() / "state"
        words = ("--supervise", "--state", self.state) if supervised else ()
        command = [*wrapper, program, "run", config, "--json", *words, *args]
        Program.__init__(self, *command[1:], executable=command[0])
        self.twin = None

    def wait_for_steps(self, database, count=ENOUGH):
        """So many more at their own tick, in that file; it may not be one yet."""
        before = self.steps_in(database)
        wait_until(lambda: self.steps_in(database) >= before + count, f"{count} steps in {database}", self.explain)
        if self.twin is None:
            self.twin = member(self, "twin")

    def steps_in(self, database):
        """Without a file of root's beside that of another user, if only for an instant: SQLite makes some for who reads."""
        return steps_in(copied(database.parent, database.name, self.copies) if self.copies else database)

    def explain(self):
        expect(self.process.poll() is None, f"it has ended\n{self.log()}")
        return self.log()

    def kill_the_recorder(self):
        before = member(self, "recorder")
        os.kill(before, signal.SIGKILL)
        member(self, "recorder", before)

    def finish(self):
        """(what it told, log)."""
        expect(member(self, "twin") == self.twin, f"another twin\n{self.log()}")
        if self.supervised:
            expect(self.account()["starts"] == 1 and self.account()["failures"] == 0, f"{self.account()}\n{self.log()}")
        told, log = end_well(self, signal.SIGTERM)
        expect(told["steps"] + told["skipped"] == told["ticks"] > 0, f"{told}")
        return told, log


def check_said(log, database, *words):
    """One event and one line each, in this order, and no other."""
    lines = [line for line in log.splitlines() if " recorder: " in line]
    texts = [text for (text,) in query(database, "SELECT text FROM events WHERE source = 'recorder' ORDER BY event")]
    expect(len(lines) == len(texts) == len(words), f"{len(words)} wanted\n{texts}\n{log}")
    expect(all(word in text and text.rstrip() in line for word, text, line in zip(words, texts, lines)), f"{words}\n{texts}\n{log}")


def check_run(told, database, first=0):
    """The newest run of the database has all from that tick on, and is in lock; its number."""
    number, lost, before = query(database, "SELECT run, entries_lost, removed_before FROM runs ORDER BY run DESC LIMIT 1")[0]
    ticks = [tick for (tick,) in query(database, "SELECT DISTINCT tick FROM samples WHERE run = ? ORDER BY tick", number)]
    steps = query(database, "SELECT step, outcome, stop FROM steps WHERE run = ? ORDER BY step", number)
    first = before if first is None else first
    expect(ticks == list(range(first, told["ticks"] + 1)), f"{ticks[:1]} … {ticks[-1:]}, {len(ticks)} ticks of {told['ticks']}")
    expect([step for step, _, _ in steps] == list(range(steps[0][0], steps[0][0] + len(steps))), "steps are missing")
    expect(steps[0][0] in (first, first - 1, 0) and steps[-1][0] >= told["ticks"] - 2, f"{steps[0]} … {steps[-1]} of {told['ticks']}")
    newest = [outcome for _, outcome, stop_ in steps if outcome != MADE_UP and stop_ != STOP_TIME][-20:]  # that had the time for a search
    expect(newest.count(FIRST_GUESS) + newest.count(OPTIMISED) >= 18, f"not in lock: {newest}")
    return number, lost, before


def check_whole(config, told, database):
    """Nothing is missing, and a replay repeats it to the bit."""
    number, lost, before = check_run(told, database)
    expect(lost == 0 and not before, f"{lost} lost, from tick {before}")
    rows = query(database, "SELECT count(*) FROM steps WHERE run = ?", number)[0][0]
    check_replay(config, database, rows, number)


def check_rest(told, database, log, fate=None):
    """Of a run that began again in another file. What the first one took with it is counted, if it is `fate`."""
    _, lost, before = check_run(told, database, None)
    if fate is None:
        expect(lost == 0, f"{lost} lost")
        return
    expect(f"was {fate} with {lost} samples, steps and events" in log, f"{lost} are counted\n{log}")
    expect(2 * before - 2 <= lost <= 2 * before + 20, f"{lost} lost, up to tick {before}")


# ---- files ----

@functools.cache
def healthy():
    """A database with a run that has come to its end."""
    with Device(OMEGA) as device:
        config, database = bench(device, name="before")
        code, _, log = run(["run", config, "--duration", "0.5"])
        expect(code == 0, log)
    return database.read_bytes()


# ---- a user who may not do everything ----

def own(path):
    if os.geteuid() == 0:
        os.chown(path, PLAIN_USER, PLAIN_USER)
        open_to_all(path)


def plain(*paths):
    """How a program is begun as such a user, whose these files are."""
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
    """A run whose database is prepared so; `where` gives the file that it must record into. (config, path, what it told, log)"""
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
        check_said(log, path, "was damaged, is called twin.db.damaged-1 now, and was made anew: ")
        expect(names(path) == ["twin.db", "twin.db.damaged-1"], f"{names(path)}")
        expect(aside(path).read_bytes() == spoiled["bytes"], "what was put aside has changed")


def test_damaged_pages_at_the_start():
    check_put_aside(lambda path: spoil(path, 100, 4096))  # the schema
    check_put_aside(lambda path: spoil(path, 2 * 4096))


def test_truncated_at_the_start():
    check_put_aside(halve)


def check_left_alone(prepare, why):
    """Supervised it is recorded beside, on a terminal refused: not a byte of it changes."""
    kept = {}

    def keep(path):
        prepare(path)
        kept["bytes"] = path.read_bytes()
    path, log = start_with(keep, True, beside)
    check_said(log, beside(path), f"is recorded into instead: {path}: {why}")
    expect(path.read_bytes() == kept["bytes"] and names(path) == ["twin.db", "twin.db.beside"], f"touched: {names(path)}")
    with Device(OMEGA) as device:
        config, path = bench(device)
        path.write_bytes(kept["bytes"])
        code, _, log = run(["run", config])
    expect(code == 65 and f"{path}: {why}" in log, f"ended with {code}\n{log}")
    expect(path.read_bytes() == kept["bytes"] and names(path) == ["twin.db"], f"touched: {names(path)}")


def test_an_empty_file_at_the_start():
    check_left_alone(lambda path: os.truncate(path, 0), "is not a twinlock database: it has only 0 bytes")


def test_a_foreign_file_at_the_start():
    check_left_alone(lambda path: path.write_bytes(FOREIGN), f"is not a twinlock database: it has only {len(FOREIGN)} bytes")
    check_left_alone(lambda path: path.write_bytes(FOREIGN * 1000), "is not a twinlock database, nor any SQLite database")


def test_a_newer_file_at_the_start():
    check_left_alone(lambda path: execute(path, "PRAGMA user_version = 99", "PRAGMA wal_checkpoint(TRUNCATE)"),
                     "the database has format 99")


def start_plain(mode, why):
    """A file that may not be read, or not be written."""
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
        check_said(log, beside(path), f"is recorded into instead: {path}: {why}")
        expect(path.read_bytes() == healthy() and names(path) == ["twin.db", "twin.db.beside"], f"touched: {names(path)}")


def test_a_read_only_file_at_the_start():
    start_plain(0o444, "may not be written")


def test_an_unreadable_file_at_the_start():
    start_plain(0, "")


def test_a_folder_that_may_not_be_entered_at_the_start():
    """Waited for, supervised; on a terminal there is nothing to record into."""
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
        expect(code == 75 and str(path) in log and "Permission denied" in log, f"ended with {code}\n{log}")
        with Live(config, True, "--db", path, **options) as live:
            live.wait_for("cannot write")
            live.twin = member(live, "twin")
            time.sleep(1)
            folder.chmod(0o755)
            live.wait_for_steps(path)
            told, log = live.finish()
    check_whole(config, told, path)
    check_said(log, path, "cannot write: ", "writes again after")


def test_a_folder_that_is_not_there_at_the_start():
    with Device(OMEGA) as device:
        config, _ = bench(device)
        path = config.parent / "later" / "twin.db"
        with Live(config, True, "--db", path) as live:
            live.wait_for("cannot write")
            time.sleep(1)
            path.parent.mkdir()
            live.wait_for_steps(path)
            told, log = live.finish()
    check_whole(config, told, path)
    check_said(log, path, "cannot write: ", "writes again after")


def test_locked_at_the_start():
    for supervised in WAYS:
        held = []

        def free(live, held=held):
            live.wait_for("cannot write")
            time.sleep(LOCKED_S)
            let_go(held[0])
        path, log = start_with(lambda path, held=held: held.append(hold(path)), supervised, lambda path: path, free)
        check_said(log, path, "cannot write: another program has locked", "writes again after")


def test_another_twinlock_at_the_start():
    with Device(OMEGA) as device:
        config, path = bench(device)
        other, _ = bench(device, name="another")
        with Live(other, False, "--db", path) as before:
            before.wait_for_steps(path)
            code, _, log = run(["run", config])
            expect(code == 75 and "another twinlock is writing it" in log, f"ended with {code}\n{log}")
            with Live(config, True) as live:
                live.wait_for("another twinlock is writing it")
                live.twin = member(live, "twin")
                time.sleep(1)
                before.finish()
                live.wait_for_steps(path)
                told, log = live.finish()
    check_whole(config, told, path)
    check_said(log, path, "cannot write: ", "writes again after")


# ---- while it is written ----

def change_while_written(act, supervised, where, **options):
    """A run, something that is done to its database after some steps, and some steps more. (config, path, what it told, log)"""
    with Device(OMEGA) as device:
        config, path = bench(device)
        with Live(config, supervised, **options) as live:
            live.wait_for_steps(path)
            act(live, path)
            live.wait_for_steps(where(path))
            told, log = live.finish()
    return config, path, told, log


def written_back(act):
    """After what is in the log has been brought into the file, and some more has been written."""
    def change(_, path):
        execute(path, "PRAGMA wal_checkpoint")
        time.sleep(0.5)
        act(path)
    return change


def test_truncated_while_written():
    """What a cut takes away is noticed even if nobody reads it again."""
    for supervised in WAYS:
        for cut in halve, lambda path: os.truncate(path, 0):
            _, path, told, log = change_while_written(written_back(cut), supervised, lambda path: path)
            check_said(log, path, "was damaged, is called twin.db.damaged-1 now, and was made anew: ")
            check_rest(told, path, log)
            expect(names(path) == ["twin.db", "twin.db.damaged-1"], f"{names(path)}")


def test_damaged_pages_while_written():
    """Found by the next one that looks at them: here the recorder's successor."""
    def act(live, path):
        written_back(lambda path: spoil(path, 2 * 4096))(live, path)
        time.sleep(0.5)
        live.kill_the_recorder()
    for supervised in WAYS:
        _, path, told, log = change_while_written(act, supervised, lambda path: path)
        check_said(log, path, "was damaged, is called twin.db.damaged-1 now, and was made anew: ")
        check_rest(told, path, log)
        expect(names(path) == ["twin.db", "twin.db.damaged-1"], f"{names(path)}")


def test_overwritten_while_written():
    """In its place, by what is not ours: that is left as it is, and our log is not played into it."""
    for supervised in WAYS:
        _, path, told, log = change_while_written(written_back(lambda path: path.write_bytes(FOREIGN)), supervised, beside)
        check_said(log, beside(path), "is recorded into instead of one that was overwritten with ")
        check_rest(told, beside(path), log, "overwritten")
        expect(path.read_bytes() == FOREIGN and not log_of(path).exists(), "touched, or a log of ours is beside it")


def test_replaced_while_written():
    """By another database of ours, which is recorded into and keeps what it had; by a foreign file, which is left as it is."""
    for supervised in WAYS:
        _, path, told, log = change_while_written(lambda _, path: replace(path, healthy()), supervised, lambda path: path)
        check_said(log, path, "was removed with ")
        check_rest(told, path, log, "removed")
        expect(query(path, "PRAGMA integrity_check") == [("ok",)], "the two were mixed")
        expect(query(path, "SELECT name FROM runs WHERE run = 1") == [("before",)], "what was in it is gone")
        _, path, told, log = change_while_written(lambda _, path: replace(path, FOREIGN), supervised, beside)
        check_said(log, beside(path), "is recorded into instead of one that was removed with ")
        check_rest(told, beside(path), log, "removed")
        expect(path.read_bytes() == FOREIGN, "touched")


def test_deleted_while_written():
    for supervised in WAYS:
        for act in lambda _, path: path.unlink(), lambda _, path: remove_all(path):
            _, path, told, log = change_while_written(act, supervised, lambda path: path)
            check_said(log, path, "was removed with ")
            check_rest(told, path, log, "removed")


def test_renamed_while_written():
    """What is in it stays whole, and can be replayed."""
    moved = "moved.db"
    for supervised in WAYS:
        config, path, told, log = change_while_written(lambda _, path: path.rename(path.with_name(moved)), supervised, lambda path: path)
        check_said(log, path, "was moved away with ")
        check_rest(told, path, log)
        before = query(path, "SELECT removed_before FROM runs")[0][0]
        kept = path.with_name(moved)
        ticks, newest = query(kept, "SELECT count(DISTINCT tick), max(tick) FROM samples")[0]
        expect(ticks == newest + 1 == before, f"{ticks} ticks up to {newest} in the one, from {before} in the other")
        check_replay(config, kept, query(kept, "SELECT count(*) FROM steps")[0][0])


def test_a_folder_that_is_made_anew_while_written():
    """By a recorder that may write there: what one may is fixed when it begins."""
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
    """The recorder is stopped, so that it cannot look, and is killed after that."""
    def change(live, path):
        recorder = member(live, "recorder")
        stop(recorder)
        act(live, path)
        os.kill(recorder, signal.SIGKILL)
    return change


def damaged():
    """A database of ours whose pages are not what they were."""
    path = scratch() / "damaged.db"
    path.write_bytes(healthy())
    spoil(path, 2 * 4096)
    return path.read_bytes()


def test_deleted_and_killed():
    """What waits is written into the next file; what was in the one before is counted."""
    for supervised in WAYS:
        for act in lambda _, path: path.unlink(), lambda _, path: remove_all(path):
            _, path, told, log = change_while_written(when_nobody_writes(act), supervised, lambda path: path)
            check_said(log, path, "was gone with ")
            check_rest(told, path, log, "gone")


def test_replaced_and_killed():
    """Our log is not played into what is there now."""
    for supervised in WAYS:
        act = when_nobody_writes(lambda _, path: replace(path, healthy()))
        _, path, told, log = change_while_written(act, supervised, lambda path: path)
        check_said(log, path, "was gone with ")
        check_rest(told, path, log, "gone")
        expect(query(path, "PRAGMA integrity_check") == [("ok",)], "the two were mixed")
        expect(query(path, "SELECT name FROM runs WHERE run = 1") == [("before",)], "what was in it is gone")
        act = when_nobody_writes(lambda _, path: replace(path, damaged()))
        _, path, told, log = change_while_written(act, supervised, lambda path: path)
        check_said(log, path, "what took its place was damaged, is called twin.db.damaged-1 now, and was made anew: ")
        check_rest(told, path, log, "gone")
        expect(aside(path).read_bytes() == damaged(), "what was put aside has changed")
        act = when_nobody_writes(lambda _, path: replace(path, FOREIGN))
        _, path, told, log = change_while_written(act, supervised, beside)
        check_said(log, beside(path), "is recorded into instead of one that was gone with ")
        check_rest(told, beside(path), log, "gone")
        expect(path.read_bytes() == FOREIGN and not log_of(path).exists(), "touched, or a log of ours is beside it")


def lock_for_a_while(live, path):
    connection = hold(path)
    live.wait_for("cannot write")
    time.sleep(LOCKED_S)
    let_go(connection)


def test_locked_while_written():
    for supervised in WAYS:
        config, path, told, log = change_while_written(lock_for_a_while, supervised, lambda path: path)
        check_said(log, path, "cannot write: another program has locked", "writes again after")
        check_whole(config, told, path)


def test_a_log_that_is_removed_while_written():
    """All that is committed is in a file with a name again, so that a power cut costs no more than ever."""
    def act(live, path):
        log_of(path).unlink()
        live.wait_for("its log, -wal, was removed")
        live.wait_for_steps(path)
        copy = scratch() / "twin.db"
        for end in "", "-wal":
            shutil.copy(f"{path}{end}", f"{copy}{end}")
        ticks, newest = query(copy, "SELECT count(DISTINCT tick), max(tick) FROM samples")[0]
        expect(ticks == newest + 1 > ENOUGH, f"{ticks} ticks up to {newest} would be left")
    for supervised in WAYS:
        config, path, told, log = change_while_written(act, supervised, lambda path: path)
        check_said(log, path, "its log, -wal, was removed")
        check_whole(config, told, path)


def test_a_newer_schema_while_written():
    """Found by the next one that opens it."""
    def act(live, path):
        execute(path, "PRAGMA user_version = 99")
        live.kill_the_recorder()
    for supervised in WAYS:
        _, path, told, log = change_while_written(act, supervised, beside)
        check_said(log, beside(path), f"is recorded into instead: {path}: the database has format 99")
        check_rest(told, beside(path), log)


def plain_while_written(act, where):
    """As a user who may not do everything, in a folder of its own. (config, path, what it told, log) for each way"""
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
        check_said(log, beside(path), f"is recorded into instead: {path}: may not be written")
        check_rest(told, beside(path), log)


def test_a_folder_that_is_closed_while_written():
    """What is open goes on: nothing is to be said."""
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
    """The folder of a run that has a file system of its own, as seen from here."""

    def __init__(self, live, folder):
        self.folder = os.open(f"/proc/{live.pid}/root{folder}", os.O_RDONLY)  # also beyond the program's end

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
            live.wait_for("cannot write")
            time.sleep(1)
            disk.make_room()
            live.wait_for("writes again")
            disk.wait_for_steps(live)
            told, log = live.finish()
    copy = disk.copied()
    check_whole(config, told, copy)
    check_said(log, copy, "cannot write: ", "writes again after")
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
