#!/usr/bin/env python3
"""The package on a bare Debian 12: apt finds all it depends on; what it installs runs and can be administered; and it
goes away as it should. The Debian is made for this test, in a folder (mmdebstrap), and forgotten.

`test_install.py` makes it; `test_install.py --inside ROOT` is what runs in it, before it is forgotten.
"""
import os
import re
import subprocess
import sys
from pathlib import Path

import debian
import twinlock_test
from debian import output_of
from twinlock_test import Skip, at_most, expect, scratch

SCORE = 2.5  # of `systemd-analyze security`: 0 is a cell, 10 is the whole machine
EXAMPLES = "/usr/share/doc/twinlock/examples"
ROOT = Path(sys.argv[2]) if sys.argv[1:2] == ["--inside"] else None


# ---- The Debian ------------------------------------------------------------------------------------------------------
def sources():
    """Debian's archive as this machine is configured to reach it: lines for sources.list."""
    line = "deb [signed-by=/usr/share/keyrings/debian-archive-keyring.gpg] $(REPO_URI) $(RELEASE) $(COMPONENT)"
    found = output_of("apt-get", "indextargets", "--format", line, "Created-By: Packages", "Origin: Debian",
                      "Label: Debian")
    if not found:
        raise Skip("apt knows no archive of Debian's here")
    return "".join(f"{line}\n" for line in sorted(set(found.splitlines())))


def make_and_enter():
    """The exit code of the tests inside; raises Skip where there is no network."""
    debian.need("mmdebstrap")
    package = debian.make()
    copied = scratch() / "twinlock.deb"  # under the same name inside
    copied.write_bytes(package.read_bytes())
    command = ["mmdebstrap", "--quiet", "--variant=apt", "--format=null", f"--include={copied}",
               f"--setup-hook=mkdir -p \"$1{copied.parent}\" && cp '{copied}' \"$1{copied}\"",
               f"--customize-hook='{sys.executable}' '{__file__}' --inside \"$1\"", "bookworm", "-", "-"]
    done = subprocess.run(command, input=sources(), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False,
                          encoding="utf-8", errors="replace", env={**os.environ, "TL_PACKAGE": str(copied)})
    print(done.stdout, end="")
    if done.returncode != 0 and "apt-get update" in done.stdout and "test_" not in done.stdout:
        raise Skip("Debian's archive cannot be reached")
    expect(done.returncode == 0, f"mmdebstrap ended with {done.returncode}; see above")


