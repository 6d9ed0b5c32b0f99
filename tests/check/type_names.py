#!/usr/bin/env python3
"""A type's name exists once: no two files define a type, a struct, a union or an enum of the same name.

Names of a file's own count as well, since a reader who looks for one finds both. What a test or an FMU defines is its own.
"""
import re

import tree
from folders import FLOORS

# Contracts: each header declares the type, and each of its implementations has a definition of its own.
CONTRACTS = {"tl_optimiser", "tl_plant_io", "tl_gpio_chip", "tl_gpio_line"}

COMMENT = re.compile(r"/\*.*?\*/|//[^\n]*|\"(?:[^\"\\\n]|\\.)*\"", re.DOTALL)
TAGGED = re.compile(r"\b(?:struct|union|enum)\s+(\w+)\s*\{")
# The end of a typedef: its name, at the start of a line behind the brace, or at the end of its line.
NAMED = re.compile(r"^\}\s*(?:__attribute__\(\(.*?\)\)\s*)?(\w+)\s*[,;]|^typedef\b[^{};]*?\b(\w+)(?:\[\w*\])*;"
                   r"|^typedef\b[^;{}]*\{[^{}]*\}\s*(\w+)"
                   r"|^typedef\b[^{};()]*\(\*(\w+)\)\(|^typedef\b[^{};()]*?\b(\w+)\([^;]*\);", re.MULTILINE)


def defined(text):
    """The names of the types that a file defines."""
    code = COMMENT.sub(" ", text)
    names = set(TAGGED.findall(code))
    for groups in NAMED.findall(code):
        names.update(name for name in groups if name)
    opaque = set(re.findall(r"^typedef\s+(?:struct|union|enum)\s+(\w+)\s+\1;", code, re.MULTILINE))
    return names - (opaque - set(TAGGED.findall(code)))


def main():
    places = {}
    sources = tree.files(".c", ".h", under=tuple(FLOORS))
    for path in sources:
        for name in defined(tree.text(path)):
            places.setdefault(name, []).append(path)
    for name, paths in sorted(places.items()):
        if name in CONTRACTS:
            continue
        for path in paths[1:]:
            tree.finding(path, 0, f"defines the type {name}, as {paths[0]} does")
    tree.finish(f"{len(places)} types")


main()
