#!/usr/bin/env python3
"""script/compare: a build is the same as itself, and whatever another one does otherwise is found and told as what it is."""
import os
import subprocess
import sys

from twinlock_test import FMUS, PATIENCE, PROGRAM, SOURCE, expect, main, scratch

CASE = "^second_order/without$"


def build(after="true"):
    """A build folder whose program is ours, with a line of shell after each of its calls, which may set the exit code."""
    folder = scratch()
    (folder / "fmus").symlink_to(FMUS)
    (folder / "bin").mkdir()
    program = folder / "bin" / "twinlock"
    program.write_text(f'#!/bin/sh\n"{PROGRAM}" "$@"\ncode=$?\n{after}\nexit $code\n', encoding="utf-8")
    program.chmod(0o755)
    return folder


def compare(*args):
    """(exit code, stdout, stderr) of script/compare without what bash does for it."""
    command = [sys.executable, SOURCE / "script" / "compare.py", "--jobs", "2", *args]
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=120 * PATIENCE, check=False,
                          env={**os.environ, "TL_SHARED": str(scratch())})
    return done.returncode, done.stdout, done.stderr


def expect_found(after, kind, *words, options=("--quick", "--only", CASE)):
    """The difference is an error; the line about it and the last line tell its kind."""
    code, out, err = compare(build(), build(after), *options)
    lines = out.splitlines()
    expect(code == 1 and not err and lines[-1].startswith("compare: DIFFERENT: "), f"{after}: {code}\n{out}{err}")
    expect(f" {kind}" in lines[-1], f"{after}: not of the kind {kind}\n{out}")
    for word in words:
        expect(any(word in line and f": {kind}: " in line for line in lines[:-1]), f"{after}: nothing tells {word!r}\n{out}")


def test_a_build_is_the_same_as_itself():
    code, out, err = compare(build(), build(), "--only", CASE)
    expect(code == 0 and not err and out.startswith("compare: same; 1 cases, 5 calls of each build"), f"{code}\n{out}{err}")


def test_a_value_of_a_table():
    """One digit, the last of the last row."""
    expect_found("sed -i '$s/.$/7/' steps.csv", "values", "steps.csv: line 260, ")


def test_a_value_of_a_database():
    """One bit of it, where no table tells."""
    update = "import sqlite3; c = sqlite3.connect('run.db'); c.execute('UPDATE outputs SET y = y * (1 + 2.3e-16) WHERE step = 100')"
    expect_found(f'"{sys.executable}" -c "{update}; c.commit(); c.close()"', "values", "database, outputs: line 102, y: ")


def test_an_exit_code_and_a_file():
    expect_found("code=70", "codes", "exit code: line 1: 2 \u2192 70", options=("--only", "^help$"))
    expect_found("touch left.tmp", "codes", "files: ")


def test_words_are_told_apart():
    other = build("echo more")
    code, out, _ = compare(build(), other, "--only", "^help$")
    expect(code == 1 and " words, in 1 cases" in out and "values" not in out, f"{code}\n{out}")
    code, out, _ = compare(build(), other, "--only", "^help$", "--allow", "words")
    expect(code == 0 and "same but for" in out.splitlines()[-1] and "words (allowed)" in out, f"{code}\n{out}")


def test_nothing_to_compare():
    good = build()
    for args in ((good,), (good, scratch()), (good, good, "--only", "nothing"), (good, good, "--allow", "values"),
                 (good, good, "--jobs", "0"), (build("code=70"), good, "--quick", "--only", CASE)):
        code, out, err = compare(*args)
        expect(code == 2 and not out and "compare: " in err, f"{args}: {code}\n{out}{err}")


main()
