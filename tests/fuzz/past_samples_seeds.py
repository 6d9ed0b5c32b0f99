#!/usr/bin/env python3
"""Makes the seeds of fuzz_past_samples: an image that is right by itself, one that is put right, one from the start of a run, and one without ticks. The
build runs it: tests/fuzz/past_samples_seeds.py FOLDER"""
import hashlib
import struct
import sys
from pathlib import Path

STEP, START = 10_000_000, 5_000_000_000_000
NEVER = -2**63
AS_IT_IS, RIGHT = b"\0", b"\x0f"  # beginning, signals, run and number of ticks are put right by the harness


def signals():
    digest = ""
    for name in "plant.torque", "plant.omega":
        digest = hashlib.sha256(f"{digest} {name}".encode()).hexdigest()
    return digest.encode()


def tick(number):
    """Without u; stamps count from t_start."""
    stamps = (NEVER if number == 0 else number * STEP - 1234, number * STEP)
    return struct.pack("=B2d2q2B", 0, 0.1 * number, 60.0 - number, *stamps, number % 2, number % 6)


def image(first, count):
    ticks = b"".join(tick(first + i) for i in range(count))
    size = 128 + len(ticks)
    return struct.pack("=8sQ65s7xQqQqq", b"twlksmp1", size, signals(), 2, first, count, STEP, START) + ticks


def main():
    folder = Path(sys.argv[1])
    (folder / "right").write_bytes(AS_IT_IS + image(1000, 8))
    (folder / "put_right").write_bytes(RIGHT + image(500, 2))
    (folder / "start").write_bytes(RIGHT + image(0, 6))
    (folder / "no_ticks").write_bytes(RIGHT + image(77, 0))


if __name__ == "__main__":
    main()
