#!/usr/bin/env python3
"""Makes the seeds of fuzz_live_tuning: blocks as they should be, and some that are not. The build runs it: tests/fuzz/live_tuning_seeds.py FOLDER"""
import hashlib
import struct
import sys
from pathlib import Path

NUMBER, TEXT, WORDS = 1, 2, 4  # what the harness puts right
INFINITY = float("inf")


def tuning(matches=((1.0, 1.0, 0.0),), adjusts=((1, 0.5, -INFINITY, INFINITY, 0.0, 0.0),), evaluations=60, time=6000000, margin=0.01):
    head = struct.pack("<IIddQq", len(matches), len(adjusts), margin, 0.001, evaluations, time)
    match = b"".join(struct.pack("<ddd", *one) for one in matches).ljust(16 * 24, b"\0")
    return head + match + b"".join(struct.pack("<Qddddd", *one) for one in adjusts).ljust(8 * 48, b"\0")


def block(right=0, number=2, who=b"ann", origin=b"push", why=b"why", text=b"{}", **values):
    digest = hashlib.sha256(text).hexdigest().encode()
    head = struct.pack("<II", number, len(text)) + digest.ljust(65, b"\0") + who.ljust(64, b"\0") + origin.ljust(16, b"\0") + why.ljust(256, b"\0")
    return bytes([right]) + head.ljust(416, b"\0") + tuning(**values) + text


SEEDS = {
    "whole": block(),
    "all_of_each": block(matches=((0.5, 2.0, 3.0),) * 16, adjusts=((1, 1.0, 0.0, 2.0, 0.1, 0.2),) * 8, text=b"{ \"twinlock\": 1 }"),
    "being_written": block(number=3),
    "put_right": block(right=NUMBER | TEXT | WORDS, number=0, who=b"\x1b[2J", text=b"other"),
    "no_tolerance": block(matches=((0.0, 1.0, 0.0),)),
    "too_many": block(matches=((1.0, 1.0, 0.0),) * 16, evaluations=100001),
    "long_who": block(who=b"x" * 64),
}


def main():
    for name, seed in SEEDS.items():
        (Path(sys.argv[1]) / name).write_bytes(seed)


if __name__ == "__main__":
    main()
