#!/usr/bin/env python3
"""Rollback by copies of memory, for FMUs without states or with wrong ones: to the bit, or with a message why not."""
import json
import re
import shutil
import sqlite3
import subprocess
import sys
from contextlib import closing

import keeper_fmu
from twinlock_test import (BAD_DATA, BUILD, NOT_LOCKED, SANITIZER, SOURCE, Skip, at_least, config_path, edited_config, expect, expect_line,
                           expect_no_line, has_line, main, read_config, run, run_well, scratch)

FMU_FAILED = 70
PROBE = BUILD / "tests" / "fmu" / "rollback_probe"


def need_memory():
    if SANITIZER:
        raise Skip("a sanitizer replaces the allocator: no copies of FMU memory")


def probe(fmu, way):
    done = subprocess.run([str(PROBE), str(fmu), way, "0.01", "200"], capture_output=True, text=True, timeout=120, check=False)
    expect(done.returncode == 0, done.stdout + done.stderr)
    return json.loads(done.stdout)


def steps_of(config, *options):
    steps = scratch() / "steps.csv"
    run_well(["replay", config, "--csv", steps, *options], wells=(0, NOT_LOCKED))
    return steps.read_text(encoding="utf-8")


def test_all_places_of_state():
    need_memory()
    found = probe(keeper_fmu.make(), "memory")
    expect(found["way"] == "memory" and found["differs"] is None and found["error"] is None and found["steps"] == 200, f"{found}")
    found = probe(keeper_fmu.make(OWN_STATE=1), "state")
    expect(found["way"] == "state" and found["differs"] is not None, f"the probe finds nothing: {found}")
    found = probe(keeper_fmu.make(OWN_STATE=1), "memory")
    expect(found["way"] == "memory" and found["differs"] is None, f"{found}")


def test_synchronised():
    """The results are the same with and without savings, for one component, and for two of the same file with separate globals."""
    need_memory()
    for components in 1, 2:
        config = keeper_fmu.config(keeper_fmu.make(), components=components)
        saved = steps_of(config)
        expect(saved.count("\n") > 90 and saved == steps_of(config, "--plain"), "other values than with --plain")


def test_large():
    """A step changes a few pages of 4 MiB. A state has these pages only, and the results are exact."""
    need_memory()
    large = keeper_fmu.make(LARGE=4 << 20)
    found = probe(large, "memory")
    expect(found["way"] == "memory" and found["differs"] is None and found["error"] is None and found["steps"] == 200, f"{found}")
    code, out, err = run(["check", keeper_fmu.config(large)])
    size = re.search(r"^  states .*\bkeeper0\D+(\d+)\.\d KiB$", out, re.M)
    expect(code == 0 and size is not None and int(size[1]) < 1024, f"a state takes more than its pages:\n{out}{err}")
    saved = steps_of(keeper_fmu.config(large))
    expect(saved.count("\n") > 90 and saved == steps_of(keeper_fmu.config(large), "--plain"), "other values than with --plain")


def test_memory_of_the_c_library():
    """Environment, time zones, locales and exit handlers belong to the process, not to the heap of an FMU."""
    need_memory()
    asks = keeper_fmu.make(LIBRARY=12)
    found = probe(asks, "memory")
    expect(found["way"] == "memory" and found["differs"] is None and found["error"] is None and found["steps"] == 200, f"{found}")
    saved = steps_of(keeper_fmu.config(asks))
    expect(saved.count("\n") > 90 and saved == steps_of(keeper_fmu.config(asks), "--plain"), "other values than with --plain")


def test_resources_that_no_copy_restores():
    """The program names the resource at the start and ends."""
    need_memory()
    for macros, resource in (({"THREAD": 2}, "thread"), ({"FILE_OPEN": 2}, "keeper.txt"), ({"MAPPED": 2}, "heap")):
        for verb in "check", "replay":
            code, out, err = run([verb, keeper_fmu.config(keeper_fmu.make(**macros))])
            expect(code == FMU_FAILED, f"{verb} {macros}: {code}\n{out}{err}")
            expect_line(err, f"warning|FMU lag|{resource}|memory")
            expect_no_line(out, "no problem found")


def test_configured_methods():
    config = keeper_fmu.config(keeper_fmu.make(), "state")
    code, out, err = run(["replay", config])
    expect(code == BAD_DATA, f"{code}\n{out}{err}")
    expect_line(err, 'line 6|components.keeper0|canGetAndSetFMUstate|"rollback": "state"')
    code, out, err = run(["replay", keeper_fmu.config(keeper_fmu.make(), "copy")])
    expect(code == BAD_DATA, f"{code}\n{out}{err}")
    expect_line(err, 'line 8|components.keeper0.rollback|"copy"|"auto"|"state"|"memory"|"replay"')
    need_memory()
    for fmu, way in ((keeper_fmu.make(), None), (keeper_fmu.make(OWN_STATE=1), "memory")):
        code, out, err = run(["check", keeper_fmu.config(fmu, way)])
        expect(code == 0, f"{code}\n{out}{err}")
        expect_line(out, "rolled back|memory")
        expect_no_line(err, "FMU lag")


