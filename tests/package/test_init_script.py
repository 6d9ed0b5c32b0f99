#!/usr/bin/env python3
"""The init script for boxes without systemd, with the real program: by dash, and by busybox with nothing but busybox's
commands."""
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
from twinlock_test import PLAIN_LIVE, FMUS, PROGRAM, SOURCE, Skip, edited_config, expect, scratch

SCRIPT = SOURCE / "board/wago-pfc200/twinlock"
NO_PLANT = {"sources": {"inverter": {"modbus_tcp": {"port": 1}}}, "duration_s": None, "record": None}


def busybox():
    """Busybox of this machine, or of the rig."""
    for path in (shutil.which("busybox"), SOURCE / ".deps/rig/host/usr/bin/busybox"):
        if path and os.access(path, os.X_OK):
            return str(path)
    raise Skip("busybox is missing")


def shells():
    """{name: (command that runs a script, PATH)}"""
    applets = scratch()
    for name in subprocess.run([busybox(), "--list"], stdout=subprocess.PIPE, check=True, text=True).stdout.split():
        (applets / name).symlink_to(busybox())
    return {"dash": (["dash"], "/usr/bin:/bin"), "busybox": ([str(applets / "sh")], str(applets))}


SHELLS = shells()


class Box:
    """Settings, and a folder for all that the script writes; what was started is killed at the end of `with`."""

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
        """What the script says."""
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


def is_gone(pid):
    """Also where it waits for a parent that takes note."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes() == b""
    except FileNotFoundError:
        return True


def with_each_shell(test):
    """Runs a test once for each shell, at the same time: they mostly wait."""
    def run():
        with ThreadPoolExecutor() as pool:
            list(pool.map(test, SHELLS))
    run.__name__ = test.__name__
    return run


@with_each_shell
def test_a_day(shell):
    """Started, asked, started again, restarted, stopped, stopped again."""
    with Box(shell) as box:
        expect("does not run" in box.call("status", 3), "it runs")
        expect("started" in box.call("start"), "not started")
        first = box.pid()
        expect(f"runs, process {first}" in box.call("status"), "another one runs")
        expect(os.getsid(first) == first, "it ends with the terminal")
        expect(f"runs already, process {first}" in box.call("start") and box.pid() == first, "started twice")
        wait_until(lambda: "inverter" in box.said(), "its log", box.said)
        expect("is what is active" in box.call("reload"), "not reloaded")
        box.call("restart")
        expect(is_gone(first) and box.pid() != first, "not restarted")
        second = box.pid()
        expect("stopped" in box.call("stop") and is_gone(second) and not box.pidfile.exists(), "not stopped")
        expect("does not run" in box.call("stop"), "it ran")
        box.call("status", 3)
        left = sorted(path.name for path in box.folder.iterdir() if not path.name.startswith("twin.db"))
        expect(left == ["log", "run", "settings", "states.json", "supervisor.json", "versions"], f"left: {left}")
        reasons = subprocess.run([PROGRAM, "show", box.folder / "twin.db"], stdout=subprocess.PIPE, check=True, text=True)
        expect("SIGTERM" in reasons.stdout, reasons.stdout)


@with_each_shell
def test_it_was_killed(shell):
    with Box(shell) as box:
        box.call("start")
        first = box.pid()
        os.killpg(first, signal.SIGKILL)
        wait_until(lambda: is_gone(first), "its end")
        expect("is dead" in box.call("status", 1), "not dead")
        box.call("start")
        expect(box.pid() != first, "the same process")
        box.call("status")
        box.call("stop")


@with_each_shell
def test_its_number_was_given_to_another(shell):
    other = subprocess.Popen(["sleep", "1000"])
    try:
        with Box(shell) as box:
            box.pidfile.write_text(f"{other.pid}\n", encoding="utf-8")
            box.call("status", 1)
            expect("does not run" in box.call("stop"), "it was stopped")
            expect(other.poll() is None, "another's process was ended")
            box.pidfile.write_text(f"{other.pid}\n", encoding="utf-8")
            box.call("start")
            expect(box.pid() != other.pid and other.poll() is None, "not started")
            box.call("stop")
    finally:
        other.kill()
        other.wait()


@with_each_shell
def test_it_does_not_end(shell):
    """As when it hangs: what SIGTERM does not end within its time is killed."""
    with Box(shell, PATIENCE=1) as box:
        box.call("start")
        pid = box.pid()
        os.kill(pid, signal.SIGSTOP)
        begun = time.monotonic()
        expect("is killed" in box.call("stop"), "not killed")
        expect(is_gone(pid) and time.monotonic() - begun < 10, "it lives")


@with_each_shell
def test_what_cannot_start(shell):
    for name, value in (("PROGRAM", "/nowhere/twinlock"), ("CONFIG", "/nowhere/plant.json"), ("DATA", "/nowhere")):
        with Box(shell, **{name: value}) as box:
            said = box.call("start", 1)
            expect(f"there is no {value}" in said and not box.pidfile.exists(), said)
    with Box(shell, CONFIG=edited_config(PLAIN_LIVE, {"step_s": 0})) as box:
        expect("ended at once" in box.call("start", 1) and not box.pidfile.exists(), "started")
        expect("step_s" in box.said(), box.said())
        box.call("status", 3)


@with_each_shell
def test_usage(shell):
    with Box(shell) as box:
        expect("usage:" in box.call("rest", 2), "no usage")


twinlock_test.main()
