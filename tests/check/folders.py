"""The plan of the code: its folders, what each may include, and which of its headers others may include.

A folder of the plan is one of master/, board/ or firmware/ with C sources. layers.py holds every #include and every symbol against this
table; picture.py draws the arrows; size.py holds the sizes.
"""
from typing import NamedTuple


class Folder(NamedTuple):
    may: tuple  # folders that it may include besides itself
    public: tuple = ()  # its headers that other folders may include; (): all but *_parts.h


MASTER = {
    "master/base": Folder(()),
    "master/fmi": Folder(("master/base",)),
    "master/plan": Folder(("master/fmi", "master/base"), ("plan", "tuning")),
    "master/cache": Folder(("master/plan", "master/fmi", "master/base"), ("cached_component",)),
    "master/graph": Folder(("master/cache", "master/plan", "master/fmi", "master/base"),
                         ("costs", "exchange", "graph", "plant", "snapshot", "track")),
    "master/measure": Folder(("master/plan", "master/base")),
    "master/solve": Folder(("master/base",), ("optimiser",)),
    "master/sync": Folder(("master/solve", "master/measure", "master/graph", "master/cache", "master/plan", "master/fmi",
                         "master/base"), ("free_twin", "objective", "proof", "record", "released_twin", "side_twin", "synchroniser", "verifier")),
    "master/event": Folder(("master/sync", "master/solve", "master/measure", "master/graph", "master/cache",
                          "master/plan", "master/fmi", "master/base"), ("event_horizon",)),
    "master/twin": Folder(("master/event", "master/sync", "master/solve", "master/measure", "master/graph",
                         "master/cache", "master/plan", "master/fmi", "master/base"), ("account", "twin", "twin_candidate", "twin_read_back", "twin_rerun", "twin_timing")),
    "master/example": Folder(("master/twin",)),
}

# Drivers know the contract and what they share, never each other.
_DRIVER = ("board/io", "master/base")
BOARD = {
    "board/io": Folder(("master/base",)),
    "board/can": Folder(_DRIVER, ("can", "can_codec", "can_interface")),
    "board/csv": Folder(_DRIVER, ("csv",)),
    "board/gpio": Folder(_DRIVER, ("gpio",)),
    "board/modbus": Folder(_DRIVER, ("modbus",)),
    "board/watchdog": Folder(("master/base",)),
}

_DRIVERS = ("board/can", "board/csv", "board/gpio", "board/modbus", "board/io")
_TWIN = ("master/twin", "master/plan")


def _firmware(*folders, others=()):
    """A folder of firmware: all of them may include its base and the one of the master."""
    return Folder(tuple(f"firmware/{folder}" for folder in folders) + ("firmware/base", *others, "master/base"))


# From the lowest to the highest.
FIRMWARE = {
    "firmware/base": Folder(("master/base",)),
    "firmware/process": _firmware(others=("board/io",)),
    "firmware/rollback": _firmware(others=("master/fmi",)),
    "firmware/config": _firmware(others=(*_TWIN, *_DRIVERS)),
    "firmware/fmu": _firmware("rollback", "config", "process", others=("master/fmi",)),
    "firmware/store": _firmware("config", "process", others=_TWIN),
    "firmware/plant": _firmware("store", "config", "process", others=("board/csv", "board/io")),
    "firmware/monitor": _firmware("plant", "store", "config", "process", others=_TWIN),
    "firmware/report": _firmware("monitor", "store", "config", others=_TWIN),
    "firmware/twin": _firmware("report", "monitor", "plant", "store", "fmu", "config", "process", others=_TWIN),
    "firmware/retune": _firmware("twin", "monitor", "plant", "store", "config", "process", others=_TWIN),
    "firmware/live": _firmware("retune", "twin", "report", "monitor", "plant", "store", "fmu", "config", "process", others=(*_TWIN, "board/watchdog")),
    "firmware/cli": _firmware("live", "retune", "twin", "report", "monitor", "plant", "store", "fmu", "config", "process", others=(*_TWIN, *_DRIVERS)),
    # twinlock-serve, a program of its own: what the network reaches has no FMU.
    "firmware/serve": _firmware("retune", "process"),
    "firmware": Folder(("firmware/cli", "firmware/process", "firmware/base")),
}
MOST_FOLDERS, MOST_ARROWS, MOST_LEVELS = 16, 65, 10  # of firmware; an arrow is a folder that includes another one

FOLDERS = {**MASTER, **BOARD, **FIRMWARE}
FLOORS = {"firmware": FIRMWARE, "board": BOARD, "master": MASTER}  # from the top
