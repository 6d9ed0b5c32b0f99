#!/usr/bin/env python3
"""What the objects need and offer: `symbols.py ROOT BUILD`.

The undefined symbols of every object of the master are held against master_symbols.txt: no malloc outside start-up,
no printf, no clock, no file; those of the CAN driver, and what drivers share, against can_symbols.txt: nothing that could send. And every symbol
that our libraries offer has the prefix tl_. By their calls folders do not know each other in a circle, nor do the files of a folder.
"""
import fnmatch
import os
import re
import subprocess
import sys

import tree

HERE = os.path.dirname(os.path.abspath(__file__))
# floor: objects, what they may need. What the CAN driver shares with others may not send either.
NEEDS = {"master": (["*"], "master_symbols.txt"), "board": (["can/*", "io/*"], "can_symbols.txt")}
# Of the drivers' libraries: what would write to the plant.
WRITES = re.compile(r"modbus_(write|mask_write|reply)|gpiod_\w*(set_value|_output)")
# What an FMU asks the C library for, and gets from us: these stand in the place of its functions.
REPLACES = ("rollback/fmu_libc.c.o",)
FLOORS = {"master": "tl_master", "board": "tl_board", "firmware": "tl_firmware"}


def read_allowed(name):
    """[(object pattern, [symbol patterns])] in the file's order."""
    rules = []
    with open(os.path.join(HERE, name), encoding="utf-8") as file:
        for line in file:
            line = line.split("#")[0].strip()
            if line:
                pattern, symbols = line.split(":")
                rules.append((pattern.strip(), symbols.split()))
    return rules


def symbols(paths, *options):
    """{path: symbols} of all of them, by one nm: it starts much slower than it reads."""
    found = {path: [] for path in paths}
    if not paths:
        return found
    done = subprocess.run(["nm", "--format=posix", "--print-file-name", *options, *paths], stdout=subprocess.PIPE, text=True, check=True)
    for line in done.stdout.splitlines():
        path, _, rest = line.partition(": ")
        found[path].append(rest.split()[0])
    return found


def needed(paths):
    return symbols(paths, "--undefined-only")


def offered(paths):
    return symbols(paths, "--extern-only", "--defined-only")


def objects(build, floor):
    """(path from the floor, path) of each object, for example ("base/arena.c.o", ...)."""
    top = os.path.join(build, floor, "CMakeFiles", FLOORS[floor] + ".dir")
    for folder, _, names in sorted(os.walk(top)):
        for name in sorted(names):
            path = os.path.join(folder, name)
            source = os.path.join(tree.root, floor, os.path.relpath(path, top).removesuffix(".o"))
            if name.endswith(".c.o") and os.path.exists(source):  # not what an older tree left in the build folder
                yield os.path.relpath(path, top), path


def check_needs(build, floor, chosen, listed):
    rules = read_allowed(listed)
    looked_at = [(name, path) for name, path in objects(build, floor) if any(fnmatch.fnmatch(name, one) for one in chosen)]
    paths = [path for _, path in looked_at]
    own = {symbol for some in offered(paths).values() for symbol in some}
    needs = needed(paths)
    for name, path in looked_at:
        allowed = [symbol for pattern, some in rules if fnmatch.fnmatch(name, pattern) for symbol in some]
        for symbol in needs[path]:
            plain = re.sub(r"^__(\w+)_chk$", r"\1", symbol)  # the checked variants of _FORTIFY_SOURCE
            if symbol not in own and not any(fnmatch.fnmatch(plain, pattern) for pattern in allowed):
                tree.finding(f"{floor}/{name}", 0, f"needs {symbol}, which {listed} does not allow there")


def find_circles(graph):
    """The sets of nodes that reach each other (Tarjan's strongly connected components)."""
    index, low, stack, circles = {}, {}, [], []

    def visit(node):
        index[node] = low[node] = len(index)
        stack.append(node)
        for target in sorted(graph.get(node, ())):
            if target not in index:
                visit(target)
                low[node] = min(low[node], low[target])
            elif target in stack:
                low[node] = min(low[node], index[target])
        if low[node] == index[node]:
            members = [stack.pop()]
            while members[-1] != node:
                members.append(stack.pop())
            if len(members) > 1:
                circles.append(sorted(members))

    for node in sorted(graph):
        if node not in index:
            visit(node)
    return circles


def check_circles(floor, needs, offers):
    """`needs`, `offers`: name of an object -> its symbols. What stands in the place of the C library's functions is called by all."""
    home = {symbol: name for name, symbols_ in offers.items() for symbol in symbols_ if symbol.startswith("tl_")}
    files, folders = {}, {}
    for name, some in needs.items():
        for target in {home[symbol] for symbol in some if symbol in home} - {name}:
            files.setdefault(name, set()).add(target)
            if os.path.dirname(target) != os.path.dirname(name):
                folders.setdefault(os.path.dirname(name), set()).add(os.path.dirname(target))
    for circle in find_circles(folders) + find_circles(files):
        tree.finding(f"{floor}/{circle[0]}", 0, "call each other in a circle: " + ", ".join(circle))


def main():
    build = os.path.abspath(sys.argv[2])
    for floor, (chosen, listed) in NEEDS.items():
        check_needs(build, floor, chosen, listed)
    count = 0
    for floor in FLOORS:
        looked_at = list(objects(build, floor))
        paths = [path for _, path in looked_at]
        needs, offers = needed(paths), offered(paths)
        count += len(looked_at)
        check_circles(floor, {name: needs[path] for name, path in looked_at}, {name: offers[path] for name, path in looked_at})
        for name, path in looked_at:
            for symbol in needs[path]:
                if WRITES.match(symbol):
                    tree.finding(f"{floor}/{name}", 0, f"needs {symbol}, which would write to the plant")
            for symbol in offers[path]:
                if not symbol.startswith("tl_") and name not in REPLACES:
                    tree.finding(f"{floor}/{name}", 0, f"offers {symbol}: a global name begins with tl_")
    tree.finish(f"{count} objects")


main()
