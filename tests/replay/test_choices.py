#!/usr/bin/env python3
"""script/studies/choices: the statements of docs/method.md about solvers, horizons and lines hold with one seed.

It draws the figures of that page.
"""
import json
import subprocess
import sys
import xml.etree.ElementTree as ElementTree

from twinlock_test import BUILD, EMULATED, HUNG_S, SKIPPED, SOURCE, at_most, expect, main, scratch

if BUILD != SOURCE / "build" / "host" or EMULATED:
    print("skipped: the studies are those of build/host")
    sys.exit(SKIPPED)


def study(*arguments):
    return subprocess.run([sys.executable, SOURCE / "script" / "studies" / "choices.py", *arguments], capture_output=True, text=True, timeout=HUNG_S,
                          check=False)


def measured(table):
    done = study("--seeds", "1", "--only", table, "--json")
    expect(done.returncode == 0, done.stderr)
    return json.loads(done.stdout)[table]


def test_a_line_is_truer():
    rows = measured("between")
    at_most(rows["the line"]["true"], 0.75 * rows["the last message"]["true"], "true MSE on the line")
    at_most(rows["the line, low-pass of 20 ms"]["true"], 0.08, "and through a low-pass")


def test_secant_needs_no_step():
    rows = measured("step")
    true = [row["true"] for name, row in rows.items() if name.startswith("secant")]
    at_most(max(true) / min(true), 1.05, "largest over smallest true MSE of secant")
    expect(rows["nelder-mead, 0.001"]["true"] > 2 * rows["nelder-mead, 0.12"]["true"], f"{rows}")


def test_pictures():
    folder = scratch()
    done = study("--pictures", folder)
    expect(done.returncode == 0, done.stderr)
    for name in "between.svg", "horizon.svg":
        expect(ElementTree.parse(folder / name).getroot().tag.endswith("svg"), f"{name} is no picture")
    between = (folder / "between.svg").read_text(encoding="utf-8")
    expect(between.count("<circle") > 8 and between.count("<polyline") == 3, between)


def test_what_it_does_not_know():
    done = study("--only", "nothing")
    expect(done.returncode == 65 and 'found "nothing", expected one of adjust' in done.stderr, done.stderr)


if __name__ == "__main__":
    main()