def test_wrong_states():
    """The program finds them before the first step and uses copies of memory. The values are those with "rollback": "memory"."""
    need_memory()
    wrong = keeper_fmu.make(OWN_STATE=1)
    code, out, err = run(["replay", keeper_fmu.config(wrong, "state")])
    expect(code == FMU_FAILED, f"{code}\n{out}{err}")
    expect_line(err, 'error|keeper0.y|1|step|"rollback"')
    code, out, err = run(["check", keeper_fmu.config(wrong)])
    expect(code == 0, f"{code}\n{out}{err}")
    expect_line(out, "rolled back|memory")
    expect_line(err, "notice|FMU lag|own states|incomplete state|memory")
    for components in 1, 2:
        chosen = steps_of(keeper_fmu.config(wrong, components=components))
        expect(chosen == steps_of(keeper_fmu.config(wrong, "memory", components)), f"{components}: other values than with \"rollback\": \"memory\"")
        expect(chosen == steps_of(keeper_fmu.config(wrong, components=components), "--plain"), f"{components}: other values than with --plain")


def late(way, *options):
    """(exit code, output of --json, log, events) of a replay of an FMU whose states are exact at the start only."""
    config, database = keeper_fmu.config(keeper_fmu.make_late(250), way), scratch() / "run.db"
    content = json.loads(config.read_text(encoding="utf-8"))
    content["synchronise"]["verify_every"] = 10
    config.write_text(json.dumps(content), encoding="utf-8")
    code, out, err = run(["replay", config, "--json", "--db", database, *options])
    with closing(sqlite3.connect(database)) as found:
        events = found.execute("SELECT tick, text FROM events WHERE source = 'twin' ORDER BY event").fetchall()
    return code, json.loads(out), err, events


def test_states_that_are_wrong_later():
    """The message has the difference, and the lock is degraded. With "auto" the program changes to copies of memory."""
    code, told, err, events = late("state")
    difference = "keeper0|y|tolerances|1 step"
    expect(code == NOT_LOCKED, f"{code}\n{err}")
    expect_line(err, "error|never in lock|degraded")
    expect_line(err, f"error|{difference}")
    expect(told["verified"]["differed"] == 1 and told["lock"]["state"] == "degraded", f"{told['verified']}, {told['lock']}")
    expect([tick is None for tick, text in events] == [False, True] and has_line(events[1][1], difference), f"{events}")
    expect(late("state", "--require-lock", "95")[0] == NOT_LOCKED, "degraded steps count as in lock")
    need_memory()
    _, told, err, events = late("auto")
    expect(told["verified"]["differed"] == 1, f"{told['verified']}\n{err}")
    expect_line(err, f"warning|{difference}|memory")
    at_least(told["verified"]["times"], 5, "checks, also after the change")
    code, told, err, events = late("memory")
    expect(code == 0 and err == "" and told["verified"]["differed"] == 0 and not events, f"{code} {told['verified']} {events}\n{err}")


def test_a_folder_of_fmus():
    """script/studies/fmus.py, without its shell script."""
    need_memory()
    folder = scratch()
    for name, fmu in ("good", keeper_fmu.make()), ("wrong", keeper_fmu.make(OWN_STATE=1)):
        shutil.copy(fmu, folder / f"{name}.fmu")
    (folder / "none.fmu").write_bytes(b"PK")
    command = [sys.executable, str(SOURCE / "script" / "studies" / "fmus.py"), "--fmus", str(folder), "--probe", str(PROBE), "--steps", "50"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    lines = {line.split(" | ")[0]: line for line in done.stdout.splitlines()}
    expect(done.returncode == 0 and "| 50 | none | exact |" in lines["good.fmu"] and "| differs in step 1 | exact |" in lines["wrong.fmu"]
           and "does not run" in lines["none.fmu"] and has_line(done.stdout, "2 of 3 run|2|0 of 1"), done.stdout + done.stderr)
    columns = done.stdout.splitlines()[0].split(" | ")
    good = dict(zip(columns, lines["good.fmu"].split(" | ")))
    found = [good[column] for column in ("beside another, each with a library of its own", "of one library")]
    expect(found == ["exact", "differs in step 1"], f"wrong results beside another instance\n{done.stdout}")
    done = subprocess.run([*command, "--only", "nothing"], capture_output=True, text=True, timeout=120, check=False)
    expect(done.returncode == BAD_DATA and "no *.fmu" in done.stderr, done.stdout + done.stderr)


def test_ours_are_the_same():
    """Copies of memory and own states give the same bits."""
    need_memory()
    for name in "motor/lock.json", "cylinder/lock.json":
        components = read_config(name)["components"]
        by_memory = edited_config(name, {"components": {component: {"rollback": "memory"} for component in components}})
        expect(steps_of(by_memory) == steps_of(config_path(name)), f"{name}: other values by memory")


main()
