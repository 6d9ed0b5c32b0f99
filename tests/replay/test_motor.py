#!/usr/bin/env python3
"""The motor bench on the product's own recording: properties of a lock in each mode and with each horizon.

Everything repeats to the bit."""
import filecmp
import json

from twinlock_test import (PLAIN_LOCK, SOURCE, at_least, at_most, edited_config, expect, expect_line, main, replay_csv, replay_json,
                           run, run_well, scratch)

STEPS = 1401
COMPONENTS = 3
RECORDING = SOURCE / "config" / "motor" / "recording.csv"
U = "motor.d"


def horizon(prediction, measurements="lag"):
    return {"synchronise": {"horizon": {"prediction": prediction, "measurements": measurements}}}


def check_sums(result):
    """Checks sums that hold for every replay of lock.json."""
    expect(result["steps"] == STEPS, f"steps: {result['steps']}")
    expect(result["evaluations"] >= STEPS, f"evaluations: {result['evaluations']}")
    executions = dict(result["executions"])
    expect(executions.pop("total") == sum(executions.values()), f"executions: {result['executions']}")
    for name, count in executions.items():
        entry = result["ledger"]["components"][name]
        expect(count == entry["predicted"] == entry["executions"] >= STEPS, f"{name}: {count} executions, {entry}")
    expect(sum(result["outcomes"].values()) == STEPS, f"outcomes: {result['outcomes']}")
    expect(result["match"]["motor.omega"]["pairs"] == STEPS, "not every step was compared")


def check_plain_sums(result, prediction):
    """Without saving, every evaluation executes every component in every step of the horizon."""
    wanted = STEPS + prediction * result["evaluations"]
    executions = dict(result["executions"])
    expect(executions.pop("total") == COMPONENTS * wanted, f"executions: {result['executions']}, wanted {wanted} each")
    expect(set(executions.values()) == {wanted}, f"executions: {executions}, wanted {wanted} each")


def csv_file(config, *options):
    path = scratch() / "steps.csv"
    run_well(["replay", config, "--csv", path, *options])
    return path


# ---- free and locked ----

def test_free():
    result = replay_json("motor/free.json")
    at_least(result["match"]["motor.omega"]["mse"], 50, "MSE, free, (rad/s)\u00b2")
    expect(result["executions"]["total"] == COMPONENTS * STEPS, f"executions: {result['executions']}")
    expect(result["evaluations"] == 0 and result["adjust"] == {}, "a free run evaluates or adjusts")
    expect(result["outcomes"]["free"] == STEPS, f"outcomes: {result['outcomes']}")


def test_lock():
    result = replay_json(PLAIN_LOCK)
    check_sums(result)
    at_most(result["match"]["motor.omega"]["mse"], 0.05, "MSE, locked, (rad/s)\u00b2")
    at_most(result["match"]["motor.omega"]["max"], 1.0, "MAX, locked, rad/s")
    outcomes = result["outcomes"]
    expect(outcomes["first guess"] + outcomes["optimised"] == STEPS, f"outcomes: {outcomes}")
    expect(result["optimised_steps"] == outcomes["optimised"] >= 1, f"optimised: {result['optimised_steps']}")


def test_lock_with_another_solver():
    result = replay_json(edited_config(PLAIN_LOCK, {"synchronise": {"algorithm": "nelder-mead"}}))
    check_sums(result)
    outcomes = result["outcomes"]
    expect(outcomes["first guess"] + outcomes["optimised"] == STEPS, f"outcomes: {outcomes}")
    expect(result["optimised_steps"] == outcomes["optimised"] > 50, f"optimised: {result['optimised_steps']}")


def test_the_slope_is_learned_at_the_first_step():
    """The first step has one more evaluation, although J is small. So the twin follows its plant closely before the brake moves."""
    rows = replay_csv(PLAIN_LOCK)
    expect(rows["evaluations"][:3] == [2, 1, 1], f"evaluations: {rows['evaluations'][:3]}")
    at_most(max(rows["J"][1:100]), 0.05, "J in the first second")


def test_keys():
    """The keys of the summary and their types."""
    result = replay_json(PLAIN_LOCK)
    for key in ("steps", "evaluations", "optimised_steps", "deadline_misses"):
        expect(isinstance(result[key], int), f"{key}: {result[key]!r}")
    expect({"mse", "max", "unit"} <= set(result["match"]["motor.omega"]), f"{result['match']}")
    expect({"first", "last", "mean", "correction_mean"} <= set(result["adjust"][U]), f"{result['adjust']}")
    expect(result["cache"]["saved"] > 0 and result["cache"]["full"] == 0, f"{result['cache']}")
    expect(result["wall_s"] > 0, f"wall_s: {result['wall_s']}")


