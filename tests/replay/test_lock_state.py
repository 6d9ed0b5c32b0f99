#!/usr/bin/env python3
"""The lock state that `replay` prints: for a lost twin, for a plant without data, and with `--require-lock`."""
import json
import random
import sqlite3
from contextlib import closing

from twinlock_test import EMULATED, NOT_LOCKED, PLAIN_LIVE, PLAIN_LOCK, SOURCE, at_most, edited_config, expect, expect_line, has_line, main, run, run_well, scratch

OMEGA = 62.981  # rad/s: where config/motor's twin starts
STEP_S = 0.001
MISSED = 6  # outcome of a step in the database
STATES = ("free", "locked", "corrected", "degraded", "lost")
CONFIG = {"step_s": STEP_S, "duration_s": None, "sources": None, "record": None, "realtime": None, "recording": {"file": "plant.csv"},
          "plant": {"torque": {"modbus": None}, "omega": {"min": None, "max": None, "modbus": None}},
          "synchronise": {"budget": {"time_s": None}, "release_s": 0}}


def config_of(seconds, seed, omega=lambda t: OMEGA, torque=lambda t: "0"):
    """The path of the live motor bench as a replay at 1 kHz, with a recording of a noisy plant at constant speed. At this rate
    the noise moves the current: released twins would show it, and the state would be corrected."""
    draw = random.Random(seed)
    config = edited_config(PLAIN_LIVE, CONFIG)
    times = [i * STEP_S for i in range(round(seconds / STEP_S) + 2)]
    rows = [f"{t:.3f},{omega(t) + draw.gauss(0, 0.3):.6f},{torque(t)}" for t in times]
    (config.parent / "plant.csv").write_text("t,omega,M_brake\n" + "\n".join(rows) + "\n", encoding="utf-8")
    return config


def recorded(config, *options):
    """(database, output of --json, exit code) of a replay."""
    database = scratch() / "run.db"
    code, out, _ = run(["replay", config, "--json", "--db", database, *options])
    return database, json.loads(out), code


def lock_events(database):
    with closing(sqlite3.connect(database)) as connection:
        return connection.execute("SELECT tick, severity, text FROM v_events WHERE source = 'lock' ORDER BY tick").fetchall()


def resets(events):
    """The lock events that are no change of state: the monitor has reset the twin."""
    return [(tick, text) for tick, _, text in events if text.split(":")[0].split(",")[0] not in STATES]


def miss(database, steps):
    """Changes the database to that of a live run that missed `steps` ticks after the step with the most negative u. That
    correction was noise. Returns its step."""
    with closing(sqlite3.connect(database)) as connection:
        (step,), = connection.execute("SELECT step FROM adjustments WHERE step BETWEEN 3000 AND 6000 ORDER BY applied LIMIT 1")
        connection.execute("UPDATE steps SET outcome = ?, stop = 0, evaluations = 0, J = NULL, J_nominal = NULL "
                           "WHERE step > ? AND step <= ?", (MISSED, step, step + steps))
        connection.execute("UPDATE runs SET verb = 'run'")
        connection.commit()
    return step


def test_a_lost_twin_is_reset():
    """A wrong friction during 0.5 s of missed ticks makes the twin unstable. Without a reset, u would swing for minutes, and
    every second step would be within tolerance. A replay of the replay has the same bits."""
    for seed in (1,) if EMULATED else (1, 2, 3):
        config = config_of(20, seed)
        database, told, code = recorded(config)
        expect(code == 0 and told["lock"]["state"] == "locked" and told["lock"]["percent"] == 100, f"before: {code}, {told['lock']}")
        missed = miss(database, 500)
        again, told, code = recorded(config, "--recording", database)
        found = lock_events(again)
        lost, locked = (next((tick for tick, _, text in found if tick > missed and text.startswith(state)), None)
                        for state in ("lost: ", "locked: "))
        expect(None not in (lost, locked), f"seed {seed}: {found}")
        at_most((lost - missed) * STEP_S, 2, f"seed {seed}: seconds until it is lost")
        at_most((locked - missed) * STEP_S, 10, f"seed {seed}: seconds until it is locked again")
        expect(len(resets(found)) == 1 and lost < resets(found)[0][0] < locked, f"seed {seed}: {found}")
        expect_line(resets(found)[0][1], f"step {resets(found)[0][0] - 1}|u|nominal")
        expect(code == 0 and told["lock"]["losses"] == 1 and told["lock"]["percent"] > 90, f"{code}, {told['lock']}")
        shown = json.loads(run_well(["show", again, "--json"]))["lock"]
        window = 100 * 1 / 20  # percent of the run: after a reset the first second is judged late
        expect(shown["losses"] == 1 and shown["state"] == "locked" and abs(shown["percent"] - told["lock"]["percent"]) < window, f"{shown}, {told['lock']}")
        third, repeated, _ = recorded(config, "--recording", again)
        expect(lock_events(third) == found and repeated["adjust"] == told["adjust"] and repeated["match"] == told["match"],
               f"seed {seed}: the replay of the replay differs: {repeated} not {told}")


