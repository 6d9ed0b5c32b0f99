"""The plan of the house: its rooms, what each may include, and what of it others may include.

A room is a folder of master/, board/ or firmware/ with C sources. layers.py holds every #include against this table;
picture.py draws the arrows that there really are.
"""
from typing import NamedTuple


class Room(NamedTuple):
    may: tuple  # rooms that it may include besides itself
    public: tuple = ()  # its headers that other rooms may include; (): all of them


MASTER = {
    "master/base": Room(()),
    "master/fmi": Room(("master/base",)),
    "master/plan": Room(("master/fmi", "master/base"), ("plan", "tuning")),
    "master/cache": Room(("master/plan", "master/fmi", "master/base"), ("cached_component",)),
    "master/graph": Room(("master/cache", "master/plan", "master/fmi", "master/base"),
                         ("costs", "exchange", "graph", "plant", "snapshot", "track")),
    "master/measure": Room(("master/plan", "master/base")),
    "master/solve": Room(("master/base",), ("optimiser",)),
    "master/sync": Room(("master/solve", "master/measure", "master/graph", "master/cache", "master/plan", "master/fmi",
                         "master/base"), ("free_twin", "lock", "objective", "proof", "record", "verifier")),
    "master/event": Room(("master/sync", "master/solve", "master/measure", "master/graph", "master/cache",
                          "master/plan", "master/fmi", "master/base"), ("event_horizon", "event_plan")),
    "master/twin": Room(("master/event", "master/sync", "master/solve", "master/measure", "master/graph",
                         "master/cache", "master/plan", "master/fmi", "master/base"), ("account", "twin", "twin_read_back", "twin_timing")),
    "master/example": Room(("master/twin",)),
}

# Drivers know the contract and what they share, never each other.
_DRIVER = ("board/io", "master/base")
BOARD = {
    "board/io": Room(("master/base",)),
    "board/can": Room(_DRIVER, ("can", "can_codec", "can_interface")),
    "board/csv": Room(_DRIVER, ("csv",)),
    "board/gpio": Room(_DRIVER, ("gpio",)),
    "board/modbus": Room(_DRIVER, ("modbus",)),
    "board/watchdog": Room(("master/base",)),
}

_DRIVERS = ("board/can", "board/csv", "board/gpio", "board/modbus", "board/io")


def _firmware(*rooms, others=(), public=()):
    """A room of the firmware: all of them may include texts, base and the master's façade."""
    below = tuple(f"firmware/{room}" for room in rooms)
    return Room(below + ("firmware/text", "firmware/base", *others, "master/base"), public)


