#!/usr/bin/env python3
"""FMUs that attack the parent of the FMU process: by endless requests, lies in shared memory, and their output.

Each run ends with 70 and a message, or continues. The recorded data stays readable."""
import json
import os
import re
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
import zipfile
from contextlib import closing
from pathlib import Path
from unittest import mock

from hostile_fmu import DESCRIPTION, config, make
from twinlock_test import PATIENCE, SANITIZER, at_least, at_most, expect, expect_line, finish, has_line, main, run, scratch, start

CLONE_FS, CLONE_FILES = 0x200, 0x400


def recording():
    """Options with which `plant` runs the FMUs in another process."""
    return ("--record", scratch() / "rows.csv")


def seconds_of(*args, **options):
    begun = time.monotonic()
    code, out, log = run(args, **options)
    return time.monotonic() - begun, code, out, log


def expect_end(args, parts, most, code=70):
    """Ends with `code` within `most` seconds, and a line of the log has `parts`."""
    lasted, ended, _, log = seconds_of(*args)
    expect(ended == code and has_line(log, parts), f"{args[0]} ended with {ended} after {lasted:.1f} s\n{log[-3000:]}")
    if not SANITIZER:
        at_most(lasted, most * PATIENCE, f"seconds of {args[0]}")


class Background:
    """A program whose log is a file."""

    def __init__(self, *args):
        self.log = scratch() / "log"
        with open(self.log, "wb") as file:
            self.process = start(args, stderr=file, stdout=subprocess.DEVNULL)

    def wait_for(self, text):
        until = time.monotonic() + 60 * PATIENCE
        while text not in self.said():
            expect(time.monotonic() < until and self.process.poll() is None, f"no {text} in the log\n{self.said()}")
            time.sleep(0.02)

    def said(self):
        return self.log.read_text(encoding="utf-8", errors="backslashreplace")

    def end(self, timeout):
        code, _, _ = finish(self.process, timeout)
        return code, self.said()


HANGS = "FMU hostile|fmi2DoStep|--call-limit"  # a call that does not return
SILENT = "process|killed|--call-limit"  # no progress, and no reliable call
TWICE = "twice|SIGINT"


# ---- endless requests ----

def test_hammering_does_not_keep_the_call_limit_away():
    expect_end(("replay", config(make("liar", HOW="hammer")), "--call-limit", "2"), f"{HANGS}|2 s", 20)


def test_hammering_does_not_keep_the_call_limit_away_of_a_plant():
    expect_end(("plant", config(make("liar", HOW="hammer")), *recording(), "--call-limit", "1"), f"{HANGS}|1 s", 20)


def test_hammering_does_not_keep_signals_away():
    program = Background("replay", config(make("liar", HOW="hammer")))
    program.wait_for("hanging")
    program.process.send_signal(signal.SIGINT)
    time.sleep(1.5)
    program.process.send_signal(signal.SIGINT)
    code, log = program.end(20)
    expect(code == 70, f"ended with {code}\n{log}")
    expect_line(log, TWICE)


def test_hammering_does_not_keep_bounds_away():
    expect_end(("replay", config(make("liar", HOW="hammer", MEBIBYTES=600))), "error|killed|MB|folder", 50)


# ---- lies about the current call ----

def test_lies_about_calls_do_not_last():
    """The process is killed after ten times the limit without a call, or a hundred times with calls without progress.

    If the scheduler does not run the FMU for as long as the limit, there is no lie, and the test repeats the run."""
    for how, limit, most in (("no call", "0.3", 20), ("toggle", "0.3", 40), ("begun", "0.1", 40)):
        for _ in range(5):
            lasted, code, _, log = seconds_of("replay", config(make("liar", HOW=how)), "--call-limit", limit)
            if not has_line(log, HANGS):
                break
        expect(code == 70 and has_line(log, SILENT), f"{how}: ended with {code} after {lasted:.1f} s\n{log[-3000:]}")
        if not SANITIZER:
            at_most(lasted, most * PATIENCE, f"seconds of {how}")


def test_lies_about_calls_do_not_last_on_a_plant():
    expect_end(("plant", config(make("liar", HOW="no call")), *recording(), "--call-limit", "0.1"), SILENT, 20)


def test_lies_about_calls_do_not_keep_signals_away():
    programs = [Background("replay", config(make("liar", HOW=how))) for how in ("no call", "toggle", "begun")]
    for program in programs:
        program.wait_for("hanging")
        program.process.send_signal(signal.SIGINT)
    time.sleep(1.5)
    for program in programs:
        program.process.send_signal(signal.SIGINT)
    for program in programs:
        code, log = program.end(20)
        expect(code == 70, f"ended with {code}\n{log}")
        expect_line(log, TWICE)


