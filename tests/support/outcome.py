#!/usr/bin/env python3
"""What CTest's reports tell beside numbers of tests; for script/test.

`outcome.py skipped REPORT LOG`: one line for each test that was skipped ("test NAME: WHY"), and for each case within a test
that ran ("case NAME CASE: WHY"). REPORT is what ctest writes with --output-junit, LOG its LastTest.log, which has every
test's whole output.
`outcome.py dearest NUMBER REPORT...`: the tests that took longest, with their seconds. A report is named after its preset.
"""
import re
import sys
import xml.etree.ElementTree
from pathlib import Path

BLOCK = re.compile(r"^\d+/\d+ Testing: (\S+)\n(.*?)^<end of output>$", re.M | re.S)
UNITY = re.compile(r"^\S+:\d+:(\w+):IGNORE(?::\s*(.*))?$", re.M)
PYTHON = re.compile(r"^ *skipped +(\w+) \([0-9.]+ s\)(?:: (.*))?$", re.M)  # twinlock_test.py
WHOLE = re.compile(r"^ *(?:skipped|rig: error): (.*)$", re.M)


def tests(report):
    """All of a report: (name, was it run, seconds)."""
    for case in xml.etree.ElementTree.parse(report).getroot().iter("testcase"):
        yield case.get("name"), case.find("skipped") is None and case.get("status") != "disabled", float(case.get("time") or 0)


def cases(output):
    """Those that were skipped in a test's output: (name, why)."""
    return UNITY.findall(output) + PYTHON.findall(output)


def reason(output):
    """Of a test that was skipped as a whole."""
    told = WHOLE.findall(output) or [why for _, why in cases(output)]
    return told[0] if told else "it does not say why"


def skipped(report, log):
    text = Path(log).read_text(encoding="utf-8", errors="replace") if Path(log).exists() else ""
    outputs = dict(BLOCK.findall(text))
    for name, was_run, _ in tests(report):
        output = outputs.get(name, "")
        if not was_run:
            yield f"test {name}: {reason(output)}"
            continue
        for case, why in cases(output):
            yield f"case {name} {case}: {why or 'it does not say why'}"


def dearest(number, reports):
    rows = [(seconds, Path(report).stem, name) for report in reports for name, _, seconds in tests(report)]
    for seconds, preset, name in sorted(rows, reverse=True)[:number]:
        yield f"{seconds:4.0f} s  {preset:6} {name}"


def main():
    verb, *words = sys.argv[1:]
    lines = skipped(*words) if verb == "skipped" else dearest(int(words[0]), words[1:])
    print("".join(f"{line}\n" for line in lines), end="")


main()
