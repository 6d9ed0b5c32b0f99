#!/usr/bin/env python3
"""What two builds take of a machine while config/motor runs live, at 1 and 10 ms, at a Modbus device on this machine.

usage: live.py --before BUILD [--build BUILD] [--pairs N] [--seconds S] [--supervise] [--unlocked]

Builds nothing: script/build does. Counting system calls needs strace. README.md says what the figures mean.
"""
import argparse
import os
import re
import shutil
import signal
import statistics
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
os.environ.update(TL_SOURCE=str(ROOT), TL_BUILD="", TWINLOCK="")  # of tests/support; each run names its own build
sys.path.insert(0, str(ROOT / "tests" / "support"))

from footprint import footprint, shared_kib  # noqa: E402
from live_test import Device, children, query  # noqa: E402
from twinlock_test import edited_config, scratch  # noqa: E402

STEPS_S = 0.001, 0.01
OMEGA = 62.981  # rad/s: where config/motor's twin starts
CYCLE = "fmus"  # the name of the thread in which the cycle calls FMUs
NOT_OWN = 6, 9  # made up, followed: master/sync/record.h
WARM_STEPS = 100
PATIENCE_S = 20


@dataclass
class Figures:
    """Of one run."""
    first_tick_s: float  # from its start as a program
    pss_kib: int
    blocks_kib: int  # of it memory that processes share
    locked_kib: int
    wakes: float  # these four for each tick: how often the cycle's thread waited,
    turns: float  # how often it was put on a processor,
    cycle_us: float  # for how long,
    tree_us: float  # and all threads of all processes
    calls: float  # system calls of the cycle's thread; NaN if they were not counted
    busy_us: float  # median of what the database says of a step
    skipped: float  # share of ticks


# ---- one run ----

def tree(pid):
    found = [pid]
    for child in children(pid):
        found += tree(child)
    return found


def tasks(pid):
    return [Path(f"/proc/{member}/task/{task}") for member in tree(pid) for task in os.listdir(f"/proc/{member}/task")]


def find_cycle(pid):
    found = [task for task in tasks(pid) if (task / "comm").read_text(encoding="utf-8").strip() == CYCLE]
    if len(found) != 1:
        sys.exit(f"live.py: {len(found)} threads \"{CYCLE}\", wanted 1")
    return found[0]


def waited(task):
    return int(re.search(r"^voluntary_ctxt_switches:\s*(\d+)", (task / "status").read_text(encoding="utf-8"), re.M)[1])


def scheduled(task):
    """(ns on a processor, how often it was put there)"""
    used, _, turns = (task / "schedstat").read_text(encoding="ascii").split()
    return int(used), int(turns)


def all_used(pid):
    used = 0
    for task in tasks(pid):
        try:
            used += scheduled(task)[0]
        except OSError:
            pass  # a thread that has just ended
    return used


def count_calls(task, seconds):
    """System calls of one thread; NaN without strace."""
    file = scratch() / "calls"
    try:
        tracer = subprocess.Popen(["strace", "-qq", "-c", "-o", file, "-p", task.name], stderr=subprocess.DEVNULL)
    except FileNotFoundError:
        return float("nan")
    time.sleep(seconds)
    tracer.send_signal(signal.SIGINT)
    tracer.wait()
    total = re.search(r"^100\.00\s+\S+\s+(?:\S+\s+)?(\d+)\s+(?:\d+ )?\s*total$", file.read_text(encoding="utf-8"), re.M)
    return int(total[1]) if total else 0


def wait_for_steps(process, database, log):
    until = time.monotonic() + PATIENCE_S
    while time.monotonic() < until and process.poll() is None:
        if database.exists() and query(database, "SELECT 1 FROM steps LIMIT 1"):
            return
        time.sleep(0.05)
    sys.exit(f"live.py: {' '.join(map(str, process.args))} records no steps\n{log.read_text(encoding='utf-8')}")


def watch(pid, seconds, step_s, traced):
    """What it takes for each tick, as a dictionary of figures."""
    cycle = find_cycle(pid)
    began, waits, (used, turns), all_ns = time.monotonic(), waited(cycle), scheduled(cycle), all_used(pid)
    time.sleep(seconds)
    ticks = (time.monotonic() - began) / step_s
    now = scheduled(cycle)
    found = {"wakes": (waited(cycle) - waits) / ticks, "turns": (now[1] - turns) / ticks, "cycle_us": (now[0] - used) / ticks / 1e3,
             "tree_us": (all_used(pid) - all_ns) / ticks / 1e3,
             "pss_kib": sum(footprint(member).pss for member in tree(pid)), "blocks_kib": sum(map(shared_kib, tree(pid))),
             "locked_kib": sum(footprint(member).locked for member in tree(pid))}
    found["calls"] = count_calls(cycle, seconds) / (seconds / step_s) if traced else float("nan")
    return found


