#!/usr/bin/env python3
"""script/studies/foreign: it runs FMUs of PythonFMU, and reports why one does not run or has other bits."""
import json
import os
import shutil
import subprocess
import sys

import foreign
from python_fmu import export
from twinlock_test import NOT_LOCKED, PATIENCE, PROGRAM, SANITIZER, SKIPPED, SOURCE, expect, expect_line, main, scratch

if SANITIZER:
    print("skipped: the studies use build/host")  # test_python_fmu.py runs such FMUs with the program
    sys.exit(SKIPPED)

# Idle threads of numpy spin for 2^26 cycles by default, which takes half of the time. 4: they sleep after 2^4.
os.environ["OPENBLAS_THREAD_TIMEOUT"] = "4"

SLAVE = """
import time
from pythonfmu import Fmi2Causality, Fmi2Slave, Integer, Real, String

class {name}(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.u, self.x, self.y, self.count, self.text, self.note = 0.0, 0.0, 0.0, 0, "", ""
        self.register_variable(Real("u", causality=Fmi2Causality.input))
        self.register_variable(String("text", causality=Fmi2Causality.input))
        self.register_variable({result}, causality=Fmi2Causality.{causality}))
        {more}

    def do_step(self, current_time, step_size):
        {body}
        return True
"""


def slave(name, body, *options, result='Real("y"', causality="output", more=""):
    source = SLAVE.format(name=name, body=body, result=result, causality=causality, more=more)
    return export(name.lower(), *options, source=source)


def study(fmus, *options):
    """(exit code, standard output, standard error) of script/studies/foreign.py, without its shell script."""
    folder = scratch()
    for fmu in fmus:
        shutil.copy(fmu, folder)
    command = [sys.executable, SOURCE / "script" / "studies" / "foreign.py", "--fmus", folder, "--program", PROGRAM,
               "--steps", "5", "--limit", "60", *options]
    path = os.path.dirname(sys.executable) + ":" + os.environ["PATH"]  # numpy is the tests' own
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=200 * PATIENCE, check=False,
                          env={**os.environ, "PATH": path})
    return done.returncode, done.stdout, done.stderr


def found_by(fmus, *options):
    """(exit code, {FMU: result})."""
    code, out, err = study(fmus, "--json", *options)
    expect(not err, err)
    return code, {result["fmu"]: result for result in json.loads(out)["fmus"]}


def test_the_mode_of_each():
    fmus = [export("plant", "--handle-state"), slave("NoState", "self.y += self.u"),  # rolled back by replay
            slave("Inner", "self.y += self.u", causality="local"),
            slave("Counts", "self.count += 1", result='Integer("count"'),
            slave("Nothing", "pass", result='String("note"', causality="parameter")]
    code, found = found_by(fmus)
    expect(code == 0, found)
    modes = {name: result["mode"] for name, result in found.items()}
    expect(modes == {"Plant.fmu": foreign.LOCKED, "NoState.fmu": foreign.LOCKED, "Inner.fmu": foreign.LOCKED,
                     "Counts.fmu": foreign.LOCKED, "Nothing.fmu": foreign.ALONE}, modes)
    for result in found.values():
        codes = result["outcomes"]["now"]["codes"]
        expect(codes["check"] == 0 and codes["replay"] in (0, NOT_LOCKED), result)
        expect(result["same_bits"] is None, result)


def test_one_that_cannot_be_locked_runs_free():
    """Each execution has another result."""
    code, found = found_by([slave("Hides", "self.y = time.perf_counter()", "--handle-state")])
    result = found["Hides.fmu"]
    expect(code == 0 and result["mode"] == foreign.COMPARED, result)
    expect_line(result["why_not_locked"], "fmu.y|1|step")


def test_why_one_does_not_run():
    broken = scratch() / "broken.fmu"
    broken.write_bytes(b"no archive")
    code, found = found_by([broken, slave("Raises", "raise ValueError('wrong')")], "--keep", scratch())
    expect(code == 0, found)
    expect(found["broken.fmu"]["outcomes"]["now"]["why"].startswith("no FMU"), found["broken.fmu"])
    raises = found["Raises.fmu"]["outcomes"]["now"]
    expect(not raises["runs"] and raises["codes"]["replay"] == 70 and "fmi2DoStep" in raises["why"], raises)


