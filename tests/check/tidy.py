#!/usr/bin/env python3
"""clang-tidy over everything the build compiles: `tidy.py ROOT BUILD`. What it looks for is in .clang-tidy.

A file that was clean is not looked at again until something changes that can change the result: the file, a header
of ours that it includes, its compiler command, .clang-tidy, or clang-tidy itself. The memory is BUILD/tidy.
"""
import concurrent.futures
import hashlib
import json
import os
import re
import shlex
import subprocess
import sys

import tree

GCC_ONLY = re.compile(r" -fno-ipa-[a-z-]+")
# Nearly all of the time is the analyzer's, which walks through some hundreds of megabytes: large pages save a tenth of it.
LARGE_PAGES = {"GLIBC_TUNABLES": "glibc.malloc.hugetlb=1"}

# Half of what the analyzer may spend on one function: little more than half of the time. Of 584 null pointers put at the ends
# of the functions of the 25 largest files it finds 501 without this limit, and all of these but one with it.
LESS = [word for option in ("-analyzer-config", "max-nodes=100000") for word in ("--extra-arg=-Xclang", f"--extra-arg={option}")]


def run(command, folder):
    return subprocess.run(command, cwd=folder, env={**os.environ, **LARGE_PAGES}, stdout=subprocess.PIPE,
                          stderr=subprocess.PIPE, text=True, check=False)


def inputs(entry):
    """The file and all headers of ours that it includes, found by the compiler."""
    words = shlex.split(entry["command"])
    output = words.index("-o")
    done = run(words[:output] + words[output + 2:] + ["-MM"], entry["directory"])
    if done.returncode != 0:
        return None
    return sorted(set(shlex.split(done.stdout.replace("\\\n", " "))[1:]))


def configurations(path):
    """The .clang-tidy files that apply to a file."""
    folder = os.path.dirname(path)
    while folder.startswith(tree.root):
        name = os.path.join(folder, ".clang-tidy")
        if os.path.exists(name):
            yield name
        folder = os.path.dirname(folder)


def key(entry, version):
    names = inputs(entry)
    if names is None:
        return None
    digest = hashlib.sha256((version + entry["command"] + " ".join(LESS)).encode())
    for name in names + list(configurations(entry["file"])):
        with open(os.path.join(entry["directory"], name), "rb") as file:
            content = file.read()
        digest.update(f"{name} {len(content)} ".encode())
        digest.update(content)
    return digest.hexdigest()


def write_commands(entries, folder):
    """The commands as clang understands them: it refuses flags that are gcc's alone."""
    with open(os.path.join(folder, "compile_commands.json"), "w", encoding="utf-8") as file:
        json.dump([{**entry, "command": GCC_ONLY.sub("", entry["command"])} for entry in entries], file)


def check(entry, build, version):
    """None if the file is clean, else what clang-tidy says."""
    name = key(entry, version)
    stamp = os.path.join(build, "tidy", name) if name else None
    if stamp and os.path.exists(stamp):
        return None
    done = run(["clang-tidy", "--quiet", "-p", os.path.join(build, "tidy"), *LESS, entry["file"]], entry["directory"])
    if done.returncode != 0:
        return done.stdout.strip() or done.stderr.strip()
    if stamp:
        open(stamp, "w", encoding="utf-8").close()
    return None


def is_quick(path):
    """Tests have short functions of their own: what calls much is dear."""
    return os.path.relpath(path, tree.root).startswith(("tests/unit", "tests/support", "fmus"))


def main():
    os.nice(5)  # tests that wait go first
    build = os.path.abspath(sys.argv[2])
    os.makedirs(os.path.join(build, "tidy"), exist_ok=True)
    version = run(["clang-tidy", "--version"], build).stdout
    with open(os.path.join(build, "compile_commands.json"), encoding="utf-8") as file:
        once = {entry["file"]: entry for entry in reversed(json.load(file))}  # shared sources are compiled often
    entries = [entry for name, entry in sorted(once.items())
               if not os.path.relpath(name, tree.root).startswith((".", "build"))]
    write_commands(entries, os.path.join(build, "tidy"))
    entries.sort(key=lambda entry: is_quick(entry["file"]))  # so that no dear one is left for the end
    with concurrent.futures.ThreadPoolExecutor(2) as pool:
        for entry, report in zip(entries, pool.map(lambda entry: check(entry, build, version), entries)):
            if report is not None:
                tree.finding(os.path.relpath(entry["file"], tree.root), 0, report)
    tree.finish(f"{len(entries)} files")


main()