def test_a_plant_that_never_answers():
    config = config_of(3, 1, omega=lambda t: float("nan"))
    database, told, code = recorded(config)
    expect(code == NOT_LOCKED and told["lock"]["state"] == "free" and told["lock"]["percent"] == 0, f"{code}, {told['lock']}")
    code, out, err = run(["replay", config])
    expect(code == NOT_LOCKED, f"{code}\n{out}")
    expect_line(out, "in lock|never|signal")
    expect_line(err, "error|never|lock")
    expect([text.split(":")[0] for _, _, text in lock_events(database)] == ["free"], f"{lock_events(database)}")
    with closing(sqlite3.connect(database)) as connection:
        ended = connection.execute("SELECT ended_reason FROM runs").fetchall()
    expect(ended == [("end of recording",)], f"{ended}")


def test_a_run_shorter_than_a_window():
    for omega, cause in ((float("nan"), "plant.omega|not a number"), (1e4 * OMEGA, "first window of 1 s|longer")):
        code, out, err = run(["replay", config_of(0.5, 1, omega=lambda t, omega=omega: omega)])
        expect(code == NOT_LOCKED and has_line(out, "in lock|never"), f"{code}\n{out}{err}")
        expect_line(err, f"error|never in lock|{cause}")


def test_a_good_start_is_no_lock():
    """The first 0.2 s are within tolerance, and no window is."""
    code, out, err = run(["replay", config_of(1.1, 1, omega=lambda t: OMEGA if t < 0.2 else 1e4 * OMEGA)])
    expect(code == NOT_LOCKED and has_line(out, "in lock|never"), f"{code}\n{out}{err}")
    expect_line(err, "error|never in lock|motor.omega|plant.omega|tolerance 1")


def test_variables_that_are_not_identifiable():
    """Speed alone does not show whether friction or current is wrong; the gain of the drive acts a step later. Each solver
    tells it once, in words."""
    friction = {"nominal": 0.0031, "step": 0.12, "min": None, "max": None}
    for solver in ("secant",) if EMULATED else ("secant", "nelder-mead", "bobyqa", "l-bfgs", "sbplx"):
        for other, step, source, parts in (("motor.I_in", 3, "lock", "since t = |motor.d and motor.I_in|one correction|horizon.prediction"),
                                           ("drive.P", 0.1, "twin", "drive.P|do not react|no correction|horizon.prediction")):
            config = edited_config(PLAIN_LOCK, {"synchronise": {
                "algorithm": solver, "adjust": {"motor.d": friction, other: {"step": step}},
                "horizon": {"prediction": 1 if source == "lock" else 2}}})
            database, _, _ = recorded(config)
            with closing(sqlite3.connect(database)) as connection:
                found = [text for text, in connection.execute("SELECT text FROM events WHERE source = ?", (source,))
                         if "alike" in text or "do not react" in text]
            expect(len(found) == 1, f"{solver}, {other}: {found}")
            expect_line(found[0], parts)


def test_require_lock():
    config = config_of(4, 1, omega=lambda t: OMEGA if t < 2 else float("nan"))
    _, told, code = recorded(config)
    percent = told["lock"]["percent"]
    expect(code == 0 and 50 < percent < 70, f"{code}, {told['lock']}")
    run_well(["replay", config, "--require-lock", f"{percent - 0.1}"])
    code, out, err = run(["replay", config, "--require-lock", "95"])
    expect(code == NOT_LOCKED, f"{code}\n{err}")
    expect_line(err, f"error|{percent:.2f} %|95 %")
    expect_line(out, f"in lock|{percent:.1f} %|free {100 - percent:.1f} %")
    code, _, err = run(["replay", SOURCE / "config" / "motor" / "free.json", "--require-lock", "95"])
    expect(code == NOT_LOCKED, f"{code}\n{err}")
    expect_line(err, "error|adjusted|95")
    for wrong in ("0", "101", "x", "-5"):
        code, _, err = run(["replay", config, "--require-lock", wrong])
        expect(code == 2, f"{wrong}: {code}\n{err}")
        expect_line(err, f"--require-lock|\"{wrong}\"|0|100")


def test_a_true_model_is_not_reset():
    """With a tolerance that is too small and narrow bounds, a right model is lost. Its states are still better than start values."""
    for tolerance in (0.02, 0.05):
        config = edited_config("motor/lock.json", {
            "components": {"motor": {"set": {"J": 0.0015}}},
            "synchronise": {"adjust": {"motor.d": {"min": 0.003, "max": 0.0032}}, "match": {"motor.omega": {"tolerance": tolerance}}}})
        database, told, _ = recorded(config)
        expect(resets(lock_events(database)) == [], f"{tolerance}: {lock_events(database)}")
        at_most(told["match"]["motor.omega"]["mse"], 1.0, f"tolerance {tolerance}: MSE, (rad/s)\u00b2")


def test_a_signal_that_is_bad():
    """The torque of the brake is missing for a second; the outputs seem to agree."""
    config = config_of(6, 1, torque=lambda t: "x" if 2 < t < 3 else "0")
    states = [text.split(":")[0] for _, _, text in lock_events(recorded(config)[0])]
    expect(states == ["locked", "degraded", "locked"], f"{states}")


if __name__ == "__main__":
    main()
