#!/usr/bin/env python3
"""`check` says by which other way a component comes back, by trying it: by forking, if it does so by replay only; by any, if it does not as it is configured."""
import json
import re
import sys
from pathlib import Path

import keeper_fmu
from twinlock_test import SANITIZER, SKIPPED, config_path, expect, main, run, run_well

if SANITIZER == "thread":
    print("skipped: it has a thread of its own, which no fork takes back")
    sys.exit(SKIPPED)

FMU_FAILED = 70
REPLAYED = {"MAPPED": 2, "RESETS": 1}  # what no copy of its memory takes back, and a fork does
COST = r"a save and a restore take [\d.e+]+ µs here, a state is a process with about [\d.]+ [KM]iB of its own: write \"rollback\": \"fork\" in the component"
BY_REPLAY = "comes back by replay, within 1000 steps of its beginning only, and "


def words(text):
    return " ".join(text.split())


def check(config, *options):
    """(its part "other ways", its log) of one in which no problem is found; what it warns of is the machine's affair."""
    code, out, err = run(["check", config, *options])
    expect(code == 0 and "\nno problem found" in out, f"{code}\n{out}{err}")
    expect("error" not in err, err)
    return words(out.partition("\nother ways\n")[2]), err


def fail(config):
    """What is said of one that does not come back, behind the error."""
    code, out, err = run(["check", config])
    expect(code == FMU_FAILED and out == "", f"{code}\n{out}{err}")
    return [line.removeprefix("twinlock: notice: ") for line in err.splitlines() if line.startswith("twinlock: notice: components.")], err


def edited(config, **components):
    """That one, with other keys of components."""
    path = Path(config)
    content = json.loads(path.read_text(encoding="utf-8"))
    for name, keys in components.items():
        content["components"][name].update(keys)
    path.write_text(json.dumps(content), encoding="utf-8")
    return config


# ---- it comes back, by replay ----

def test_by_forking_too():
    """And what it says to write is what does it."""
    told, err = check(keeper_fmu.config(keeper_fmu.make(**REPLAYED)))
    expect(re.search(f"components.keeper0: {BY_REPLAY}exactly by forking for as long as it runs; {COST} no problem", told), told + err)
    out = run_well(["check", keeper_fmu.config(keeper_fmu.make(**REPLAYED), "fork")])
    expect("rolled back by forking" in out and "other ways" not in out, out)


def test_not_by_forking_either():
    for macros, why in (({"THREAD": 2}, "has a thread, which no fork takes back"), ({"FILE_OPEN": 2}, "keeper.txt, which no fork takes back")):
        told, err = check(keeper_fmu.config(keeper_fmu.make(RESETS=1, **macros)))
        expect(f"components.keeper0: {BY_REPLAY}not by forking: has a" in told and f"{why} no problem" in told, told + err)


def test_each_for_itself():
    """Who cannot be forked does not keep the other from it."""
    config = edited(keeper_fmu.config(keeper_fmu.make(EXCEPTIONS=0, **REPLAYED), components=2), keeper0={"fmu": str(keeper_fmu.make_false("late", OPENS=15)), "rollback": "replay"})
    told, err = check(config)
    expect(re.search(f"components.keeper0: {BY_REPLAY}not by forking: has an open file.*which no fork takes back components.keeper1: {BY_REPLAY}exactly by forking", told), told + err)


def test_what_crashes_or_hangs_there():
    """It is a finding: the check goes on."""
    for how, why in (("*(volatile int *)8 = 0;", "crashed in fmi2DoStep: Segmentation fault"), ("for (;;) {};", "FMU keeper0 has not returned from fmi2DoStep for 2 s")):
        told, err = check(keeper_fmu.config(keeper_fmu.make(ALONE=how, **REPLAYED)), "--call-limit", "2")
        expect(f"{BY_REPLAY}not by forking: " in told and why in told, told + err)


def test_other_values_there():
    """Led back it gives something else."""
    told, err = check(keeper_fmu.config(keeper_fmu.make(ALONE="if (steps >= 2) { factor += (double)getpid(); };", **REPLAYED)))
    expect(f"{BY_REPLAY}not by forking: " in told and "does not come back to where it was" in told, told + err)


def test_with_libraries():
    """Those are the program's, and not in another process."""
    told, err = check(edited(keeper_fmu.config(keeper_fmu.make(**REPLAYED)), keeper0={"libraries": ["libm.so.6"]}))
    expect(f'{BY_REPLAY}not by forking: needs "libraries", which its own process would not have' in told, told + err)


def test_nothing_to_be_tried():
    out = run_well(["check", config_path("motor/lock.json")])
    expect("other ways" not in out, out)


# ---- it does not come back ----

def test_another_than_the_named():
    """By its memory, of which a sanitizer has none; and that is what does it."""
    told, err = fail(keeper_fmu.config(keeper_fmu.make(OWN_STATE=1), "state"))
    way, said = ("fork", "by forking") if SANITIZER else ("memory", "by its memory")
    expect(len(told) == 1 and told[0].startswith(f"components.keeper0: comes back exactly {said}; a save and a restore take ")
           and told[0].endswith(f': write "rollback": "{way}" in the component'), err)
    run_well(["check", keeper_fmu.config(keeper_fmu.make(OWN_STATE=1), way)])


def test_one_that_is_given_again():
    """Which is no way that has a name."""
    told, err = fail(keeper_fmu.config(keeper_fmu.make_false("parameters", OPENS=15), "memory")) if not SANITIZER else ([], "")
    expect(SANITIZER or (len(told) == 1 and "comes back exactly by its state, if it is given again what it had been given" in told[0]
                         and told[0].endswith('"rollback": "auto" in the component')), err)


def test_by_forking_if_nothing_else():
    told, err = fail(keeper_fmu.config(keeper_fmu.make(MAPPED=2), components=2))
    expect(len(told) == 2 and all(re.fullmatch(f"components.keeper{i}: comes back exactly by forking; {COST}", line) for i, line in enumerate(told)), err)


def test_by_replay_if_nothing_else():
    told, err = fail(keeper_fmu.config(keeper_fmu.make(THREAD=2, RESETS=1), "fork"))
    expect(told == ['components.keeper0: comes back by replay, within 1000 steps of its beginning only: write "rollback": "replay" in the component'], err)


def test_in_no_way():
    for way in None, "replay":
        told, err = fail(keeper_fmu.config(keeper_fmu.make(THREAD=2), way))
        expect(told == ["components.keeper0: does not come back in another way either, nor by forking: has a thread, which no fork takes back"], err)


main()