def first_tick(database, spawned):
    rows = query(database, "SELECT (julianday(started) - 2440587.5) * 86400.0 + t_ns / 1e9 FROM steps JOIN runs USING (run) "
                 "WHERE outcome NOT IN (?, ?) ORDER BY step LIMIT 1", *NOT_OWN)
    return rows[0][0] - spawned


def one_run(build, step_s, options, traced=False):
    with Device(OMEGA) as device:
        config = edited_config("motor/live.json", {
            "duration_s": None, "step_s": step_s, "synchronise": {"budget": {"time_s": 0.6 * step_s}},
            "sources": {"inverter": {"modbus_tcp": {"port": device.port}}}, "record": {"commit_s": 0.25},
            "realtime": {"lock_memory": not options.unlocked}})
        database, log = config.parent / "twin.db", config.parent / "log"
        # A copy for each run: where a file lies in the page cache decides up to half of a cold step, with the same bytes.
        program = shutil.copy(build / "bin" / "twinlock", scratch())
        command = [program, "run", config]
        command += ["--supervise", "--state", config.parent / "state"] if options.supervise else []
        with open(log, "wb") as file:
            spawned = time.time()
            process = subprocess.Popen(list(map(str, command)), stdin=subprocess.DEVNULL, stdout=file, stderr=file,
                                       env={**os.environ, "TWINLOCK_FMU_PATH": str(options.before / "fmus"), "TMPDIR": str(scratch())})
        try:
            wait_for_steps(process, database, log)
            time.sleep(1)
            found = watch(process.pid, options.seconds, step_s, traced)
            process.send_signal(signal.SIGTERM)
            process.wait(PATIENCE_S)
        finally:
            if process.poll() is None:
                process.kill()
    busy = [used for used, in query(database, "SELECT used_ns FROM steps WHERE outcome NOT IN (?, ?) AND step >= ?", *NOT_OWN, WARM_STEPS)]
    total, skipped = query(database, "SELECT count(*), sum(outcome = ?) FROM steps", NOT_OWN[0])[0]
    return Figures(first_tick(database, spawned), busy_us=statistics.median(busy) / 1e3, skipped=skipped / total, **found)


# ---- both ----

ROWS = (
    ("first tick after", "first_tick_s", "s"), ("PSS of all processes", "pss_kib", "KiB"), ("of it shared blocks", "blocks_kib", "KiB"),
    ("locked, each for itself", "locked_kib", "KiB"),
    ("cycle waits, a tick", "wakes", ""), ("cycle's turns, a tick", "turns", ""), ("cycle's processor time, a tick", "cycle_us", "us"),
    ("all processor time, a tick", "tree_us", "us"), ("a step, by the database", "busy_us", "us"), ("ticks skipped", "skipped", ""),
)


def print_row(what, unit, before, now):
    ratios = [b / a for a, b in zip(before, now) if a != 0]
    ratio = f"{statistics.median(ratios):8.3f}" if ratios else f"{'-':>8}"
    a, b = statistics.median(before), statistics.median(now)
    print(f"  {what:32}{a:12.4g}{b:12.4g}{ratio}{b - a:+12.4g} {unit}".rstrip(), flush=True)


def compare(step_s, options):
    """Medians, and the median of the ratios of pairs, whose order takes turns."""
    builds, runs = (options.before, options.build), ([], [])
    for i in range(options.pairs):
        for which in ((0, 1), (1, 0))[i % 2]:
            runs[which].append(one_run(builds[which], step_s, options))
    print(f"{1e3 * step_s:g} ms, {options.pairs} pairs{'before':>30}{'now':>12}{'ratio':>8}{'more':>12}")
    for what, name, unit in ROWS:
        print_row(what, unit, *([getattr(run, name) for run in side] for side in runs))
    traced = [[one_run(build, step_s, options, True).calls] for build in builds]  # apart: who is traced is slow
    print_row("cycle's system calls, a tick", "", *traced)


def main():
    parser = argparse.ArgumentParser(description="What two builds take of a machine while config/motor runs live.")
    parser.add_argument("--before", type=Path, required=True, help="the build folder of before, whose FMUs both get")
    parser.add_argument("--build", type=Path, default=ROOT / "build" / "host", help="the build folder of now; default: build/host")
    parser.add_argument("--pairs", type=int, default=10, help="runs of each; default 10")
    parser.add_argument("--seconds", type=float, default=4, help="for which a run is watched; default 4")
    parser.add_argument("--supervise", action="store_true", help="runs are supervised")
    parser.add_argument("--unlocked", action="store_true", help="with lock_memory off: memory as it is without a permission to lock it")
    options = parser.parse_args()
    options.before, options.build = options.before.resolve(), options.build.resolve()
    for build in options.before, options.build:
        if not os.access(build / "bin" / "twinlock", os.X_OK):
            sys.exit(f"live.py: there is no {build}/bin/twinlock: run script/build first")
    for step_s in STEPS_S:
        compare(step_s, options)


main()
