#!/usr/bin/env python3
"""The picture of the house, drawn from the #includes: `picture.py ROOT [--write]`.

docs/rooms.svg shows the rooms and the arrows between them; the table below it in DESIGN.md lists all arrows. Without
--write both are held against the code; with it, they are drawn anew. Rooms stand in storeys: each is above all that it
includes. An arrow that others imply, A -> C beside A -> B -> C, is in the table only.
"""
import os
import re
import sys

import tree
from rooms import FLOORS, ROOMS

DOCUMENT, PICTURE = "DESIGN.md", "docs/rooms.svg"
BEGIN, END = "<!-- rooms: made by tests/check/picture.py --write -->", "<!-- end of rooms -->"
INCLUDE = re.compile(r'^\s*#\s*include\s*"((?:' + "|".join(FLOORS) + r')/[^"]+)"', re.MULTILINE)

BOX, HIGH, GAP, STOREY, MARGIN, LANE = 96, 34, 14, 82, 24, 40  # of the drawing, in pixels
FILL = {"firmware": "#dbe9f6", "board": "#fbe6d0", "master": "#dff0dc"}
LINE = {"firmware": "#4a78a6", "board": "#b9722d", "master": "#4f8a48"}


def read():
    """Room -> (number of files, the rooms it includes)."""
    house = {room: (0, set()) for room in ROOMS}
    for path in tree.files(".c", ".h", under=tuple(FLOORS)):
        room = os.path.dirname(path)
        count, arrows = house.get(room, (0, set()))
        arrows |= {os.path.dirname(target) for target in INCLUDE.findall(tree.text(path))} - {room}
        house[room] = (count + 1, arrows)
    return house


def storeys(house):
    """Room -> how many storeys are below it; a circle is reported."""
    height = {}

    def climb(room, chain):
        if room in chain:
            tree.finding(DOCUMENT, 0, "rooms in a circle: " + " -> ".join(chain[chain.index(room):] + (room,)))
            return 0
        if room not in height:
            height[room] = 1 + max((climb(target, chain + (room,)) for target in house[room][1]), default=-1)
        return height[room]

    for room in house:
        climb(room, ())
    return height


def direct(house, room):
    """The rooms that a room includes and that nothing it includes leads to."""
    seen = set()
    todo = list(house[room][1])
    while todo:
        for target in house[todo.pop()][1] - seen:
            seen.add(target)
            todo.append(target)
    return sorted(house[room][1] - seen)


def floor(room):
    return room.split("/")[0]


def place(house, height):
    """Room -> (x, y) of its upper left corner: a lane for each floor, a row for each storey. In a row the rooms stand in the
    order of those above that include them."""
    places = {}
    left = MARGIN
    top = max(height.values())
    for lane in FLOORS:
        rows = [sorted(room for room in house if floor(room) == lane and height[room] == storey) for storey in range(top + 1)]
        width = max(map(len, rows)) * (BOX + GAP) - GAP
        for storey in range(top, -1, -1):
            above = {room: [places[other][0] for other in places if room in house[other][1] and floor(other) == lane]
                     for room in rows[storey]}
            row = sorted(rows[storey], key=lambda room: (sum(above[room]) / len(above[room]) if above[room] else 0, room))
            begin = left + (width - len(row) * (BOX + GAP) + GAP) / 2
            for number, room in enumerate(row):
                places[room] = (begin + number * (BOX + GAP), MARGIN + (top - storey) * STOREY)
        left += width + LANE
    return places, left - LANE + MARGIN, 2 * MARGIN + top * STOREY + HIGH


def arrow(here, there, colour):
    """A curve from below one box to above another."""
    x1, y1, x2, y2 = here[0] + BOX / 2, here[1] + HIGH, there[0] + BOX / 2, there[1] - 3
    bend = min(48.0, (y2 - y1) / 2)
    return (f'<path d="M{x1:.0f} {y1:.0f}C{x1:.0f} {y1 + bend:.0f} {x2:.0f} {y2 - bend:.0f} {x2:.0f} {y2:.0f}" stroke="{colour}" '
            f'marker-end="url(#{colour[1:]})"/>')


def draw(house, height):
    places, width, high = place(house, height)
    lines = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {high}" font-family="sans-serif" '
             'font-size="14" text-anchor="middle">', "<title>The rooms of twinlock, and what includes what</title>",
             f'<rect width="{width:.0f}" height="{high}" fill="#fff"/>', "<defs>"]
    for colour in LINE.values():
        lines.append(f'<marker id="{colour[1:]}" viewBox="0 0 6 6" refX="4" refY="3" markerWidth="6" markerHeight="6" '
                     f'orient="auto"><path d="M0 0L6 3L0 6z" fill="{colour}"/></marker>')
    lines += ["</defs>", '<g fill="none" stroke-width="1.1" opacity="0.75">']
    for room in sorted(house):
        lines += [arrow(places[room], places[target], LINE[floor(room)]) for target in direct(house, room)]
    lines.append("</g>")
    for room, (x, y) in sorted(places.items()):
        name = room.split("/")[-1] if "/" in room else "main"
        lines.append(f'<rect x="{x:.0f}" y="{y}" width="{BOX}" height="{HIGH}" rx="5" fill="{FILL[floor(room)]}" '
                     f'stroke="{LINE[floor(room)]}"/><text x="{x + BOX / 2:.0f}" y="{y + 22}">{name}</text>')
    for lane in FLOORS:
        middle = [x + BOX / 2 for room, (x, _) in places.items() if floor(room) == lane]
        lowest = max(y for room, (_, y) in places.items() if floor(room) == lane)
        top = min(y for room, (_, y) in places.items() if floor(room) == lane)
        x = (min(middle) + max(middle)) / 2
        y = top - 12 if top > 2 * MARGIN else lowest + HIGH + 20
        lines.append(f'<text x="{x:.0f}" y="{y}" font-weight="bold" fill="{LINE[lane]}">{lane}/</text>')
    return "\n".join(lines) + "\n</svg>\n"


def short(room, arrows):
    """Rooms of the same floor by their last name."""
    own = floor(room) + "/"
    return ", ".join(target.removeprefix(own) for target in sorted(arrows, key=lambda one: (not one.startswith(own), one)))


def table(house, height):
    lines = ["| room | files | includes |", "| --- | --- | --- |"]
    for room in sorted(house, key=lambda one: (list(FLOORS).index(floor(one)), -height[one], one)):
        count, arrows = house[room]
        lines.append(f"| `{room}` | {count} | {short(room, arrows)} |")
    return "\n".join(lines)


def main():
    house = read()
    height = storeys(house)
    text = tree.text(DOCUMENT)
    begin, end = text.find(BEGIN), text.find(END)
    if begin < 0 or end < begin:
        tree.finding(DOCUMENT, 0, f"has no place for the rooms: {BEGIN} … {END}")
        tree.finish(f"{len(house)} rooms")
    wanted = {PICTURE: draw(house, height),
              DOCUMENT: f"{text[:begin]}{BEGIN}\n\n{table(house, height)}\n\n{text[end:]}"}
    for path, content in wanted.items():
        name = os.path.join(tree.root, path)
        if "--write" in sys.argv:
            os.makedirs(os.path.dirname(name), exist_ok=True)
            with open(name, "w", encoding="utf-8") as file:
                file.write(content)
        elif not os.path.exists(name) or tree.text(path) != content:
            tree.finding(path, 0, "the rooms are not the code's: draw them anew by tests/check/picture.py . --write")
    tree.finish(f"{len(house)} rooms")


main()