def test_json_and_csv_agree():
    result, rows = replay_json(PLAIN_LOCK), replay_csv(PLAIN_LOCK)
    adjust = result["adjust"][U]
    corrections = [u - nominal for u, nominal in zip(rows[U], rows[f"{U} nominal"])]
    expect(rows["step"] == list(range(STEPS)), "steps are not 0 \u2026 1400")
    expect(sum(rows["evaluations"]) == result["evaluations"], "evaluations differ")
    expect(adjust["first"] == rows[U][0] and adjust["last"] == rows[U][-1], "first or last u differs")
    expect(abs(adjust["mean"] - sum(rows[U]) / STEPS) <= 1e-12, "the mean of u differs")
    expect(abs(adjust["correction_mean"] - sum(corrections) / STEPS) <= 1e-12, "the mean correction differs")
    expect(set(rows[f"{U} nominal"]) == {0.0031}, "the nominal is not the configured one")
    for J, y, y_hat, outcome in zip(rows["J"], rows["motor.omega"], rows["plant.omega"], rows["outcome"]):
        expect(abs(J - (y - y_hat) ** 2) <= 1e-9, f"J is {J}, but the difference is {y - y_hat}")
        expect(J < 1 and outcome in ("first guess", "optimised"), f"J is {J} at a step that is {outcome}")


# ---- modes and horizons ----

def test_ahead():
    result = replay_json("motor/ahead.json")
    check_sums(result)
    free, ahead = replay_json("motor/free.json")["match"]["motor.omega"], result["match"]["motor.omega"]
    at_least(free["mse"] / ahead["mse"], 30, "ahead: MSE falls by")


def test_hold():
    """With a horizon of one step, both modes use the step's own measurement, which is known."""
    hold, lag = (csv_file(edited_config(PLAIN_LOCK, horizon(1, mode))) for mode in ("hold", "lag"))
    expect(filecmp.cmp(hold, lag, False), "T_P = 1: hold differs from lag")


def test_lag_with_longer_horizons():
    for prediction in (2, 3):
        result = replay_json(edited_config(PLAIN_LOCK, horizon(prediction)))
        check_sums(result)
        at_most(result["match"]["motor.omega"]["mse"], 0.60, f"T_P = {prediction}: MSE, (rad/s)\u00b2")


def test_horizon_ends_with_the_recording():
    """A step is computed only while the recording has the measurements of its horizon."""
    lines = RECORDING.read_text(encoding="utf-8").splitlines()
    rows = [line for line in lines[1:] if float(line.split(",")[0]) <= 1.0]
    short = scratch() / "short.csv"
    short.write_text("\n".join([lines[0], *rows]) + "\n", encoding="utf-8")
    last_tick = int(float(rows[-1].split(",")[0]) * 100)
    for prediction in (1, 2, 3):
        config = edited_config(PLAIN_LOCK, horizon(prediction))
        steps = replay_json(config, "--recording", short)["steps"]
        expect(steps == last_tick - prediction + 1, f"T_P = {prediction}: {steps} steps of {last_tick} ticks")


def test_budget_bounds_evaluations():
    for limit in (2, 5):
        edits = {"synchronise": {"algorithm": "l-bfgs", "budget": {"evaluations": limit}}}
        largest = max(replay_csv(edited_config(PLAIN_LOCK, edits))["evaluations"])
        expect(largest == limit, f"{largest} evaluations, the budget is {limit}")


def test_a_dynamic_horizon_gets_enough_evaluations():
    """60 unknowns with a configured budget of 60: the solver would never try most of them."""
    config = edited_config(PLAIN_LOCK, {"synchronise": {"horizon": {"prediction": 60, "shape": "dynamic"}}})
    expect_line(run_well(["check", config]), "secant|at most 62 evaluations")
    result = replay_json(config)
    expect(result["lock"]["percent"] > 99, result["lock"])


def test_time_budget_is_ignored():
    hurried = csv_file(edited_config(PLAIN_LOCK, {"synchronise": {"budget": {"time_s": 1e-9}}}))
    expect(filecmp.cmp(hurried, csv_file(edited_config(PLAIN_LOCK)), False), "the time budget matters")


def test_plain():
    """Without saving every evaluation executes every component, and nothing else is different."""
    for prediction in (1, 3):
        config = edited_config(PLAIN_LOCK, horizon(prediction))
        check_plain_sums(replay_json(config, "--plain"), prediction)
        expect(filecmp.cmp(csv_file(config), csv_file(config, "--plain"), False), f"T_P = {prediction}: --plain matters")


def test_weight_0_is_reported_only():
    compared = {"synchronise": {"match": {"drive.e": {"to": "plant.omega", "weight": 0}}}}
    config = edited_config(PLAIN_LOCK, compared)
    result, rows, alone = replay_json(config), replay_csv(config), replay_csv(PLAIN_LOCK)
    check_sums(result)
    match = result["match"]["drive.e"]
    expect(match["pairs"] == STEPS and match["mse"] > 100 and match["unit"] == "rad/s", f"drive.e: {match}")
    expect(rows[U] == alone[U] and rows["J"] == alone["J"], "a match with weight 0 changes what is committed")
    expect_line(run_well(["replay", config]), f"drive.e|{match['mse'] ** 0.5:.3g} rad/s rms|compared only")


