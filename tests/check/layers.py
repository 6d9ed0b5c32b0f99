#!/usr/bin/env python3
"""Arrows point down only: every #include is held against the floors, and our headers have no cycle."""
import os
import re

import tree

DRIVERS = ("can", "csv", "gpio", "modbus")  # folders of board/: each sees itself, the contract and master/base

# Folder -> folders and files of ours that it may include. A folder not named here takes what the one above it has.
MAY_INCLUDE = {
    "master/base": ["master/base"],
    "master/fmi": ["master/fmi", "master/base"],
    "master/plan": ["master/plan", "master/fmi", "master/base"],
    "master/cache": ["master/cache", "master/plan", "master/fmi", "master/base"],
    "master/graph": ["master/graph", "master/cache", "master/plan", "master/fmi", "master/base"],
    "master": ["master"],
    "board": ["board", "master/base"],
    **{f"board/{driver}": [f"board/{driver}", "board/io", "master/base"] for driver in DRIVERS},
    "firmware": ["firmware", "board", "master"],
    "fmus": ["fmus"],
    "tests": ["tests", "firmware", "board", "master"],
    "tests/hil/fmus": ["fmus/common"],  # FMUs as ours are
}

C99 = set("assert complex ctype errno fenv float inttypes iso646 limits locale math setjmp signal stdarg stdbool "
          "stddef stdint stdio stdlib string tgmath time wchar wctype".split())
FMI = re.compile(r"fmi2\w+\.h$")
# Standard headers that would bring clocks, files, locales or signals into the master.
NOT_IN_MASTER = {"time.h", "signal.h", "locale.h", "setjmp.h", "errno.h"}
# Libraries that belong to one floor.
OWNER = {"nlopt.h": "master/solve", "modbus.h": "board", "gpiod.h": "board", "cJSON.h": "firmware",
         "sqlite3.h": "firmware", "expat.h": "firmware", "zip.h": "firmware", "dlfcn.h": "firmware"}

READS_FILES = "fmus/csv"  # the one model that does: without waiting, which takes POSIX

INCLUDE = re.compile(r'^\s*#\s*include\s*(?:"([^"]+)"|<([^>]+)>)')


def below(path, folder):
    return path.startswith(folder + "/")


def rule(path):
    """The folders and files that a file may include."""
    while path and path not in MAY_INCLUDE:
        path = os.path.dirname(path)
    return MAY_INCLUDE.get(path, [])


def resolve(path, name):
    """A quoted include as a path from the root; None if it is no file of ours."""
    beside = os.path.normpath(os.path.join(os.path.dirname(path), name))
    for candidate in (name, beside):
        if os.path.isfile(os.path.join(tree.root, candidate)):
            return candidate
    return None


def check_ours(path, number, name, target):
    if target.endswith(".c"):
        tree.finding(path, number, f"includes a source file: {target}")
    if target != name and not below(path, "fmus"):
        tree.finding(path, number, f'say "{target}", from the root of the repository')
    if not any(target == allowed or below(target, allowed) for allowed in rule(path)):
        tree.finding(path, number, f"{os.path.dirname(path)} may not know {target}")


def check_foreign(path, number, name):
    base = os.path.basename(name)
    owner = OWNER.get(base)
    if owner and not below(path, owner) and not below(path, "tests"):
        tree.finding(path, number, f"<{name}> belongs to {owner}")
    if below(path, READS_FILES):
        return
    if not (below(path, "master") or below(path, "fmus")) or owner or FMI.match(base):
        return
    if name.removesuffix(".h") not in C99 or (below(path, "master") and name in NOT_IN_MASTER):
        tree.finding(path, number, f"<{name}> is not for {path.split('/')[0]}: plain C99 only, no clock, no system")


def find_cycle(graph):
    """Reports each chain of headers that comes back to where it began."""
    state = {}

    def visit(path, chain):
        state[path] = "open"
        for target in sorted(graph.get(path, ())):
            if state.get(target) == "open":
                cycle = chain[chain.index(target):] + [target]
                tree.finding(path, 0, "include cycle: " + " -> ".join(cycle))
            elif target not in state:
                visit(target, chain + [target])
        state[path] = "done"

    for path in sorted(graph):
        if path not in state:
            visit(path, [path])


def main():
    graph = {}
    sources = tree.files(".c", ".h", under=("master", "board", "firmware", "fmus", "tests"))
    for path in sources:
        for number, line in enumerate(tree.text(path).splitlines(), 1):
            match = INCLUDE.match(line)
            if not match:
                continue
            target = resolve(path, match[1]) if match[1] else None
            if target:
                check_ours(path, number, match[1], target)
                graph.setdefault(path, set()).add(target)
            elif match[1] and "/" in match[1]:
                tree.finding(path, number, f'there is no "{match[1]}"')
            else:
                check_foreign(path, number, match[1] or match[2])
    find_cycle(graph)
    tree.finish(f"{len(sources)} files")


main()
