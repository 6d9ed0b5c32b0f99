#!/usr/bin/env python3
"""Tests and checks find the files of another user's clone, which git does not trust, without a
change of settings."""
import os
import subprocess
import sys

import debian
from twinlock_test import SOURCE, expect, main, scratch

FOREIGN = {**os.environ, "GIT_TEST_ASSUME_DIFFERENT_OWNER": "1"}  # git's own test of that case


def clone():
    """A repository with two files and an ignored one."""
    root = scratch()
    for name, text in ((".gitignore", "*.db\n"), ("mine.txt", "mine\n"), ("left.db", "left\n")):
        (root / name).write_text(text, encoding="utf-8")
    subprocess.run(["git", "-C", root, "init", "--quiet"], check=True)
    return root


def test_files_are_found():
    root = clone()
    plain = subprocess.run(["git", "-C", root, "ls-files"], env=FOREIGN, stdout=subprocess.PIPE, stderr=subprocess.PIPE, check=False, encoding="utf-8")
    expect(plain.returncode != 0 and "dubious ownership" in plain.stderr, f"git trusts everybody here: {plain.stderr}")
    os.environ["GIT_TEST_ASSUME_DIFFERENT_OWNER"] = "1"
    expect(sorted(debian.sources(root=root)) == [".gitignore", "mine.txt"], f"{debian.sources(root=root)}")
    found = debian.output_of(sys.executable, "-c", "import tree; print(*tree.files())", root, cwd=SOURCE / "tests" / "check")
    expect(found.split() == [".gitignore", "mine.txt"], found)


main()
