#!/usr/bin/env python3
"""script/build installs only what the build needs, and configures the product without tests; with
tests only if their dependencies are installed. It runs in a copy in which nothing is compiled."""
import os
import shutil
import subprocess

from twinlock_test import SOURCE, Skip, expect, expect_line, main, scratch

DEPS = SOURCE / ".deps"
PROGRAMS = {
    "cmake": '#!/bin/sh\n[ "$1" != --build ] || exec echo "no work is done" \nexec %s "$@"\n' % shutil.which("cmake"),
}


def copy():
    """A copy of the repository with only the dependencies of the build."""
    root = scratch()
    for path in SOURCE.iterdir():
        if path.name not in (".git", ".deps", "build", "script"):
            (root / path.name).symlink_to(path)
    shutil.copytree(SOURCE / "script", root / "script")
    bootstrap = root / "script" / "bootstrap"
    bootstrap.rename(root / "script" / "real_bootstrap")
    bootstrap.write_text('#!/bin/sh\necho "$@" >>asked_for\nexec script/real_bootstrap "$@"\n', encoding="utf-8")
    bootstrap.chmod(0o755)
    (root / ".deps").mkdir()
    (root / ".deps" / "fmi2").symlink_to(DEPS / "fmi2")
    return root


def build(root, *arguments):
    """Runs script/build, and returns the options with which it called script/bootstrap."""
    folder = scratch()
    for name, text in PROGRAMS.items():
        (folder / name).write_text(text, encoding="utf-8")
        (folder / name).chmod(0o755)
    (root / "asked_for").write_text("", encoding="utf-8")
    done = subprocess.run([root / "script" / "build", *arguments], env={**os.environ, "PATH": f"{folder}:{os.environ['PATH']}"},
                          stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, encoding="utf-8", check=False)
    expect(done.returncode == 0, f"{arguments}: {done.returncode}: {done.stdout}")
    return (root / "asked_for").read_text(encoding="utf-8").split()


def targets(root):
    return (root / "build" / "host" / "build.ninja").read_text(encoding="utf-8")


def test_with_tests_if_their_dependencies_are_there():
    root = copy()
    expect("--build" in build(root), "it installs more than the build needs")
    without = targets(root)
    expect("bin/twinlock:" in without and "motor.fmu" in without and "twinlock.1.gz" in without, "parts of the product are missing")
    expect("test_arena" not in without and "unity" not in without and ".deps/venv" not in without, "tests would be built")
    for name in ("unity", "venv"):
        (root / ".deps" / name).symlink_to(DEPS / name)
    expect("--build" not in build(root), "it does not update the dependencies of tests")
    expect("test_arena" in targets(root), "no tests are built")


def test_fmus_for_all_machines_if_there_are_compilers():
    """After script/test built FMUs for this machine, script/test --all installs the other
    compilers."""
    if not (DEPS / "sysroot" / "arm64" / ".complete").exists():
        raise Skip("there is no sysroot for arm64: script/bootstrap --cross installs it")
    root = copy()
    build(root)
    expect("aarch64-linux/motor.so" not in targets(root), "FMUs are built for an ARM without its libraries")
    (root / ".deps" / "sysroot").symlink_to(DEPS / "sysroot")
    build(root)
    expect("binaries/aarch64-linux/motor.so" in targets(root), "FMUs are still built for this machine only")


def test_by_hand_without_bootstrap():
    root = copy()
    done = subprocess.run(["cmake", "--preset", "host"], cwd=root, stdout=subprocess.PIPE, stderr=subprocess.PIPE, encoding="utf-8", check=False)
    expect(done.returncode == 1, done.stderr)
    expect_line(done.stderr, ".deps/unity/unity.c|script/bootstrap")


main()
