"""Faults of the database of a service in a booted Debian (booted.py), at the start and while it is
written.

The twin must be in lock again without help, and systemd must not have restarted the service. The
plant stands still, so a step out of lock is caused by the fault.
"""
import os
import re
import signal
import sqlite3
import time

from bad_databases import FOREIGN, aside, beside, copied, execute, halve, hold, let_go, log_of, remove_all, replace, spoil
from live_test import FIRST_GUESS, MADE_UP, OPTIMISED, STOP_TIME, count_lines, query, wait_until
from twinlock_test import at_least, expect, has_line, json

NAME = "faults"
UNIT = f"twinlock@{NAME}"
FOLDER = "/var/lib/twinlock"
PORT = 1503
LATE_S = 5  # limit for an answer and for a reading: the machine of the plant may be busy
ENOUGH = 50  # steps
IN_LOCK = 0.95  # share of these steps
LOCKED = "cannot write|locked"  # by another program: parts of the recorder's message, see has_line()
TAKEN = "another twinlock|process"  # writes the database
OUTCOMES = "SELECT outcome FROM steps WHERE steps.run = ? AND step > ? AND outcome <> ? AND stop <> ? ORDER BY step"


def newest_run(database):
    """The number of the newest run; 0 if there is none, or no database yet."""
    try:
        return query(database, "SELECT coalesce(max(run), 0) FROM runs")[0][0]
    except sqlite3.Error:
        return 0


def outcomes(database, since=-1):
    """Outcomes of the newest run's steps, without steps that were caught up or had no time for a
    search."""
    try:
        return [outcome for (outcome,) in query(database, OUTCOMES, newest_run(database), since, MADE_UP, STOP_TIME)]
    except sqlite3.Error:
        return []


def share_in_lock(found):
    return sum(outcome in (FIRST_GUESS, OPTIMISED) for outcome in found) / max(len(found), 1)


def newest_step(database):
    return query(database, "SELECT max(step) FROM steps WHERE steps.run = ?", newest_run(database))[0][0]


class Service:
    """The unit twinlock@faults in the machine, its plant, and its database as seen from outside."""

    def __init__(self, machine, examples):
        self.machine = machine
        self.path = machine.root / f"{FOLDER}/{NAME}.db".lstrip("/")
        self.configuration = machine.root / f"etc/twinlock/{NAME}.json"
        self.main = self.twin = ""
        live = json.loads((examples / "motor/live.json").read_text(encoding="utf-8"))
        del live["duration_s"]
        live["record"]["commit_s"] = 0.1
        live["sources"]["inverter"]["modbus_tcp"].update(port=PORT, timeout_s=LATE_S)
        for signal_ in live["plant"].values():
            signal_["stale_s"] = LATE_S
        self.configuration.write_text(json.dumps(live), encoding="utf-8")
        plant = json.loads((examples / "motor/plant.json").read_text(encoding="utf-8"))
        plant.update(duration_s=3600, recording={"file": "still.csv", "time_column": "t"})
        (machine.root / "srv/still.csv").write_text("t,torque\n0,0\n3600,0\n", encoding="utf-8")
        (machine.root / "srv/still.json").write_text(json.dumps(plant), encoding="utf-8")
        machine.run_well("systemd-run", "--unit=still", "twinlock", "plant", "/srv/still.json", "--for", f"/etc/twinlock/{NAME}.json")

    def member(self, role):
        """The process id in the machine; "" if there is none."""
        group = self.machine.property(UNIT, "ControlGroup")
        script = 'for pid in $(cat "/sys/fs/cgroup$0/cgroup.procs"); do echo "$pid $(tr "\\0" " " <"/proc/$pid/cmdline")"; done'
        found = re.search(rf"^(\d+) twinlock: {role}", self.machine.run("sh", "-c", script, group).stdout, re.M)
        return found[1] if found else ""

    def said(self):
        return self.machine.journal(UNIT)

    def start(self):
        self.machine.run_well("systemctl", "start", UNIT)
        self.twin = wait_until(lambda: self.member("twin"), "the twin", self.said)
        self.main = self.machine.property(UNIT, "MainPID")

    def stop(self):
        """Stops the service, and checks that it is still the same process with the same twin."""
        wanted = {"ActiveState": "active", "MainPID": self.main, "NRestarts": "0"}
        found = {name: self.machine.property(UNIT, name) for name in wanted}
        expect(found == wanted and self.member("twin") == self.twin, f"{found}, twin {self.member('twin')}, not {self.twin}\n{self.said()}")
        self.machine.run_well("systemctl", "stop", UNIT)
        expect(self.machine.property(UNIT, "Result") == "success", self.said())

    def kill(self, role, number=signal.SIGKILL):
        self.machine.run_well("sh", "-c", f"kill -{int(number)} {self.member(role)}")

    def wait_for_lock(self, database, after=0):
        """Waits until a run newer than `after` is in lock; `database` returns the path of its
        file."""
        def is_in_lock():
            found = outcomes(database()) if newest_run(database()) > after else []
            return len(found) >= ENOUGH and share_in_lock(found[-ENOUGH:]) >= IN_LOCK
        wait_until(is_in_lock, "lock", self.said)

    def remove_files(self):
        for file in self.path.parent.glob(f"{self.path.name}*"):
            file.unlink()

    def put(self, content):
        """Writes the database file, and removes all files beside it."""
        self.remove_files()
        self.path.write_bytes(content)
        owner = self.path.parent.stat()
        os.chown(self.path, owner.st_uid, owner.st_gid)


