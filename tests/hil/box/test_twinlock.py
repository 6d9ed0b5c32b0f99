#!/usr/bin/env python3
"""On the box: twinlock gives the same figures as on the host, bit for bit. tests/hil/test_rig.py
puts the host's into the folder `rig` of the build folder."""
import json

import twinlock_test
from twinlock_test import BUILD, expect


def test_check():
    out = twinlock_test.run_well(["check", twinlock_test.config_path("motor/lock.json")])
    expect("problem" in out.splitlines()[-1], out)


def test_replay_as_on_the_host():
    figures = twinlock_test.replay_json("motor/lock.json")
    print(f"    the replay took {figures['wall_s']:.3f} s here")
    wanted = json.loads((BUILD / "rig" / "lock.json").read_text(encoding="utf-8"))
    expect(figures["steps"] > 1000, f"only {figures['steps']} steps")
    different = {key for key in figures.keys() | wanted.keys() if figures.get(key) != wanted.get(key)} - {"wall_s"}
    expect(not different, f"other figures than on the host: {sorted(different)}")


twinlock_test.main()
