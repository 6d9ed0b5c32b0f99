#!/usr/bin/env python3
"""`check --recording` replays a recording with several prediction horizons, and proposes the one whose states are nearest to the
plant. The plant here is two lags in series; only the second one is measured, so its true first state judges the choice."""
import csv
import json
import math
import os
import random
import signal
import subprocess
import time

from twinlock_test import (PROGRAM, at_least, at_most, config_path, edited_config, expect, expect_line, main, merge, run, run_well, scratch, shared_recording,
                           write_config)

SECONDS, NOISE = 3600, 0.05
FIRST_S, SECOND_S = 60.0, 40.0  # time constants


class Vessels:
    """A recording of the plant whose gain differs by `error` from the model's; and its true states after each second."""

    def __init__(self, error=0.0, seconds=SECONDS):
        choice = random.Random(f"vessels {error}")
        self.folder, self.truth = scratch(), []
        inflow, first, second = 1.0, 1.0, 1.0
        with open(self.folder / "recording.csv", "w", encoding="utf-8", newline="") as file:
            rows = csv.writer(file)
            rows.writerow(["time", "q", "level"])
            for at in range(seconds + 1):
                inflow = choice.uniform(0.5, 2.0) if at % 400 == 0 else inflow
                rows.writerow([at, f"{inflow:.6f}", f"{second + choice.gauss(0.0, NOISE):.6f}"])
                self.truth.append(first)
                first, second = first + (inflow * (1.0 + error) - first) / FIRST_S, second + (first - second) / SECOND_S

    @property
    def path(self):
        return self.folder / "recording.csv"

    def config(self, **synchronise):
        return write_config({
            "twinlock": 1, "name": "two vessels", "step_s": 1,
            "components": {"first": {"fmu": "lag.fmu", "set": {"T": FIRST_S, "x_start": 1, "t_step": 1}},
                           "second": {"fmu": "lag.fmu", "set": {"T": SECOND_S, "x_start": 1, "t_step": 1}}},
            "plant": {"q": {"unit": "1"}, "level": {"unit": "1"}},
            "connect": [["plant.q", "first.u"], ["first.y", "second.u"]],
            "recording": {"time_column": "time"},
            "synchronise": {"adjust": {"first.u": {"step": 0.1, "min": 0, "max": 4}},
                            "match": {"second.y": {"to": "plant.level", "tolerance": 0.2}, "first.y": {"to": "plant.level", "weight": 0}},
                            **synchronise}}, scratch())

    def hidden_error(self, config):
        """Root mean square error of the first state, which no sensor measures, after a fifth of the time."""
        out = run_well(["replay", config, "--recording", self.path, "--csv", "-"])
        rows = list(csv.reader(out.splitlines()))
        column = rows[0].index("first.y simulated")
        squares = [(float(row[column]) - self.truth[round(float(row[0]))]) ** 2 for row in rows[1 + len(rows) // 5:]]
        return math.sqrt(sum(squares) / len(squares))


def horizons(config, recording, *options):
    return json.loads(run_well(["check", config, "--recording", recording, "--json", *options]))


def judge(error):
    plant = Vessels(error)
    told = horizons(plant.config(), plant.path)
    trials = [trial for trial in told["horizons"]["trials"] if not trial["free_twin"]]
    expect([trial["prediction"] for trial in trials] == [2, 5, 10, 20, 50, 100, 200] and not any(trial["fault"] for trial in trials), f"{told['horizons']}")

    def hidden(**synchronise):
        return plant.hidden_error(edited_config(plant.config(), merge(told["proposal"], {"synchronise": synchronise})))

    found = {trial["prediction"]: hidden(horizon={"prediction": trial["prediction"]}, free_twin=False) for trial in trials}
    alone = hidden(horizon={"prediction": 2}, adjust={"first.u": {"min": 0, "max": 1e-9}})
    chosen, proposed = told["proposal"]["synchronise"], hidden()
    print(f"    model {error:+.0%}: hidden state off by {', '.join(f'{found[each]:.3f} (T_P {each})' for each in found)}; alone {alone:.3f}; "
          f"proposed {chosen['horizon']}{' rests' if chosen.get('free_twin') else ''}: {proposed:.3f}")
    at_most(proposed, max(1.2 * alone, NOISE), "error of the hidden state")
    at_most(proposed, max(1.2 * min(found.values()), NOISE), "the same, against the best horizon")
    expect(max(found.values()) > 3.0 * proposed, f"no horizon was bad: {found}")


def test_the_right_model():
    judge(0.0)


def test_a_model_that_is_a_little_wrong():
    judge(0.01)


def test_a_wrong_model():
    judge(0.05)


def test_tanks_of_the_shared_case():
    """Two tanks behind a pump. With T_P 30 the lock reads 100 %, and the upper level is 13 mm off; left alone it is 0.5 mm off."""
    case = shared_recording("../cases/hidden-level/tank.csv").parent
    with open(case / "tank_truth.csv", encoding="utf-8", newline="") as file:
        truth = [(float(row["time"]), float(row["h1"])) for row in csv.DictReader(file)]
    config, recording = case / "right_model_TP30.json", case / "tank.csv"
    told = horizons(config, recording)

    def hidden_mm(path):
        rows = list(csv.reader(run_well(["replay", path, "--recording", recording, "--csv", "-"]).splitlines()))
        column = rows[0].index("tanks.h1 simulated")
        by_time = {round(2 * at): level for at, level in truth}
        squares = [(float(row[column]) - by_time[round(2 * float(row[0]))]) ** 2 for row in rows[1:]]
        return 1e3 * math.sqrt(sum(squares) / len(squares))

    at_least(hidden_mm(config), 10.0, "upper level with T_P 30, mm")
    fmus = {"components": {name: {"fmu": str(case / f"{name}.fmu")} for name in ("pump", "tanks")}}
    at_most(hidden_mm(edited_config(config, merge(told["proposal"], fmus))), 2.0, "as proposed, mm (σ of the lower level)")


def test_shipped_horizons_are_proposed():
    for name, chosen in (("motor", 1), ("tclab", 8), ("bench_cylinder", 1)):
        found = horizons(config_path(f"{name}/lock.json"), config_path(f"{name}/recording.csv"))["proposal"]["synchronise"]
        expect(found["horizon"]["prediction"] == chosen and "free_twin" not in found, f"{name}: {found}")


def test_page():
    page = run_well(["check", config_path("tclab/lock.json"), "--recording", config_path("tclab/recording.csv")])
    expect(max(map(len, page.splitlines()[2:])) <= 80, page)
    table = page.partition("\nhorizons\n")[2].partition("\nproposed\n")[0]
    rows = [line.split() for line in table.splitlines() if line.split()[0].isdigit()]
    expect([int(row[0]) for row in rows] == [1, 2, 5, 8, 10, 20, 8] and rows[-1][1] == "free_twin", table)
    expect([row[0] for row in rows if row[-1] == "*"] == ["8"], table)
    expect_line(table, "longer|600 steps")
    expect_line(page, "prediction 8|shortest|corrects")


def why_not(config, recording=None):
    """Without trials there is still a proposal for the signals."""
    told = horizons(config, recording or config_path("motor/recording.csv"))
    expect("horizon" not in told["proposal"].get("synchronise", {}), f"{told['proposal']}")
    return told["horizons"]["note"]


def test_without_trials_the_reason_is_there():
    expect_line(why_not(config_path("motor/free.json")), "nothing is adjusted")
    expect_line(why_not(config_path("cylinder/lock.json"), config_path("cylinder/recording.csv")), "event horizon")
    expect_line(why_not(edited_config("motor/lock.json", {"components": {"motor": {"keep": "outputs"}}})), "released twins|outputs")
    expect_line(why_not(edited_config("motor/lock.json", {"step_s": 0.2, "synchronise": {"budget": {"time_s": 0.1}}})), "too short")
    code, out, err = run(["check", edited_config("motor/lock.json", {"components": {"motor": {"fmu": "none.fmu"}}}), "--recording",
                          config_path("motor/recording.csv"), "--json"])
    expect(code == 0 and "none.fmu" in err, f"{code} {err}")
    expect_line(json.loads(out)["horizons"]["note"], "FMUs cannot be used")


def test_a_database_as_recording():
    """A run from the start values counts. A run that resumes another one has states that a trial has not."""
    database = scratch() / "run.db"
    run_well(["replay", config_path("motor/lock.json"), "--db", database])
    found = horizons(config_path("motor/lock.json"), database)
    expect(found["proposal"]["synchronise"]["horizon"] == {"prediction": 1}, f"{found['horizons']}")


def test_a_change_of_the_configuration_is_not_written():
    plant = Vessels(seconds=900)
    config = plant.config()
    before = config.read_bytes()
    horizons(config, plant.path)
    expect(config.read_bytes() == before and sorted(os.listdir(config.parent)) == [config.name], f"{os.listdir(config.parent)}")


def test_it_can_be_interrupted():
    plant = Vessels()
    with subprocess.Popen([PROGRAM, "check", plant.config(), "--recording", plant.path], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as check:
        time.sleep(1.0)  # the signal may come in any trial, or before the first one
        check.send_signal(signal.SIGINT)
        out, err = check.communicate(timeout=60)
    expect(check.returncode == 75 and "SIGINT" in err and "{" not in out, f"{check.returncode}\n{out}{err}")


if __name__ == "__main__":
    from twinlock_test import main
    main()