_TWIN = ("master/twin", "master/plan")
FIRMWARE = {
    "firmware/base": Room(("master/base",)),
    "firmware/text": Room(("firmware/base", "master/base")),
    "firmware/process": _firmware(),
    "firmware/control": _firmware("process", public=("control_wire", "control_words", "control_client", "control_server", "last_word")),
    "firmware/confine": _firmware("process", public=("confine", "refusal", "bounds", "process_limits", "fmu_refusals")),
    "firmware/json": _firmware(),
    "firmware/config": _firmware("json", others=(*_TWIN, *_DRIVERS), public=("config", "measurements", "problems")),
    "firmware/copies": _firmware(public=("own_copies",)),
    "firmware/pages": _firmware(public=("fmu_pages", "fmu_places", "fmu_written")),
    "firmware/rollback": _firmware("pages", others=("master/fmi",), public=("fmu_allocation", "fmu_memory", "fmu_replay")),
    "firmware/forked": _firmware("process", others=("master/fmi",), public=("forked_calls", "forked_host", "forked_line", "forked_pool")),
    "firmware/description": _firmware(others=("master/fmi",), public=("model_description",)),
    "firmware/fmu": _firmware("copies", "description", "forked", "rollback", "process", others=("master/fmi",),
                              public=("fmu_store", "fmu_archive", "fmu_guard", "fmu_host", "fmu_thread", "library")),
    "firmware/supervise": _firmware("process", others=("board/watchdog",), public=("supervisor", "restarts", "service")),
    "firmware/database": _firmware(),
    "firmware/outbox": _firmware("process", others=_TWIN, public=("outbox", "outbox_reader", "outbox_rest", "recorder_entry", "recorder_events", "run_types")),
    "firmware/record": _firmware("outbox", "database", "process", "config", others=_TWIN,
                                 public=("recorder", "recorder_writer", "recorder_state", "recorder_settings")),
    "firmware/history": _firmware("outbox", "database", "config", others=_TWIN, public=("history", "history_rows")),
    "firmware/plant": _firmware("history", "outbox", "process", "config", others=_DRIVERS,
                                public=("conditioner", "live_plant", "plant_input", "plant_mail", "recording")),
    "firmware/diagnose": _firmware("config", others=_TWIN, public=("lock_judge", "lock_rescue", "lock_tally", "noise_meter", "noise_watch")),
    "firmware/advice": _firmware("diagnose", "plant", "process", "config", others=_TWIN),
    "firmware/report": _firmware("diagnose", "outbox", "config", others=_TWIN,
                                 public=("figures_json", "html_report", "run_end", "run_figures", "summary", "trajectory")),
    "firmware/show": _firmware("report", "history", "outbox", "diagnose", "config", others=_TWIN, public=("show",)),
    "firmware/assembly": _firmware("plant", "report", "diagnose", "record", "outbox", "fmu", "config", others=_TWIN),
    "firmware/twin": _firmware("assembly", "plant", "report", "diagnose", "record", "outbox", "fmu", "forked", "confine", "process", "config", others=_TWIN),
    "firmware/past": _firmware("twin", "assembly", "report", "history", "outbox", "config", others=_TWIN,
                               public=("past", "past_follow", "past_history", "past_outbox", "past_samples")),
    "firmware/run": _firmware("twin", "assembly", "report", "diagnose", "plant", "record", "outbox", "fmu", "process", "config", others=_TWIN,
                              public=("checkpointer", "cycle", "journal", "live_stage", "live_tuning", "realtime", "replay", "safe_hold", "status_line", "watch")),
    "firmware/shadow": _firmware("past", "run", "report", "twin", "assembly", "fmu", "process", "outbox", "config", others=_TWIN),
    "firmware/live": _firmware("shadow", "activate", "versions", "run", "past", "twin", "assembly", "report", "diagnose", "plant", "record", "outbox", "fmu", "supervise", "confine", "process", "config",
                               others=_TWIN, public=("live_blocks", "live_job", "live_role", "live_twin", "live_wire")),
    "firmware/tree": _firmware("live", "errand", "control", "run", "twin", "assembly", "report", "plant", "outbox", "supervise", "process", "config", others=_TWIN, public=("tree",)),
    "firmware/versions": _firmware("diagnose", "config", "json", others=_TWIN, public=("allowed_names", "change_rules", "config_change", "probation", "refusals", "versions")),
    "firmware/errand": _firmware("versions", "control", "plant", "twin", "assembly", "confine", "outbox", "process", "diagnose", "config", others=_TWIN),
    "firmware/activate": _firmware("errand", "versions", "control", "outbox", "process", "diagnose", "config", others=_TWIN,
                                   public=("activator", "activation_host", "version_start")),
    "firmware/emulate": _firmware("twin", "assembly", "plant", "process", "config", others=_DRIVERS),
    # What the network reaches: a program of its own.
    "firmware/door": _firmware("control"),
    "firmware/serve": _firmware("door", "control", "supervise", "confine", "process", public=("http_request", "answer")),
    # Who asks a run from outside.
    "firmware/retune": _firmware("control", public=("talk", "talk_page")),
    "firmware/verbs": _firmware("advice", "emulate", "retune", "tree", "live", "activate", "errand", "control", "run", "twin", "assembly", "show", "report", "diagnose", "plant", "record", "outbox", "fmu", "supervise", "process",
                                "config", others=_TWIN, public=("command_line",)),
    "firmware": Room(("firmware/verbs", "firmware/process", "firmware/base")),
}

ROOMS = {**MASTER, **BOARD, **FIRMWARE}
MOST_FILES = 25  # .c and .h of a room
FLOORS = {"firmware": FIRMWARE, "board": BOARD, "master": MASTER}  # from the top
