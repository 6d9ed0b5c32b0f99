"""What processes hold: memory, descriptors, threads."""
import os
import re
from dataclasses import dataclass
from pathlib import Path

OURS = "memfd:twinlock"


@dataclass(frozen=True)
class Footprint:
    """KiB, and numbers. Shared memory has a fixed size, and a process has the more of it resident the longer it has lived: it touches page after
    page for the first time. So `private` tells a leak, resident memory as a whole does not."""
    private: int  # heaps, stacks, what was written of files
    shared: int  # mapped of twinlock's shared memory, touched or not
    held: int  # private, and its share of what is resident of shared memory, so that sums are right; no files
    pss: int  # as before, and its share of files
    locked: int
    descriptors: int
    threads: int


def value(text, name):
    return int(re.search(rf"^{name}:\s*(\d+)", text, re.M)[1])


def mapped_kib(maps):
    """Of twinlock's shared memory."""
    ranges = (line.split(maxsplit=1)[0].split("-") for line in maps.splitlines() if OURS in line)
    return sum(int(end, 16) - int(begin, 16) for begin, end in ranges) // 1024


def footprint(pid):
    """None of a process that is going, or not yet what it will be."""
    try:
        status, rollup, maps = (Path(f"/proc/{pid}/{name}").read_text(encoding="utf-8") for name in ("status", "smaps_rollup", "maps"))
        return Footprint(private=value(status, "RssAnon"), shared=mapped_kib(maps), held=value(rollup, "Pss_Anon") + value(rollup, "Pss_Shmem"),
                         pss=value(rollup, "Pss"), locked=value(status, "VmLck"), descriptors=len(os.listdir(f"/proc/{pid}/fd")),
                         threads=value(status, "Threads"))
    except (OSError, TypeError):
        return None


def shared_kib(pid):
    """What a process has of twinlock's shared memory, by its share."""
    maps, ours, total = Path(f"/proc/{pid}/smaps").read_text(encoding="utf-8"), False, 0
    for line in maps.splitlines():
        if re.match(r"[0-9a-f]+-[0-9a-f]+ ", line):
            ours = OURS in line
        elif ours and line.startswith("Pss:"):
            total += int(line.split()[1])
    return total
