#!/usr/bin/env python3
"""The cost of a dead twin for its supervisor (tests/support/kills.py).

Four kills and four hangs on one processor here, more of them by tests/hil/kills. The test limits
the supervisor's processor time only. A supervisor with real-time priority once spent a second on
waiting for a kernel thread.
"""
import argparse
import os

from kills import PATIENCE_S, campaign, describe
from twinlock_test import expect, main

MOST_USED_S = 0.25  # usual: 0.002 s

CORE = max(os.sched_getaffinity(0))


def expect_cheap(costs):
    print(f"    {describe(costs)}")
    expect(all(cost.used_s < MOST_USED_S for cost in costs), f"the supervisor was busy for long: {costs}")
    expect(all(cost.gap_s < PATIENCE_S for cost in costs), f"keepalives are missing: {costs}")
    expect(all(cost.left == 0 for cost in costs), f"dead processes: {costs}")


def test_kills():
    expect_cheap(campaign("kill", 4, CORE))


def test_hangs():
    expect_cheap(campaign("hang", 4, CORE))


def test_kills_beside_a_task_that_is_more_urgent_than_the_cycle():
    expect_cheap(campaign("kill", 4, CORE, load=True))


def by_hand(options):
    for kind, count in ("kill", options.kills), ("hang", options.hangs):
        if count > 0:
            print(f"{kind}{', beside a FIFO task' if options.fifo_load else ''}: "
                  f"{describe(campaign(kind, count, options.core, options.fifo_load))}", flush=True)


parser = argparse.ArgumentParser()
parser.add_argument("words", nargs="*")
parser.add_argument("--by-hand", action="store_true")
parser.add_argument("--kills", type=int, default=200)
parser.add_argument("--hangs", type=int, default=200)
parser.add_argument("--core", type=int, default=CORE)
parser.add_argument("--fifo-load", action="store_true")
if parser.parse_args().by_hand:
    by_hand(parser.parse_args())
else:
    main()
