#!/usr/bin/env python3
"""The init script for boxes without systemd, with the real program: in dash, and in busybox with
only busybox's commands."""
import contextlib
import os
import shutil
import signal
import subprocess
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import twinlock_test
from live_test import wait_until
from twinlock_test import PLAIN_LIVE, FMUS, PROGRAM, SOURCE, Skip, edited_config, expect, expect_line, expect_no_line, scratch

SCRIPT = SOURCE / "board/wago-pfc200/twinlock"
NO_PLANT = {"sources": {"inverter": {"modbus_tcp": {"port": 1}}}, "duration_s": None, "record": None}


def busybox():
    """Path of busybox on this machine, or else of the rig's."""
    for path in (shutil.which("busybox"), SOURCE / ".deps/rig/host/usr/bin/busybox"):
        if path and os.access(path, os.X_OK):
            return str(path)
    raise Skip("busybox is missing")


def shells():
    """{name: (command that runs a script, PATH for it)}"""
    applets = scratch()
    for name in subprocess.run([busybox(), "--list"], stdout=subprocess.PIPE, check=True, text=True).stdout.split():
        (applets / name).symlink_to(busybox())
    return {"dash": (["dash"], "/usr/bin:/bin"), "busybox": ([str(applets / "sh")], str(applets))}


SHELLS = shells()


class Box:
    """Settings, and a folder for all files of the script. The end of `with` kills the started
    program."""

    def __init__(self, shell, **settings):
        self.shell, self.path = SHELLS[shell]
        self.folder = scratch()
        self.pidfile = self.folder / "pid"
        self.log = self.folder / "log"
        values = {"PROGRAM": PROGRAM, "CONFIG": edited_config(PLAIN_LIVE, NO_PLANT), "DATA": self.folder,
                  "WATCHDOG": "", "LOGGER": f"tee -a {self.log}", "PIDFILE": self.pidfile, "PATIENCE": 10,
                  "CONTROL": self.folder / "run/control", **settings}
        self.settings = self.folder / "settings"
        self.settings.write_text("".join(f"{name}='{value}'\n" for name, value in values.items()), encoding="utf-8")

    def __enter__(self):
        return self

    def __exit__(self, *unused):
        with contextlib.suppress(OSError, ValueError):
            os.killpg(int(self.pidfile.read_text()), signal.SIGKILL)

    def call(self, word, code=0):
        """Runs the script, which must end with `code`. Returns its output."""
        environment = {"PATH": self.path, "TWINLOCK_SETTINGS": str(self.settings), "TWINLOCK_FMU_PATH": str(FMUS),
                       "TMPDIR": str(scratch())}
        done = subprocess.run([*self.shell, SCRIPT, word], env=environment, stdout=subprocess.PIPE, text=True,
                              stderr=subprocess.STDOUT, timeout=60, check=False)
        expect(done.returncode == code, f"{word} ended with {done.returncode}, not {code}: {done.stdout}{self.said()}")
        return done.stdout

    def said(self):
        return self.log.read_text(encoding="utf-8") if self.log.exists() else ""

    def pid(self):
        return int(self.pidfile.read_text())


def shown(box):
    return subprocess.run([PROGRAM, "show", box.folder / "twin.db"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                          check=False, text=True)


def is_gone(pid):
    """True also for a zombie."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes() == b""
    except FileNotFoundError:
        return True


def with_each_shell(test):
    """Runs a test once for each shell, in parallel, because the tests mostly wait."""
    def run():
        with ThreadPoolExecutor() as pool:
            list(pool.map(test, SHELLS))
    run.__name__ = test.__name__
    return run


@with_each_shell
def test_a_day(shell):
    """Start, status, start again, reload, restart, stop, stop again."""
    with Box(shell) as box:
        expect_line(box.call("status", 3), "twinlock:|not")
        said = box.call("start")
        first = box.pid()
        expect_line(said, f"started|{first}")
        expect_line(box.call("status"), f"twinlock:|{first}")
        expect(os.getsid(first) == first, "it ends with the terminal")
        said = box.call("start")
        expect_line(said, f"already|{first}")
        expect(box.pid() == first, "started twice")
        wait_until(lambda: "inverter" in box.said(), "its log", box.said)
        said = box.call("reload")
        expect_line(said, "authorise|commission")
        expect_line(said, "active")
        box.call("restart")
        expect(is_gone(first) and box.pid() != first, "not restarted")
        second = box.pid()
        wait_until((box.folder / "states.json").exists, "states.json", box.said)
        wait_until(lambda: shown(box).returncode == 0, "a recorded run", box.said)
        expect("stopped" in box.call("stop") and is_gone(second) and not box.pidfile.exists(), "not stopped")
        expect_no_line(box.call("stop"), "stopped")
        box.call("status", 3)
        left = sorted(path.name for path in box.folder.iterdir() if not path.name.startswith("twin.db"))
        expect(left == ["log", "run", "settings", "states.json", "supervisor.json", "versions"], f"left: {left}")
        reasons = shown(box).stdout
        expect("SIGTERM" in reasons, reasons)


@with_each_shell
def test_it_was_killed(shell):
    with Box(shell) as box:
        box.call("start")
        first = box.pid()
        os.killpg(first, signal.SIGKILL)
        wait_until(lambda: is_gone(first), "its end")
        expect_line(box.call("status", 1), "dead")
        box.call("start")
        expect(box.pid() != first, "the same process")
        box.call("status")
        box.call("stop")


@with_each_shell
def test_another_process_has_its_number(shell):
    other = subprocess.Popen(["sleep", "1000"])
    try:
        with Box(shell) as box:
            box.pidfile.write_text(f"{other.pid}\n", encoding="utf-8")
            box.call("status", 1)
            expect_no_line(box.call("stop"), "stopped")
            expect(other.poll() is None, "the script ended another process")
            box.pidfile.write_text(f"{other.pid}\n", encoding="utf-8")
            box.call("start")
            expect(box.pid() != other.pid and other.poll() is None, "not started")
            box.call("stop")
    finally:
        other.kill()
        other.wait()


@with_each_shell
def test_it_does_not_end(shell):
    """A stopped process stands for one that hangs. The script kills it if SIGTERM does not end it
    in PATIENCE s."""
    with Box(shell, PATIENCE=1) as box:
        box.call("start")
        pid = box.pid()
        os.kill(pid, signal.SIGSTOP)
        begun = time.monotonic()
        expect_line(box.call("stop"), f"killed|{pid}|1 s")
        expect(is_gone(pid) and time.monotonic() - begun < 10, "it lives")


@with_each_shell
def test_what_cannot_start(shell):
    for name, value in (("PROGRAM", "/nowhere/twinlock"), ("CONFIG", "/nowhere/plant.json"), ("DATA", "/nowhere")):
        with Box(shell, **{name: value}) as box:
            said = box.call("start", 1)
            expect_line(said, f"not started|{value}|{box.settings}")
            expect(not box.pidfile.exists(), said)
    with Box(shell, CONFIG=edited_config(PLAIN_LIVE, {"step_s": 0})) as box:
        expect_line(box.call("start", 1), "not started|log")
        expect(not box.pidfile.exists(), "the PIDFILE is left")
        expect("step_s" in box.said(), box.said())
        box.call("status", 3)


@with_each_shell
def test_usage(shell):
    with Box(shell) as box:
        expect("usage:" in box.call("rest", 2), "no usage")


twinlock_test.main()
