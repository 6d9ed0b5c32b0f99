#!/usr/bin/env python3
"""FMUs that attack who watches them: by asking without end, by lies in the memory that they share, by what they print. Each of them ends with 70 and a
sentence, or its run goes on; and what was kept of the run can be read."""
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
from twinlock_test import PATIENCE, SANITIZER, at_least, at_most, expect, finish, main, run, scratch, start

CLONE_FS, CLONE_FILES = 0x200, 0x400


def recording():
    """What `plant` needs besides, for a process of its own."""
    return ("--record", scratch() / "rows.csv")


def seconds_of(*args, **options):
    begun = time.monotonic()
    code, out, log = run(args, **options)
    return time.monotonic() - begun, code, out, log


def expect_end(args, said, most, code=70):
    """With that sentence, and in time."""
    lasted, ended, _, log = seconds_of(*args)
    expect(ended == code and said in log, f"{args[0]} ended with {ended} after {lasted:.1f} s\n{log[-3000:]}")
    if not SANITIZER:
        at_most(lasted, most * PATIENCE, f"seconds of {args[0]}")


class Background:
    """A program, and what it says, in a file."""

    def __init__(self, *args):
        self.log = scratch() / "log"
        with open(self.log, "wb") as file:
            self.process = start(args, stderr=file, stdout=subprocess.DEVNULL)

    def wait_for(self, text):
        until = time.monotonic() + 60 * PATIENCE
        while text not in self.said():
            expect(time.monotonic() < until and self.process.poll() is None, f"does not say {text}\n{self.said()}")
            time.sleep(0.02)

    def said(self):
        return self.log.read_text(encoding="utf-8", errors="backslashreplace")

    def end(self, timeout):
        code, _, _ = finish(self.process, timeout)
        return code, self.said()


# ---- who asks without end ----

def test_hammering_does_not_keep_the_call_limit_away():
    expect_end(("replay", config(make("liar", HOW="hammer")), "--call-limit", "2"), "has not returned from fmi2DoStep for 2 s", 20)


def test_hammering_does_not_keep_the_call_limit_away_of_a_plant():
    expect_end(("plant", config(make("liar", HOW="hammer")), *recording(), "--call-limit", "1"),
               "has not returned from fmi2DoStep for 1 s", 20)


def test_hammering_does_not_keep_signals_away():
    program = Background("replay", config(make("liar", HOW="hammer")))
    program.wait_for("hanging")
    program.process.send_signal(signal.SIGINT)
    time.sleep(1.5)
    program.process.send_signal(signal.SIGINT)
    code, log = program.end(20)
    expect(code == 70 and "asked twice to end, by SIGINT" in log, f"ended with {code}\n{log}")


def test_hammering_does_not_keep_bounds_away():
    expect_end(("replay", config(make("liar", HOW="hammer", MEBIBYTES=600))), "in the folder of the FMUs", 50)


# ---- lies about the call that is under way ----

def test_lies_about_calls_do_not_last():
    """Ten times the limit without a call, or a hundred times with calls that come to nothing. A liar that had no turn for as long as the limit has not lied, and
    is told for what it is: who sees that tries again."""
    for how, limit, most in (("no call", "0.3", 20), ("toggle", "0.3", 40), ("begun", "0.1", 40)):
        for _ in range(5):
            lasted, code, _, log = seconds_of("replay", config(make("liar", HOW=how)), "--call-limit", limit)
            if "has not returned from fmi2DoStep" not in log:
                break
        expect(code == 70 and "s nothing came of it" in log, f"{how}: ended with {code} after {lasted:.1f} s\n{log[-3000:]}")
        if not SANITIZER:
            at_most(lasted, most * PATIENCE, f"seconds of {how}")


def test_lies_about_calls_do_not_last_on_a_plant():
    expect_end(("plant", config(make("liar", HOW="no call")), *recording(), "--call-limit", "0.1"), "s nothing came of it", 20)


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
        expect(code == 70 and "asked twice to end, by SIGINT: ended at once" in log, f"ended with {code}\n{log}")


