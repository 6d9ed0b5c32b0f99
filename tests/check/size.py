#!/usr/bin/env python3
"""How large the product is: `size.py [ROOT]` prints the lines of code of each folder, without comments and blanks.

They are held against size.txt. A product that differs by more than 3 % from its total there needs new numbers
(`size.py ROOT --write`), and the commit that brings them says why. Firmware's folders have 800 to 9,000 lines with comments.
"""
import os
import re
import sys

import tree
from folders import FIRMWARE, FLOORS

NUMBERS = "tests/check/size.txt"
GROWTH = 0.03
SMALLEST, LARGEST = 800, 9000  # lines of a folder of firmware, comments and blanks included
COMMENT = re.compile(r'("(?:\\.|[^"\\\n])*")|/\*.*?\*/|//[^\n]*', re.DOTALL)


def code_lines(text):
    bare = COMMENT.sub(lambda match: match[1] or "\n" * match[0].count("\n"), text)
    return sum(1 for line in bare.split("\n") if line.strip())


def measure():
    """Folder -> lines of code, and folder -> lines."""
    code, lines = {}, {}
    for path in tree.files(".c", ".h", under=tuple(FLOORS)):
        folder = os.path.dirname(path)
        text = tree.text(path)
        code[folder] = code.get(folder, 0) + code_lines(text)
        lines[folder] = lines.get(folder, 0) + text.count("\n")
    return code, lines


def read_numbers():
    path = os.path.join(tree.root, NUMBERS)
    if not os.path.exists(path):
        return {}
    with open(path, encoding="utf-8") as file:
        return {name: int(number) for number, name in (line.split() for line in file if not line.startswith("#"))}


def write_numbers(code):
    with open(os.path.join(tree.root, NUMBERS), "w", encoding="utf-8") as file:
        file.write("# Lines of code without comments and blanks: made by tests/check/size.py ROOT --write\n")
        file.writelines(f"{code[folder]:6d} {folder}\n" for folder in sorted(code))


def main():
    code, lines = measure()
    if "--write" in sys.argv[2:]:
        write_numbers(code)
    total, noted = sum(code.values()), sum(read_numbers().values())
    for folder in sorted(code):
        print(f"{code[folder]:6d} {folder}")
        if folder in FIRMWARE and folder != "firmware" and not SMALLEST <= lines[folder] <= LARGEST:
            tree.finding(folder, 0, f"{lines[folder]} lines, expected {SMALLEST} to {LARGEST}: merge or divide the folder")
    for floor in FLOORS:
        print(f"{sum(count for folder, count in code.items() if folder.split('/')[0] == floor):6d} all of {floor}")
    print(f"{total:6d} all")
    if abs(total - noted) > GROWTH * noted:
        tree.finding(NUMBERS, 0, f"{total} lines of code, expected {noted} within {GROWTH:.0%}: write new numbers, and say why in the commit")
    tree.finish(f"{len(code)} folders")


if __name__ == "__main__":
    main()
