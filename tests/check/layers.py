#!/usr/bin/env python3
"""Arrows point down only: every #include is held against the plan (folders.py), the libraries against their owners.
Neither headers nor pairs of a source and its header know each other in a circle."""
import os
import re

import tree
from folders import FIRMWARE, FLOORS, FOLDERS, MOST_ARROWS, MOST_FOLDERS, MOST_LEVELS

FMUS = "fmus"
# Outside of the plan: folder -> folders of ours that it may include. One not named here takes what the one above it has.
OUTSIDE = {
    FMUS: [FMUS],
    "tests": ["tests", *FLOORS],
    "tests/hil/fmus": ["fmus/common"],  # FMUs as ours are
    "tests/fmu/copies": ["tests/fmu/copies", "fmus/common"],
    "tests/fmu/hostile": ["tests/fmu/hostile", "fmus/common"],
    "tests/fmu/keeper": ["fmus/common", "tests/fmu/keeper"],
}

C99 = set("assert complex ctype errno fenv float inttypes iso646 limits locale math setjmp signal stdarg stdbool "
          "stddef stdint stdio stdlib string tgmath time wchar wctype".split())
FMI = re.compile(r"fmi2\w+\.h$")
# Standard headers that would bring clocks, files, locales or signals into the master.
NOT_IN_MASTER = {"time.h", "signal.h", "locale.h", "setjmp.h", "errno.h"}
# Libraries, and the folders and files they belong to.
OWNERS = {
    "nlopt.h": ("master/solve",),
    "modbus.h": ("board/modbus",),
    "gpiod.h": ("board/gpio",),
    "cJSON.h": ("firmware/config", "firmware/base/json.c"),
    "sqlite3.h": ("firmware/store",),
    "expat.h": ("firmware/fmu",),
    "zlib.h": ("board/csv",),
    "zip.h": ("firmware/fmu",),
    "seccomp.h": ("firmware/process",),
    "landlock.h": ("firmware/process",),
    "dlfcn.h": ("master/example", "firmware/fmu", "firmware/rollback/fmu_libc.c",
                "firmware/rollback/fmu_memory.c", "firmware/rollback/fmu_regions.c"),
    "watchdog.h": ("board/watchdog",),
    "microhttpd.h": ("firmware/serve",),
    "gnutls.h": ("firmware/serve/certificate.c",),
    "x509.h": ("firmware/serve/certificate.c",),
    "grp.h": ("firmware/process/confine.c", "firmware/rollback/fmu_libc.c"),
    "pwd.h": ("firmware/retune/control_client.c", "firmware/rollback/fmu_libc.c"),
    "iconv.h": ("firmware/rollback/fmu_libc.c", "firmware/fmu/model_description.c"),
    "libintl.h": ("firmware/rollback/fmu_libc.c",),
    "threads.h": ("firmware/rollback/fmu_libc.c",),
    # Who starts threads, or has a lock that several of them take.
    "pthread.h": ("firmware/base/os.c", "firmware/base/os.h", "firmware/base/relay.h", "firmware/cli/plant_server.c",
                  "firmware/fmu/fmu_thread.c", "firmware/live/child.h", "firmware/live/log_relay.h",
                  "firmware/plant/plant_reader.c", "firmware/process/crash.c",
                  "firmware/rollback/fmu_libc.c", "firmware/store/database_file.c", "firmware/store/recorder.c",
                  "firmware/twin/twin_process.c"),
}

MADE = "description.h"  # of an FMU, from its modelDescription.xml
# What else the floors above the master may include: C99, the system, and no library that has no owner.
SYSTEM = set("dirent.h elf.h fcntl.h gcov.h getopt.h libgen.h link.h malloc.h net/if.h arpa/inet.h netdb.h netinet/in.h netinet/tcp.h poll.h printf.h "
             "sched.h stdio_ext.h strings.h termios.h unistd.h sanitizer/lsan_interface.h".split())
SYSTEM_FOLDERS = ("sys/", "linux/")

READS_FILES = "fmus/csv"  # the one model that does: without waiting, which takes POSIX

COMMENT = re.compile(r"/\*.*?\*/|//[^\n]*", re.DOTALL)
INCLUDE = re.compile(r'^\s*#\s*(?:include|include_next|import)\b\s*(.*)')
PLAIN = re.compile(r'"([^"]+)"$|<([^>]+)>$')


def below(path, folder):
    return path == folder or path.startswith(folder + "/")


def floor(path):
    return path.split("/")[0]


def outside(path):
    """What a file that is in no folder may include."""
    while path and path not in OUTSIDE:
        path = os.path.dirname(path)
    return OUTSIDE.get(path, [])


def resolve(path, name, quoted):
    """An include as a path from the root; None if it is no file of ours."""
    beside = os.path.normpath(os.path.join(os.path.dirname(path), name))
    for candidate in (name, beside) if quoted else (name,):
        if os.path.isfile(os.path.join(tree.root, candidate)):
            return candidate
    return None


def check_arrow(path, number, target):
    here, there = os.path.dirname(path), os.path.dirname(target)
    if here not in FOLDERS:
        if not any(below(target, allowed) for allowed in outside(path)):
            tree.finding(path, number, f"{here} may not know {target}")
    elif there != here:
        public = FOLDERS[there].public if there in FOLDERS else ()
        if there not in FOLDERS[here].may:
            tree.finding(path, number, f"{here} may not know {target}")
        elif target.endswith("_parts.h") or (public and os.path.basename(target).removesuffix(".h") not in public):
            tree.finding(path, number, f"{target} is private to {there}" + (f"; public there: {', '.join(public)}" if public else ""))


