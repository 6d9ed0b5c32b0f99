#!/usr/bin/env python3
"""An FMU in a process of its own, forked to be saved: to the bit what it is by other ways, and what a fork cannot take back is named."""
import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import hostile_fmu
import keeper_fmu
from twinlock_test import BAD_DATA, BUILD, NOT_LOCKED, SANITIZER, SKIPPED, config_path, edited_config, expect, main, read_config, run, run_well, scratch, start

if SANITIZER == "thread":
    print("skipped: it has a thread of its own, which no fork takes back")
    sys.exit(SKIPPED)

FMU_FAILED = 70
PROBE = BUILD / "tests" / "fmu" / "rollback_probe"


def probe(fmu):
    done = subprocess.run([str(PROBE), str(fmu), "fork", "0.01", "200"], capture_output=True, text=True, timeout=120, check=False)
    expect(done.returncode == 0, done.stdout + done.stderr)
    return json.loads(done.stdout)


def steps_of(config, *options):
    steps = scratch() / "steps.csv"
    run_well(["replay", config, "--csv", steps, *options], wells=(0, NOT_LOCKED))
    return steps.read_text(encoding="utf-8")


def forked(name, **keys):
    components = read_config(name)["components"]
    return edited_config(name, {"components": {component: {"rollback": "fork", **keys} for component in components}})


def lasting(config, seconds):
    """The same for so many seconds; None: for all of its recording."""
    return config if seconds is None else edited_config(config, {"duration_s": seconds})


def descendants(process):
    """Numbers and beginnings of all that were started by it, or by those."""
    parents, begun = {}, {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()
        except OSError:
            continue
        parents[int(stat.parent.name)], begun[int(stat.parent.name)] = int(fields[1]), fields[19]
    found, fresh = set(), {process}
    while fresh:
        fresh = {child for child, parent in parents.items() if parent in fresh}
        found |= fresh
    return {(child, begun[child]) for child in found}


def are_left(processes):
    """Those of them that have not ended."""
    left = []
    for number, begun in processes:
        try:
            fields = Path(f"/proc/{number}/stat").read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()
        except OSError:
            continue
        if fields[19] == begun and fields[0] != "Z":
            left.append(number)
    return left


def test_wherever_it_keeps_its_state():
    """Also in memory that it maps itself, which no copy of a heap has."""
    for fmu in keeper_fmu.make(), keeper_fmu.make(OWN_STATE=1), keeper_fmu.make(MAPPED=2):
        found = probe(fmu)
        expect(found["way"] == "fork" and found["differs"] is None and found["error"] is None and found["steps"] == 200, f"{found}")


def test_ours_are_the_same():
    """By forking to the bit what they are by their own states; with few processes as with many, since the FMU catches up."""
    parts = (1, 3) if SANITIZER else (4, None)  # s; AddressSanitizer's tables are forked with it each time
    for name, seconds in zip(("motor/lock.json", "cylinder/lock.json"), parts):
        expected = steps_of(lasting(config_path(name), seconds))
        expect(steps_of(lasting(forked(name), seconds)) == expected, f"{name}: other values by forking")
    expected = steps_of(lasting(config_path("cylinder/lock.json"), 3))
    expect(steps_of(lasting(forked("cylinder/lock.json", fork_nodes=2), 3)) == expected, "other values with two snapshots")


def test_what_no_fork_takes_back():
    for macros, said in (({"THREAD": 2}, "a thread"), ({"FILE_OPEN": 2}, "keeper.txt")):
        code, out, err = run(["replay", keeper_fmu.config(keeper_fmu.make(**macros), "fork")])
        expect(code == FMU_FAILED and said in err and "no fork takes back" in err, f"{macros}: {code}\n{out}{err}")


def test_told():
    config = keeper_fmu.config(keeper_fmu.make(), "fork")
    code, out, err = run(["check", config])
    expect(code == 0 and "rolled back by forking its process" in out, f"{code}\n{out}{err}")
    content = json.loads(Path(config).read_text(encoding="utf-8"))
    content["components"]["keeper0"]["libraries"] = ["libm.so.6"]
    Path(config).write_text(json.dumps(content), encoding="utf-8")
    code, out, err = run(["check", config])
    expect(code == BAD_DATA and "libraries" in err and "fork" in err, f"{code}\n{out}{err}")


def hostile(name, **macros):
    lock = {**hostile_fmu.LOCKED, "components": {"hostile": {"rollback": "fork"}}}
    return hostile_fmu.config(hostile_fmu.make(name, **macros), lock)


def test_crash_exit_and_hang():
    """Told as of one in the twin's process: which FMU, and in which function; also if it is one that was forked, or that is loaded."""
    at_step = {"AT": "fmi2DoStep", "CALL": 60}
    for config, said in ((hostile("end", HOW="*(volatile int *)8 = 0;", **at_step), "FMU hostile crashed in fmi2DoStep: Segmentation fault"),
                         (hostile("end", HOW="_exit(3);", **at_step), "FMU hostile crashed in fmi2DoStep: its process has ended itself with 3"),
                         (hostile("end", HOW="abort();", AT="fmi2Instantiate"), "crashed in fmi2Instantiate"),
                         (hostile("end", HOW="abort();", AT="load"), "crashed in the loading of the library"),
                         (hostile("hang", **at_step), "FMU hostile has not returned from fmi2DoStep for 4 s")):
        code, out, err = run(["replay", config, "--call-limit", "4"])
        expect(code == FMU_FAILED and said in err, f"{said}: {code}\n{out}{err}")


def test_a_crash_in_check():
    """Also where it would step on with the plant's initial values."""
    for call in 1, 25:
        code, out, err = run(["check", hostile("end", HOW="*(volatile int *)8 = 0;", AT="fmi2DoStep", CALL=call)])
        expect(code == FMU_FAILED and "FMU hostile crashed in fmi2DoStep" in err and "no problem found" not in out, f"{call}: {code}\n{out}{err}")


def test_nobody_is_left():
    """Whoever ends the program, however."""
    config = forked("cylinder/lock.json")
    for number in signal.SIGKILL, signal.SIGTERM:
        running = start(["replay", config, "--realtime"])
        deadline = time.monotonic() + 30
        processes = descendants(running.pid)
        while len(processes) < 6 and time.monotonic() < deadline:
            time.sleep(0.05)
            processes = descendants(running.pid)
        expect(len(processes) >= 6, f"no snapshots: {processes}")
        running.send_signal(number)
        running.communicate()
        while are_left(processes) and time.monotonic() < deadline:
            time.sleep(0.05)
        expect(not are_left(processes), f"{are_left(processes)} are left after signal {number}")


main()
