#!/usr/bin/env python3
"""On the box, with one processor and without real-time throttling: a supervised twin is killed, and
its FMU hangs. No process spins for ever, and every dead process is reaped. The printed times have
no meaning here."""
from pathlib import Path

from kills import Pace, campaign, describe
from twinlock_test import expect, main

THROTTLE = Path("/proc/sys/kernel/sched_rt_runtime_us")
PACE = Pace(step_s=0.1, hang_s=6)


def unthrottled(kind, count):
    before = THROTTLE.read_text(encoding="ascii")
    THROTTLE.write_text("-1", encoding="ascii")
    try:
        costs = campaign(kind, count, 0, pace=PACE)
    finally:
        THROTTLE.write_text(before, encoding="ascii")
    print(f"    {describe(costs)}")
    expect(sum(cost.left for cost in costs) == 0, f"zombies are left: {costs}")


def test_kills():
    unthrottled("kill", 3)


def test_hangs():
    unthrottled("hang", 3)


main()