def test_signals_to_itself_change_nothing():
    """Only the parent process ends the FMU process."""
    _, wanted, _ = run(("replay", config(make("good")), "--json"))
    for number in (signal.SIGINT, signal.SIGTERM):
        fmu = make("liar", HOW="signal", NUMBER=int(number))
        code, _, log = run(("plant", config(fmu), *recording()))
        expect(code == 0 and has_line(log, "101 rows"), f"plant ended with {code}\n{log}")
        code, out, log = run(("replay", config(fmu), "--json", "--call-limit", "2"))
        expect(code == 0 and json.loads(out)["steps"] == json.loads(wanted)["steps"], f"replay ended with {code}\n{log}")


def test_a_signal_that_comes_early_ends_in_order():
    path = config(make("good"))
    for wait in range(0, 60, 2):
        process = start(("replay", path, "--realtime"))
        time.sleep(0.05 + wait / 1000)
        process.send_signal(signal.SIGINT)
        _, log = process.communicate(timeout=30 * PATIENCE)
        code = process.returncode  # that of the signal, if it came before the program's handler
        expect(code in (75, -signal.SIGINT) and not has_line(log, "by signal"), f"after {wait} ms it ended with {code}\n{log}")


# ---- lies about its end ----

def test_an_end_without_a_reason_is_logged():
    """The FMU claims the end of the run during a step, or a failure while it is built, with an empty message."""
    ended, built = 8, 5
    last, first = make("liar", HOW="failed", NUMBER=ended), make("liar", HOW="failed", NUMBER=built, AT="fmi2Instantiate", CALL=1)
    for fmu, verb, options, word in ((last, "replay", (), "ended"), (last, "plant", recording(), "ended"),
                                     (first, "replay", (), "failed"), (first, "plant", recording(), "failed")):
        code, _, log = run((verb, config(fmu), *options))
        expect(code == 70 and log.count("twinlock: error: ") == 1, f"{verb} ended with {code}\n{log}")
        expect_line(log, f"error|FMU process|{word}")


# ---- threads ----

def test_no_thread_has_its_own_descriptors():
    for verb, options in (("replay", tuple), ("plant", recording)):
        for flags in (0, CLONE_FILES, CLONE_FS):
            code, _, log = run((verb, config(make("liar", HOW="pipes", NUMBER=flags)), *options()))
            expect(code == 0 and "a thread apart: Operation not permitted" in log, f"ended with {code}\n{log}")
        code, _, log = run((verb, config(make("liar", HOW="unshare")), *options()))
        expect(code == 0 and "descriptors apart: Operation not permitted" in log, f"ended with {code}\n{log}")


# ---- environment and files ----

def test_fmus_do_not_get_secrets_of_the_environment():
    path = config(make("liar", HOW="environment"))
    for command, secret in ((("replay", path), False), (("replay", path, "--unconfined"), True),
                            (("plant", path, *recording()), False), (("plant", path, "--unconfined", *recording()), True)):
        with mock.patch.dict(os.environ, {"MY_SECRET": "4711", "TZ": "Europe/Berlin", "OMP_NUM_THREADS": "1"}):
            code, _, log = run(command)
        expect(code == 0 and ("MY_SECRET" in log) == secret, f"{command}: ended with {code}\n{log}")
        expect("has TZ=Europe/Berlin" in log and "has OMP_NUM_THREADS=1" in log and "has PATH=" in log, log)


def test_a_python_in_a_home_opens_no_home():
    """A Python below the home does not open the home, with its private keys, to FMUs. Only the library folder is readable."""
    home = scratch()
    (home / "bin").mkdir()
    (home / "bin" / "python3").symlink_to(sys.executable)
    (home / "lib").mkdir()
    (home / "key").write_text("a private key", encoding="utf-8")
    path = config(make("liar", HOW="read", FILE_NAME=str(home / "key")))
    for variables in ({"PATH": f"{home}/bin:{os.environ['PATH']}"}, {"PYTHONPATH": str(home)}, {"LD_LIBRARY_PATH": str(home)}):
        with mock.patch.dict(os.environ, {"HOME": str(home), **variables}):
            code, _, log = run(("replay", path), cwd=home)
            _, page, _ = run(("check", path), cwd=home)
        expect(code == 0 and "has read nothing" in log, f"{variables}: ended with {code}\n{log}")
        expect(f"    {home}\n" not in page and (f"    {home}/lib\n" in page) == ("PATH" in variables), f"{variables}\n{page}")


# ---- output ----

def test_output_of_fmus_is_limited():
    program = Background("replay", config(make("liar", HOW="flood", MEBIBYTES=60)))
    code, _ = program.end(60)
    log = program.log.read_bytes()
    text = log.decode(errors="backslashreplace")
    ours = "\n".join(line for line in text.splitlines() if line.startswith("twinlock: warning"))
    expect(code == 0, f"ended with {code}\n{ours}")
    expect_line(ours, "FMUs print")
    expect_line(ours, LEFT_OUT)
    at_least(len(log), 32 << 20, "bytes of the log")
    at_most(len(log), 40 << 20, "bytes of the log")


