#!/usr/bin/env python3
"""The output of `check`: its figures, and that the run stays within them."""
import json
import math
import os
import re

from twinlock_test import (BUILD, EMULATED, PLAIN_LIVE, PLAIN_LOCK, SANITIZER, SOURCE, at_least, at_most, edited_config, expect, expect_line, expect_no_line, main,
                           replay_json, run, run_well, scratch, within)

WIDTH = 80
CONFIGURATIONS = ("motor/lock.json", "motor/free.json", "motor/live.json", "emps/lock.json", "emps/ahead.json")


def config(**synchronise):
    return edited_config(PLAIN_LOCK, {"synchronise": {"algorithm": "nelder-mead", **synchronise}})


def last_line(page):
    return page.splitlines()[-1]


def number(page, pattern):
    found = re.search(pattern, page)
    expect(found is not None, f"nothing matches {pattern}\n{page}")
    return float(found.group(1))


def needs(page):
    """{component: [Γ, C, plain, first, then, nodes, KiB, µs]}; None for a dash."""
    lines = page[page.index("\u0393_k"):page.index("  sum ")].splitlines()[1:]
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


def test_units_are_converted():
    """A speed in rpm gives the same twin as one in rad/s, and the page shows the conversion."""
    signal = {"unit": "rpm", "min": -5000, "max": 5000, "csv": {"column": "omega", "scale": 30 / math.pi}}
    changed = edited_config("motor/lock.json", {"plant": {"omega": signal}})
    page = run_well(["check", changed])
    expect_line(page, "match|motor.omega|(rpm → rad/s: × 0.10472)")
    plain = replay_json(edited_config("motor/lock.json", {}))
    summary = replay_json(changed)
    within(summary["match"]["motor.omega"]["mse"], plain["match"]["motor.omega"]["mse"], 0.01, "MSE")  # rounding can change a search
    code, _, err = run(["check", edited_config("motor/lock.json", {"plant": {"omega": {"unit": "furlong"}}})])
    expect(code == 65, f"ended with {code}")
    expect_line(err, "synchronise.match.motor.omega|furlong|rad/s")


def test_search_and_horizon():
    page = run_well(["check", config(fallback="bobyqa", horizon={"prediction": 3, "shape": "dynamic"})])
    expect_line(page, "nelder-mead|bobyqa|60 evaluations")
    expect_line(page, "T_D = 1|T_P = 3|dynamic|3 unknowns")
    expect_line(page, "lag|i + 3")
    found = needs(page)
    expect([found[name][:5] for name in ("drive", "motor", "plant")] ==
           [[2, 2, 3, 2, 1], [3, 0, 3, 3, 3], [2, None, 3, 2, 0]], f"{found}")
    expect(all(found[name][5] > 0 and found[name][6] > 0 and found[name][7] > 0 for name in ("drive", "motor")),
           f"nodes, memory or time of a cache is missing: {found}")
    expect(found["plant"][5:] == [None, None, None], f"{found}")
    expect_line(page, "worst step|246 executions|60 evaluations")


def test_a_horizon_too_short_for_the_plant():
    """Two vessels in series, of 0.6 s and 0.4 s: within T_P = T_D = 2 steps of 10 ms the input hardly acts. The input of a series
    of lags acts by 1 − (0.6·exp(−t/0.6) − 0.4·exp(−t/0.4))/0.2."""
    short = edited_config("vessels/live.json", {"synchronise": {"horizon": {"prediction": 2}}})
    page = run_well(["check", short])
    expect_line(page, "moves second.y|within T_P")
    steps = number(" ".join(page.split()), r"synchronise.adjust.first.u: .*A whole tolerance takes (\d+) steps")
    by = [5 - 5 * (0.6 * math.exp(-i / 60) - 0.4 * math.exp(-i / 40)) / 0.2 for i in range(100)]
    wanted = next(i for i, value in enumerate(by) if value > 0.05)
    expect(abs(steps - wanted) <= 1, f"{steps} steps to a tolerance of 0.05 with an input of 0 … 5, wanted {wanted}")
    expect_line(page, "no problem found|1 warning")
    page = run_well(["check", SOURCE / "config" / "vessels" / "live.json"])
    expect_no_line(page, "whole tolerance")
    within(number(page, r"by ([\d.]+) within 10 s"), 0.1, 0.001, "movement by a step of 0.1, of a gain of 1")


def test_a_run_keeps_to_it():
    """No step exceeds the executions of the worst step, no component those of an evaluation, no cache the nodes."""
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
        expect_line(page, f"FMUs|{memory} MiB|--memory-limit|256 MiB|1024 threads")


def test_it_proposes_to_keep_nothing():
    """If saving 2 MiB takes far longer than a step: 0.07 times the time, so a loaded machine changes nothing."""
    if SANITIZER:
        return
    source = BUILD / "tests/bench/sized_2048.fmu"
    component = {"fmu": str(source), "rollback": "memory"}
    document = {"twinlock": 1, "name": "large", "step_s": 0.01, "components": {"large": component},
                "plant": {"y": {"csv": {"column": "y"}}},
                "synchronise": {"adjust": {"large.u": {"nominal": 0, "step": 0.1}}, "match": {"large.y": {"to": "plant.y", "tolerance": 1}},
                                "horizon": {"prediction": 20}, "algorithm": "nelder-mead"}}
    pages = []
    for keep in "states", "none", "auto":
        component["keep"] = keep
        path = scratch() / f"{keep}.json"
        path.write_text(json.dumps(document), encoding="utf-8")
        pages.append(run_well(["check", path]))
    expect_line(pages[0], 'large|"keep": "none"|times')
    expect_no_line(pages[1], "keep|times")
    expect_line(pages[2], '"auto" keeps none')


