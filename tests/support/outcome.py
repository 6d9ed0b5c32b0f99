#!/usr/bin/env python3
"""Skipped and slow tests from CTest's reports, for script/test.

`outcome.py skipped REPORT LOG`: a line for each skipped test ("test NAME: WHY"), and for each skipped case of other tests
("case NAME CASE: WHY"). REPORT is the file of ctest --output-junit, LOG its LastTest.log with the output of all tests.
`outcome.py dearest NUMBER REPORT...`: the slowest tests with their seconds. A report is named after its preset.
"""
import re
import sys
import xml.etree.ElementTree
from pathlib import Path

NO_REASON = "no reason given"
BLOCK = re.compile(r"^\d+/\d+ Testing: (\S+)\n(.*?)^<end of output>$", re.M | re.S)
UNITY = re.compile(r"^\S+:\d+:(\w+):IGNORE(?::\s*(.*))?$", re.M)
PYTHON = re.compile(r"^ *skipped +(\w+) \([0-9.]+ s\)(?:: (.*))?$", re.M)  # twinlock_test.py
WHOLE = re.compile(r"^ *(?:skipped|rig: error): (.*)$", re.M)


def tests(report):
    """All tests of a report: (name, True if it was run, seconds)."""
    for case in xml.etree.ElementTree.parse(report).getroot().iter("testcase"):
        yield case.get("name"), case.find("skipped") is None and case.get("status") != "disabled", float(case.get("time") or 0)


def cases(output):
    """The skipped cases in a test's output: (name, why)."""
    return UNITY.findall(output) + PYTHON.findall(output)


def reason(output):
    """Why a whole test was skipped."""
    told = WHOLE.findall(output) or [why for _, why in cases(output)]
    return told[0] if told else NO_REASON


def skipped(report, log):
    text = Path(log).read_text(encoding="utf-8", errors="replace") if Path(log).exists() else ""
    outputs = dict(BLOCK.findall(text))
    for name, was_run, _ in tests(report):
        output = outputs.get(name, "")
        if not was_run:
            yield f"test {name}: {reason(output)}"
            continue
        for case, why in cases(output):
            yield f"case {name} {case}: {why or NO_REASON}"


def dearest(number, reports):
    rows = [(seconds, Path(report).stem, name) for report in reports for name, _, seconds in tests(report)]
    for seconds, preset, name in sorted(rows, reverse=True)[:number]:
        yield f"{seconds:4.0f} s  {preset:6} {name}"


def main():
    verb, *words = sys.argv[1:]
    lines = skipped(*words) if verb == "skipped" else dearest(int(words[0]), words[1:])
    print("".join(f"{line}\n" for line in lines), end="")


main()