def test_the_page_of_a_check_is_limited():
    page = scratch() / "page"
    with open(page, "wb") as file:
        code, _, log = finish(start(("check", config(make("liar", HOW="page", CALL=1, MEBIBYTES=200))), stdout=file), 60)
    expect(code == 70, f"ended with {code}\n{log}")
    expect_line(log, "error|killed|page|check|67 MB")
    at_most(page.stat().st_size, 65 << 20, "bytes of the page")


def test_a_closed_page_is_logged():
    code, _, log = run(("check", config(make("liar", HOW="no page", CALL=1))))
    expect(code == 70, f"ended with {code}\n{log}")
    expect_line(log, "error|page|check|closed")


def test_forged_severities_are_ignored():
    code, _, log = run(("replay", config(make("liar", HOW="levels"))))
    expect(code == 0 and "fmu: <0>forged 0\nfmu: <2>forged 2\n" in log and "\nfmu: twinlock: error: forged\n" in log, f"ended with {code}\n{log}")


# ---- advice ----

def test_no_advice_to_remove_a_device():
    code, _, log = run(("plant", config(make("good")), "--record", "/dev/null"))
    expect(code != 0 and has_line(log, "error|/dev/null|File exists") and "remove" not in log, f"ended with {code}\n{log}")


# ---- texts with control characters ----

OBEYED = re.compile(rb"[\x00-\x08\x0b-\x1f\x7f]|\xc2[\x80-\x9f]|\xe2\x80[\xa8-\xae]")  # a terminal obeys these; not \n and \t


def test_control_characters_are_removed():
    """The log, the report and the database have none, and stay readable."""
    for how, parts in (("bad name", "error|fmi2DoStep|2 s|--call-limit"), ("bad error", "error")):
        database, page, log = scratch() / "twin.db", scratch() / "page.html", scratch() / "log"
        with open(log, "wb") as file:
            code, _, _ = finish(start(("replay", config(make("liar", HOW=how)), "--call-limit", "2", "--db", database, "--report", page),
                                      stderr=file, stdout=subprocess.DEVNULL), 60)
        expect(code == 70 and has_line(log.read_text(encoding="utf-8"), parts), f"{how}: ended with {code}\n{log.read_bytes()}")
        if page.exists():
            page.read_text(encoding="utf-8")
        expect(not OBEYED.search(log.read_bytes()), f"{how}: {log.read_bytes()}")
        with closing(sqlite3.connect(database)) as connection:
            for text, in connection.execute("SELECT ended_reason FROM runs UNION ALL SELECT text FROM events"):
                expect(text is None or not OBEYED.search(text.encode()), f"{how}: {text!r} in the database")
        code, shown, complaint = run(("show", database))
        expect(code == 0 and "hostile" in shown, f"{how}: show ended with {code}\n{complaint}")


def test_control_characters_in_a_unit_are_replaced():
    """In an honest FMU; check and replay agree about it."""
    fmu = shutil.copy(make("good"), scratch() / "unit.fmu")
    description = DESCRIPTION.read_text(encoding="utf-8")
    for unit in ("&#x85;m", "&#x202E;m"):
        changed = description.replace('unit="1"', f'unit="{unit}"').replace('<Unit name="1"', f'<Unit name="{unit}"')
        expect(changed != description, "has no unit to change")
        subprocess.run(["zip", "-q", "-d", fmu, "modelDescription.xml"], check=True)
        with zipfile.ZipFile(fmu, "a") as archive:
            archive.writestr("modelDescription.xml", changed)
        path = config(fmu)
        for verb in ("check", "replay"):
            code, out, log = run((verb, path))
            expect(code == 0 and not OBEYED.search(out.encode()), f"{verb} ended with {code}\n{log}{out!r}")


# ---- a log without a reader ----

LEFT_OUT = "warning|lines|FMU"

def children(pid):
    return Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="ascii").split()


def expect_killed_unread(*options, asks=0):
    """The FMU process is killed although the pipe of the log is full. When the test reads the log, the program ends; returns the log."""
    fmu = make("liar", HOW="flood", MEBIBYTES=1, HANGS=True)
    process = start(("replay", config(fmu), *options), stdout=subprocess.DEVNULL)
    time.sleep(4 * PATIENCE)
    for _ in range(asks):
        process.send_signal(signal.SIGINT)
        time.sleep(1.5)
    until = time.monotonic() + 20 * PATIENCE
    while any(state(child) not in "ZX" for child in children(process.pid)):
        expect(time.monotonic() < until, f"{options}: still runs with a full pipe")
        time.sleep(0.05)
    code, _, log = finish(process, 30)
    expect(code == 70 and has_line(log, LEFT_OUT), f"ended with {code}\n{log[-3000:]}")
    return log


def state(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0]
    except OSError:
        return "X"


def test_a_log_without_a_reader_does_not_keep_the_call_limit_away():
    log = expect_killed_unread("--call-limit", "10")
    expect(has_line(log, f"{HANGS}|10 s"), log[-3000:])


def test_a_log_without_a_reader_does_not_keep_signals_away():
    log = expect_killed_unread(asks=2)
    expect(has_line(log, TWICE), log[-3000:])


main()