# ---- Inside ----------------------------------------------------------------------------------------------------------
def inside(*args, user="root"):
    """Standard output of a command in the Debian, which must succeed."""
    return output_of("chroot", f"--userspec={user}:{user}", ROOT, *args,
                     env={"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "LC_ALL": "C.UTF-8", "DEBIAN_FRONTEND": "noninteractive"})


def place(path):
    return ROOT / path.lstrip("/")


def of_ours():
    """Every path with our name in it, outside of what the kernel shows."""
    found = inside("find", "/", "-xdev", "(", "-path", "/proc", "-o", "-path", "/sys", "-o", "-path", "/tmp", "-o",
                   "-path", "/var/lib/dpkg", ")", "-prune", "-o", "-name", "*twinlock*", "-print")
    return sorted(found.splitlines())


def test_the_program_runs():
    expect(inside("twinlock", "--help").startswith("usage: twinlock VERB"), "another help")


def test_the_examples_are_good():
    """As installed: their FMUs, recordings and schema are found."""
    for folder in sorted(path for path in place(EXAMPLES).iterdir() if path.is_dir() and list(path.glob("*.json"))):
        if folder.name == "schema":
            continue
        names = [path.name for path in sorted(folder.glob("*.json")) if "emulate" not in path.read_text("utf-8")]
        for name in names[:2] + names[-1:]:
            inside("twinlock", "check", f"{EXAMPLES}/{folder.name}/{name}")
    said = inside("twinlock", "replay", f"{EXAMPLES}/motor/lock.json")
    expect("MSE" in said, said)


def test_a_user_of_its_own():
    _, _, uid, _, _, home, shell = inside("getent", "passwd", "twinlock").strip().split(":")
    expect(int(uid) < 1000 and home == "/var/lib/twinlock" and shell == "/usr/sbin/nologin", f"{uid} {home} {shell}")
    expect(set(inside("id", "-nG", "twinlock").split()) == {"twinlock", "dialout"}, inside("id", "twinlock"))


def test_nothing_is_enabled():
    found = inside("find", "/etc/systemd", "-name", "*twinlock*")
    expect(found == "", found)
    expect(list(place("/etc/twinlock").iterdir()) == [], "a configuration of ours")


def exposure_of(unit):
    """After systemd has found nothing wrong with it."""
    inside("systemd-analyze", "verify", "--man=no", unit)
    said = inside("systemd-analyze", "security", "--offline=true", "--no-pager", unit)
    return float(re.search(r"Overall exposure level.*: ([0-9.]+)", said)[1])


def test_the_unit():
    at_most(exposure_of("twinlock@motor.service"), SCORE, "exposure")


def test_the_unit_with_the_drop_ins_of_the_examples():
    folder = place("/etc/systemd/system/twinlock@dropped.service.d")
    folder.mkdir(parents=True)
    for drop_in in place(f"{EXAMPLES}/systemd").glob("*.conf"):
        (folder / drop_in.name).write_bytes(drop_in.read_bytes())
    expect(len(list(folder.iterdir())) == 2, "other drop-ins")
    at_most(exposure_of("twinlock@dropped.service"), SCORE, "exposure")
    inside("rm", "-r", "/etc/systemd/system/twinlock@dropped.service.d")


def test_it_runs_as_its_user():
    """The configuration and the places of the unit, and a plant beside it."""
    inside("cp", f"{EXAMPLES}/motor/live.json", "/etc/twinlock/motor.json")
    inside("install", "-d", "-o", "twinlock", "-g", "twinlock", "-m", "750", "/var/lib/twinlock")
    script = (f"twinlock plant {EXAMPLES}/motor/live.json >/dev/null 2>&1 & plant=$!; "
              "twinlock run /etc/twinlock/motor.json --db /var/lib/twinlock/motor.db --duration 1; code=$?; "
              "kill $plant; exit $code")
    said = inside("sh", "-c", script, user="twinlock")
    expect("locked" in said or "MSE" in said, said)
    expect("motor bench" in inside("twinlock", "show", "/var/lib/twinlock/motor.db"), "no run in the database")


def test_enabled_by_the_administrator():
    inside("systemctl", "enable", "twinlock@motor")
    expect(place("/etc/systemd/system/multi-user.target.wants/twinlock@motor.service").is_symlink(), "not enabled")


def test_an_upgrade_keeps_everything():
    before = place("/var/lib/twinlock/motor.db").read_bytes()
    inside("dpkg", "--install", os.environ["TL_PACKAGE"])
    expect(place("/var/lib/twinlock/motor.db").read_bytes() == before, "another database")
    expect(place("/etc/twinlock/motor.json").exists(), "the configuration is gone")
    expect(place("/etc/systemd/system/multi-user.target.wants/twinlock@motor.service").is_symlink(), "disabled")


def test_removal_leaves_what_is_not_ours():
    inside("dpkg", "--remove", "twinlock")
    found = of_ours()
    expect(found == ["/etc/systemd/system/multi-user.target.wants/twinlock@motor.service", "/etc/twinlock",
                     "/var/lib/twinlock"], f"{found}")
    expect(place("/var/lib/twinlock/motor.db").exists(), "the database is gone")


def test_a_purge_takes_the_databases_too():
    inside("dpkg", "--purge", "twinlock")
    found = of_ours()
    expect(found == ["/etc/twinlock"], f"{found}")
    expect(place("/etc/twinlock/motor.json").exists(), "the administrator's configuration is gone")
    expect(inside("getent", "passwd", "twinlock"), "the user is gone")


if ROOT is None:
    try:
        make_and_enter()
    except Skip as skip:
        print(f"skipped: {skip.why}")
        raise
else:
    sys.argv[1:] = []
    twinlock_test.main()
