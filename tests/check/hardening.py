#!/usr/bin/env python3
"""Everything that is shipped is compiled with what makes a bug harder to use: `hardening.py ROOT BUILD`.

Looked at are the commands of the build: those of the floors, and those that make FMUs for each machine.
"""
import json
import os
import re
import shlex
import sys

import tree

FLAGS = ("-fstack-protector-strong", "-fstack-clash-protection", "-D_FORTIFY_SOURCE=2")
SHIPPED = ("master", "board", "firmware", "fmus")
FMU = re.compile(r"^  COMMAND = .*-fvisibility=hidden -shared .* -o (\S+/fmus/\S+\.so) ", re.MULTILINE)


def check(path, words):
    for flag in FLAGS:
        if flag not in words:
            tree.finding(path, 0, f"is compiled without {flag}")


def main():
    build = os.path.abspath(sys.argv[2])
    count = 0
    with open(os.path.join(build, "compile_commands.json"), encoding="utf-8") as file:
        for entry in json.load(file):
            path = os.path.relpath(entry["file"], tree.root)
            if path.split("/")[0] in SHIPPED:
                count += 1
                check(path, shlex.split(entry["command"]))
    with open(os.path.join(build, "build.ninja"), encoding="utf-8") as file:
        for match in FMU.finditer(file.read()):
            count += 1
            check(os.path.relpath(match[1], build), match[0].split())
    if count == 0:
        tree.finding(os.path.relpath(build, tree.root), 0, "compiles nothing that is shipped")
    tree.finish(f"{count} commands")


main()
