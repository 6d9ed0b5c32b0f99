#!/usr/bin/env python3
"""On the box: unit tests that depend on the kernel (clocks, threads, sockets, FIFOs, files, shared
objects). All unit tests would take minutes on an emulated processor."""
import subprocess
import time

import twinlock_test
from twinlock_test import HUNG_S, BUILD, expect

PROGRAMS = ["test_component", "test_csv_live", "test_journal", "test_synchroniser", "test_sample_buffer", "test_plant_server"]


def test_units():
    for name in PROGRAMS:
        begun = time.monotonic()
        done = subprocess.run([BUILD / "tests" / name], capture_output=True, encoding="utf-8", timeout=HUNG_S, check=False)
        expect(done.returncode == 0 and " 0 Failures" in done.stdout,
               f"{name} ended with {done.returncode}\n{done.stdout}{done.stderr}")
        print(f"    {name} {time.monotonic() - begun:.1f} s")


twinlock_test.main()
