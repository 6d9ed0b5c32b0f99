#!/usr/bin/env python3
"""Makes a seed of fuzz_config_change: two texts, a NUL between. The build runs it: tests/fuzz/config_change_seeds.py FOLDER"""
import sys
from pathlib import Path

BEFORE = b'{"connect": [["a","b"],["c","d"]], "delays": {"synchronous": [["x","y"]]}}'
AFTER = b'{"connect": [["c","d"],["a","b"],["e","f"]], "delays": "measure"}'


def main():
    (Path(sys.argv[1]) / "arrays").write_bytes(BEFORE + b"\0" + AFTER)


if __name__ == "__main__":
    main()