def test_signals_to_itself_change_nothing():
    """Only its parent ends it."""
    _, wanted, _ = run(("replay", config(make("good")), "--json"))
    for number in (signal.SIGINT, signal.SIGTERM):
        fmu = make("liar", HOW="signal", NUMBER=int(number))
        code, _, log = run(("plant", config(fmu), *recording()))
        expect(code == 0 and "played to the end" in log, f"plant ended with {code}\n{log}")
        code, out, log = run(("replay", config(fmu), "--json", "--call-limit", "2"))
        expect(code == 0 and json.loads(out)["steps"] == json.loads(wanted)["steps"], f"replay ended with {code}\n{log}")


def test_a_signal_that_comes_early_ends_in_order():
    path = config(make("good"))
    for wait in range(0, 60, 2):
        process = start(("replay", path, "--realtime"))
        time.sleep(0.05 + wait / 1000)
        process.send_signal(signal.SIGINT)
        _, log = process.communicate(timeout=30 * PATIENCE)
        code = process.returncode  # by the signal, if it came before the program had begun
        expect(code in (75, -signal.SIGINT) and "ended by signal" not in log, f"after {wait} ms it ended with {code}\n{log}")


# ---- lies about its end ----

def test_who_fails_and_does_not_say_why_is_told():
    """By its last word in a step; and by the one after building, for which it has a log of its own."""
    ended, built = 8, 5
    last, first = make("liar", HOW="failed", NUMBER=ended), make("liar", HOW="failed", NUMBER=built, AT="fmi2Instantiate", CALL=1)
    silent, failed = "the process of the FMUs has ended, and does not say why", "the process of the FMUs has failed, and does not say why"
    for fmu, verb, options, said in ((last, "replay", (), silent), (last, "plant", recording(), silent),
                                     (first, "replay", (), failed), (first, "plant", recording(), failed)):
        code, _, log = run((verb, config(fmu), *options))
        expect(code == 70 and log.count("twinlock: error: ") == 1 and f"{said}\n" in log, f"{verb} ended with {code}\n{log}")


# ---- what a thread has besides ----

def test_no_thread_has_descriptors_of_its_own():
    for verb, options in (("replay", tuple), ("plant", recording)):
        for flags in (0, CLONE_FILES, CLONE_FS):
            code, _, log = run((verb, config(make("liar", HOW="pipes", NUMBER=flags)), *options()))
            expect(code == 0 and "a thread apart: Operation not permitted" in log, f"ended with {code}\n{log}")
        code, _, log = run((verb, config(make("liar", HOW="unshare")), *options()))
        expect(code == 0 and "descriptors apart: Operation not permitted" in log, f"ended with {code}\n{log}")


# ---- what it finds around it ----

def test_secrets_in_the_environment_are_not_handed_on():
    path = config(make("liar", HOW="environment"))
    for command, secret in ((("replay", path), False), (("replay", path, "--unconfined"), True),
                            (("plant", path, *recording()), False), (("plant", path, "--unconfined", *recording()), True)):
        with mock.patch.dict(os.environ, {"MY_SECRET": "4711", "TZ": "Europe/Berlin", "OMP_NUM_THREADS": "1"}):
            code, _, log = run(command)
        expect(code == 0 and ("MY_SECRET" in log) == secret, f"{command}: ended with {code}\n{log}")
        expect("has TZ=Europe/Berlin" in log and "has OMP_NUM_THREADS=1" in log and "has PATH=" in log, log)


def test_a_python_in_a_home_opens_no_home():
    """As a private key beside it; a component may still name what it reads."""
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


# ---- how much it prints ----

def test_what_it_prints_has_an_end():
    program = Background("replay", config(make("liar", HOW="flood", MEBIBYTES=60)))
    code, _ = program.end(60)
    log = program.log.read_bytes()
    expect(code == 0 and b"what they print from here on is left out" in log and b"lines that FMUs have printed were left out" in log,
           f"ended with {code}")
    at_least(len(log), 32 << 20, "bytes of the log")
    at_most(len(log), 40 << 20, "bytes of the log")


