#!/usr/bin/env python3
"""On the box: the motor bench of config/motor/box.json, each poll a reading. `twinlock plant` is
the true plant, with noise: its speed comes by CAN and its torque by Modbus TCP. Its start bit is a
GPIO line, which the test pulls at the instants of config/motor/box.csv. `twinlock run` is
supervised, with the watchdog armed.

TL_SCENARIO_S: duration in seconds, at most 60. The default of 24 has a pull of the brake, a stop
and a start, if the plant starts within some seconds.
"""
import os
import re
import threading
import time
from pathlib import Path

import box
import can_bus
from live_test import (FREE_RUN, GOOD, MADE_UP, STOP_TIME, Program, check_database, check_free_run, check_replay, check_summary,
                       end_well, number, query, refused_writes)
from supervised import Supervised, expect_starts, known_state
from twinlock_test import BUILD, PLAIN_BOX, SOURCE, at_least, config_path, edited_config, expect, main, read_table

SECONDS = float(os.environ.get("TL_SCENARIO_S", "24"))
WATCHDOG_S = 10


class StartBit(threading.Thread):
    """Pulls the line whenever the plant's start bit changes."""

    def __init__(self):
        super().__init__(daemon=True)
        table = read_table(config_path("motor/box.csv"))
        self.rows = list(zip(table["t"], table["enabled"]))
        self.done, self.pulls = threading.Event(), 0
        box.set_line("enabled", self.rows[0][1] == 1)

    def run(self):
        begun, before = time.monotonic(), self.rows[0][1]
        for instant, level in self.rows:
            if level != before:
                if self.done.wait(max(0.0, begun + instant - time.monotonic())):
                    return
                box.set_line("enabled", level == 1)
                before, self.pulls = level, self.pulls + 1

    def end(self):
        self.done.set()
        self.join()


def watchdog_is_armed():
    name = Path(box.description()["watchdog"]["device"]).name
    return Path("/sys/class/watchdog", name, "state").read_text(encoding="ascii").strip() == "active"


def expect_no_stale_sample_used(database):
    """Checks by the stamps that good samples are younger than stale_s. A stamp may be 1 us after
    its instant."""
    oldest = query(database, """SELECT signals.name, max(tick * step_ns - stamp_ns) / 1e6, min(tick * step_ns - stamp_ns) / 1e6
                                FROM samples JOIN signals USING (run, signal) JOIN runs USING (run)
                                WHERE kind = 'plant' AND quality = ? AND signals.name NOT LIKE '%@reading' GROUP BY signal""", GOOD)
    limits = {"plant.torque": 200, "plant.omega": 200, "plant.enabled": 500}
    print(f"    oldest good samples, ms: {[(name, round(age, 1)) for name, age, _ in oldest]}")
    expect(sorted(name for name, *_ in oldest) == sorted(limits), f"{oldest}")
    for name, age, newest in oldest:
        expect(age <= limits[name] and newest >= -0.001, f"good samples of {name} are {newest} … {age} ms old")


def expect_start_bit(database, pulls):
    """Checks that the run followed the line, and that the motor stopped and ran again."""
    levels = [value for (value,) in query(database, """SELECT value FROM samples JOIN signals USING (run, signal)
                                                      WHERE name = 'plant.enabled' AND quality = 0 ORDER BY tick""")]
    edges = sum(one != other for one, other in zip(levels, levels[1:]))
    expect(edges == pulls >= 2, f"{edges} edges of {pulls} pulls")
    slowest, fastest = query(database, "SELECT min(simulated), max(simulated) FROM outputs")[0]
    expect(slowest < 2 and fastest > 55, f"the twin's speed was between {slowest} and {fastest} rad/s")


def play(config, duration):
    """Runs the plant and the twin. Returns (report of `run`, its log, the plant's log, pulls of the
    line)."""
    start_bit = StartBit()
    plant_config = SOURCE / "config" / "motor" / "box_plant.json"
    device = box.description()["watchdog"]["device"]
    with Supervised(config, "--json", "--watchdog", device, "--watchdog-timeout", WATCHDOG_S, "--duration", duration,
                    state=known_state(BUILD / "rig" / "gpio_states.json")) as live:
        live.wait_for("supervisor:|start")  # on a busy machine it would come after the pulls
        expect(watchdog_is_armed(), "the watchdog is not armed")
        with Program("plant", plant_config, "--for", config, "--seed", "7") as plant:
            plant.wait_for("CAN|vcan0")
            start_bit.start()
            live.process.wait(20 * duration + 60)
            told, log = end_well(live)
            expect(live.account()["starts"] == 1, f"restarted: {live.account()}\n{log}")
            start_bit.end()
            code, _, plant_log = plant.end(15)
            expect(code == 0, f"the plant ended with {code}\n{plant_log}")
    return told, log, plant_log, start_bit.pulls


def test_motor_scenario():
    config = edited_config(PLAIN_BOX, {"duration_s": None, "realtime": {"hang_s": 8}})
    database = config.parent / "twin.db"
    sent = can_bus.transmitted()
    told, log, plant_log, pulls = play(config, SECONDS)
    sent = can_bus.transmitted() - sent
    # only the plant has sent frames, and no client has written
    frames = int(re.search(r"(\d+) frames\D+ 0\b", plant_log)[1])
    expect(sent == frames, f"{sent} frames on the bus, {frames} of them the plant's")
    expect(refused_writes(plant_log) == 0, plant_log)
    # every tick is accounted for
    expect(told["ticks"] == round(SECONDS / 0.01) + 1, f"{told['ticks']} ticks in {SECONDS} s")
    rows = check_summary(told, database, components=4)
    expect(rows == told["ticks"] - 1 or rows == told["ticks"], f"{rows} rows of {told['ticks']} ticks")
    check_database(database)
    expect(number(database, "SELECT entries_lost FROM runs") == 0, "entries were lost")
    # samples
    expect_no_stale_sample_used(database)
    check_free_run(database)
    expect_start_bit(database, pulls)
    # an emulated processor has no time for some searches; a finished one gives lock
    done = "outcome NOT IN (:free, :made) AND stop <> :time"
    wanted = {"free": FREE_RUN, "made": MADE_UP, "time": STOP_TIME}
    searched = number(database, f"SELECT count(*) FROM steps WHERE {done}", wanted)
    within = number(database, f"SELECT count(*) FROM steps WHERE J < 1 AND {done}", wanted)
    print(f"    {told['ticks']} ticks = {told['steps']} steps + {told['skipped']} skipped; {told['outcomes']}; {frames} frames; "
          f"MSE {told['match']['motor.omega']['mse']:.4g}, MAX {told['match']['motor.omega']['max']:.3g} rad/s")
    at_least(within / searched, 0.8, f"of {searched} searched steps are within tolerance")
    # the end
    expect(not watchdog_is_armed(), f"the watchdog is still armed\n{log}")
    expect_starts(database, "start")
    begun = time.monotonic()
    check_replay(config, database, rows)
    print(f"    the replay took {time.monotonic() - begun:.1f} s here")
    while time.monotonic() < begun + WATCHDOG_S + 1:  # an armed watchdog would reset the box now
        time.sleep(0.1)


main()
