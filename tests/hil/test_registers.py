#!/usr/bin/env python3
"""script/studies/registers: `probe` finds mistakes on a few random devices, and cures no right configuration."""
import json
import os
import subprocess
import sys

from twinlock_test import BUILD, EMULATED, HUNG_S, SKIPPED, SOURCE, expect, main

try:
    import pymodbus  # noqa: F401
except ImportError as reason:
    print(f"no pymodbus here: {reason}")
    sys.exit(1 if os.environ.get("CI") == "true" else SKIPPED)
if BUILD != SOURCE / "build" / "host" or EMULATED:
    print("skipped: the studies are those of build/host")
    sys.exit(SKIPPED)

MISTAKES = "words", "bytes", "plus 1", "notation", "table", "framing", "limit", "scale"


def test_a_few_devices():
    """Two devices of each kind. Counts have room for a loaded machine, on which a device may seem silent."""
    done = subprocess.run([sys.executable, SOURCE / "script" / "studies" / "registers.py", "--devices", "2", "--seed", "36", "--jobs", "2",
                           "--only", ",".join((*MISTAKES, "none", "faulty sensor")), "--json"], capture_output=True, text=True, timeout=HUNG_S, check=False)
    expect(done.returncode in (0, 1), done.stderr)
    figures = json.loads(done.stdout)
    right = sum(figures["kinds"][kind]["right"] for kind in MISTAKES)
    expect(right >= 12, f"{right} of 16 cured: {figures['kinds']}")
    expect(figures["kinds"]["none"]["nothing"] == 2, f"{figures['kinds']['none']}")
    expect(sum(row["false"] for row in figures["kinds"].values()) <= 1, f"{figures['kinds']}")


main()
