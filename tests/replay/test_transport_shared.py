#!/usr/bin/env python3
"""The transport system of the thesis, with the recording that it was checked with (not part of the product; skipped if
absent)."""
from twinlock_test import (at_most, edited_config, expect, main, replay_csv, replay_json, run_well, shared_recording,
                           within)

X, ENABLED = "product.x", "belt2.enabled"


def recording():
    return shared_recording("thesis_transport_slow.csv")


def test_free():
    result = replay_json("transport/free.json", "--recording", recording())
    expect(result["steps"] == 160, f"steps: {result['steps']}")
    within(result["match"][X]["mse"], 16778, 0.01, "MSE, mm\u00b2")
    within(result["match"][X]["max"], 231, 0.001, "MAX, mm")


def test_slow():
    config = "transport/slow.json"
    match = replay_json(config, "--recording", recording())["match"][X]
    at_most(match["mse"], 152, "MSE, mm\u00b2")
    at_most(match["max"], 17.75, "MAX, mm")
    rows = replay_csv(config, "--recording", recording())
    expect(max(rows["evaluations"]) <= 2, f"{max(rows['evaluations'])} evaluations in a step")
    hangs = [u for u, time in zip(rows[ENABLED], rows["time"]) if 3 < time <= 5]
    moves = [u for u, time in zip(rows[ENABLED], rows["time"]) if 5.5 < time <= 8]
    expect(not any(hangs), "belt 2 was on while the product hung")
    within(sum(moves) / len(moves), 0.438, 0.05, "belt 2 is on in")
    out = run_well(["check", edited_config(config)])
    expect("T_D = 2, T_P = 2" in out, out)


main()
