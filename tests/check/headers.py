#!/usr/bin/env python3
"""Each header stands alone: it compiles by itself, twice in a row; it says what it is for; and
its include guard is named after its path."""
import concurrent.futures
import os
import re
import subprocess

import tree

FLAGS = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-fsyntax-only", "-x", "c", "-"]
FEATURES = {
    "master": [],  # never any
    "board": ["-D_POSIX_C_SOURCE=200809L", "-D_DEFAULT_SOURCE"],
    "firmware": ["-D_GNU_SOURCE"],
    "fmus": [],
    "tests": ["-D_GNU_SOURCE"],
}
# The FMI headers are always those of this checkout, also when another tree is looked at.
DEPS = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", ".deps")


def check_text(path):
    source = tree.text(path)
    comment = re.match(r"/\*(.*?)\*/", source, re.DOTALL)
    if not comment or len(comment[1].split()) < 4:
        tree.finding(path, 1, "must begin with a comment that says what it is for")
    guard = "TL_" + re.sub(r"\W", "_", path).upper()
    code = re.sub(r"/\*.*?\*/|//[^\n]*", "", source, flags=re.DOTALL).split("\n")
    lines = [line.strip() for line in code if line.strip()]
    if lines[:2] != [f"#ifndef {guard}", f"#define {guard}"] or lines[-1] != "#endif":
        tree.finding(path, 1, f"must have the include guard {guard} around everything")


def compile_alone(path):
    folders = ["-I", tree.root, "-I", os.path.dirname(os.path.join(tree.root, path)),
               "-isystem", os.path.join(DEPS, "fmi2"), "-isystem", os.path.join(DEPS, "unity")]
    source = f'#include "{path}"\n' * 2 + "typedef int tl_not_empty;\n"
    done = subprocess.run(["gcc", *folders, *FEATURES[path.split("/")[0]], *FLAGS], cwd=tree.root,
                          input=source, text=True,
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False)
    return path, done.returncode, done.stdout


def main():
    headers = tree.files(".h", under=tuple(FEATURES))
    for path in headers:
        check_text(path)
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        for path, code, output in pool.map(compile_alone, headers):
            if code != 0:
                tree.finding(path, 0, f"does not compile alone:\n{output.rstrip()}")
    tree.finish(f"{len(headers)} headers")


main()
