#!/usr/bin/env python3
"""On the box: unit tests of the build that lean on the kernel (clocks, threads, sockets, FIFOs, files, shared objects).
All of them would take minutes on an emulated processor."""
import subprocess

import twinlock_test
from twinlock_test import BUILD, expect

PROGRAMS = ["test_component", "test_csv_live", "test_mailbox", "test_plant_server", "test_recorder"]


def test_units():
    for name in PROGRAMS:
        done = subprocess.run([BUILD / "tests" / name], capture_output=True, encoding="utf-8", timeout=60, check=False)
        expect(done.returncode == 0 and " 0 Failures" in done.stdout,
               f"{name} ended with {done.returncode}\n{done.stdout}{done.stderr}")


twinlock_test.main()
