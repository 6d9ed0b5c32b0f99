#!/usr/bin/env python3
"""A cylinder live, by a FIFO, whose strokes are searched in real time: a search that lasts over many cycles, each within
its time, finds the throttle; a replay of the database repeats it to the bit."""
import signal
from statistics import median

from live_test import (STOP_TIME, Program, check_database, check_replay, check_rows, end_well, query, wait_for_steps,
                       wait_until)
from twinlock_test import at_most, edited_config, expect, main, scratch

FIRST = 0.01  # the twin's throttle; the plant's is 0.023
PERIOD_S, BUDGET_S = 0.005, 0.002
T_STEP = 5e-6  # s: a macro step of the twin takes some 150 us, and a cycle has time for some ten of the 500 of a search
FREE = 3  # executions of a step without a search
STROKE_S, STROKES = 2.0, 15  # the valve's period; the test ends with the second stroke that was searched


def valve(folder):
    """What the PLC tells the valve: extend, and half a period later retract."""
    rows = ["t,move_out", "0,0"]
    for stroke in range(STROKES):
        begin = 0.3 + stroke * STROKE_S
        rows += [f"{begin},1", f"{begin + STROKE_S / 2},0"]
    path = folder / "valve.csv"
    path.write_text("\n".join(rows) + "\n")
    return str(path)


def plant_config():
    return edited_config("cylinder/plant.json", {"duration_s": STROKES * STROKE_S,
                                                 "recording": {"file": valve(scratch())}})


def twin_config(measurements):
    signals = {name: {"csv": {"source": "stream"}} for name in ("move_out", "extended")}
    return edited_config("cylinder/lock.json", {
        "components": {"cylinder": {"set": {"t_step": T_STEP, "throttle_extend": FIRST}}},
        "sources": {"stream": {"csv": {"file": "plant.fifo", "time_column": "t"}}},
        "plant": {**signals, "airflow": None},
        "synchronise": {"match": {"cylinder.airflow": None}, "horizon": {"measurements": measurements},
                        "budget": {"time_s": BUDGET_S}},
        "record": {"file": "run.db", "commit_s": 0.1}, "realtime": {"priority": 0, "lock_memory": False}})


def wait_for_strokes(live, database):
    """Until a stroke was searched and has told the throttle, and another one is over as well."""
    def there():
        expect(live.process.poll() is None, f"the run has ended\n{live.log()}")
        ended = query(database, "SELECT outcome FROM v_steps WHERE outcome NOT IN ('held', 'searching', 'caught up')")
        return "optimised" in [outcome for outcome, in ended[:-1]]
    wait_for_steps(live, database, 1)
    wait_until(there, "two strokes", live.log)


def run_live(measurements):
    """(configuration, database, what it told) of a run of two strokes or more."""
    config = twin_config(measurements)
    fifo, database = config.parent / "plant.fifo", config.parent / "run.db"
    with Program("plant", plant_config(), "--fifo", fifo) as plant:
        wait_until(fifo.exists, "the FIFO", plant.log)
        with Program("run", config, "--json") as live:
            wait_for_strokes(live, database)
            told, _ = end_well(live, signal.SIGTERM)
    check_database(database)
    return config, database, told


def expect_many_cycles(database):
    """The search that has found the throttle was left and taken up again, each time within the period. That is asserted
    of the median: one cycle may be late for what else the machine does, most of them only for the search."""
    found, u, value = query(database, "SELECT step, applied, J FROM v_steps JOIN adjustments USING (run, step) "
                            "WHERE outcome = 'optimised' ORDER BY step LIMIT 1")[0]
    expect(u != FIRST and value < 1, f"the throttle found at step {found} is {u}, J = {value}")
    cycles = query(database, "SELECT executions, used_ns FROM steps WHERE step < ? AND stop = ?", found, STOP_TIME)
    worked = [used for executions, used in cycles if executions > FREE]
    expect(len(worked) >= 2, f"the first search has worked in {len(worked)} cycles before that of its end: {cycles}")
    print(f"    throttle {u:.4f}")
    at_most(median(worked) / 1e9, PERIOD_S, f"time of {len(worked)} cycles of the search, median, s")


def test_a_search_over_many_cycles():
    for measurements in ("lag", "hold"):
        config, database, told = run_live(measurements)
        rows = check_rows(database)
        expect(told["steps"] + told["skipped"] == told["ticks"] == rows, f"{rows} rows: {told}")
        expect(told["ledger"]["total"]["difference"] == 0, f"ledger: {told['ledger']}")
        print(f"    {measurements}: {told['time_limited']} cycles cut short, {told['skipped']} of {told['ticks']} "
              f"ticks skipped, {told['deadline_misses']} deadlines missed")
        expect_many_cycles(database)
        check_replay(config, database, rows)


if __name__ == "__main__":
    main()
