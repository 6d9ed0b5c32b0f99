#!/usr/bin/env python3
"""The page of `check`: what an engineer reads before a run, and that the run keeps to it."""
import os
import re

from twinlock_test import (EMULATED, PLAIN_LIVE, PLAIN_LOCK, SOURCE, at_most, edited_config, expect, main, replay_json, run, run_well, scratch)

WIDTH = 80
CONFIGURATIONS = ("motor/lock.json", "motor/free.json", "motor/live.json", "emps/lock.json", "emps/ahead.json")


def config(**synchronise):
    return edited_config(PLAIN_LOCK, {"synchronise": {"algorithm": "nelder-mead", **synchronise}})


def number(page, pattern):
    found = re.search(pattern, page)
    expect(found is not None, f"nothing matches {pattern}\n{page}")
    return float(found.group(1))


def needs(page):
    """{component: [Γ, C, plain, first, then, nodes, KiB, µs]}, None where there is a dash."""
    lines = page[page.index("executions of an evaluation"):page.index("  sum ")].splitlines()[2:]
    rows = [line.split() for line in lines]
    return {row[0]: [None if cell == "-" else float(cell) for cell in row[1:]] for row in rows}


def test_it_fits_into_a_terminal():
    long = {"synchronise": {"horizon": {"prediction": 12, "shape": "dynamic"}, "fallback": "sbplx",
                            "budget": {"evaluations": 100000}, "saving": {"structure": False}}}
    pages = [run_well(["check", SOURCE / "config" / name]) for name in CONFIGURATIONS]
    pages.append(run_well(["check", edited_config(PLAIN_LOCK, long)]))
    for page in pages:
        lines = page.splitlines()[1:]  # the first is the configuration's own name
        widest = max(lines, key=len)
        expect(len(widest) <= WIDTH, f"{len(widest)} columns: {widest}")


def test_search_and_horizon():
    page = run_well(["check", config(fallback="bobyqa", horizon={"prediction": 3, "shape": "dynamic"})])
    expect("search  nelder-mead, then bobyqa; at most 60 evaluations a step\n" in page, page)
    expect("horizon T_D = 1, T_P = 3, dynamic: 3 unknowns\n" in page, page)
    expect("timing  measurements lag: step i is computed at tick i + 3\n" in page, page)
    found = needs(page)
    expect([found[name][:5] for name in ("drive", "motor", "plant")] ==
           [[2, 2, 3, 2, 1], [3, 0, 3, 3, 3], [2, None, 3, 2, 0]], f"{found}")
    expect(all(found[name][5] > 0 and found[name][6] > 0 and found[name][7] > 0 for name in ("drive", "motor")),
           f"nodes, memory or time of a cache is missing: {found}")
    expect(found["plant"][5:] == [None, None, None], f"{found}")
    expect("worst step   246 executions: 60 evaluations and the commit\n" in page, page)


def test_a_run_keeps_to_it():
    """No step has more executions than its worst; no evaluation more than the page says; the cache is never fuller."""
    for prediction, shape in ((1, "static"), (3, "static"), (4, "dynamic")):
        chosen = config(horizon={"prediction": prediction, "shape": shape})
        page, database = run_well(["check", chosen]), scratch() / "run.db"
        told, found = replay_json(chosen, "--db", database), needs(page)
        steps = run_well(["show", database, "--csv", "steps"]).splitlines()
        column = steps[0].split(",").index("executions")
        at_most(max(int(row.split(",")[column]) for row in steps[1:]), number(page, r"worst step +(\d+) "),
                f"T_P = {prediction}: executions of a step")
        at_most(told["cache"]["nodes_peak"], max(row[5] or 0 for row in found.values()), "nodes of a cache")
        for name, entry in told["ledger"]["components"].items():
            most = told["steps"] * (1 + found[name][3]) + told["evaluations"] * found[name][4]
            at_most(entry["predicted"], most, f"executions of {name}")


