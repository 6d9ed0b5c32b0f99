#!/usr/bin/env python3
"""What an honest client of twinlock-serve waits for at most while others attack it, and the server's memory: `tests/bench/serve.py [SECONDS]`.

Each attack goes on for so long (default 10 s). Ends with 1 if somebody waited for more than 2 s, or the server took more than 64 MiB. It starts what
is in build/host, or in $TL_BUILD.
"""
import os
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
os.environ.setdefault("TL_SOURCE", str(ROOT))
os.environ.setdefault("TL_BUILD", str(ROOT / "build/host"))
os.environ.setdefault("TWINLOCK", os.environ["TL_BUILD"] + "/bin/twinlock")
sys.path.insert(0, str(ROOT / "tests/support"))

from floods import ATTACKS, longest_wait  # noqa: E402  the path is set above
from served import Box  # noqa: E402

LIMIT_S, LIMIT_MIB = 2.0, 64.0


def main():
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 10.0
    is_good = True
    with Box() as box:
        box.put(b'{"x": "' + 260000 * b"y" + b'"}')
        for attack in ATTACKS:
            wait = longest_wait(box, attack, seconds)
            is_good = is_good and wait <= LIMIT_S
            print(f"{attack.__name__:18} {wait:6.3f} s", flush=True)
        memory = box.memory() / 2**20
    print(f"memory             {memory:6.1f} MiB")
    sys.exit(0 if is_good and memory <= LIMIT_MIB else 1)


main()
