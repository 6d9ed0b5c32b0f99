"""Helpers for tests of the Debian packages: make and inspect them."""
import os
import platform
import re
import subprocess
from pathlib import Path

from twinlock_test import BUILD, SOURCE, Failure, Skip, expect, scratch


def need(*programs):
    """Skips the test if a program is missing. script/bootstrap installs these only on request."""
    for name in programs:
        if not any(os.access(os.path.join(folder, name), os.X_OK) for folder in os.environ["PATH"].split(":")):
            raise Skip(f"{name} is missing")


def output_of(*args, **options):
    """Standard output of a command, which must succeed."""
    done = subprocess.run(list(map(str, args)), stdout=subprocess.PIPE, stderr=subprocess.PIPE, encoding="utf-8",
                          check=False, **options)
    if done.returncode != 0:
        raise Failure(f"{' '.join(map(str, args))} ended with {done.returncode}\n{done.stdout}{done.stderr}")
    return done.stdout


def sources(*below, root=SOURCE):
    """Paths of files that git tracks or would add. safe.directory permits a clone of another user,
    for this command only."""
    return [name for name in output_of("git", "-c", f"safe.directory={root.resolve()}", "-C", root, "ls-files", "-z", "--cached",
                                       "--others", "--exclude-standard", *below).split("\0") if name]


def release():
    """The code name of this machine's Debian."""
    return platform.freedesktop_os_release()["VERSION_CODENAME"]


def archive(name):
    """Lines of sources.list for the Debian release `name`, with the mirror of this machine's apt.
    """
    line = "deb [signed-by=/usr/share/keyrings/debian-archive-keyring.gpg] $(REPO_URI) $(CODENAME) $(COMPONENT)"
    found = output_of("apt-get", "indextargets", "--format", line, "Created-By: Packages", "Origin: Debian", "Label: Debian")
    if not found:
        raise Skip("apt knows no archive of Debian's here")
    return "".join(f"{line}\n" for line in sorted(set(found.replace(f" {release()}", f" {name}").splitlines())))


def make(build=BUILD, umask=0o022, name="twinlock", **environment):
    """Packs the build folder `build`, with a given umask and environment. Returns the path of the
    package."""
    folder = scratch()
    output_of("cpack", "--config", build / "CPackConfig.cmake", "-B", folder, umask=umask,
              env={**os.environ, **environment})
    packages = list(folder.glob(f"{name}_*.deb"))
    expect(len(packages) == 1, f"cpack has made {packages}")
    return packages[0]


def fields(package):
    """{name: value} of the control file."""
    control = re.sub(r"\n ", " ", output_of("dpkg-deb", "--field", package))
    return dict(line.split(": ", 1) for line in control.splitlines() if line)


def contents(package):
    """[(mode as "-rw-r--r--", "owner/group", path, target of a link or None)]"""
    rows = [line.split(None, 5) for line in output_of("dpkg-deb", "--contents", package).splitlines()]
    return [(mode, owner, *(path.split(" -> ") + [None])[:2]) for mode, owner, _, _, _, path in rows]


def unpacked(package):
    """Unpacks a package into a new folder, with its control files in DEBIAN."""
    folder = scratch()
    output_of("dpkg-deb", "--raw-extract", package, folder / "root")
    return folder / "root"


def needed(program):
    """Names of the libraries that a program is linked to, also of another architecture."""
    return re.findall(r"\(NEEDED\).*\[(.+)\]$", output_of("readelf", "--dynamic", "--wide", program), re.M)


def package_of(library):
    """The Debian package of this architecture that contains a library."""
    paths = re.findall(rf"^\t?\s*{re.escape(library)} .* => (\S+)$", output_of("/sbin/ldconfig", "-p"), re.M)
    expect(paths, f"ldconfig does not know {library}")
    names = {name for path in paths for name in {path, os.path.realpath(path), str(Path("/usr") / path[1:])}}
    for name in sorted(names):
        done = subprocess.run(["dpkg", "-S", name], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, check=False,
                              encoding="utf-8")
        if done.returncode == 0:
            return done.stdout.split(":")[0]
    raise Failure(f"no package has {library}: {paths}")
