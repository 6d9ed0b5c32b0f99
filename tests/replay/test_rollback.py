#!/usr/bin/env python3
"""An FMU without functions for its state, or with wrong ones, is rolled back by its memory: to the bit, or it is said why not."""
import json
import re
import shutil
import sqlite3
import subprocess
import sys
from contextlib import closing

import keeper_fmu
from twinlock_test import BAD_DATA, BUILD, NOT_LOCKED, SANITIZER, SOURCE, Skip, at_least, config_path, edited_config, expect, main, read_config, run, run_well, scratch

FMU_FAILED = 70
PROBE = BUILD / "tests" / "fmu" / "rollback_probe"


def need_memory():
    if SANITIZER:
        raise Skip("a sanitizer has an allocator of its own: FMUs are not rolled back by their memory")


def probe(fmu, way):
    done = subprocess.run([str(PROBE), str(fmu), way, "0.01", "200"], capture_output=True, text=True, timeout=120, check=False)
    expect(done.returncode == 0, done.stdout + done.stderr)
    return json.loads(done.stdout)


def steps_of(config, *options):
    steps = scratch() / "steps.csv"
    run_well(["replay", config, "--csv", steps, *options], wells=(0, NOT_LOCKED))
    return steps.read_text(encoding="utf-8")


def test_wherever_it_keeps_its_state():
    need_memory()
    found = probe(keeper_fmu.make(), "memory")
    expect(found["way"] == "memory" and found["differs"] is None and found["error"] is None and found["steps"] == 200, f"{found}")
    found = probe(keeper_fmu.make(OWN_STATE=1), "state")
    expect(found["way"] == "state" and found["differs"] is not None, f"the probe finds nothing: {found}")
    found = probe(keeper_fmu.make(OWN_STATE=1), "memory")
    expect(found["way"] == "memory" and found["differs"] is None, f"{found}")


def test_synchronised():
    """The same with and without all that is saved; one by one, and two of one file, whose globals are each one's own."""
    need_memory()
    for components in 1, 2:
        config = keeper_fmu.config(keeper_fmu.make(), components=components)
        saved = steps_of(config)
        expect(saved.count("\n") > 90 and saved == steps_of(config, "--plain"), "other values with what is saved")


def test_large():
    """Some MiB, of which a step changes a few pages: to the bit, and a state is those, not the megabytes."""
    need_memory()
    large = keeper_fmu.make(LARGE=4 << 20)
    found = probe(large, "memory")
    expect(found["way"] == "memory" and found["differs"] is None and found["error"] is None and found["steps"] == 200, f"{found}")
    code, out, err = run(["check", keeper_fmu.config(large)])
    size = re.search(r"one of keeper0 takes (\d+)\.\d KiB", out)
    expect(code == 0 and size is not None and int(size[1]) < 1024, f"a state takes more than its pages:\n{out}{err}")
    saved = steps_of(keeper_fmu.config(large))
    expect(saved.count("\n") > 90 and saved == steps_of(keeper_fmu.config(large), "--plain"), "other values with what is saved")


def test_what_the_library_keeps():
    """Environment, time zones, locales, what is called at the end: everybody's, and in no FMU's heap."""
    need_memory()
    asks = keeper_fmu.make(LIBRARY=12)
    found = probe(asks, "memory")
    expect(found["way"] == "memory" and found["differs"] is None and found["error"] is None and found["steps"] == 200, f"{found}")
    saved = steps_of(keeper_fmu.config(asks))
    expect(saved.count("\n") > 90 and saved == steps_of(keeper_fmu.config(asks), "--plain"), "other values with what is saved")


def test_what_no_copy_takes_back():
    """It is named, at the start, and nothing is synchronised."""
    need_memory()
    for macros, said in (({"THREAD": 2}, "a thread"), ({"FILE_OPEN": 2}, "keeper.txt"), ({"MAPPED": 2}, "memory elsewhere")):
        for verb in "check", "replay":
            code, out, err = run([verb, keeper_fmu.config(keeper_fmu.make(**macros))])
            expect(code == FMU_FAILED and said in err and "no copy of its memory takes back" in err, f"{verb} {macros}: {code}\n{out}{err}")
            expect("no problem found" not in out, f"check {macros}: {out}")


def test_what_is_chosen():
    config = keeper_fmu.config(keeper_fmu.make(), "state")
    code, out, err = run(["replay", config])
    expect(code == BAD_DATA and "canGetAndSetFMUstate" in err, f"{code}\n{out}{err}")
    code, out, err = run(["replay", keeper_fmu.config(keeper_fmu.make(), "copy")])
    expect(code == BAD_DATA and "rollback" in err, f"{code}\n{out}{err}")
    need_memory()
    for fmu, way in ((keeper_fmu.make(), None), (keeper_fmu.make(OWN_STATE=1), "memory")):
        code, out, err = run(["check", keeper_fmu.config(fmu, way)])
        expect(code == 0 and "rolled back by its memory" in out and "instead" not in err, f"{code}\n{out}{err}")


