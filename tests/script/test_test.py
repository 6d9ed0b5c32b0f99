#!/usr/bin/env python3
"""script/test: rejected options, and the report of skipped tests and cases, on a real run of ctest.
"""
import subprocess
import sys

from twinlock_test import SOURCE, expect, has_line, main, scratch

# name, what it prints, its exit code
TESTS = [
    ("unit", "a.c:7:test_one:PASS\na.c:9:test_two:IGNORE: no disk here\na.c:11:test_three:IGNORE\n3 Tests 0 Failures 2 Ignored", 0),
    ("script", "  passed   test_a (0.1 s)\n  skipped  test_b (0.0 s): no bus here", 0),
    ("whole", "skipped: no box here", 77),
    ("plain", "all is well", 0),
]


def run(*arguments):
    done = subprocess.run([SOURCE / "script" / "test", *arguments], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT, text=True, check=False)
    return done.returncode, done.stdout


def test_an_unknown_room():
    code, output = run("--room", "attic")
    expect(code == 2 and "no room attic" in output and "  master/sync\n" in output, f"{code}: {output}")


def test_an_ambiguous_room():
    code, output = run("--room", "base")
    expect(code == 2 and "more than one" in output and "  master/base\n" in output and "  firmware/base\n" in output,
           f"{code}: {output}")


def test_a_room_is_no_pattern():
    code, output = run("--room", "sy.c")
    expect(code == 2 and "no room sy.c" in output, f"{code}: {output}")


def test_wrong_usage():
    for arguments in (["--room"], ["--room", ""], ["--room", "/"], ["--fast", "--room", "sync"], ["--all", "--fast"], ["--all", "--room", "sync"], ["-k"], ["--quick"], ["sync"]):
        code, output = run(*arguments)
        expect(code == 2 and "usage: script/test" in output, f"{arguments}: {code}: {output}")


def test_an_invalid_pattern():
    code, output = run("--fast", "-k", "(")
    expect(code == 2 and "expected a regular expression" in output, f"{code}: {output}")


def ctest():
    """Runs TESTS by ctest. Returns the paths of the report and the log."""
    folder = scratch()
    lines = []
    for name, output, code in TESTS:
        program = folder / name
        program.write_text(f"#!/bin/sh\ncat <<'TEXT'\n{output}\nTEXT\nexit {code}\n", encoding="utf-8")
        program.chmod(0o755)
        lines.append(f'add_test({name} "{program}")\nset_tests_properties({name} PROPERTIES SKIP_RETURN_CODE 77)\n')
    (folder / "CTestTestfile.cmake").write_text("".join(lines), encoding="utf-8")
    report = folder / "report.xml"
    subprocess.run(["ctest", "--output-junit", report], cwd=folder, stdout=subprocess.DEVNULL, check=True)
    return report, folder / "Testing" / "Temporary" / "LastTest.log"


def outcome(*arguments):
    done = subprocess.run([sys.executable, SOURCE / "tests" / "support" / "outcome.py", *arguments], stdout=subprocess.PIPE,
                          text=True, check=True)
    return done.stdout.splitlines()


def test_skipped_tests_and_cases():
    found = outcome("skipped", *ctest())
    wanted = ["case|unit|test_two|no disk here", "case|unit|test_three", "case|script|test_b|no bus here", "test|whole|no box here"]
    expect(len(found) == len(wanted) and all(map(has_line, found, wanted)), f"found {found}")


def test_the_longest_tests():
    report, _ = ctest()
    found = outcome("dearest", "2", report)
    expect(len(found) == 2 and all(" s  report" in line for line in found), f"found {found}")


main()
