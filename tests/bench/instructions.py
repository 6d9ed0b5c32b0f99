#!/usr/bin/env python3
"""Counts the instructions of steps and searches (callgrind), and compares them with instructions.json.

usage: instructions.py [--build FOLDER] [--write]

Ends with 1 if a count is more than 10 % above the committed one, and with 77 if this cannot be tested here: valgrind is
missing, or the compiler is not the one of the committed counts. --write replaces the committed counts. Builds nothing.
"""
import argparse
import concurrent.futures
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import bench

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
COMMITTED = HERE / "instructions.json"
MOST = 1.10  # times the committed count
SKIPPED = 77
STEPS = {kind: more - less for kind, (less, more) in bench.STEPS.items()}
CASES = {  # what a count is divided by
    "free/lag/3": lambda count: 3 * STEPS["free"],  # steps of components
    "free/lag/10": lambda count: 10 * STEPS["free"],
    "free/lag/30": lambda count: 30 * STEPS["free"],
    "locked/lag/secant": lambda count: STEPS["locked"],  # synchronised steps of two components
    "locked/lag/nelder-mead": lambda count: STEPS["locked"],
    "chain/lag/8": lambda count: count.executions,  # of a search
}


def compiler_of(build):
    """First line of the compiler's --version."""
    found = re.search(r"^CMAKE_C_COMPILER:\w+=(.*)$", (build / "CMakeCache.txt").read_text(encoding="utf-8"), re.M)
    return subprocess.run([found[1], "--version"], stdout=subprocess.PIPE, text=True, check=True).stdout.splitlines()[0]


def measure(build):
    """{case: instructions}"""
    program = str(build / "tests" / "bench" / "bench")
    with concurrent.futures.ThreadPoolExecutor(2) as pool:
        counts = pool.map(bench.difference, [(program, case, "twin") for case in CASES])
    return {case: round(count.instructions / divisor(count)) for (case, divisor), count in zip(CASES.items(), counts)}


def compare(committed, found):
    """Prints both counts of each case. Returns the number of cases that are too high or not committed."""
    failed = 0
    for case, now in found.items():
        before = committed.get(case, 0)
        is_higher = now > MOST * before
        failed += is_higher
        print(f"{case:<24}{before:9}{now:9}" + ("  more than 10 % higher: see why, or use --write" if is_higher else ""))
    return failed


def main():
    parser = argparse.ArgumentParser(description="Counts instructions and compares them with the committed counts.")
    parser.add_argument("--build", type=Path, default=ROOT / "build" / "host", help="the build folder")
    parser.add_argument("--write", action="store_true", help="replace the committed counts")
    arguments = parser.parse_args()
    build = arguments.build.resolve()
    committed = json.loads(COMMITTED.read_text(encoding="utf-8"))
    if shutil.which("valgrind") is None:
        print("skipped: valgrind is missing: script/bootstrap --all installs it")
        return SKIPPED
    compiler = compiler_of(build)
    if compiler != committed["compiler"] and not arguments.write:
        print(f"skipped: instructions.json has the counts of another compiler: {committed['compiler']}")
        return SKIPPED
    found = measure(build)
    failed = compare(committed["instructions"], found)
    if arguments.write:
        text = json.dumps({"compiler": compiler, "instructions": found}, indent=2)
        COMMITTED.write_text(text + "\n", encoding="utf-8")
        return 0
    return 1 if failed else 0


sys.exit(main())
