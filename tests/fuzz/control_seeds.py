#!/usr/bin/env python3
"""Makes the seeds of fuzz_control: each a message that is sent to one end as it should be, or changed in one place. The build runs it:
tests/fuzz/control_seeds.py FOLDER"""
import struct
import sys
from pathlib import Path

SERVER, CLIENT, VERDICT = range(3)
SHOW, TAKE, PROBLEM, END = 0, 3, 4, 6  # tl_control_verb; tl_control_kind


def text(content=None):
    """What comes as memory; None: nothing does."""
    return bytes([1]) if content is None else bytes([0]) + struct.pack(">I", len(content)) + content


def changed(*places):
    """Those bytes of the message: (where, to what)."""
    return bytes([len(places)]) + b"".join(struct.pack(">IB", where, value) for where, value in places)


def message(end, kind, content, *places):
    return bytes([end, kind]) + text(content) + bytes([1]) + changed(*places)


def raw(end, kind, content):
    return bytes([end, kind]) + text() + bytes([0]) + struct.pack(">I", len(content)) + content


SEEDS = {
    "show": message(SERVER, SHOW, None),
    "take": message(SERVER, TAKE, b"{}"),
    "clean_name": message(SERVER, SHOW, None, (192, ord("a"))),
    "raw_request": raw(SERVER, SHOW, b"hello"),
    "problem": message(CLIENT, PROBLEM, None),
    "end": message(CLIENT, END, None, (8, 1)),
    "raw_reply": raw(CLIENT, END, b""),
    "verdict": bytes([VERDICT]) + changed((4, 1), (8, 1), (24, 0x1B)),
}


def main():
    for name, seed in SEEDS.items():
        (Path(sys.argv[1]) / name).write_bytes(seed)


if __name__ == "__main__":
    main()