def test_the_page_of_a_check_has_an_end():
    page = scratch() / "page"
    with open(page, "wb") as file:
        code, _, log = finish(start(("check", config(make("liar", HOW="page", CALL=1, MEBIBYTES=200))), stdout=file), 60)
    expect(code == 70 and "the page of the check is longer than 67 MB" in log, f"ended with {code}\n{log}")
    at_most(page.stat().st_size, 65 << 20, "bytes of the page")


def test_a_page_that_is_closed_is_told():
    code, _, log = run(("check", config(make("liar", HOW="no page", CALL=1))))
    expect(code == 70 and "an FMU has closed what it is printed to" in log, f"ended with {code}\n{log}")


def test_levels_are_not_believed():
    code, _, log = run(("replay", config(make("liar", HOW="levels"))))
    expect(code == 0 and "fmu: <0>forged 0\nfmu: <2>forged 2\n" in log and "\nfmu: twinlock: error: forged\n" in log, f"ended with {code}\n{log}")


# ---- advice ----

def test_no_device_is_to_be_removed():
    code, _, log = run(("plant", config(make("good")), "--record", "/dev/null"))
    expect(code != 0 and "/dev/null cannot be written" in log and "remove" not in log, f"ended with {code}\n{log}")


# ---- texts that are none ----

OBEYED = re.compile(rb"[\x00-\x08\x0b-\x1f\x7f]|\xc2[\x80-\x9f]|\xe2\x80[\xa8-\xae]")  # with newlines and tabs left out


def test_a_text_that_is_none_goes_nowhere():
    """Neither to the log nor into a report, nor into a database, which all can still read."""
    for how, said in (("bad name", "has not returned from fmi2DoStep"), ("bad error", "")):
        database, page, log = scratch() / "twin.db", scratch() / "page.html", scratch() / "log"
        with open(log, "wb") as file:
            code, _, _ = finish(start(("replay", config(make("liar", HOW=how)), "--call-limit", "2", "--db", database, "--report", page),
                                      stderr=file, stdout=subprocess.DEVNULL), 60)
        expect(code == 70 and said in log.read_text(encoding="utf-8"), f"{how}: ended with {code}\n{log.read_bytes()}")
        if page.exists():
            page.read_text(encoding="utf-8")
        expect(not OBEYED.search(log.read_bytes()), f"{how}: {log.read_bytes()}")
        with closing(sqlite3.connect(database)) as connection:
            for text, in connection.execute("SELECT ended_reason FROM runs UNION ALL SELECT text FROM events"):
                expect(text is None or not OBEYED.search(text.encode()), f"{how}: {text!r} in the database")
        code, shown, complaint = run(("show", database))
        expect(code == 0 and "hostile" in shown, f"{how}: show ended with {code}\n{complaint}")


def test_a_unit_that_is_none_is_repaired():
    """That of an honest FMU: check and replay agree about it."""
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


# ---- a log that nobody reads ----

def children(pid):
    return Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="ascii").split()


def expect_killed_unread(*options, asks=0):
    """Its process is killed although nobody reads the log; when somebody does, the program ends, and has said why."""
    fmu = make("liar", HOW="flood", MEBIBYTES=1, HANGS=True)
    process = start(("replay", config(fmu), *options), stdout=subprocess.DEVNULL)
    time.sleep(4 * PATIENCE)
    for _ in range(asks):
        process.send_signal(signal.SIGINT)
        time.sleep(1.5)
    until = time.monotonic() + 20 * PATIENCE
    while any(state(child) not in "ZX" for child in children(process.pid)):
        expect(time.monotonic() < until, f"{options}: lives on while nobody reads")
        time.sleep(0.05)
    code, _, log = finish(process, 30)
    expect(code == 70 and "lines that FMUs have printed were left out" in log, f"ended with {code}\n{log[-3000:]}")
    return log


def state(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0]
    except OSError:
        return "X"


def test_a_log_that_nobody_reads_does_not_keep_the_call_limit_away():
    log = expect_killed_unread("--call-limit", "10")
    expect("has not returned from fmi2DoStep for 10 s" in log, log[-3000:])


def test_a_log_that_nobody_reads_does_not_keep_signals_away():
    log = expect_killed_unread(asks=2)
    expect("asked twice to end, by SIGINT" in log, log[-3000:])


main()
