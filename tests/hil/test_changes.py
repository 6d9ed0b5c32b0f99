#!/usr/bin/env python3
"""Changes the configuration of one run many times, half in place, half by another twin.

No tick may be missing or recorded twice, and memory must not grow. Eight changes here, a hundred by
tests/hil/changes.
"""
import argparse

from changes import many_changes, undisturbed
from twinlock_test import at_most, main

SEED = 20261123
GROWN_KIB = 2048  # of all processes together


def show(number, kind):
    print(f"    {number}: {kind}", flush=True)


def test_a_few():
    cost = many_changes(8, SEED)
    at_most(cost.grown_kib, GROWN_KIB, "KiB of growth")


def by_hand(count, seed, processor):
    cost = many_changes(count, seed, show, processor)
    print(f"{cost.changes} changes (seed {seed}{'' if processor is None else f', on processor {processor}'}), {cost.runs} runs: {cost.ticks} ticks, none missing or twice; "
          f"{cost.busy} sent again because the machine was busy; {cost.skipped} caught up, {cost.misses} deadlines missed, {cost.out_of_lock} steps not within tolerance; private memory {cost.grown_kib:+} KiB")
    ticks, skipped, misses = undisturbed(cost.ticks / 100, processor)
    print(f"the same time without a change: {ticks} ticks, {skipped} caught up, {misses} deadlines missed")
    at_most(cost.grown_kib, GROWN_KIB, "KiB of growth")


parser = argparse.ArgumentParser()
parser.add_argument("--by-hand", action="store_true")
parser.add_argument("--changes", type=int, default=100)
parser.add_argument("--seed", type=int, default=SEED)
parser.add_argument("--processor", type=int)
options, _ = parser.parse_known_args()
if options.by_hand:
    by_hand(options.changes, options.seed, options.processor)
else:
    main()