def test_a_free_run():
    page = run_well(["check", SOURCE / "config" / "motor" / "free.json"])
    expect("\u0393_k" not in page and "worst step" not in page, page)
    expect(re.search(r"free step +3 executions\n +[0-9.e+-]+ \u00b5s .*[0-9.e+-]+ % .*period\n", page), page)
    expect_line(last_line(page), "no problem found|plant")
    expect("warning" not in page, page)


def sizes(page):
    """{name: KiB} of the rows of memory."""
    rows = re.findall(r"^  (\w[\w ]*?) +([0-9.]+) KiB", page, re.M)
    return {name: float(size) for name, size in rows}


def test_memory_of_a_live_twin():
    """260 KiB of sample buffers: 12 s of two signals, polled every 5 ms, are 4096 readings of 32 bytes each, and counts."""
    live = sizes(run_well(["check", PLAIN_LIVE]))
    expect(260.0 in live.values(), f"{live}")
    at_least(max(live.values()), 2600, "KiB of the record queue, for 30 s")
    without_resume = sizes(run_well(["check", edited_config(PLAIN_LIVE, {"record": {"resume_s": 0}})]))
    only_for_resume = live.keys() - without_resume.keys()
    expect("checkpoint" in only_for_resume and len(only_for_resume) == 2, f"{live}, without resume {without_resume}")
    at_least(max(without_resume.values()), 2600, "KiB of the record queue without resume")
    free = sizes(run_well(["check", SOURCE / "config" / "motor" / "free.json"]))
    expect(len(free) == 1 and max(free.values()) < 260, f"{free}")


def test_how_long_the_database_holds():
    """The size of a recording of 7 minutes differs from what `check` expects by 10 % at most."""
    folder = scratch()
    live = SOURCE / "config" / "vessels" / "live.json"
    run_well(["plant", SOURCE / "config" / "vessels" / "plant.json", "--record", folder / "normal.csv"])
    run_well(["replay", live, "--recording", folder / "normal.csv", "--db", folder / "run.db"])
    told = run_well(["check", edited_config(live, {"record": {"max_mb": 100}})])
    line = next(line for line in told.splitlines() if line.startswith("  record  "))
    found = re.search(r"100 MB hold about (\d+) min (\d+) s", line)
    expect(found, line)
    expected = (0.75 * 100e6 - 4 * 4 * 2**20) / (folder / "run.db").stat().st_size * 418.7  # a quarter is for minutes and hours
    within(60 * int(found[1]) + int(found[2]), expected, 0.1, "s that 100 MB hold")


def test_the_plant_is_not_asked():
    """A wrong port is no problem of the configuration. The last line says that nothing tested it."""
    wrong = edited_config(PLAIN_LIVE, {"sources": {"inverter": {"modbus_tcp": {"port": 1}}}})
    expect_line(last_line(run_well(["check", wrong])), "no problem found|not asked|`probe`")


def test_warnings_are_counted_and_no_error():
    one = run_well(["check", config(saving={"structure": False})])
    expect_line(last_line(one), "no problem found|1 warning")
    two = run_well(["check", config(saving={"structure": False, "sequences": False})])
    expect_line(last_line(two), "no problem found|2 warnings")
    expect_line(two, "structure: no|sequences: no")
    expect([row[5:7] for row in needs(two).values()] == [[None, None]] * 3, f"a cache although nothing is saved: {two}")


def refused(parts, **edits):
    code, _, err = run(["check", edited_config(PLAIN_LOCK, {"synchronise": edits})])
    expect(code == 65, f"it ended with {code}\n{err}")
    expect_line(err, parts)


def test_values_without_effect_or_without_end():
    refused('synchronise.adjust.motor.d|"dwell_s"|Boolean|Real', adjust={"motor.d": {"dwell_s": 0.5}})
    for seconds, shown in ((10.001, "10.001"), (1e9, "1000000000")):
        refused(f"synchronise.match.motor.omega.condition.low_pass_s|{shown}|1000|step_s|10 s",
                match={"motor.omega": {"condition": {"low_pass_s": seconds}}})
    run_well(["check", config(match={"motor.omega": {"condition": {"low_pass_s": 10}}})])


def test_fmus_that_cannot_step():
    edits = {"components": {"motor": {"set": {"J": 1e-320}}}, "plant": {"torque": {"initial": 5}}}
    code, page, err = run(["check", edited_config(PLAIN_LOCK, edits)])
    expect(code == 70, f"it ended with {code}\n{page}{err}")
    expect_line(err, "components.motor|step 0, at 0 s|fmi2DoStep|fmi2Error|it said|diverged|set")
    expect("no problem" not in page, page)


if __name__ == "__main__":
    main()
