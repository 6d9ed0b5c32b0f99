#!/usr/bin/env python3
"""Makes the seeds of fuzz_csv that are no text: gzip, UTF-16, and both. The build runs it: tests/fuzz/csv_seeds.py FOLDER"""
import gzip
import sys
from pathlib import Path

ROWS = "time;omega;brake\n0;1;2\n"


def main():
    folder = Path(sys.argv[1])
    (folder / "compressed.csv").write_bytes(gzip.compress(ROWS.encode(), mtime=0))
    (folder / "wide.csv").write_bytes(ROWS.encode("utf-16"))
    (folder / "compressed_wide.csv").write_bytes(gzip.compress(ROWS.encode("utf-16"), mtime=0))


if __name__ == "__main__":
    main()
