#!/usr/bin/env python3
"""More CAN frames than the box can read: runs tests/hil/box/test_can_floods.py there."""
import box
from power_cuts import need_rig
from supervised import store_saved_states
from twinlock_test import BUILD, PLAIN_CAN, expect, main


def test_on_the_box():
    need_rig()
    results = BUILD / "rig"
    results.mkdir(exist_ok=True)
    store_saved_states(PLAIN_CAN, results / "can_states.json")
    done = box.run(["tests/hil/box/run", "tests/hil/box/test_can_floods.py"], timeout=840)
    print(done.stdout, end="")
    expect(done.returncode == 0, f"the tests on the box ended with {done.returncode}\n{done.stderr}")


main()