# ---- at the start ----

def newer(file):
    execute(file, "PRAGMA user_version = 99", "PRAGMA wal_checkpoint(TRUNCATE)")


AT_THE_START = (  # the fault, and the end of the name of the file that must be recorded into
    (halve, ""),
    (lambda file: spoil(file, 2 * 4096), ""),
    (lambda file: os.truncate(file, 0), ".beside"),
    (lambda file: file.write_bytes(FOREIGN), ".beside"),
    (newer, ".beside"),
    (lambda file: file.chmod(0o440), ".beside"),
    (lambda file: file.chmod(0), ".beside"))


def check_at_the_start(service, whole):
    for prepare, end in AT_THE_START:
        service.put(whole)
        prepare(service.path)
        before = service.path.read_bytes()
        service.start()
        service.wait_for_lock(lambda end=end: service.path.with_name(service.path.name + end))
        service.stop()
        expect((service.path if end else aside(service.path)).read_bytes() == before, "the faulty file has changed")


def check_another_program(service, whole):
    """The database is locked by another program, and then written by another twinlock."""
    service.put(whole)
    before = newest_run(service.path)
    held = hold(service.path)
    service.start()
    wait_until(lambda: has_line(service.said(), LOCKED), LOCKED, service.said)
    let_go(held)
    service.wait_for_lock(lambda: service.path, before)
    service.stop()
    before = newest_run(service.path)
    service.machine.run_well("systemd-run", "--unit=another", "--uid=twinlock", "twinlock", "run", f"/etc/twinlock/{NAME}.json", "--db",
                             f"{FOLDER}/{NAME}.db")
    service.wait_for_lock(lambda: service.path, before)
    service.start()
    wait_until(lambda: has_line(service.said(), TAKEN), TAKEN, service.said)
    before = newest_run(service.path)
    service.machine.run_well("systemctl", "stop", "another")
    service.wait_for_lock(lambda: service.path, before)
    service.stop()


# ---- while it is written ----

def endure(service, name, path, act, where):
    """Causes a fault, and checks that the steps after it are recorded into the file `where`, in
    lock."""
    since = newest_step(path)
    act(path)
    wait_until(lambda: len(outcomes(where, since)) >= ENOUGH, f"steps in {where}", service.said)
    found = outcomes(where, since)
    at_least(share_in_lock(found), IN_LOCK, f"{name}: in lock, of {len(found)} steps")


def written_back(act):
    """Returns a function that writes the log back into the file first."""
    def change(file):
        execute(file, "PRAGMA wal_checkpoint")
        act(file)
    return change


def lock(file):
    held = hold(file)
    time.sleep(3)
    let_go(held)


def close_folder(file):
    file.parent.chmod(0)
    time.sleep(2)
    file.parent.chmod(0o750)


