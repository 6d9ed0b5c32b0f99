#!/usr/bin/env python3
"""A cylinder live, by a FIFO: a search over each stroke finds the throttle in real time.

The search takes many cycles, each within its time. A replay must give the same bits.
"""
import signal
from statistics import median

from live_test import (STOP_TIME, Program, check_database, check_replay, check_rows, end_well, query, wait_for_steps,
                       wait_until)
from twinlock_test import at_most, edited_config, expect, main, scratch

FIRST = 0.01  # the twin's throttle; the plant's is 0.023
PERIOD_S, BUDGET_S = 0.005, 0.002
T_STEP = 5e-6  # s: a step of the twin takes some 150 us, so a cycle has time for ten of a search's 500 steps
FREE = 3  # executions of a step without a search
STROKE_S, STROKES = 2.0, 15  # s, the valve's period; the test ends after the second searched stroke


def valve(folder):
    """The PLC's commands to the valve: extend, and half a period later retract."""
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
    """Waits until the search of a stroke has found the throttle, and one more search has ended."""
    def there():
        expect(live.process.poll() is None, f"the run has ended\n{live.log()}")
        ended = query(database, "SELECT outcome FROM v_steps WHERE outcome NOT IN ('held', 'searching', 'caught up')")
        return "optimised" in [outcome for outcome, in ended[:-1]]
    wait_for_steps(live, database, 1)
    wait_until(there, "two strokes", live.log)


def run_live(measurements):
    """(configuration, database, --json report) of a run of at least two strokes."""
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
    """Checks that the first search continued over several cycles, each shorter than the period.

    This tests the median of the cycles: other load of the machine may delay single cycles.
    """
    found, u, value = query(database, "SELECT step, applied, J FROM v_steps JOIN adjustments USING (run, step) "
                            "WHERE outcome = 'optimised' ORDER BY step")[0]
    expect(u != FIRST and value < 1, f"the throttle found at step {found} is {u}, J = {value}")
    cycles = query(database, "SELECT executions, used_ns FROM steps WHERE step < ? AND stop = ?", found, STOP_TIME)
    worked = [used for executions, used in cycles if executions > FREE]
    expect(len(worked) >= 2, f"the first search took {len(worked)} cycles before its last one: {cycles}")
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