def test_what_fmus_may_take():
    """By default half of the memory and at most 4 GiB."""
    fair = min(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGESIZE") // 2, 4 << 30) >> 20
    for words, memory in ([] if EMULATED else [((), fair)]) + [(("--memory-limit", 700), 700)]:  # an emulator has less memory
        page = run_well(["check", config(), *map(str, words)])
        expect(f"  FMUs may take {memory} MiB (--memory-limit), 256 MiB of files, 1024 threads\n" in page, page)


def test_a_free_run():
    page = run_well(["check", SOURCE / "config" / "motor" / "free.json"])
    expect("executions of an evaluation" not in page and "worst step" not in page, page)
    expect(re.search(r"free step    3 executions\n +[0-9.e+-]+ \u00b5s here: [0-9.e+-]+ % of the period\n", page), page)
    expect(page.endswith("no problem found\n"), page)


def test_what_a_live_plant_takes():
    """12 s of two signals, polled every 5 ms: 4096 readings of 32 bytes each, and their counts."""
    page = run_well(["check", PLAIN_LIVE])
    expect("  mail         260.0 KiB for the plant's newest readings, in `run`\n" in page, page)
    sizes = {name: (float(size), unit) for name, size, unit in re.findall(r"^  (outbox|checkpoint|past) +([0-9.]+) (\w+) ", page, re.M)}
    expect(sizes.keys() == {"outbox", "checkpoint", "past"}, page)
    expect(sizes["outbox"][1] == "KiB" and sizes["outbox"][0] > 2048, f"a ring of 30 s: {sizes}")
    page = run_well(["check", edited_config(PLAIN_LIVE, {"record": {"resume_s": 0}})])
    expect("  outbox " in page and "  checkpoint " not in page and "  past " not in page, page)
    page = run_well(["check", SOURCE / "config" / "motor" / "free.json"])
    expect("  mail " not in page and "  outbox " not in page and "  past " not in page, page)


def test_warnings_are_counted_and_no_error():
    one = run_well(["check", config(saving={"structure": False})])
    expect(one.endswith("no problem found, 1 warning\n"), one)
    two = run_well(["check", config(saving={"structure": False, "sequences": False})])
    expect(two.endswith("no problem found, 2 warnings\n"), two)
    expect("saved by structure: no, by sequences: no\n" in two, two)
    expect([row[5:7] for row in needs(two).values()] == [[None, None]] * 3, f"a cache that is not there: {two}")


def refused(path, text, **edits):
    code, _, err = run(["check", edited_config(PLAIN_LOCK, {"synchronise": edits})])
    expect(code == 65 and path in err and text in err, f"it ended with {code}\n{err}")


def test_what_would_have_no_effect_or_no_end():
    refused("synchronise.adjust.motor.d", '"dwell_s" is for a Boolean, and motor.d is Real',
            adjust={"motor.d": {"dwell_s": 0.5}})
    for seconds in (10.001, 1e9):
        refused("synchronise.match.motor.omega.condition.low_pass_s",
                "expected at most 1000 times step_s, which is 10 s",
                match={"motor.omega": {"condition": {"low_pass_s": seconds}}})
    run_well(["check", config(match={"motor.omega": {"condition": {"low_pass_s": 10}}})])


def test_fmus_that_cannot_step():
    edits = {"components": {"motor": {"set": {"J": 1e-320}}}, "plant": {"torque": {"initial": 5}}}
    code, page, _ = run(["check", edited_config(PLAIN_LOCK, edits)])
    expect(code == 0 and "time is not told: the FMUs cannot step" in page, f"it ended with {code}\n{page}")
    warning = " ".join(page.partition("\nwarnings\n")[2].split())
    expect(warning.startswith("plant: the FMUs cannot step with its initial values (motor"), page)
    expect("\u00b5s here" not in page, page)


if __name__ == "__main__":
    main()
