#!/usr/bin/env python3
"""A minute and a bit of script/soak, with each of its faults; and that it would find what grows. The long form is by hand."""
import argparse
import random
import re
import signal
import subprocess
import sys
from collections import Counter

from live_test import wait_until
from slopes import count_grows, slope_of
from soak import ELSEWHERE, FORGIVEN_S, MOST_FAILURES, TWIN, plan, soak
from twinlock_test import SOURCE, expect, main, scratch

SCRIPT = SOURCE / "script" / "soak"
SHORT = "0.02", "--every", "7"  # 72 s, ten faults


def noise(order, before):
    """Of a figure that moves slowly."""
    return 0.8 * before + order.gauss(0, 50)


def life(order, begun, slope, count=100, period=5.0):
    level, wander, points = order.uniform(5000, 9000), 0.0, []
    for i in range(count):
        wander = noise(order, wander)
        points.append((begun + i * period, level + wander + slope / 3600 * i * period))
    return points


def test_slopes():
    """What grows is seen through restarts, and noise is not taken for growth."""
    order, false = random.Random(1), 0
    for i in range(200):
        lives = [life(order, 500 * j, 0) for j in range(7)]
        false += slope_of(lives).grows()
        grown = slope_of([life(order, 500 * j, 3000) for j in range(7)])
        expect(grown.grows() and abs(grown.slope - 3000) < 2 * grown.noise, f"{i}: {grown}")
    expect(false <= 4, f"noise was taken for growth {false} times of 200")
    expect(slope_of([[(0, 1), (1, 2)]]) is None, "a slope of two points")
    expect(not slope_of([[(i, 7) for i in range(10)]]).grows(), "what stays the same grows")


def test_counts():
    expect(count_grows([5, 5, 6, 6, 7, 7]), "from 5 to 7")
    expect(not count_grows([5, 6, 5, 6, 5, 6]), "to and fro")
    expect(not count_grows([5, 9]), "too few")


def expect_forgiven(faults):
    """As firmware/supervise/restarts.c counts, each twin having lived from failure to failure."""
    failures, last = 0, 0.0
    for at, kind in faults:
        if kind in TWIN:
            failures = max(0, failures - int(max(0, at - last - 5) // FORGIVEN_S)) + 1
            last = at
            expect(failures <= MOST_FAILURES, f"a restart loop at {at}")


def test_plans():
    """Whatever the seed: each kind in turn, none of them a restart loop."""
    for seed in range(50):
        for every in (5, 7, 30, 60, 100):
            faults = plan(3600, every, seed)
            expect(len(faults) == 3600 // every, f"{len(faults)}")
            expect(all(every * i <= at <= every * (i + 0.5) for i, (at, _) in enumerate(faults)), "not one in each interval")
            expect_forgiven(faults)
        kinds = Counter(kind for _, kind in plan(3600, 60, seed))
        expect(all(6 <= kinds[kind] <= 7 for kind in (*TWIN, *ELSEWHERE)), f"{kinds}")
    expect(plan(3600, 60, 1) == plan(3600, 60, 1) != plan(3600, 60, 2), "the seed decides nothing, or not all")


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
    """A report all the same, and nothing is left running."""
    path = scratch() / "out"
    with open(path, "wb") as file, subprocess.Popen([SCRIPT, "1", "--every", "7"], stdout=file, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL) as script:
        wait_until(lambda: b"whole again" in path.read_bytes(), "the first fault", path.read_text)
        script.send_signal(signal.SIGINT)
        code = script.wait(60)
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
