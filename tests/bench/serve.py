#!/usr/bin/env python3
"""What an honest client of twinlock-serve waits for at most while others attack it, the server's memory, and what a twin of 10 ms beside it
loses, and how long its steps take: `tests/bench/serve.py [SECONDS]`.

Each attack goes on for so long (default 10 s); before them, the twin runs as long undisturbed. Ends with 1 if somebody waited for more than 2 s, or the server
took more than 64 MiB. It starts what is in build/host, or in $TL_BUILD, and its figures are those of a machine that nobody else uses.
"""
import os
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
os.environ.setdefault("TL_SOURCE", str(ROOT))
os.environ.setdefault("TL_BUILD", str(ROOT / "build/host"))
os.environ.setdefault("TWINLOCK", os.environ["TL_BUILD"] + "/bin/twinlock")
sys.path.insert(0, str(ROOT / "tests/support"))

from floods import ATTACKS, HONEST, longest_wait  # noqa: E402  the path is set above
from live_test import Device, query  # noqa: E402
from retuned import Retuned  # noqa: E402
from served import MOTOR, Box  # noqa: E402
from supervised import end_orderly, wait_for_run  # noqa: E402
from tree import OMEGA  # noqa: E402

LIMIT_S, LIMIT_MIB = 2.0, 64.0
COUNTS = "ticks", "skipped", "deadline_misses"


def counts(box):
    state = box.ask("GET", f"{MOTOR[:-len('motor')]}twin", "read", address=HONEST).end
    return [state[name] for name in COUNTS]


def print_twin(what, before, after, database):
    """Of the steps between the two."""
    lost = [new - old for old, new in zip(before, after)]
    used = sorted(nanoseconds / 1e6 for nanoseconds, in query(
        database, f"SELECT used_ns FROM steps WHERE step BETWEEN {before[0] + 1} AND {after[0]}"))
    print(f"twin, {what:12} {lost[0]} ticks, {lost[1]} skipped, {lost[2]} deadlines missed; a step took {used[len(used) // 2]:.3f} ms in the middle, "
          f"{used[len(used) * 99 // 100]:.3f} of 99 %, {used[-1]:.3f} at most", flush=True)


def main():
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 10.0
    is_good = True
    with Device(OMEGA) as device, Retuned(device.port) as live, Box() as box:
        (box.folder / "plants/twin").mkdir()
        (box.folder / "plants/twin/control").symlink_to(live.socket)
        wait_for_run(live, live.database, 1)
        box.put(b'{"x": "' + 260000 * b"y" + b'"}')
        before = counts(box)
        time.sleep(seconds * len(ATTACKS))
        between = counts(box)
        for attack in ATTACKS:
            wait = longest_wait(box, attack, seconds)
            is_good = is_good and wait <= LIMIT_S
            print(f"{attack.__name__:18} {wait:6.3f} s", flush=True)
        after = counts(box)
        memory = box.memory() / 2**20
        end_orderly(live)
        print_twin("undisturbed", before, between, live.database)
        print_twin("attacked", between, after, live.database)
    print(f"memory             {memory:6.1f} MiB")
    sys.exit(0 if is_good and memory <= LIMIT_MIB else 1)


main()
