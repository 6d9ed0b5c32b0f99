"""Draws the README's picture of a lock as SVG: the plant, the twin left alone, the twin locked, and the correction.

usage: lock_picture.py TWINLOCK OUT.svg   (TWINLOCK: the program; reads config/motor/free.json and lock.json)
"""
import csv
import io
import subprocess
import sys

WIDTH, LEFT, RIGHT = 860, 64, 20
PLANT, ALONE, LOCKED, INK, GRID, PALE = "#8a8f98", "#d9822b", "#1f6fb2", "#30343b", "#e4e7eb", "#b9d3e8"


def trajectory(twinlock, config):
    """The rows of one replay."""
    done = subprocess.run([twinlock, "replay", config, "--csv", "-"], check=True, capture_output=True, text=True)
    return list(csv.DictReader(io.StringIO(done.stdout)))


class Panel:
    """One plot: maps values to pixels and collects SVG."""

    def __init__(self, top, height, low, high, end):
        self.top, self.height, self.low, self.high, self.end = top, height, low, high, end
        self.parts = []

    def x(self, time):
        return LEFT + (WIDTH - LEFT - RIGHT) * time / self.end

    def y(self, value):
        return self.top + self.height * (self.high - value) / (self.high - self.low)

    def axes(self, ticks, title, seconds):
        for value in ticks:
            y = self.y(value)
            self.parts.append(f'<line x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{y:.1f}" y2="{y:.1f}" stroke="{GRID}"/>')
            self.parts.append(f'<text x="{LEFT - 8}" y="{y + 4:.1f}" text-anchor="end">{value:g}</text>')
        self.parts.append(f'<text x="{LEFT}" y="{self.top - 10}" font-weight="600">{title}</text>')
        if seconds:
            for second in range(0, int(self.end) + 1, 2):
                self.parts.append(f'<text x="{self.x(second):.1f}" y="{self.top + self.height + 18}" '
                                  f'text-anchor="middle">{second} s</text>')

    def line(self, times, values, colour, width):
        points = " ".join(f"{self.x(t):.1f},{self.y(min(max(v, self.low), self.high)):.1f}"
                          for t, v in zip(times, values))
        self.parts.append(f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="{width}" '
                          f'stroke-linejoin="round"/>')

    def legend(self, entries):
        x = WIDTH - RIGHT
        for text, colour in reversed(entries):
            x -= 7 * len(text) + 34
            y = self.top - 14
            self.parts.append(f'<line x1="{x}" x2="{x + 20}" y1="{y}" y2="{y}" stroke="{colour}" stroke-width="3"/>')
            self.parts.append(f'<text x="{x + 26}" y="{y + 4}">{text}</text>')


def smoothed(values, half=10):
    """Means over 2 · half + 1 values, fewer at the ends; with steps of 10 ms over 0.2 s."""
    parts = (values[max(0, i - half):i + half + 1] for i in range(len(values)))
    return [sum(part) / len(part) for part in parts]


def draw(free, lock):
    """The whole SVG text."""
    times = [float(row["time"]) for row in lock]
    plant = [float(row["plant.omega measured"]) for row in lock]
    alone = [float(row["motor.omega simulated"]) for row in free]
    locked = [float(row["motor.omega simulated"]) for row in lock]
    correction = [float(row["motor.d applied"]) - float(row["motor.d nominal"]) for row in lock]
    speed = Panel(44, 250, 40, 85, times[-1])
    speed.axes((40, 50, 60, 70, 80), "motor speed, rad/s", False)
    speed.legend([("plant, measured", PLANT), ("twin left alone", ALONE), ("twin locked", LOCKED)])
    speed.line(times, alone, ALONE, 1.6)
    speed.line(times, plant, PLANT, 3.6)
    speed.line(times, locked, LOCKED, 1.4)
    bound = 1.1 * max(map(abs, correction))
    corrected = Panel(344, 90, -bound, bound, times[-1])
    step = float(f"{bound / 1.6:.1g}")
    corrected.axes((-step, 0, step), "correction Δu of the friction d, N·m·s/rad", True)
    corrected.legend([("each step", PALE), ("mean of 0.2 s", LOCKED)])
    corrected.line(times, correction, PALE, 0.8)
    corrected.line(times, smoothed(correction), LOCKED, 1.6)
    body = "\n".join(speed.parts + corrected.parts)
    return (f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} 464" font-family="sans-serif" '
            f'font-size="12" fill="{INK}">\n<rect width="{WIDTH}" height="464" fill="white"/>\n{body}\n</svg>\n')


def main():
    """Replays twice and writes the picture."""
    twinlock, out = sys.argv[1:3]
    free = trajectory(twinlock, "config/motor/free.json")
    lock = trajectory(twinlock, "config/motor/lock.json")
    with open(out, "w", encoding="utf-8") as file:
        file.write(draw(free, lock))


if __name__ == "__main__":
    main()
