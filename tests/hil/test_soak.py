#!/usr/bin/env python3
"""72 s of script/soak with each of its faults, and tests of its detection of growth. The long form
runs by hand."""
import argparse
import mmap
import os
import random
import re
import signal
import subprocess
import sys
from collections import Counter

from footprint import footprint
from live_test import wait_until
from slopes import count_grows, slope_of, without_once
from soak import ELSEWHERE, FORGIVEN_S, MOST_FAILURES, TWIN, plan, soak
from twinlock_test import HUNG_S, SOURCE, expect, main, scratch

SCRIPT = SOURCE / "script" / "soak"
SHORT = "0.02", "--every", "7"  # 72 s, ten faults


def noise(order, before):
    """Slowly changing noise: the next value after `before`."""
    return 0.8 * before + order.gauss(0, 50)


def life(order, begun, slope, count=100, period=5.0):
    level, wander, points = order.uniform(5000, 9000), 0.0, []
    for i in range(count):
        wander = noise(order, wander)
        points.append((begun + i * period, level + wander + slope / 3600 * i * period))
    return points


def lasting_slope(lives):
    return slope_of(map(without_once, lives))


def test_slopes():
    """Growth is detected across restarts, and noise does not count as growth."""
    order, false = random.Random(1), 0
    for i in range(200):
        lives = [life(order, 500 * j, 0) for j in range(7)]
        false += slope_of(lives).grows()
        grown = slope_of([life(order, 500 * j, 3000) for j in range(7)])
        expect(lasting_slope([life(order, 500 * j, 3000) for j in range(7)]).grows(), f"{i}: counts as a single step")
        expect(grown.grows() and abs(grown.slope - 3000) < 2 * grown.noise, f"{i}: {grown}")
    expect(false <= 4, f"noise counted as growth {false} times of 200")
    expect(slope_of([[(0, 1), (1, 2)]]) is None, "a slope of two points")
    expect(not slope_of([[(i, 7) for i in range(10)]]).grows(), "a constant grows")


PAGE = 4  # KiB


