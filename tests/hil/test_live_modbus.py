#!/usr/bin/env python3
"""The main use case: the emulated plant by Modbus TCP, in real time, with a locked twin; then the
replay.

With TL_LONG=1 the run takes the 14 s of config/motor/live.json, else 6 s of them.
"""
import os
import signal

from live_test import (Program, check_database, check_replay, check_summary, end_well, expect_reasons,
                       free_port, number, refused_writes)
from twinlock_test import edited_config, expect, main, read_config

LIVE = "motor/live.json"


def test_recording_by_modbus():
    duration = read_config(LIVE)["duration_s"] if os.environ.get("TL_LONG") == "1" else 6
    config = edited_config(LIVE, {"duration_s": duration,
                                  "sources": {"inverter": {"modbus_tcp": {"port": free_port()}}}})
    database = config.parent / "run.db"
    with Program("plant", config) as plant:
        plant.wait_for("inverter|Modbus TCP")
        with Program("run", config, "--json", "--db", database) as run:
            told, _ = end_well(run)
        code, _, log = plant.end(signal.SIGTERM)
    expect(code == 0, f"the plant ended with {code}\n{log}")
    expect(refused_writes(log) == 0, log)

    rows = check_summary(told, database)
    wanted = round(duration / 0.01) + 1
    expect(told["ticks"] == wanted, f"{told['ticks']} ticks in {duration} s, wanted {wanted}")
    check_database(database)
    expect_reasons(database, "duration")
    expect(number(database, "SELECT entries_lost FROM runs") == 0, "entries were lost")
    in_lock = told["outcomes"]["first guess"] + told["outcomes"]["optimised"]
    expect(in_lock > 0, f"never in lock: {told['outcomes']}")
    match = told["match"]["motor.omega"]
    print(f"    {told['steps']} steps, {told['skipped']} skipped, {told['deadline_misses']} deadline misses, "
          f"{in_lock} in lock, {told['evaluations']} evaluations, {told['executions']['total']} executions, "
          f"MSE {match['mse']:.4g} (rad/s)\u00b2, MAX {match['max']:.4g} rad/s")

    again = check_replay(config, database, rows)
    for key in "steps", "evaluations", "optimised_steps", "match", "adjust", "outcomes", "skipped":
        expect(again[key] == told[key], f"{key}: the run told {told[key]}, its replay {again[key]}")
    for key in "executions", "ledger":
        expect(again[key] == told[key], f"{key} of the replay: {again[key]}, the run told {told[key]}")


if __name__ == "__main__":
    main()
