#!/usr/bin/env python3
"""The transport system with the product's own recordings, and with plants of other jam times and speeds.

Tests the deviation of the twin, the number of evaluations, and that everything repeats to the bit."""
import filecmp

from twinlock_test import (NOT_LOCKED, SOURCE, at_least, at_most, edited_config, expect, expect_line, main, read_table, replay_csv, replay_json,
                           run_well, scratch, within)

STEP_S = 0.05
FOLDER = SOURCE / "config" / "transport"
X, ENABLED, VELOCITY = "product.x", "belt2.enabled", "product.p_v_x2"


def mse_and_max(result):
    match = result["match"][X]
    expect(match["unit"] == "mm", f"unit: {match['unit']}")
    return match["mse"], match["max"]


def replay_on(name, recording, edits=None):
    return replay_json(edited_config(f"transport/{name}.json", edits), "--recording", recording)


def record(kind, seed, edits=None, control=None):
    """The path of a new recording of slow_plant.json or fast_plant.json. `control`: rows (t, enabled1, enabled2, carries2), by
    default those of slow_control.csv or fast_control.csv."""
    config = edited_config(f"transport/{kind}_plant.json", edits)
    if control is not None:
        driving = config.parent / "control.csv"
        driving.write_text("t,enabled1,enabled2,carries2\n" + "".join("%g,%d,%d,%d\n" % row for row in control))
        config = edited_config(config, {"recording": {"file": str(driving)}})
    made = config.parent / "made.csv"
    run_well(["plant", config, "--record", made, "--seed", seed])
    return made


def hanging_until(released, speed, seed):
    """A plant whose product is stuck from 3 s until `released` (s), and then moves at `speed` (mm/s)."""
    control = [(0, 0, 0, 0), (1, 1, 0, 0), (3, 0, 1, released <= 3), (max(released, 3.01), 0, 1, 1), (10, 0, 1, 1)]
    return record("slow", seed, {"components": {"belt2": {"set": {"v_x": speed}}}}, control)


def on_share(rows, begin, end):
    """The share of steps with belt 2 on, of those that end between two instants (s)."""
    values = [u for u, time in zip(rows[ENABLED], rows["time"]) if begin < time <= end]
    return sum(values) / len(values)


def check_locked(recording, released):
    """Limits of a twin locked by `enabled` of belt 2, for any plant slower than the twin. Returns its rows."""
    free, locked = replay_on("free", recording), replay_on("slow", recording)
    rows = replay_csv("transport/slow.json", "--recording", recording)
    at_most(mse_and_max(locked)[0] / mse_and_max(free)[0], 0.05, "MSE over that of the free twin")
    at_most(mse_and_max(locked)[1] / mse_and_max(free)[1], 0.20, "MAX over that of the free twin")
    expect(max(rows["evaluations"]) <= 2, f"{max(rows['evaluations'])} evaluations in a step")
    expect(set(rows[ENABLED]) <= {0.0, 1.0}, f"belt 2 is {set(rows[ENABLED])}")
    if released > 3.3:
        expect(on_share(rows, 3.2, min(released, 8)) == 0, "belt 2 was on while the product was stuck")
    return rows


# ---- free, slow, fast ----

def test_free():
    mse, largest = mse_and_max(replay_json("transport/free.json"))
    within(mse, 16941, 0.01, "MSE, free, mm\u00b2")
    within(largest, 230.1, 0.01, "MAX, free, mm")


def test_slow():
    rows = check_locked(FOLDER / "slow_recording.csv", 5.0)
    mse, largest = mse_and_max(replay_json("transport/slow.json"))
    at_most(mse, 160, "MSE, locked, mm\u00b2")
    at_most(largest, 18.5, "MAX, locked, mm")
    within(on_share(rows, 5.5, 8.0), 30 / 70, 0.1, "belt 2 is on in")
    expect(all(abs(y - y_hat) < 8 for time, y, y_hat in zip(rows["time"], rows[X], rows["plant.x"]) if time > 5.5),
           "the twin deviates from a moving product")


def test_slow_is_nominal_if_nothing_helps():
    """Until the product reaches belt 2, both values are equally good, so the nominal one is committed."""
    rows = replay_csv("transport/slow.json")
    early = [i for i, time in enumerate(rows["time"]) if time < 2.5]
    expect(all(rows["outcome"][i] == "nominal" and rows["evaluations"][i] == 2 for i in early), "not nominal")
    expect(all(rows[ENABLED][i] == rows[f"{ENABLED} nominal"][i] == 0 for i in early), "belt 2 is on")


def test_distance():
    out = run_well(["check", FOLDER / "slow.json"])
    for parts in ("T_D = 2|T_P = 2|static|1 unknown", "search|boolean|2 evaluations", "adjust|belt2.enabled|off or on", "no problem found"):
        expect_line(out, parts)


def test_fast():
    """Switching belt 2 cannot move the product faster than 70 mm/s; adjusting its velocity can."""
    result = replay_json("transport/fast.json")
    mse, largest = mse_and_max(result)
    at_most(mse, 1.0, "MSE, locked, mm\u00b2")
    at_most(largest, 4.0, "MAX, locked, mm")
    at_most(result["evaluations"] / result["steps"], 1.05, "evaluations per step")
    moving = [u for u, time in zip(*(replay_csv("transport/fast.json")[key] for key in (VELOCITY, "time"))) if 4 < time < 6]
    within(sum(moving) / len(moving), 90, 0.05, "mean velocity, mm/s")
    by_enabled = {"synchronise": {"adjust": {VELOCITY: None, ENABLED: {}}, "algorithm": "boolean",
                                  "horizon": {"prediction": 2}}}
    at_least(mse_and_max(replay_json(edited_config("transport/fast.json", by_enabled)))[0], 300 * mse,
             "MSE by belt 2 on and off, mm\u00b2")