def paged(seconds, taken):
    """The memory of a process in whole pages, every 5 s. `taken(t)`: KiB that it has allocated by
    then."""
    return [(t, 2000 + taken(t) // PAGE * PAGE) for t in range(0, seconds, 5)]


def rising(seconds, rises):
    """As paged(), for a process that allocates so much at these times: [(at, KiB)]."""
    return paged(seconds, lambda t: sum(kib for at, kib in rises if t >= at))


def test_leaks():
    """Leaks of single pages, in processes that restart every two minutes, or live for hours."""
    for seconds, lives, kib_per_s in (120, 20, 4), (120, 20, 1), (450, 7, 4), (450, 7, 0.25), (3500, 1, 4), (3500, 1, 0.02):
        slope = lasting_slope([paged(seconds, lambda t: t * kib_per_s) for _ in range(lives)])
        expect(slope.grows(), f"{kib_per_s} KiB/s in {lives} lives of {seconds} s: {slope}")
    storms = lasting_slope([rising(600, [(at, 100) for at in range(50, 600, 120)]) for _ in range(5)])
    expect(storms.grows(), f"100 KiB at each storm: {storms}")
    kills = lasting_slope([rising(3500, [(at, 132) for at in range(100, 3500, 180)])])
    expect(kills.grows(), f"132 KiB at each restart: {kills}")


def test_no_leaks():
    """Memory that a process allocates once does not count as a leak, at any time and of any
    size."""
    order = random.Random(2)
    for seconds, lives in (120, 20), (450, 7), (3500, 1):
        for kib in PAGE, 24, 132:
            slope = lasting_slope([rising(seconds, [(order.uniform(0, seconds), kib) for _ in range(2)]) for _ in range(lives)])
            expect(not slope.grows(), f"{kib} KiB twice in each of {lives} lives of {seconds} s: {slope}")
    pages = lasting_slope([rising(450, [(100, 24), (200, 132), (300, PAGE)]) for _ in range(7)])
    expect(not pages.grows(), f"a page more: {pages}")


def test_footprint():
    """Shared memory counts with its whole size, and not as private memory, whether it was written
    or not."""
    mib = 1 << 20
    before = footprint(os.getpid())
    block = os.memfd_create("twinlock test")
    os.ftruncate(block, 8 * mib)
    with mmap.mmap(-1, 4 * mib, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS) as private, mmap.mmap(block, 8 * mib) as shared:
        mapped = footprint(os.getpid())
        expect(mapped.shared - before.shared == 8192 and mapped.held - before.held < 1024, f"{before}, {mapped}")
        shared.write(bytes(2 * mib))
        touched = footprint(os.getpid())
        expect(touched.shared == mapped.shared and touched.private - before.private < 1024, f"touched: {before}, {touched}")
        expect(1024 < touched.held - before.held < 3072, f"touched, held: {before}, {touched}")
        private.write(bytes(4 * mib))
        grown = footprint(os.getpid())
        expect(3072 < grown.private - touched.private < 5120 and 3072 < grown.held - touched.held < 5120, f"grown: {touched}, {grown}")
    os.close(block)
    expect(footprint(os.getpid()).shared == before.shared, "unmapped memory counts")


def test_counts():
    expect(count_grows([5, 5, 6, 6, 7, 7]), "from 5 to 7")
    expect(not count_grows([5, 6, 5, 6, 5, 6]), "to and fro")
    expect(not count_grows([5, 9]), "too few")


def expect_forgiven(faults):
    """Checks that no fault is a restart loop, with the rule of firmware/live/restarts.c."""
    failures, last = 0, 0.0
    for at, kind in faults:
        if kind in TWIN:
            failures = max(0, failures - int(max(0, at - last - 5) // FORGIVEN_S)) + 1
            last = at
            expect(failures <= MOST_FAILURES, f"a restart loop at {at}")


def test_plans():
    """With each seed all kinds take turns, without a restart loop."""
    for seed in range(50):
        for every in (5, 7, 30, 60, 100):
            faults = plan(3600, every, seed)
            expect(len(faults) == 3600 // every, f"{len(faults)}")
            expect(all(every * i <= at <= every * (i + 0.5) for i, (at, _) in enumerate(faults)), "not one in each interval")
            expect_forgiven(faults)
        kinds = Counter(kind for _, kind in plan(3600, 60, seed))
        expect(all(6 <= kinds[kind] <= 7 for kind in (*TWIN, *ELSEWHERE)), f"{kinds}")
    expect(plan(3600, 60, 1) == plan(3600, 60, 1) != plan(3600, 60, 2), "a plan depends on more or less than its seed")


def run_script(*args):
    done = subprocess.run([SCRIPT, *args], capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL)
    return done.returncode, done.stdout, done.stderr


def test_a_minute_and_a_bit():
    code, out, err = run_script(*SHORT)
    print("".join(f"    {line}\n" for line in out.splitlines()), end="")
    expect(code == 0 and "all is well" in out, f"ended with {code}\n{out}{err}")
    for kind in (*TWIN, *ELSEWHERE):
        expect(re.search(rf"\d × {kind}", out), f"no {kind} in\n{out}")


def test_interrupted():
    """An interrupted run still reports."""
    path = scratch() / "out"
    with open(path, "wb") as file, subprocess.Popen([SCRIPT, "1", "--every", "7"], stdout=file, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL) as script:
        wait_until(lambda: b"whole again" in path.read_bytes(), "the first fault", path.read_text)
        script.send_signal(signal.SIGINT)
        code = script.wait(HUNG_S)
    out = path.read_text(encoding="utf-8")
    expect(code == 0 and "interrupted" in out and "recorded: " in out and "all is well" in out, f"ended with {code}\n{out}")


def test_usage():
    for args in ([], ["-1"], ["1", "2"], ["1", "--seed"], ["1", "--every", "x"], ["1", "--no"]):
        code, _, err = run_script(*args)
        expect(code == 2 and "usage:" in err, f"{args}: {code}\n{err}")
    code, out, _ = run_script("--help")
    expect(code == 0 and "usage:" in out, f"{code}\n{out}")


parser = argparse.ArgumentParser()
parser.add_argument("words", nargs="*")
parser.add_argument("--by-hand", action="store_true")
parser.add_argument("--hours", type=float)
parser.add_argument("--every", type=int, default=60)
parser.add_argument("--seed", type=int, default=1)
options = parser.parse_args()
if options.by_hand:
    sys.exit(0 if soak(options.hours * 3600, max(options.every, 5), options.seed, lambda text: print(text, flush=True)) else 1)
main()
