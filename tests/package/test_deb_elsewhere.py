#!/usr/bin/env python3
"""The Debian package has the same bytes if it is built from the same sources in another folder."""
import shutil

import debian
from debian import output_of
from twinlock_test import SOURCE, expect, main, scratch


def test_the_same_bytes_from_sources_elsewhere():
    """A new build in another folder, without tests and checks, which are not packed."""
    copy = scratch() / "elsewhere"
    copy.mkdir()
    for name in debian.sources():
        if (SOURCE / name).is_file():
            (copy / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(SOURCE / name, copy / name, follow_symlinks=False)
            shutil.copymode(SOURCE / name, copy / name)
    (copy / ".deps").mkdir()
    for part in (SOURCE / ".deps").iterdir():
        if part.name in ("fmi2", "unity"):  # copy: gcc records the resolved path of a system header
            shutil.copytree(part, copy / ".deps" / part.name)
        elif part.is_dir():
            (copy / ".deps" / part.name).symlink_to(part)
    output_of("cmake", "--preset", "host", cwd=copy)
    output_of("cmake", "--build", "--preset", "host", "-j", "2", "--target", "tl_package", cwd=copy)
    expect(debian.make(copy / "build/host").read_bytes() == debian.make().read_bytes(), "another package from sources elsewhere")


main()