# ---- other plants ----

def test_other_noise():
    for seed in (1001, 1002, 1003):
        check_locked(record("slow", seed), 5.0)
        at_most(mse_and_max(replay_on("fast", record("fast", seed)))[0], 2.0, "fast: MSE, mm\u00b2")


def test_other_hangs():
    for seed, released in enumerate((3, 3.7, 4.6, 6.0, 9.0), 11):
        check_locked(hanging_until(released, 30, seed), released)


def test_other_speeds():
    for seed, speed in enumerate((10, 50, 70), 21):
        rows = check_locked(hanging_until(5.0, speed, seed), 5.0)
        at_most(abs(on_share(rows, 5.7, 8.0) - speed / 70), 0.08, f"{speed} mm/s: belt 2's share is off by")
    for seed, speed in enumerate((30, 70, 120), 31):
        recording = record("fast", seed, {"components": {"belt2": {"set": {"v_x": speed}}}})
        at_most(mse_and_max(replay_on("fast", recording))[0], 2.0, f"fast, {speed} mm/s: MSE, mm\u00b2")


# ---- messages ----

def test_messages():
    """A message with the state of a belt exists for one step; the receiver holds the state."""
    edits = {"compare": {f"process.{name}{belt}": {"to": f"plant.enabled{belt}"} for name in ("valid", "value")
                         for belt in (1, 2)}
             | {f"event_to_cyclic.enabled{belt}": {"to": f"plant.enabled{belt}"} for belt in (1, 2)}}
    rows = replay_csv(edited_config("transport/free.json", edits))
    for belt, changes in ((1, [1, 0]), (2, [1])):
        told = [i for i, valid in enumerate(rows[f"process.valid{belt}"]) if valid]
        expect([rows[f"process.value{belt}"][i] for i in told] == changes, f"belt {belt}: told in steps {told}")
        expect(sum(rows[f"process.value{belt}"]) == sum(changes), f"belt {belt}: a value without a message")
        plant, held = rows[f"plant.enabled{belt}"], rows[f"event_to_cyclic.enabled{belt}"]
        expect(held[1:] == plant[:-1] and held[0] == 0, f"belt {belt}: the held state differs from the plant's one step before")


def test_a_plant_has_no_delays():
    """`plant` works without delays also if a signal feeds an input and is compared."""
    emulate = {"columns": {"x": {"from": "product.x"}, "enabled1": {"from": "plant.enabled1"}}, "message_s": [0.05, 0.05]}
    edits = {"compare": {"event_to_cyclic.enabled1": {"to": "plant.enabled1"}}, "emulate": emulate}
    record = scratch() / "plant.csv"
    run_well(["plant", edited_config("transport/free.json", edits), "--record", record])
    rows = read_table(record)
    expect(len(rows["x"]) > 100 and max(rows["x"]) > min(rows["x"]), f"{len(rows['x'])} rows")


def test_inputs_that_are_no_booleans():
    """The last good values are used, and the summary counts the bad ones."""
    words = scratch() / "words.csv"
    rows = (FOLDER / "slow_recording.csv").read_text().splitlines()
    words.write_text("\n".join(line[:-1] + "on" if line.endswith("1") else line for line in rows) + "\n")
    config = FOLDER / "slow.json"
    told = run_well(["replay", config, "--recording", words], wells=(0, NOT_LOCKED))
    expect_line(told, "plant.enabled2|102 of 163 samples")
    bad = replay_json("transport/slow.json", "--recording", words)["plant"]
    expect(bad["enabled1"]["not_good"] == 0 < bad["enabled2"]["not_good"] < bad["enabled2"]["samples"], f"{bad}")


# ---- repeatable ----

def csv_file(config, *options):
    path = scratch() / "steps.csv"
    run_well(["replay", config, "--csv", path, *options])
    return path


def test_plain():
    for name in ("slow", "fast"):
        config = FOLDER / f"{name}.json"
        expect(filecmp.cmp(csv_file(config), csv_file(config, "--plain"), False), f"{name}: --plain matters")
        saved, plain = replay_json(config)["executions"], replay_json(config, "--plain")["executions"]
        at_most(saved["total"] / plain["total"], 0.51, f"{name}: executions over those without saving")


def test_recordings_are_regenerated():
    """The commands in README.md make the recordings."""
    for kind in ("slow", "fast"):
        made = record(kind, 1)
        expect(filecmp.cmp(made, FOLDER / f"{kind}_recording.csv", False), f"{kind}: twinlock plant makes another recording")


def test_metres():
    """The same plant measured in metres: the comparison converts units."""
    table = read_table(FOLDER / "slow_recording.csv")
    metres = scratch() / "metres.csv"
    rows = zip(table["t"], table["x"], table["enabled1"], table["enabled2"])
    metres.write_text("t,x,enabled1,enabled2\n" + "".join(f"{t!r},{x / 1000!r},{a:g},{b:g}\n" for t, x, a, b in rows))
    edits = {"plant": {"x": {"unit": "m", "min": -0.5, "max": 1}}}
    for name in ("free", "slow"):
        wanted = mse_and_max(replay_json(f"transport/{name}.json"))
        for value, want, what in zip(mse_and_max(replay_on(name, metres, edits)), wanted, ("MSE, mm\u00b2", "MAX, mm")):
            within(value, want, 1e-9, f"{name}, in metres: {what}")


main()