def check_while_written(service, whole):
    """Causes one fault after the other, in the same run of the same processes."""
    path = service.path
    spoiled = path.with_name("spoiled")
    spoiled.write_bytes(whole)
    spoil(spoiled, 2 * 4096)

    def then_killed(act):
        def change(file):
            act(file)
            service.kill("recorder")
        return change

    def unseen(act):
        """Returns a function that stops the recorder before the fault, and kills it afterwards."""
        def change(file):
            service.kill("recorder", signal.SIGSTOP)
            act(file)
            service.kill("recorder")
        return change

    service.remove_files()
    service.start()
    service.wait_for_lock(lambda: path)
    for name, act in (("removed", lambda file: file.unlink()),
                      ("all of it removed", remove_all),
                      ("moved away", lambda file: file.rename(file.with_name("moved.db"))),
                      ("replaced", lambda file: replace(file, whole)),
                      ("its log removed", lambda file: log_of(file).unlink()),
                      ("locked", lock),
                      ("its folder closed", close_folder),
                      ("removed, the recorder killed", unseen(lambda file: file.unlink())),
                      ("replaced, the recorder killed", unseen(lambda file: replace(file, whole))),
                      ("replaced by a damaged one, the recorder killed", unseen(lambda file: replace(file, spoiled.read_bytes()))),
                      ("cut off", written_back(halve)),
                      ("emptied", written_back(lambda file: os.truncate(file, 0))),
                      ("damaged pages, the recorder killed", then_killed(written_back(lambda file: spoil(file, 2 * 4096))))):
        endure(service, name, path, act, path)
    expect(aside(path, 4).exists(), "four were damaged")
    endure(service, "overwritten", path, lambda file: file.write_bytes(FOREIGN), beside(path))
    ends = ".beside", ".beside-2", ".beside-3", ".beside-4"
    for name, act, end, then in (("newer", lambda file: execute(file, "PRAGMA user_version = 99"), *ends[0:2]),
                                 ("read-only", lambda file: file.chmod(0o440), *ends[1:3]),
                                 ("unreadable", lambda file: file.chmod(0), *ends[2:4])):
        endure(service, f"{name}, the recorder killed", path.with_name(path.name + end), then_killed(act), path.with_name(path.name + then))
    expect(path.read_bytes() == FOREIGN, "the foreign file has changed")
    service.stop()
    spoiled.unlink()


# ---- a full disk ----

def check_a_full_disk(service):
    """The disk is full at the start, and while the database is written. The recorder writes the
    rest later."""
    machine = service.machine

    def database():
        return copied(f"/proc/{machine.first}/root{FOLDER}", f"{NAME}.db")

    def fill():
        machine.run("sh", "-c", f"head -c 20M /dev/zero >>{FOLDER}/ballast")

    def wait_for_another(parts, act):
        times = count_lines(service.said(), parts)
        act()
        wait_until(lambda: count_lines(service.said(), parts) > times, f"\"{parts}\"", service.said)

    def make_room():
        machine.run_well("sh", "-c", f": >{FOLDER}/ballast")

    machine.run_well("mount", "-t", "tmpfs", "-o", "size=16m", "none", FOLDER)
    fill()
    wait_for_another("cannot write", service.start)
    wait_for_another("again after", make_room)
    service.wait_for_lock(database)
    since = newest_step(database())
    wait_for_another("cannot write", fill)
    time.sleep(1)
    wait_for_another("again after", make_room)
    wait_until(lambda: len(outcomes(database(), since)) >= ENOUGH, "steps on the disk", service.said)
    at_least(share_in_lock(outcomes(database(), since)), IN_LOCK, "a full disk: in lock")
    service.stop()
    machine.run_well("umount", FOLDER)


def check_bad_databases(machine, examples):
    service = Service(machine, examples)
    service.start()
    service.wait_for_lock(lambda: service.path)
    service.stop()
    whole = service.path.read_bytes()
    check_at_the_start(service, whole)
    check_another_program(service, whole)
    check_while_written(service, whole)
    check_a_full_disk(service)
    service.remove_files()
    service.configuration.unlink()
    machine.call("stop", "still")
