#!/usr/bin/env python3
"""Makes the seeds of fuzz_past: an image with a checkpoint, one of inputs, one from the start, and samples. The build runs it:
tests/fuzz/past_seeds.py FOLDER"""
import struct
import sys
from pathlib import Path

STEP, NOW = 10_000_000, 5_000_000_000_000
RIGHT = b"\7"  # magic, size, start and signals are put right by the harness
NO_STEP, STEPPED, BEGAN_ANEW = 0, 1, 2


def tick(number, step, adjusts):
    stamps = (-2**63 if number == 0 else number * STEP - 1234, number * STEP)
    u = (0.0 if step == NO_STEP else 0.003,) * adjusts
    return struct.pack(f"=B2d2q2B{adjusts}d", step, 0.1 * number, 60.0 - number, *stamps, number % 2, 0, *u)


def tuning(tick):
    """Of one match and one variable."""
    values = struct.pack("=IIddQq", 1, 1, 0.01, 0.001, 60, 6000000) + struct.pack("=ddd", 1.0, 1.0, 0.0).ljust(16 * 24, b"\0")
    adjust = struct.pack("=Qddddd", 1, 0.0031, -1.0, 1.0, 0.0, 0.0).ljust(8 * 48, b"\0")
    return struct.pack("=qI65s3x", tick, 2, b"a" * 64) + values + adjust


def image(origin, first, count, checkpoint, taken=b""):
    matches, adjusts, components = (0, 0, 0) if origin == 0 else (1, 1, 2)  # of samples: none
    ticks = b"".join(tick(first + i, (NO_STEP, STEPPED, BEGAN_ANEW)[i * adjusts], adjusts) for i in range(count))
    size = 181 + len(taken) + len(checkpoint) + len(ticks)
    last = first + count - 1
    head = struct.pack("=8s7q6QI65x", b"twlkpst6", size, 7, first, last, STEP, NOW - last * STEP, 1_700_000_000_000,
                       len(checkpoint), len(taken) // 888, 2, matches, adjusts, components, origin)
    return RIGHT + head + checkpoint + taken + ticks


def main():
    folder = Path(sys.argv[1])
    (folder / "checkpoint").write_bytes(image(1, 1001, 3, b"state"))
    (folder / "tunings").write_bytes(image(1, 1001, 3, b"state", tuning(900) + tuning(1002)))
    (folder / "start").write_bytes(image(2, 0, 3, b""))
    (folder / "inputs").write_bytes(image(3, 500, 2, b""))
    (folder / "samples").write_bytes(image(0, 1000, 8, b""))
    (folder / "no_ticks").write_bytes(image(1, 77, 0, b"state"))


if __name__ == "__main__":
    main()
