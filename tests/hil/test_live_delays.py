#!/usr/bin/env python3
"""Delays in a live run: the look-back of each signal, waiting for the next reading, and the
measured Δo.

A replay must give the same bits.
"""
import random
import signal

import delays
from live_test import (Program, check_replay, check_rows, check_summary, end_well, expect_events, expect_same_events, query,
                       wait_for_lock, wait_for_steps, wait_until)
from twinlock_test import PLAIN_LIVE, SOURCE, edited_config, expect, main, run_well, scratch

SECOND, MS = 10**9, 10**6
ALIKE = 1000  # ns: a reading up to so much after an instant belongs to that instant
LATE = 4 * MS  # ns from the stamp of a reading to its arrival, at most: one period of the rows


def streamed(config, signals, recording, **changes):
    """The configuration with these signals from a FIFO, into which the plant plays the recording.

    Returns the paths (configuration, FIFO, database).
    """
    sources = {"stream": {"csv": {"file": "plant.fifo", "time_column": "time", "period_s": 0.001}}, "inverter": None}
    plant = {name: {"modbus": None, "csv": {"source": "stream", "column": name}} for name in signals}
    edits = {"sources": sources, "plant": plant, "record": {"file": "twin.db", "commit_s": 0.1}, "duration_s": None,
             "recording": {"file": str(recording), "time_column": "time"}, **changes}
    path = edited_config(config, edits)
    return path, path.parent / "plant.fifo", path.parent / "twin.db"


def chain(seconds, seed=1):
    """(path, true delay in ms) of a recording of the chain of table 5.16, with a command every half
    second."""
    path = scratch() / "recording.csv"
    commands = [SECOND + i * SECOND // 2 for i in range(2 * seconds)]
    rows, delay = delays.make_chain(random.Random(seed), 0.01, commands, (seconds + 1) * SECOND)
    delays.write_recording(path, rows)
    return path, delay / 1e6


def expect_looked_up(database, name, look_back, take_next):
    """Checks that nine of ten samples of a signal have the right one of all recorded readings.

    Rows are as frequent as ticks, so a row may be stamped just before its tick. On a busy machine
    it then arrives after the tick, and the row before it is right too.
    """
    rows = query(database, """SELECT tick * step_ns, stamp_ns FROM samples JOIN signals USING (run, signal)
                              JOIN runs USING (run) WHERE kind = 'plant' AND signals.name = ? AND run = 1 ORDER BY tick""", name)
    stamps = sorted({stamp for _, stamp in rows if stamp is not None})
    wrong = 0
    for instant, stamp in rows[10:]:
        at = instant - look_back
        later = [other for other in stamps if at <= other <= instant]
        before = [other for other in stamps if other <= at + ALIKE]
        there = [other for other in before if other <= instant - LATE] or before[:1]
        right = stamp == later[0] if take_next and later else there[-1] <= stamp <= before[-1]
        wrong += not right
    # a reading that was even later is recorded with a later tick
    expect(len(rows) > 300 and wrong <= len(rows) // 10, f"{name}: {wrong} of {len(rows)} samples have a wrong reading")


def age(database, name):
    """The age of a signal's values at their ticks in ms, as 95th percentile: one period of the rows
    on an idle machine."""
    ages = query(database, """SELECT (tick * step_ns - stamp_ns) / 1e6 FROM samples JOIN signals USING (run, signal) JOIN runs USING (run)
                              WHERE kind = 'plant' AND signals.name = ? AND run = 1 AND stamp_ns IS NOT NULL ORDER BY 1""", name)
    return ages[len(ages) * 19 // 20][0]


def play(path, fifo, database, steps):
    """The --json report of a run whose plant writes into the FIFO."""
    with Program("plant", path, "--fifo", fifo) as plant:
        wait_until(fifo.exists, "the FIFO", plant.log)
        with Program("run", path, "--json") as live:
            wait_for_steps(live, database, steps)
            told, _ = end_well(live, signal.SIGTERM)
        plant.end(signal.SIGTERM)
    return told


def test_measured_delay_of_a_free_twin():
    recording, true = chain(12)
    path, fifo, database = streamed("second_order/both.json", ("u", "y"), recording,
                                    delays={"measure": {"range_s": 0.05}, "take": "next"})
    told = play(path, fifo, database, 1800)
    expect(told["skipped"] < told["steps"] // 10, f"{told['skipped']} skipped")
    rows = query(database, "SELECT count(*) FROM steps")[0][0]
    expect(rows == told["steps"] + told["skipped"], f"{rows} rows, {told}")
    expect_looked_up(database, "plant.u", 100000, False)
    found = told["delays"]
    print(f"    {found}; true {true:.3f} ms, by the readings")
    # The input's delay is 11.9 ms; the look-up subtracts at most one step. An older input makes the
    # twin late.
    late = age(database, "plant.u")
    print(f"    19 of 20 values of u are at most {late:.1f} ms old")
    expect(found["state"] == "known" and true - 4.5 <= found["measured_s"] * 1e3 <= true + 4.5 + late, f"{found}, true {true}, {late} ms late")
    expect_events(database, ("info", "delay|\u0394o|ms"))
    again = scratch() / "again.db"
    run_well(["replay", path, "--recording", database, "--db", again])
    for table, columns in (("outputs", "step, simulated, measured, quality"), ("steps", "step, t_ns, outcome")):
        sql = f"SELECT {columns} FROM {table} WHERE run = 1 ORDER BY step"
        expect(query(database, sql) == query(again, sql), f"{table} differ")
    expect_same_events(database, 1, again)


def test_a_synchronised_twin():
    """The motor bench with a measurement that is 15 ms late and inputs that are 12 ms late."""
    recording = SOURCE / "config" / "motor" / "recording.csv"
    section = {
        "participants": {"bus": {"cycle_s": 0.01}, "sensor": {"dead_s": 0.015, "cycle_s": 1}, "gate": {"dead_s": 0.012, "cycle_s": 1}},
        "synchronous": [["bus", "sensor", "gate"]],
        "input": {"plant": ["bus"], "simulation": ["bus", "gate"]},
        "output": {"plant": ["sensor", "bus"], "simulation": ["bus", "gate"]},
    }
    path, fifo, database = streamed(PLAIN_LIVE, ("omega", "torque"), recording, delays=section)
    document = {"plant": {"torque": {"csv": {"column": "M_brake"}}}, "recording": {"time_column": "t"},
                "sources": {"stream": {"csv": {"time_column": "t", "file": str(fifo)}}}, "record": {"file": str(database)}}
    path = edited_config(path, document)
    with Program("plant", path, "--fifo", fifo) as plant:
        wait_until(fifo.exists, "the FIFO", plant.log)
        with Program("run", path, "--json") as live:
            wait_for_lock(live, database)
            wait_for_steps(live, database, 400)
            told, _ = end_well(live, signal.SIGTERM)
        plant.end(signal.SIGTERM)
    rows = check_summary(told, database)
    expect(check_rows(database) == rows, "rows are missing")
    lead = query(database, "SELECT lead FROM runs")[0][0]
    expect(lead == 1 + 3, f"lead {lead}")  # output ceil((15 + 10)/10) = 3, input 2, and T_P = 1
    expect_looked_up(database, "plant.omega", 15 * MS, True)
    expect_looked_up(database, "plant.torque", 8 * MS, False)
    check_replay(path, database, rows)


if __name__ == "__main__":
    main()
