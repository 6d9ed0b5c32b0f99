#!/usr/bin/env python3
"""script/bootstrap --cross: quick and silent where there is nothing to do, and where something fails it says what, and leaves what
was there. It runs in a copy of the repository's head, with programs that fail in place of some."""
import os
import shutil
import subprocess
import time

from twinlock_test import SOURCE, at_most, expect, main, scratch

MACHINES = {"armhf": "arm-linux-gnueabihf", "arm64": "aarch64-linux-gnu"}
DEPS = SOURCE / ".deps"
APT = """#!/bin/sh
for word in "$@"; do case $word in Dir::Cache=*) cache=${word#*=} ;; esac; done
case " $* " in
    *Dir::State=*) ;;
    *) exec %s "$@" ;; # the machine's own lists, which a fresh container has not
esac
case " $* " in
    *" $TL_FAILS "*) echo "this fails on purpose" >&2; exit 100 ;;
    *" update "*) ;;
    *" install "*) echo "this is no package" >"$cache/archives/broken.deb" ;;
    *) exec %s "$@" ;;
esac
""" % (shutil.which("apt-get"), shutil.which("apt-get"))  # fetches nothing else


def copy():
    """A repository with everything but sysroots."""
    root = scratch()
    (root / "script").mkdir()
    (root / ".deps").mkdir()
    for name in ("bootstrap", "requirements.txt"):
        shutil.copy2(SOURCE / "script" / name, root / "script" / name)
    shutil.copytree(SOURCE / "script" / "shared", root / "script" / "shared")
    for name in ("unity", "fmi2"):
        shutil.copytree(DEPS / name, root / ".deps" / name)
    (root / ".deps" / "venv").symlink_to(DEPS / "venv")
    return root


def bootstrap(root, *arguments, programs=None, fails="nothing does"):
    """(exit code, stdout, stderr), with some programs replaced."""
    folder = scratch()
    for name, text in (programs or {}).items():
        path = folder / name
        path.write_text(text, encoding="utf-8")
        path.chmod(0o755)
    done = subprocess.run([root / "script" / "bootstrap", *arguments], capture_output=True, text=True, timeout=300, check=False,
                          env={**os.environ, "PATH": f"{folder}:{os.environ['PATH']}", "TL_FAILS": fails})
    left = sorted((root / ".deps").glob("tmp.*"))
    expect(not left, f"left in .deps: {left}")
    return done.returncode, done.stdout, done.stderr


def expect_failure(found, *words):
    code, _, err = found
    for word in ("bootstrap: error: ", "bootstrap: what to do: ", *words):
        expect(code == 1 and word in err, f"ended with {code}, without \"{word}\":\n{err}")


def old_sysroot(root):
    """One that another version has made."""
    folder = root / ".deps" / "sysroot" / "armhf"
    folder.mkdir(parents=True)
    (folder / ".complete").write_text("something else", encoding="utf-8")
    (folder / "library").write_text("old", encoding="utf-8")
    return folder


# ---- what there is ----

def test_links_stay_inside():
    """A link that leads out of it would be one to this machine's library."""
    for machine, triplet in MACHINES.items():
        root = DEPS / "sysroot" / machine
        links = [path for path in root.rglob("*") if path.is_symlink()]
        expect(len(links) > 20, f"{machine}: only {len(links)} links")
        for link in links:
            expect(link.resolve().is_relative_to(root), f"{link} leads to {link.resolve()}")
        for name in ("libm.so", "libsqlite3.so", "libzip.so"):
            expect((root / "usr/lib" / triplet / name).exists(), f"{machine}: no {name}")


def test_nothing_but_headers_and_libraries():
    """The emulator looks for every file there first: no /tmp, no /etc. (And what dpkg knows of the packages.)"""
    for machine in MACHINES:
        root = DEPS / "sysroot" / machine
        found = {path.name for path in root.iterdir()} | {str(path.relative_to(root)) for top in ("usr", "var", "var/lib")
                                                          for path in (root / top).iterdir()}
        expect(found == {".complete", "lib", "usr", "usr/include", "usr/lib", "var", "var/lib", "var/lib/dpkg"}, f"{machine}: {sorted(found)}")


def test_nothing_to_do():
    root = copy()
    (root / ".deps" / "sysroot").symlink_to(DEPS / "sysroot")
    begun = time.monotonic()
    expect(bootstrap(root, "--cross") == (0, "bootstrap: nothing to do\n", ""), "something to do")
    at_most(time.monotonic() - begun, 5, "s for nothing")
    expect(bootstrap(root, "--quiet", "--cross") == (0, "", ""), "--quiet is not")


# ---- what fails ----

def test_usage():
    root = copy()
    code, out, err = bootstrap(root, "--cross", "--nonsense")
    expect(code == 2 and not out and "usage: script/bootstrap [--build | --all] [--cross]" in err, f"{code}: {err}")
    code, out, _ = bootstrap(root, "--cross", "--help")
    expect(code == 0 and "qemu-user" in out, f"{code}: {out}")


def test_another_machine():
    programs = {"dpkg": "#!/bin/sh\necho riscv64\n"}
    expect_failure(bootstrap(copy(), "--cross", programs=programs), "amd64", "riscv64", "script/build")


def expect_old_one_kept(fails, *words):
    root = copy()
    old = old_sysroot(root)
    expect_failure(bootstrap(root, "--cross", programs={"apt-get": APT}, fails=fails), *words)
    expect((old / "library").read_text(encoding="utf-8") == "old", "the old sysroot has changed")
    expect(not (root / ".deps" / "sysroot" / "arm64").exists(), "there is one for arm64")


def test_no_lists():
    expect_old_one_kept("update", "packages for armhf could not be fetched", "this fails on purpose")


def test_no_packages():
    expect_old_one_kept("install", "packages for armhf could not be fetched", "this fails on purpose")


def test_a_package_that_is_damaged():
    expect_old_one_kept("nothing", "packages for armhf could not be unpacked", "not a Debian format archive")


main()