def test_one_that_takes_too_long():
    code, found = found_by([slave("Sleeps", "time.sleep(600)")], "--limit", "3")
    now = found["Sleeps.fmu"]["outcomes"]["now"]
    expect(code == 0, found)
    expect_line(now["why"], "check|--limit")


def other_bits(change):
    """A script that runs twinlock and then a line of shell."""
    program = scratch() / "twinlock"
    program.write_text(f'#!/bin/sh\n"{PROGRAM}" "$@"\ncode=$?\n{change}\nexit $code\n', encoding="utf-8")
    program.chmod(0o755)
    return program


def test_same_bits_and_others():
    """One changed cell is found. Values that differ in each run are ignored; the others still count."""
    fmus = [slave("Steady", "self.y += self.u"),
            slave("Jittery", "self.y = time.perf_counter(); self.x += 1", more='self.register_variable(Real("x", causality='
                                                                              'Fmi2Causality.output))')]
    code, found = found_by(fmus, "--before", PROGRAM)
    expect(code == 0, found)
    expect(found["Steady.fmu"]["same_bits"] is True and not found["Steady.fmu"]["unsteady"], found)
    expect(found["Jittery.fmu"]["same_bits"] is True and found["Jittery.fmu"]["unsteady"] == ["fmu.y simulated"], found)
    changed = other_bits("[ ! -f now.csv ] || sed -i '$s/good/stale/g' now.csv")
    code, found = found_by(fmus, "--before", PROGRAM, "--program", changed)
    expect(code == 1 and [result["same_bits"] for result in found.values()] == [False, False], found)


def failing(text):
    """A program that logs `text` and fails."""
    program = scratch() / "twinlock"
    program.write_text(f"#!/bin/sh\necho 'twinlock: {text}' >&2\nexit 70\n", encoding="utf-8")
    program.chmod(0o755)
    return program


def test_one_that_ran_before():
    """The program under test reports a denied call and fails; then an older one does, with the message of that time."""
    under_test, older = (failing(text) for text in ("warning: FMU fmu: system call execve denied in fmi2Instantiate (reported once)",
                                                    "error: fmu asked for execve in fmi2Instantiate"))
    fmu = slave("Asks", "self.y += self.u")
    code, out, err = study([fmu], "--before", PROGRAM, "--program", under_test)
    expect(code == 1 and not err, err)
    lines = [line.split() for line in out.splitlines()]
    expect(lines[1][:6] == ["Asks.fmu", "locked", "yes", "no", "-", "execve"], out)
    expect(lines[-1][:4] == ["kept:", "0", "of", "1"], out)
    code, out, _ = study([fmu], "--before", older)
    expect(code == 0 and out.splitlines()[1].split()[2:4] == ["no", "yes"], out)


def test_confined_and_unconfined():
    """The bits are the same, also with threads of numpy and with a temporary file. An FMU that starts a program fails, and the
    report names the refused call."""
    fmus = [export("plant", "--handle-state"),
            slave("Numeric", "import numpy; self.y += float(numpy.linalg.solve(numpy.eye(300) + 1, numpy.full(300, self.u))[0])"),
            slave("Notes", "import tempfile; file = tempfile.TemporaryFile(); self.y += self.u + file.write(b'1')"),
            slave("Starts", "import subprocess; self.y += self.u + subprocess.run(['true']).returncode")]
    code, found = found_by(fmus, "--before-options=--unconfined")
    expect(code == 1, found)
    for name in ("Plant.fmu", "Numeric.fmu", "Notes.fmu"):
        expect(found[name]["same_bits"] is True and not found[name]["unsteady"], found[name])
    before, now = found["Starts.fmu"]["outcomes"].values()
    expect(before["runs"] and not before["refused"] and not now["runs"], found["Starts.fmu"])
    expect(any(" in fmi2DoStep" in call for call in now["refused"]), found["Starts.fmu"])


def test_nothing_to_run():
    code, out, err = study([])
    expect(code == 65 and not out and err.count("\n") == 1 and "no FMU" in err, f"{code}\n{out}{err}")


main()
