#!/usr/bin/env python3
"""On the box: the GPIO chip of a supervised run is removed, like a USB adapter, and plugged in
again. Meanwhile the twin holds the start bit and stays in lock by the other signals, and no process
restarts."""
from can_bus import OMEGA, Motor, wait_for_value
from live_test import (GOOD, NO_LINK, Device, check_database, check_replay, check_rows, expect_events, expect_in_order, last_step,
                       qualities, query, wait_for_lock, wait_for_quality, wait_for_steps)
from supervised import Supervised, end_orderly, known_state, wait_for_run
from test_live_gpio import Chip
from twinlock_test import BUILD, PLAIN_BOX, edited_config, expect, main

# Nominal current of the drive, A, while the start bit has no link. If the bit fell, it would be
# below 0 within 0.1 s.
ASKED = """SELECT count(*), min(nominal) FROM adjustments a JOIN samples s ON s.run = a.run AND s.tick = a.step
           JOIN signals ON signals.run = s.run AND signals.signal = s.signal
           WHERE signals.kind = 'plant' AND name = 'plant.enabled' AND quality = ?"""


def live_config(port):
    config = edited_config(PLAIN_BOX, {
        "duration_s": None, "record": {"commit_s": 0.1}, "realtime": {"hang_s": 5},
        "sources": {"inverter": {"modbus_tcp": {"port": port}}, "panel": {"gpio": {"chip": "bench", "period_s": 0.02}}},
        "plant": {"enabled": {"gpio": {"line": "START"}}}})
    return config, config.parent / "twin.db"


def test_a_chip_is_pulled_out_and_put_back():
    with Chip("bench", ["START"]) as chip, Device(OMEGA) as device, Motor(OMEGA):
        chip.set("START", True)
        config, database = live_config(device.port)
        with Supervised(config, state=known_state(BUILD / "rig" / "gpio_states.json")) as live:
            wait_for_run(live, database, 1)
            for _ in range(2):
                wait_for_value(live, database, "enabled", 1)
                chip.pull_out()
                wait_for_quality(live, database, "enabled", NO_LINK)
                wait_for_lock(live, database, last_step(database))
                chip.plug_in()
                chip.set("START", True)
            wait_for_value(live, database, "enabled", 1)
            wait_for_steps(live, database, last_step(database) + 50)
            wait_for_lock(live, database, last_step(database))
            end_orderly(live)
            expect(live.account()["starts"] == 1, f"restarted: {live.account()}\n{live.log()}")
    expect_in_order(qualities(database, "enabled"), [GOOD, NO_LINK, GOOD, NO_LINK, GOOD], "quality of the start bit")
    expect_events(database, *2 * (("warning", "plant.enabled|panel"), ("info", "plant.enabled|good")))
    expect_events(database, *2 * (("warning", "START|chip"), ("info", "START|connected")))
    steps, least = query(database, ASKED, NO_LINK)[0]
    expect(steps > 40 and least > 0, f"the start bit was not held: at least {least} A in {steps} steps")
    check_database(database)
    check_replay(config, database, check_rows(database))


main()
