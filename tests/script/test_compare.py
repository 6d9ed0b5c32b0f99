#!/usr/bin/env python3
"""script/compare: this build equals itself in all replays and commits the values of digests.txt; a
difference of another build is reported with its kind.

digests.txt was made by the build of commit 8c25954 with NLopt 2.7.1 and the C library 2.36, from
all cases and the recordings of TL_SHARED. If values change on purpose, renew it with these
recordings: script/compare BUILD BUILD --quick --digests tests/script/digests.txt

script/compare disables FMA in the C library, so that every x86-64 processor computes the same bits.
Another version of the library may not: it computes the tanh of all cases named cylinder, the noise
of plants, and roots and powers in NLopt.
"""
import os
import platform
import subprocess
import sys

from twinlock_test import BUILD, FMUS, PATIENCE, PROGRAM, SOURCE, Skip, expect, main, scratch

CASE = "^second_order/without$"
QUICK = ("--quick", "--only", CASE)
DIGESTS = SOURCE / "tests" / "script" / "digests.txt"


def build(after="true", said="cat"):
    """A build folder whose program calls this build's. `after`: a line of shell after each call,
    which may set `code`. `said`: a filter of its standard output."""
    folder = scratch()
    (folder / "fmus").symlink_to(FMUS)
    (folder / "bin").mkdir()
    program = folder / "bin" / "twinlock"
    call = f'"{PROGRAM}" "$@" >"$TMPDIR/said"\ncode=$?\n{said} "$TMPDIR/said"\nrm "$TMPDIR/said"'
    program.write_text(f"#!/bin/sh\n{call}\n{after}\nexit $code\n", encoding="utf-8")
    program.chmod(0o755)
    return folder


def of_database(statement):
    """A line of shell that runs an SQL statement on the database of a call."""
    text = f"import sqlite3; c = sqlite3.connect('run.db'); c.execute('{statement}'); c.commit(); c.close()"
    return f'"{sys.executable}" -c "{text}"'


def compare(*args, shared=None):
    """(exit code, stdout, stderr) of script/compare.py."""
    command = [sys.executable, SOURCE / "script" / "compare.py", "--jobs", "2", *args]
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=1500 * PATIENCE, check=False,
                          env={**os.environ, "TL_SHARED": str(scratch()) if shared is None else shared})
    return done.returncode, done.stdout, done.stderr


def digests_of(text):
    """{case: set of "table=digest"}"""
    return {name: set(found) for name, *found in (line.split() for line in text.splitlines())}


def expect_found(after, kind, *words, options=QUICK):
    """Checks that a difference gives exit code 1, and that its line and the last line have its
    kind."""
    code, out, err = compare(build(), build(after), *options)
    lines = out.splitlines()
    expect(code == 1 and not err and lines[-1].startswith("compare: DIFFERENT: "), f"{after}: {code}\n{out}{err}")
    expect(f" {kind}" in lines[-1], f"{after}: not of the kind {kind}\n{out}")
    for word in words:
        expect(any(word in line and f": {kind}: " in line for line in lines[:-1]), f"{after}: no {word!r}\n{out}")


def test_every_case():
    file = scratch() / "digests.txt"
    code, out, err = compare(BUILD, BUILD, "--quick", "--digests", file, shared=os.environ.get("TL_SHARED", ""))
    print(f"    {out}", end="")
    expect(code == 0 and not err and out.startswith("compare: same; "), f"{code}\n{out}{err}")
    if platform.machine() != "x86_64":
        raise Skip(f"digests.txt is of x86_64, and this machine is {platform.machine()}")
    held, found = digests_of(DIGESTS.read_text(encoding="utf-8")), digests_of(file.read_text(encoding="utf-8"))
    absent = [name for name in held if name not in found and not name.startswith("shared/")]
    differ = [f"{name}: {' '.join(sorted(texts ^ held.get(name, set())))}" for name, texts in found.items()
              if texts != held.get(name)]
    expect(not absent, f"no longer a case: {', '.join(absent)}")
    expect(not differ, f"{len(differ)} of {len(found)} cases have other digests than digests.txt:\n" + "\n".join(differ))


def test_a_digest_is_of_every_bit():
    file = scratch() / "digests.txt"
    other = build(of_database("UPDATE outputs SET simulated = simulated * (1 + 2.3e-16) WHERE step = 100"))
    code, out, err = compare(other, other, *QUICK, "--digests", file)
    expect(code == 0 and not err, f"{code}\n{out}{err}")
    (name, found), = digests_of(file.read_text(encoding="utf-8")).items()
    differ = found - digests_of(DIGESTS.read_text(encoding="utf-8"))[name]
    expect([text.split("=")[0] for text in differ] == ["outputs"], f"{differ}")


def test_a_renamed_column_is_the_same():
    """A renamed column has a canonical name in NAMES, so that comparison and digest stay the same.
    Others are an error."""
    files = [scratch() / "digests.txt" for _ in range(2)]
    renamed = build(of_database("ALTER TABLE adjustments RENAME COLUMN nominal TO u_hat"), "sed s/correction_mean/delta_mean/")
    for before, after, file in ((build(), renamed, files[0]), (renamed, build(), files[1])):
        code, out, err = compare(before, after, "--quick", "--only", "^variant/two$", "--digests", file)
        expect(code == 0 and not err and out.startswith("compare: same; "), f"{code}\n{out}{err}")
    expect(files[0].read_text(encoding="utf-8") == files[1].read_text(encoding="utf-8"), "other digests")
    unknown = build(of_database("ALTER TABLE adjustments RENAME COLUMN nominal TO nobody"))
    code, out, err = compare(unknown, unknown, *QUICK, "--digests", files[0])
    expect(code == 2 and "adjustments has no nominal: add the new names to NAMES" in err, f"{code}\n{out}{err}")


def test_a_value_of_a_table():
    """One changed digit, the last of the last row."""
    expect_found("sed -i '$s/.$/7/' steps.csv", "values", "steps.csv: line 260, ")


def test_a_value_of_a_database():
    """One changed bit, which no CSV table shows."""
    update = of_database("UPDATE outputs SET simulated = simulated * (1 + 2.3e-16) WHERE step = 100")
    expect_found(update, "values", "database, outputs: line 102, simulated: ")


def test_an_exit_code_and_a_file():
    expect_found("code=70", "codes", "exit code: line 1: 2 \u2192 70", options=("--only", "^help$"))
    expect_found("touch left.tmp", "codes", "files: ")


def test_differences_of_words():
    other = build("echo more")
    code, out, _ = compare(build(), other, "--only", "^help$")
    expect(code == 1 and " words, in 1 cases" in out and "values" not in out, f"{code}\n{out}")
    code, out, _ = compare(build(), other, "--only", "^help$", "--allow", "words")
    expect(code == 0 and "same but for" in out.splitlines()[-1] and "words (allowed)" in out, f"{code}\n{out}")


def test_nothing_to_compare():
    good = build()
    for args in ((good,), (good, scratch()), (good, good, "--only", "nothing"), (good, good, "--allow", "values"),
                 (good, good, "--jobs", "0"), (build("code=70"), good, *QUICK)):
        code, out, err = compare(*args)
        expect(code == 2 and not out and "compare: " in err, f"{args}: {code}\n{out}{err}")


main()
