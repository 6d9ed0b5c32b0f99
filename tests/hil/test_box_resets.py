#!/usr/bin/env python3
"""The watchdog resets the box if the supervisor is stopped or dead, and only then.

After the reset the supervisor reports the reason. The rig boots three times in one QEMU, whose
i6300esb keeps the cause of a reset. The script of each boot is tests/hil/box/reset.py.
"""
import subprocess

from power_cuts import make_disk, need_rig
from twinlock_test import BUILD, SOURCE, expect, main, scratch

BOOTS = ["boot 1", "alive though the child was killed", "boot 2", "the supervisor is killed", "boot 3", "ended orderly"]


def test_resets():
    need_rig()
    rig = [SOURCE / "script" / "rig", "--source", SOURCE, "--build", BUILD, "--timeout", "840", "--reboots",
           "--disk", make_disk(scratch())]
    done = subprocess.run([*rig, "--", "python3", "tests/hil/box/reset.py"], capture_output=True, encoding="utf-8",
                          errors="replace", check=False)
    told = [line for line in done.stdout.splitlines() if line in BOOTS]
    expect(done.returncode == 0 and told == BOOTS, f"ended with {done.returncode}\n{done.stdout}{done.stderr[-6000:]}")


main()