def test_wrong_states():
    """Found before the first step: then its memory it is, and the values are those that it has by its memory from the beginning."""
    need_memory()
    wrong = keeper_fmu.make(OWN_STATE=1)
    code, out, err = run(["replay", keeper_fmu.config(wrong, "state")])
    expect(code == FMU_FAILED and "does not come back to where it was" in err and '"rollback" of the component' in err, f"{code}\n{out}{err}")
    code, out, err = run(["check", keeper_fmu.config(wrong)])
    expect(code == 0 and "rolled back by its memory" in out and "by its own states (incomplete state: led back at once it is exact, after other steps it is not): it is rolled back by its memory instead" in err, f"{code}\n{out}{err}")
    for components in 1, 2:
        chosen = steps_of(keeper_fmu.config(wrong, components=components))
        expect(chosen == steps_of(keeper_fmu.config(wrong, "memory", components)), f"{components}: other values than by memory from the beginning")
        expect(chosen == steps_of(keeper_fmu.config(wrong, components=components), "--plain"), f"{components}: other values with what is saved")


def late(way, *options):
    """What the replay tells of one whose states are right at the start: code, --json, what it says, and its events."""
    config, database = keeper_fmu.config(keeper_fmu.make_late(500), way), scratch() / "run.db"
    content = json.loads(config.read_text(encoding="utf-8"))
    content["synchronise"]["verify_every"] = 10
    config.write_text(json.dumps(content), encoding="utf-8")
    code, out, err = run(["replay", config, "--json", "--db", database, *options])
    with closing(sqlite3.connect(database)) as found:
        events = found.execute("SELECT tick, text FROM events WHERE source = 'twin' ORDER BY event").fetchall()
    return code, json.loads(out), err, events


def test_states_that_are_wrong_later():
    """Told with the size of it, and degraded; by its memory from then on, if that may be."""
    code, told, err, events = late("state")
    said = "keeper0 does not come back to where it was: y was 0."
    expect(code == 0 and said in err and "tolerances) 1 step after it was led back; what is committed may be wrong" in err, f"{code}\n{err}")
    expect(told["verified"]["differed"] == 1 and told["lock"]["state"] == "degraded", f"{told['verified']}, {told['lock']}")
    expect([tick is None for tick, text in events] == [False, True] and said in events[1][1], f"{events}")
    expect(late("state", "--require-lock", "95")[0] == NOT_LOCKED, "it counts as in lock")
    need_memory()
    _, told, err, events = late("auto")
    expect("by its memory from now on" in err and told["verified"]["differed"] == 1, f"{told['verified']}\n{err}")
    at_least(told["verified"]["times"], 5, "looked, and further on")
    code, told, err, events = late("memory")
    expect(code == 0 and err == "" and told["verified"]["differed"] == 0 and not events, f"{code} {told['verified']} {events}\n{err}")


def test_a_folder_of_fmus():
    """script/fmus, without what bash does for it."""
    need_memory()
    folder = scratch()
    for name, fmu in ("good", keeper_fmu.make()), ("wrong", keeper_fmu.make(OWN_STATE=1)):
        shutil.copy(fmu, folder / f"{name}.fmu")
    (folder / "none.fmu").write_bytes(b"PK")
    command = [sys.executable, str(SOURCE / "script" / "studies" / "fmus.py"), "--fmus", str(folder), "--probe", str(PROBE), "--steps", "50"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    lines = {line.split(" | ")[0]: line for line in done.stdout.splitlines()}
    expect(done.returncode == 0 and "| 50 | none | exact |" in lines["good.fmu"] and "| differs in step 1 | exact |" in lines["wrong.fmu"]
           and "does not run" in lines["none.fmu"] and "2 of 3 run; 2 come back exactly by their memory, and 0 of 1 that declare" in done.stdout,
           done.stdout + done.stderr)
    columns = done.stdout.splitlines()[0].split(" | ")
    good = dict(zip(columns, lines["good.fmu"].split(" | ")))
    found = [good[column] for column in ("beside another, each with a library of its own", "of one library")]
    expect(found == ["exact", "differs in step 1"], f"its globals are in its library\n{done.stdout}")
    done = subprocess.run([*command, "--only", "nothing"], capture_output=True, text=True, timeout=120, check=False)
    expect(done.returncode == BAD_DATA and "there is no *.fmu" in done.stderr, done.stdout + done.stderr)


def test_ours_are_the_same():
    """By memory to the bit what they are by their own states."""
    need_memory()
    for name in "motor/lock.json", "cylinder/lock.json":
        components = read_config(name)["components"]
        by_memory = edited_config(name, {"components": {component: {"rollback": "memory"} for component in components}})
        expect(steps_of(by_memory) == steps_of(config_path(name)), f"{name}: other values by memory")


main()
