#!/usr/bin/env python3
"""A GPIO chip that is pulled out while its lines are read, on the box, in a boot of its own. The other tests of GPIO are in
tests/hil/box/test_live_gpio.py, which tests/hil/test_rig.py runs with all that is there."""
import box
from twinlock_test import SOURCE, expect, main


def test_a_chip_that_is_pulled_out():
    python = SOURCE / ".deps" / "venv" / "bin" / "python"
    done = box.run([python, "tests/hil/box/test_live_gpio.py", "pulled_out"], timeout=150)
    expect(done.returncode == 0, f"ended with {done.returncode}\n{done.stdout}{done.stderr}")


main()