def test_never_worse_than_nominal():
    """If nothing within the bounds helps, the nominal is committed, so the twin equals the free one."""
    edits = {"synchronise": {"adjust": {U: {"min": 1e6, "max": 2e6}}}}
    rows, free = replay_csv(edited_config(PLAIN_LOCK, edits)), replay_csv("motor/free.json")
    expect(rows["outcome"].count("nominal") > 100, "no search failed")
    later = set(rows["outcome"][1:])  # in the first step the solver evaluates once more
    expect(later == {"first guess", "nominal"}, f"outcomes: {later}")
    expect(set(rows[U]) == {0.0031}, "another value than the nominal was committed")
    expect(rows["motor.omega"] == free["motor.omega"], "the twin differs from the free one")


def test_bounds_hold():
    edits = {"synchronise": {"adjust": {U: {"min": -0.05, "max": 0.04}}}}
    rows = replay_csv(edited_config(PLAIN_LOCK, edits))
    expect(all(-0.05 <= u <= 0.04 for u in rows[U]), f"u in {min(rows[U])} … {max(rows[U])}")
    expect(len(set(rows[U])) > 3, "u hardly moves")


# ---- repeatable ----

def test_repeatable_to_the_bit():
    for name in ("free", "lock"):
        config = edited_config(f"motor/{name}.json")
        once, again = csv_file(config), csv_file(config)
        expect(once.stat().st_size > 50_000, f"{name}: only {once.stat().st_size} bytes")
        expect(filecmp.cmp(once, again, False), f"{name}: two replays differ")
        code, out, _ = run(["replay", config, "--csv", "-"])
        expect(code == 0 and out == once.read_text(encoding="utf-8"), f"{name}: --csv - differs from a file")


def test_realtime_gives_the_same():
    config = edited_config(PLAIN_LOCK, {"duration_s": 0.2})
    quick, paced = csv_file(config), csv_file(config, "--realtime")
    expect(filecmp.cmp(quick, paced, False), "--realtime gives other values")
    wall = json.loads(run_well(["replay", config, "--json", "--realtime"]))["wall_s"]
    expect(wall >= 0.2, f"--realtime took {wall} s for 0.2 s")


def test_a_replay_of_the_database_is_the_same():
    config, database = edited_config(PLAIN_LOCK), scratch() / "run.db"
    from_csv = csv_file(config, "--db", database)
    from_database = csv_file(config, "--recording", database)
    expect(filecmp.cmp(from_csv, from_database, False), "the database gives other values")


# ---- the plant ----

def test_the_recording_is_regenerated():
    """The command in config/motor/README.md makes config/motor/recording.csv."""
    made = scratch() / "recording.csv"
    run_well(["plant", SOURCE / "config" / "motor" / "plant.json", "--record", made, "--seed", "1"])
    expect(filecmp.cmp(made, RECORDING, False), "twinlock plant --seed 1 makes another recording")


# ---- between two readings ----

LINE = {"plant": {"omega": {"every_s": 0.04}, "torque": {"every_s": 0.04, "between": "mean"}},
        "synchronise": {"match": {"motor.omega": {"between": "line"}}}}


def recorded(config):
    """The database of a replay."""
    path = scratch() / "run.db"
    run_well(["replay", config, "--db", path])
    return path


def test_a_run_with_between_last_is_replayed_with_line():
    """The database has the stamps of the readings, so its replay equals that of the recording, but ends some steps sooner."""
    line = edited_config(PLAIN_LOCK, LINE)
    wanted = csv_file(line).read_bytes()
    found = csv_file(line, "--recording", recorded(PLAIN_LOCK)).read_bytes()
    expect(wanted.startswith(found), "the replay of the database has other values")
    at_least(found.count(b"\n"), STEPS - 8, "rows")


def test_a_run_with_between_line_is_replayed_as_recorded():
    """Also with another configuration: values between readings are not interpolated twice."""
    line = edited_config(PLAIN_LOCK, LINE)
    run_of_it = recorded(line)
    for config in (line, edited_config(line, {"name": "another"})):
        expect(filecmp.cmp(csv_file(line), csv_file(config, "--recording", run_of_it), False), "another replay")


def test_check_prints_the_wait():
    page = run_well(["check", edited_config(PLAIN_LOCK, LINE)])
    for parts in ("lag|i + 6", "matched|4 ticks", "inputs|5 ticks"):
        expect_line(page, parts)
    for mode in ("hold", "ahead"):
        edits = {**LINE, "synchronise": {**LINE["synchronise"], "horizon": {"measurements": mode}}}
        page = run_well(["check", edited_config(PLAIN_LOCK, edits)])
        warnings = " ".join(page.partition("\nwarnings\n")[2].split())
        expect(warnings.count('"between"') == 2, page)
        expect_line(warnings, f"plant.torque|synchronise.match.motor.omega|{mode}")
        expect(filecmp.cmp(csv_file(edited_config(PLAIN_LOCK, edits)), csv_file(edited_config(PLAIN_LOCK, horizon(1, mode))), False),
               f"{mode}: other values than without \"between\"")


main()
