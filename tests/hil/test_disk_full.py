#!/usr/bin/env python3
"""The disk becomes full while the twin runs.

The cycle must not be disturbed, the log and an event must report it, and no recorded entry may be
lost. The tests use a small tmpfs in a user namespace, if the system permits it, and a limit on the
size of files.
"""
import errno
import os
import resource
import shutil
import signal
import subprocess
import time

from live_test import (PATIENCE, Device, Program, check_database, check_ledger, check_replay, check_rows,
                       check_summary, committed_steps, end_well, expect_events, expect_reasons, member, number, query,
                       wait_for_steps, wait_until)
from twinlock_test import PLAIN_LIVE, PROGRAM, Skip, at_most, edited_config, expect, expect_line, expect_no_line, json, main, scratch

OMEGA = 62.981  # rad/s: where config/motor's twin starts


def disk_config(device):
    return edited_config(PLAIN_LIVE, {"duration_s": None, "record": {"commit_s": 0.1, "resume_s": 0},
                                             "sources": {"inverter": {"modbus_tcp": {"port": device.port}}}})


def expect_kept_up(told):
    """Checks that each tick was computed or skipped, in spite of the full disk."""
    expect(told["steps"] + told["skipped"] == told["ticks"] > 0, f"{told}")
    check_ledger(told, told["ticks"] + told["evaluations"])


class SmallDisk(Program):
    """`run` with its own file system of 16 MiB at `folder`."""

    MOUNT = 'mount -t tmpfs -o size=16m none "$0" && exec "$@"'

    def __init__(self, folder, *args, mount=MOUNT):
        wrapped = ["unshare", "-Urm", "sh", "-c", mount, str(folder), PROGRAM, *args]
        super().__init__(*wrapped[1:], executable=wrapped[0])


def expect_small_disks():
    trial = ["unshare", "-Urm", "sh", "-c", SmallDisk.MOUNT, scratch(), "true"]
    there = shutil.which("unshare") is not None
    if not there or subprocess.run(trial, capture_output=True, check=False).returncode != 0:
        raise Skip("a file system of its own is not permitted here")


def test_full_disk():
    expect_small_disks()
    folder = scratch()
    with Device(OMEGA) as device:
        config = disk_config(device)
        with SmallDisk(folder, "run", config, "--json", "--db", folder / "twin.db") as live:
            live.wait_for("connected")
            disk = os.open(f"/proc/{live.pid}/root{folder}", os.O_RDONLY)  # valid after the program's end
            wait_until(lambda: written(disk) > 100_000, "something in the database", live.log)
            ballast = os.open("ballast", os.O_WRONLY | os.O_CREAT, dir_fd=disk)
            fill(ballast)
            live.wait_for("cannot write")
            os.ftruncate(ballast, 0)
            live.wait_for("again after")
            before = written(disk)
            wait_until(lambda: written(disk) > before, "more in the database", live.log)
            told, _ = end_well(live, signal.SIGTERM)
        database = scratch() / "twin.db"
        for name in os.listdir(disk):
            if name.startswith("twin.db"):
                with open(os.open(name, os.O_RDONLY, dir_fd=disk), "rb") as source:
                    (database.parent / name).write_bytes(source.read())
        os.close(ballast)
        os.close(disk)
    expect_kept_up(told)
    check_database(database)
    rows = check_summary(told, database)
    expect_events(database, ("error", "cannot write"), ("info", "again after"))
    lost = number(database, "SELECT entries_lost FROM runs")
    expect(lost == 0, f"{lost} entries were lost, although the queues had space")
    check_replay(config, database, rows)


def written(disk):
    """The size of the write-ahead log, which only grows in such a short run."""
    try:
        return os.stat("twin.db-wal", dir_fd=disk).st_size
    except FileNotFoundError:
        return 0


def fill(file):
    """Writes until there is no space left, not even for one byte."""
    size = 1 << 20
    while size > 0:
        try:
            os.write(file, bytes(size))
        except OSError as reason:
            expect(reason.errno == errno.ENOSPC, f"the ballast cannot be written: {reason}")
            size //= 2


def test_full_disk_at_an_orderly_end():
    """The account reports an orderly end, although there is no space for a new file."""
    expect_small_disks()
    folder = scratch()
    with Device(OMEGA) as device:
        arguments = "--supervise", "--state", folder / "state", "--db", scratch() / "twin.db"
        with SmallDisk(folder, "run", disk_config(device), *arguments) as live:
            live.wait_for("connected")
            disk = os.open(f"/proc/{live.pid}/root{folder}", os.O_RDONLY)
            account = os.open("state/supervisor.json", os.O_RDONLY, dir_fd=disk)
            expect(json.loads(os.read(account, 4096))["running"], "not running")
            fill(os.open("ballast", os.O_WRONLY | os.O_CREAT, dir_fd=disk))
            code, _, log = live.end(signal.SIGTERM)
            expect(code == 0, f"{code}\n{log}")
            expect_no_line(log, "restarts")  # a warning if the account cannot be saved
            expect(not json.loads(os.pread(account, 4096, 0))["running"], "the account says that it still runs")


def test_a_state_that_can_only_be_read():
    """As after a fault of a memory card. The run must start anyway."""
    expect_small_disks()
    folder = scratch()
    mount = 'mount -t tmpfs none "$0" && mount -o remount,ro "$0" && exec "$@"'
    with Device(OMEGA) as device:
        config = disk_config(device)
        arguments = "--supervise", "--state", folder, "--control", scratch() / "control", "--db", scratch() / "twin.db"
        with SmallDisk(folder, "run", config, *arguments, mount=mount) as live:
            live.wait_for("connected")
            live.wait_for(f"error|--state {folder}")
            live.wait_for(f"error|{folder}|{config}")
            code, _, log = live.end(signal.SIGTERM)
            expect(code == 0, f"{code}\n{log}")


def limit_files(live, size):
    """Limits the size of the recorder's files from now on."""
    recorder = member(live, "recorder")
    hard = resource.prlimit(recorder, resource.RLIMIT_FSIZE)[1]
    resource.prlimit(recorder, resource.RLIMIT_FSIZE, (size, hard))


def test_disk_that_stays_full():
    with Device(OMEGA) as device:
        config = disk_config(device)
        database = config.parent / "twin.db"
        with Program("run", config, "--json") as live:
            wait_for_steps(live, database, 20)
            limit_files(live, os.stat(f"{database}-wal").st_size)
            live.wait_for("cannot write")
            kept = committed_steps(database)
            begun = time.monotonic()
            wait_until(lambda: time.monotonic() > begun + 0.3, "a few more ticks")
            code, out, log = live.end(signal.SIGTERM)
            at_most(time.monotonic() - begun, PATIENCE, "seconds to the end, 2 of them a time-out")
        expect(code == 75, f"it ended with {code}\n{log}")
        expect_kept_up(json.loads(out))
        check_database(database)
        rows = check_rows(database)
        expect(rows >= kept, f"{rows} steps are left of {kept}")
        expect(query(database, "SELECT ended FROM runs") == [(None,)], "the run has an end, on a full disk")
        with Program("run", config, "--json", "--duration", "0.3") as live:
            told, _ = end_well(live)
        check_summary(told, database, run=2)
        expect_reasons(database, "cleanly", "duration")


if __name__ == "__main__":
    main()
