#!/usr/bin/env python3
"""The power of a box is cut while it records (tests/support/power_cuts.py): three times here, as often as you like by
tests/hil/power_cuts."""
import os
import subprocess
import sys
import time

from power_cuts import cuts
from twinlock_test import SOURCE, Skip, expect, main

CUTS = 3


def show(number, figures):
    print(f"    cut {number}, {figures['after_s']:.2f} s after the first commit: {figures['steps']} steps are there, "
          f"{figures['missing']} samples missing; configuration {figures['behind']} behind, {figures['kept']} accounts kept",
          flush=True)


def test_power_cuts():
    prepared = subprocess.run([SOURCE / "tests" / "hil" / "rig" / "prepare"], capture_output=True, encoding="utf-8", check=False)
    if prepared.returncode != 0:
        expect(os.environ.get("CI") != "true", f"{prepared.stderr}\n(CI=true does not allow to skip it)")
        raise Skip(prepared.stderr.strip())
    cuts(CUTS, time.time_ns(), show)


def by_hand(count, seed):
    table = cuts(count, seed, show)
    missing = sorted(figures["missing"] for figures in table)
    print(f"{count} cuts (seed {seed}): integrity ok, file system without a fault and replay to the bit each time; samples "
          f"missing: median {missing[len(missing) // 2]}, most {missing[-1]} of 100; configuration as of the newest replacement "
          f"{sum(figures['behind'] == 0 for figures in table)} times, of the one before it "
          f"{sum(figures['behind'] == 1 for figures in table)} times, neither 0 times")


if sys.argv[1:2] == ["--cuts"]:
    by_hand(int(sys.argv[2]), int(sys.argv[4]))
else:
    main()
