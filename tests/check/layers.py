#!/usr/bin/env python3
"""Arrows point down only: every #include is held against the floors, and our headers have no cycle."""
import os
import re

import tree

PLAN = "master/plan.h"  # plain data that a configuration becomes; it knows fmi and base only

# Folder -> folders and files of ours that it may include. A folder not named here takes what the one above it has.
MAY_INCLUDE = {
    "master/base": ["master/base"],
    "master/fmi": ["master/fmi", "master/base"],
    "master/graph": ["master/graph", "master/cache", "master/fmi", "master/base", PLAN],
    "master/cache": ["master/cache", "master/fmi", "master/base", PLAN],
    "master/sync": ["master/sync", "master/cache", "master/graph", "master/fmi", "master/base", PLAN],
    PLAN: ["master/fmi", "master/base"],
    "master": ["master"],
    "board": ["board", "master/base"],
    "firmware": ["firmware", "board", "master"],
    "fmus": ["fmus"],
    "tests": ["tests", "firmware", "board", "master"],
    "tests/hil/fmus": ["fmus/common"],  # FMUs as ours are
}
DRIVERS = "board/io"  # a driver (modbus.c, modbus_link.h, ...) sees itself, this contract and master/base
CONTRACT = "board/io/plant_io.h"

C99 = set("assert complex ctype errno fenv float inttypes iso646 limits locale math setjmp signal stdarg stdbool "
          "stddef stdint stdio stdlib string tgmath time wchar wctype".split())
FMI = re.compile(r"fmi2\w+\.h$")
# Standard headers that would bring clocks, files, locales or signals into the master.
NOT_IN_MASTER = {"time.h", "signal.h", "locale.h", "setjmp.h", "errno.h"}
# Libraries that belong to one floor.
OWNER = {"nlopt.h": "master/sync", "modbus.h": "board", "gpiod.h": "board", "cJSON.h": "firmware",
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


def driver(path):
    """What a file of DRIVERS belongs to: modbus for modbus.c and modbus_link.h."""
    return re.match(r"[^_.]*", os.path.basename(path))[0]


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
    elif below(path, DRIVERS) and below(target, DRIVERS):
        if target != CONTRACT and driver(target) != driver(path):
            tree.finding(path, number, f"a driver may not know another driver: {target}")


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
