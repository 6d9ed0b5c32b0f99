#!/usr/bin/env python3
"""A GPIO chip that is pulled out while its lines are read, on the box, in a boot of its own. The other tests of GPIO are in
tests/hil/box/test_live_gpio.py, which tests/hil/test_rig.py runs with all that is there.

Linux 6.1 damages its own memory when a chip of gpio-sim goes while user space holds its lines, and may stop at any time after
that. So a boot that is lost says nothing of us, and there is a second one; what the test itself says counts."""
import box
from twinlock_test import SOURCE, Failure, Skip, main

BOOTS = 2
KILLED, TIMED_OUT = 137, 124


def test_a_chip_that_is_pulled_out():
    python = SOURCE / ".deps" / "venv" / "bin" / "python"
    command = ["timeout", "--signal=KILL", "40", python, "tests/hil/box/test_live_gpio.py", "pulled_out"]
    lost = (KILLED, TIMED_OUT, box.description()["reach"]["lost"])
    for _ in range(BOOTS):
        done = box.run(command, timeout=140)
        if done.returncode == 0:
            return
        if done.returncode not in lost or "FAILED" in done.stdout:
            raise Failure(f"ended with {done.returncode}\n{done.stdout}{done.stderr}")
    raise Skip(f"the box was lost in {BOOTS} boots: its kernel does not survive a chip that is pulled out")


main()
