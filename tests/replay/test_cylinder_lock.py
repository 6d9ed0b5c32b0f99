#!/usr/bin/env python3
"""The cylinder, synchronised by its throttle at the end of each stroke.

The search finds the throttle with any first step, in the first tick in which the measurement determines it. The next stroke is
right from its start."""
from twinlock_test import (SOURCE, at_most, config_path, edited_config, expect, expect_line, main, read_config, read_table,
                           replay_csv, replay_json, run_well, scratch, within)

END, AIR, THROTTLE = "cylinder.extend_signal", "cylinder.airflow", "cylinder.throttle_extend"
BENCH = SOURCE / "config" / "cylinder"
LOCK = config_path("cylinder/lock.json")
STEPS = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1)
FIRST, SECOND = 0.765, 6.265  # s: the plant arrives
T_S, HALF = 0.005, 8
FREE = 3 * 1800


def config(step=0.01, measurements="lag", **more):
    return edited_config("cylinder/lock.json", {
        "synchronise": {"adjust": {THROTTLE: {"step": step}}, "horizon": {"measurements": measurements}, **more}})


def test_any_first_step():
    for step in STEPS:
        for measurements, late in (("lag", HALF), ("hold", 0)):
            result = replay_json(config(step, measurements))
            what = f"{measurements}, first step {step}"
            within(result["adjust"][THROTTLE]["last"], 0.023, 0.002 / 0.023, f"{what}: throttle")
            expect(result["match"][END]["mse"] == late / 1799, f"{what}: {result['match'][END]}")
            at_most(result["executions"]["total"] / FREE, 1.5, f"{what}: executions per free-running one")
            expect(result["ledger"]["total"]["difference"] == 0, f"{what}: {result['ledger']['total']}")


def test_the_second_stroke_is_right_from_the_start():
    for measurements, late in (("lag", HALF), ("hold", 0)):
        rows = replay_csv(config(measurements=measurements))
        wrong = [t for t, y, y_hat in zip(rows["time"], rows[END], rows["plant.extended"]) if y != y_hat]
        expect(len(wrong) == late and all(FIRST <= t < FIRST + late * T_S for t in wrong), f"{measurements}: {wrong}")
        ended = [(t, outcome, n) for t, outcome, n in zip(rows["time"], rows["outcome"], rows["evaluations"])
                 if outcome not in ("held", "searching")]
        instants = [round(t - late * T_S, 6) for t, _, _ in ended]
        expect(instants == [FIRST, SECOND] and ended[1][1:] == ("first guess", 1), f"{measurements}: {ended}")


def test_states_that_are_not_matched_converge():
    """The airflow is not matched. On the second stroke it equals the plant's, except for the noise of 0.03 l/s."""
    rows = replay_csv("cylinder/lock.json")
    errors = [y - y_hat for t, y, y_hat in zip(rows["time"], rows[AIR], rows["plant.airflow"]) if 6 < t < 9]
    at_most(sum(e * e for e in errors) / len(errors), 1.5e-3, "airflow, second stroke: MSE, (l/s)\u00b2")


def test_the_same_bits_from_the_database():
    database = scratch() / "twin.db"
    run_well(["replay", LOCK, "--db", database])
    one, two = scratch() / "one.csv", scratch() / "two.csv"
    run_well(["replay", LOCK, "--csv", one])
    run_well(["replay", LOCK, "--recording", database, "--csv", two])
    expect(one.read_bytes() == two.read_bytes(), "the replay of the database differs")
    told = run_well(["show", database])
    expect_line(told, "stroke|cylinder.throttle_extend|0.01|0.023125|J = 0|8 evaluations|tick 161")
    expect(read_table(one)["step"][-1] == 1799, "steps")


def test_a_short_end_signal():
    """The PLC ends its command when the cylinder arrives, so the signal is on for two steps only. Halving continues if as many
    samples are too early as are too late."""
    folder = scratch()
    (folder / "valve.csv").write_text("t,move_out\n0,0\n0.5,1\n0.765,0\n2.5,1\n2.765,0\n4,0\n")
    plant = edited_config("cylinder/plant.json", {"duration_s": 4, "recording": {"file": str(folder / "valve.csv")}})
    recording = folder / "recording.csv"
    run_well(["plant", plant, "--record", recording])
    for step in STEPS:
        for measurements in ("lag", "hold"):
            rows = replay_csv(config(step, measurements), "--recording", recording)
            ended = [(J, u) for J, u, outcome in zip(rows["J"], rows[THROTTLE], rows["outcome"])
                     if outcome not in ("held", "searching")]
            expect(ended[-1][0] < 1, f"{measurements}, first step {step}: J and throttle {ended}")
            within(ended[-1][1], 0.023, 0.002 / 0.023, f"{measurements}, first step {step}: throttle")


def test_delays():
    """The bus delays measurements by 12 ms, but not commands. With the delay configured, the result is the same."""
    table = read_table(BENCH / "recording.csv")
    late = scratch() / "late.csv"
    rows = sorted([(t, f"{m:g}", "") for t, m in zip(table["t"], table["move_out"])]
                  + [(t + 0.012, "", f"{e:g}") for t, e in zip(table["t"], table["extended"])])
    late.write_text("t,move_out,extended,airflow\n" + "".join(f"{t:.9f},{m},{e},0\n" for t, m, e in rows))
    apart, paired = (replay_json(edited_config("cylinder/lock.json", {"delays": delays}), "--recording", late)
                     for delays in (None, {"output": -0.012}))
    within(paired["adjust"][THROTTLE]["last"], 0.023, 0.02, "throttle, with the delay configured")
    expect(apart["adjust"][THROTTLE]["last"] < 0.0222, f"throttle, without: {apart['adjust']}")


def test_an_end_signal_that_also_feeds_an_input():
    """With delays, the input and the measurement are two lookups. The measurement ends a stroke."""
    connect = [*read_config("cylinder/lock.json")["connect"], ["plant.extended", "cylinder.move_in"]]
    out = run_well(["check", edited_config("cylinder/lock.json", {"connect": connect, "delays": {"output": -0.012}})])
    expect_line(out, "stroke|plant.move_out|plant.extended")
    expect_line(out, "\u0394o = -12 ms")


def test_other_solvers():
    for algorithm in ("bobyqa", "sbplx"):
        result = replay_json(config(algorithm=algorithm))
        within(result["adjust"][THROTTLE]["last"], 0.023, 0.002 / 0.023, f"{algorithm}: throttle")
        expect(result["match"][END]["mse"] == HALF / 1799, f"{algorithm}: {result['match'][END]}")


def test_check_prints_the_stroke():
    page = run_well(["check", LOCK])
    for parts in ("stroke|plant.move_out|plant.extended|2 s", "J|T_F = 16 steps", "lag|8 steps", "tick i + 1", "evaluation|1224 executions",
                  "no problem found"):
        expect_line(page, parts)


main()
