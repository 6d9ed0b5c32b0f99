"""What processes hold: memory, descriptors, threads."""
import os
import re
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Footprint:
    """KiB, and numbers."""
    rss: int
    locked: int
    pss: int  # shared memory counts for each who has it by its share, so that sums are right
    descriptors: int
    threads: int


def value(text, name):
    return int(re.search(rf"^{name}:\s*(\d+)", text, re.M)[1])


def footprint(pid):
    """None of a process that is going, or not yet what it will be."""
    try:
        status, maps = (Path(f"/proc/{pid}/{name}").read_text(encoding="utf-8") for name in ("status", "smaps_rollup"))
        return Footprint(value(maps, "Rss"), value(status, "VmLck"), value(maps, "Pss"), len(os.listdir(f"/proc/{pid}/fd")), value(status, "Threads"))
    except (OSError, TypeError):
        return None


def shared_kib(pid):
    """What a process has of twinlock's shared memory, by its share."""
    maps, ours, total = Path(f"/proc/{pid}/smaps").read_text(encoding="utf-8"), False, 0
    for line in maps.splitlines():
        if re.match(r"[0-9a-f]+-[0-9a-f]+ ", line):
            ours = "memfd:twinlock" in line
        elif ours and line.startswith("Pss:"):
            total += int(line.split()[1])
    return total
