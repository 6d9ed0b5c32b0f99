"""Zips one FMU so that the same contents always give the same bytes: fixed order, times and modes.

Usage: package.py FMU NAME=FILE ...    writes FMU with each FILE under its NAME

`cmake -E tar --format=zip --mtime=...` is not enough: it adds access and change times and user ids. Needs
nothing but Python's standard library.
"""

import sys
import zipfile
from pathlib import Path

MIDNIGHT_2000 = (2000, 1, 1, 0, 0, 0)
UNIX = 3
REGULAR_FILE_0755 = 0o100755


def main():
    fmu, *members = sys.argv[1:]
    with zipfile.ZipFile(fmu, "w") as archive:
        for name, _, file in sorted(member.partition("=") for member in members):
            info = zipfile.ZipInfo(name, MIDNIGHT_2000)
            info.create_system = UNIX
            info.external_attr = REGULAR_FILE_0755 << 16
            info.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(info, Path(file).read_bytes())


if __name__ == "__main__":
    main()
