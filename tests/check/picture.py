#!/usr/bin/env python3
"""The picture of the house, drawn from the #includes: `picture.py ROOT [--write]`.

docs/folders.svg shows the folders and the arrows between them. Without --write it is compared with the code; with it, it is drawn
again. Folders stand in levels: each is above all that it includes. An arrow that others imply, A -> C beside A -> B -> C, is omitted.
"""
import os
import re
import sys

import tree
from folders import FLOORS, FOLDERS

PICTURE = "docs/folders.svg"
INCLUDE = re.compile(r'^\s*#\s*include\s*"((?:' + "|".join(FLOORS) + r')/[^"]+)"', re.MULTILINE)

BOX, HIGH, GAP, LEVEL, MARGIN, LANE = 96, 34, 14, 82, 24, 40  # of the drawing, in pixels
FILL = {"firmware": "#dbe9f6", "board": "#fbe6d0", "master": "#dff0dc"}
LINE = {"firmware": "#4a78a6", "board": "#b9722d", "master": "#4f8a48"}


def read():
    """Folder -> the folders that it includes."""
    house = {folder: set() for folder in FOLDERS}
    for path in tree.files(".c", ".h", under=tuple(FLOORS)):
        folder = os.path.dirname(path)
        house.setdefault(folder, set()).update({os.path.dirname(target) for target in INCLUDE.findall(tree.text(path))} - {folder})
    return house


def levels(house):
    """Folder -> how many levels are below it; a circle is reported."""
    height = {}

    def climb(folder, chain):
        if folder in chain:
            tree.finding(PICTURE, 0, "folders in a circle: " + " -> ".join(chain[chain.index(folder):] + (folder,)))
            return 0
        if folder not in height:
            height[folder] = 1 + max((climb(target, chain + (folder,)) for target in house[folder]), default=-1)
        return height[folder]

    for folder in house:
        climb(folder, ())
    return height


def direct(house, folder):
    """The folders that a folder includes and that nothing it includes leads to."""
    seen = set()
    todo = list(house[folder])
    while todo:
        for target in house[todo.pop()] - seen:
            seen.add(target)
            todo.append(target)
    return sorted(house[folder] - seen)


def floor(folder):
    return folder.split("/")[0]


def place(house, height):
    """Folder -> (x, y) of its upper left corner: a lane for each floor, a row for each level. In a row the folders stand in the
    order of those above that include them."""
    places = {}
    left = MARGIN
    top = max(height.values())
    for lane in FLOORS:
        rows = [sorted(folder for folder in house if floor(folder) == lane and height[folder] == level) for level in range(top + 1)]
        width = max(map(len, rows)) * (BOX + GAP) - GAP
        for level in range(top, -1, -1):
            above = {folder: [places[other][0] for other in places if folder in house[other] and floor(other) == lane]
                     for folder in rows[level]}
            row = sorted(rows[level], key=lambda folder: (sum(above[folder]) / len(above[folder]) if above[folder] else 0, folder))
            begin = left + (width - len(row) * (BOX + GAP) + GAP) / 2
            for number, folder in enumerate(row):
                places[folder] = (begin + number * (BOX + GAP), MARGIN + (top - level) * LEVEL)
        left += width + LANE
    return places, left - LANE + MARGIN, 2 * MARGIN + top * LEVEL + HIGH


def arrow(here, there, colour):
    """A curve from below one box to above another."""
    x1, y1, x2, y2 = here[0] + BOX / 2, here[1] + HIGH, there[0] + BOX / 2, there[1] - 3
    bend = min(48.0, (y2 - y1) / 2)
    return (f'<path d="M{x1:.0f} {y1:.0f}C{x1:.0f} {y1 + bend:.0f} {x2:.0f} {y2 - bend:.0f} {x2:.0f} {y2:.0f}" stroke="{colour}" '
            f'marker-end="url(#{colour[1:]})"/>')


def draw(house, height):
    places, width, high = place(house, height)
    lines = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {high}" font-family="sans-serif" '
             'font-size="14" text-anchor="middle">', "<title>The folders of twinlock, and what includes what</title>",
             f'<rect width="{width:.0f}" height="{high}" fill="#fff"/>', "<defs>"]
    for colour in LINE.values():
        lines.append(f'<marker id="{colour[1:]}" viewBox="0 0 6 6" refX="4" refY="3" markerWidth="6" markerHeight="6" '
                     f'orient="auto"><path d="M0 0L6 3L0 6z" fill="{colour}"/></marker>')
    lines += ["</defs>", '<g fill="none" stroke-width="1.1" opacity="0.75">']
    for folder in sorted(house):
        lines += [arrow(places[folder], places[target], LINE[floor(folder)]) for target in direct(house, folder)]
    lines.append("</g>")
    for folder, (x, y) in sorted(places.items()):
        name = folder.split("/")[-1] if "/" in folder else "main"
        lines.append(f'<rect x="{x:.0f}" y="{y}" width="{BOX}" height="{HIGH}" rx="5" fill="{FILL[floor(folder)]}" '
                     f'stroke="{LINE[floor(folder)]}"/><text x="{x + BOX / 2:.0f}" y="{y + 22}">{name}</text>')
    for lane in FLOORS:
        middle = [x + BOX / 2 for folder, (x, _) in places.items() if floor(folder) == lane]
        lowest = max(y for folder, (_, y) in places.items() if floor(folder) == lane)
        top = min(y for folder, (_, y) in places.items() if floor(folder) == lane)
        x = (min(middle) + max(middle)) / 2
        y = top - 12 if top > 2 * MARGIN else lowest + HIGH + 20
        lines.append(f'<text x="{x:.0f}" y="{y}" font-weight="bold" fill="{LINE[lane]}">{lane}/</text>')
    return "\n".join(lines) + "\n</svg>\n"


def main():
    house = read()
    content = draw(house, levels(house))
    name = os.path.join(tree.root, PICTURE)
    if "--write" in sys.argv:
        os.makedirs(os.path.dirname(name), exist_ok=True)
        with open(name, "w", encoding="utf-8") as file:
            file.write(content)
    elif not os.path.exists(name) or tree.text(PICTURE) != content:
        tree.finding(PICTURE, 0, "the folders are not the code's: draw them again by tests/check/picture.py . --write")
    tree.finish(f"{len(house)} folders")


main()