def check_ours(path, number, name, target):
    if not target.endswith(".h"):
        tree.finding(path, number, f"includes a source file: {target}")
    if target != name and not below(path, FMUS):
        tree.finding(path, number, f'say "{target}", from the root of the repository')
    check_arrow(path, number, target)


def check_foreign(path, number, name):
    owners = OWNERS.get(os.path.basename(name))
    is_system = name in SYSTEM or name.startswith(SYSTEM_FOLDERS) or name.removesuffix(".h") in C99
    if floor(path) in FLOORS and not owners and not is_system and not FMI.match(os.path.basename(name)):
        tree.finding(path, number, f"<{name}> has no owner: give it one in tests/check/layers.py")
    if owners and floor(path) in FLOORS and not any(below(path, owner) for owner in owners):
        tree.finding(path, number, f"<{name}> belongs to {', '.join(owners)}")
    if below(path, READS_FILES) or FMI.match(os.path.basename(name)) or (below(path, FMUS) and name == MADE):
        return
    if floor(path) not in ("master", FMUS) or (owners and floor(owners[0]) == floor(path)):
        return
    if name.removesuffix(".h") not in C99 or (below(path, "master") and name in NOT_IN_MASTER):
        tree.finding(path, number, f"<{name}> is not for {floor(path)}: plain C99 only, no clock, no system")


def find_circle(graph, what):
    """Reports each chain of nodes that comes back to where it began."""
    state = {}

    def visit(node, chain):
        state[node] = "open"
        for target in sorted(graph.get(node, ())):
            if state.get(target) == "open":
                circle = chain[chain.index(target):] + [target]
                tree.finding(node, 0, f"{what}: " + " -> ".join(circle))
            elif target not in state:
                visit(target, chain + [target])
        state[node] = "done"

    for node in sorted(graph):
        if node not in state:
            visit(node, [node])


def pair(path):
    """x.c, x.h and x_parts.h, what several sources behind x.h share, are one."""
    return os.path.splitext(path)[0].removesuffix("_parts")


def between_pairs(graph):
    """The same arrows between pairs."""
    pairs = {}
    for path, targets in graph.items():
        if floor(path) in FLOORS:
            pairs.setdefault(pair(path), set()).update(pair(target) for target in targets)
            pairs[pair(path)].discard(pair(path))
    return pairs


def check_folders(sources):
    """Each source of the floors is in a folder of the plan."""
    for path in sources:
        if floor(path) not in (*FLOORS, FMUS, "tests"):
            tree.finding(path, 0, f"{floor(path)} is no floor of the plan in tests/check/folders.py")
        elif floor(path) in FLOORS and os.path.dirname(path) not in FOLDERS:
            tree.finding(path, 0, f"{os.path.dirname(path)} is no folder of the plan in tests/check/folders.py")


def level(folder, arrows):
    return 1 + max((level(target, arrows) for target in arrows[folder]), default=0)


def check_limits(graph):
    """Firmware stays small to read: few folders, few arrows between them, few levels."""
    arrows = {folder: set() for folder in FIRMWARE if folder != "firmware"}
    for path, targets in graph.items():
        here = os.path.dirname(path)
        if here in arrows:
            arrows[here] |= {os.path.dirname(target) for target in targets if os.path.dirname(target) in arrows} - {here}
    if tree.has_findings(): # an arrow that points up might close a circle, which has no levels
        return
    counts = (("folders", len(arrows), MOST_FOLDERS), ("arrows between folders", sum(map(len, arrows.values())), MOST_ARROWS),
              ("levels", max(level(folder, arrows) for folder in arrows), MOST_LEVELS))
    print("firmware: " + ", ".join(f"{count} {what}" for what, count, _ in counts))
    for what, count, most in counts:
        if count > most:
            tree.finding("firmware", 0, f"{count} {what}, expected at most {most}")


def includes(text):
    """(line, what is included, as it stands there) of a file, but for comments."""
    code = COMMENT.sub(lambda comment: " " + "\n" * comment[0].count("\n"), text)
    for number, line in enumerate(code.splitlines(), 1):
        match = INCLUDE.match(line)
        if match:
            yield number, match[1].strip()


def main():
    graph = {}
    sources = tree.files(".c", ".h")
    for path in sources:
        for number, what in includes(tree.text(path)):
            match = PLAIN.match(what)
            if not match:
                tree.finding(path, number, f'an include says "a file" or <a file> and no more: {what}')
                continue
            name = match[1] or match[2]
            target = resolve(path, name, bool(match[1]))
            if target:
                check_ours(path, number, name, target)
                graph.setdefault(path, set()).add(target)
            elif match[1] and "/" in name:
                tree.finding(path, number, f'there is no "{name}"')
            else:
                check_foreign(path, number, name)
            if target and match[2]:
                tree.finding(path, number, f'say "{name}", not <{name}>')
    find_circle(graph, "include cycle")
    find_circle(between_pairs(graph), "these pairs know each other in a circle")
    check_folders(sources)
    check_limits(graph)
    tree.finish(f"{len(sources)} files")


main()
