#!/usr/bin/env python3
"""script/studies/commission: a tank whose outlet is three times as wide as that of the FMU, with few candidates."""
import dataclasses
import os
import sys

from twinlock_test import BUILD, EMULATED, SKIPPED, SOURCE, expect, main

if BUILD != SOURCE / "build" / "host" or EMULATED:
    print("skipped: the studies are those of build/host")
    sys.exit(SKIPPED)
import commission  # noqa: E402


def test_a_tank():
    os.environ["TWINLOCK_FMU_PATH"] = str(BUILD / "fmus")
    commission.TRIALS = 2
    row = commission.measure(dataclasses.replace(commission.PLANTS["tank"], seconds=300), "outlet", 1, False)
    print(f"    MSE of readings 1/{row['ratio_readings']:.0f}, true 1/{row['ratio_true']:.0f} of the twin left alone")
    expect(row["reached"], row)


if __name__ == "__main__":
    main()
