#!/usr/bin/env python3
"""A clean clone on a bare Debian 13: script/bootstrap finds its packages, script/package builds,
and replays commit the same bits as on Debian 12.

build/debian13 contains the Debian, from the mirror of this machine's apt. The test makes it again
after a week, because updates change its libraries.
"""
import functools
import os
import platform
import shutil
import subprocess
import time

import debian
from twinlock_test import SOURCE, Skip, expect, expect_line, main

RELEASE = "trixie"
WEEK_S = 7 * 24 * 3600
LIMIT_S = 900  # of one command; together they take 3 minutes
ROOT = SOURCE / "build" / "debian13"
TREE = "/srv/twinlock"
ALONE = ["unshare", "--mount", "--pid", "--fork", "--kill-child"]  # neither mounts nor processes remain
MOUNTS = 'mount --rbind /dev "$0/dev" && mount -t proc proc "$0/proc" && '


def call(*command, **options):
    return subprocess.run(list(map(str, (*ALONE, *command))), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False, encoding="utf-8",
                          errors="replace", timeout=LIMIT_S, **options)


def remove(path):
    subprocess.run(["rm", "-rf", "--one-file-system", path], check=True)


def make(root):
    """Makes the Debian, with the proxy settings of this machine's apt. dpkg does not sync, because
    the test can make it again."""
    ways = [line for line in debian.output_of("apt-config", "dump", "Acquire").splitlines() if line.startswith(("Acquire::http", "Acquire::Check"))]
    done = call("mmdebstrap", "--quiet", "--variant=apt", "--skip=cleanup/apt", "--dpkgopt=force-unsafe-io", *(f"--aptopt={line}" for line in ways),
                RELEASE, root, "-", input=debian.archive(RELEASE))
    print(done.stdout, end="")
    if done.returncode != 0:
        raise Skip(f"no Debian 13 could be made: mmdebstrap ended with {done.returncode}, see above")


@functools.cache
def tree():
    """Copies the files of a clone into the Debian, with the pinned FMI headers, so that the test
    needs no PyPI."""
    if debian.release() == RELEASE:
        raise Skip("this machine is a Debian 13 itself")
    debian.need("mmdebstrap", "unshare")
    if os.geteuid() != 0 or call("mount", "-t", "proc", "proc", "/proc").returncode != 0:
        raise Skip("this takes root and its right to mount")
    if not ROOT.exists() or ROOT.stat().st_ctime < time.time() - WEEK_S:
        remove(ROOT)
        made = ROOT.with_suffix(".new")
        remove(made)
        make(made)
        made.rename(ROOT)
    shutil.copy("/etc/resolv.conf", ROOT / "etc" / "resolv.conf")
    folder = ROOT / TREE.lstrip("/")
    remove(folder)
    for name in debian.sources():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(SOURCE / name, folder / name, follow_symlinks=False)
    shutil.copytree(SOURCE / ".deps" / "fmi2", folder / ".deps" / "fmi2")
    return folder


def inside(*command, **environment):
    """Output of a command in that tree inside the Debian, which must succeed."""
    tree()
    done = call("sh", "-c", MOUNTS + 'exec chroot "$0" "$@"', ROOT, "env", "-C", TREE, *(f"{name}={value}" for name, value in environment.items()), *command,
                env={"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "HOME": "/root", "LC_ALL": "C.UTF-8", "PYTHONDONTWRITEBYTECODE": "1",
                     **{name: value for name, value in os.environ.items() if name.lower().endswith("_proxy")}})
    expect(done.returncode == 0, f"{' '.join(command)} ended with {done.returncode}\n{done.stdout}")
    return done.stdout


def test_it_builds_and_makes_a_package():
    out = inside("script/package")
    expect(out.count("\npackage: build/package/twinlock") == 2, out)


def test_a_replay_has_no_warning():
    out = inside("build/host/bin/twinlock", "replay", "config/motor/lock.json", TWINLOCK_FMU_PATH="build/host/fmus")
    expect_line(out, "in lock|100.0 %")
    expect("warning" not in out, out)


def test_the_same_bits():
    if platform.machine() != "x86_64":
        raise Skip(f"digests.txt is of x86_64, and this machine is {platform.machine()}")
    out = inside("python3", "script/compare.py", "build/host", "build/host", "--quick", "--digests", "build/digests.txt", PYTHONPATH="script/studies",
                 TL_SHARED="/nowhere")
    print(f"    {out}", end="")
    found = (tree() / "build" / "digests.txt").read_text(encoding="utf-8").splitlines()
    held = [line for line in (SOURCE / "tests" / "script" / "digests.txt").read_text(encoding="utf-8").splitlines() if not line.startswith("shared/")]
    expect(found == held, "other digests than digests.txt:\n" + "\n".join(sorted(set(found) ^ set(held))))


main()
