#!/usr/bin/env python3
"""The cylinder bench with the product's own recording: the delay of the free twin, its only wrong parameter (the
throttle), its valve and its beam."""
import filecmp
import math

from twinlock_test import (SOURCE, at_most, edited_config, expect, main, replay_csv, replay_json, run_well, scratch,
                           within, write_config)

BENCH = SOURCE / "config" / "cylinder"
END, AIR = "cylinder.extend_signal", "cylinder.airflow"
STEPS, NOISE = 1800, 0.03  # of recording.csv; l/s
EXTEND, RETRACT = (0.5, 6.0), 3.5  # s, as in valve.csv


def with_set(**values):
    """free.json with other start values of the cylinder."""
    return edited_config("cylinder/free.json", {"components": {"cylinder": {"set": values}}})


def changes(rows, column):
    """[(time, new value)] of a signal that starts with 0."""
    values = [0.0, *rows[column]]
    return [(time, after) for time, before, after in zip(rows["time"], values, values[1:]) if before != after]


def mse(rows, first, last):
    """MSE of the airflow between two instants."""
    errors = [y - y_hat for time, y, y_hat in zip(rows["time"], rows[AIR], rows["plant.airflow"])
              if first < time <= last]
    return sum(error * error for error in errors) / len(errors)


def test_free():
    """The plant arrives 0.265 s after the command of the valve, the twin 50 steps later. Both leave the end at once."""
    rows = replay_csv("cylinder/free.json")
    expect(len(rows["time"]) == STEPS, f"steps: {len(rows['time'])}")
    expect(changes(rows, "plant.extended") == [(0.765, 1), (3.515, 0), (6.265, 1)], f"{changes(rows, 'plant.extended')}")
    expect(changes(rows, END) == [(1.015, 1), (3.515, 0), (6.515, 1)], f"{changes(rows, END)}")


def test_figures():
    result = replay_json("cylinder/free.json")
    within(result["match"][END]["mse"], 2 * 50 / (STEPS - 1), 1e-12, "extended: MSE")
    within(result["match"][AIR]["mse"], 0.0705, 0.01, "airflow: MSE, (l/s)\u00b2")
    expect(result["executions"]["total"] == 3 * STEPS, f"executions: {result['executions']}")


def test_only_the_extending_throttle_is_wrong():
    rows = replay_csv("cylinder/free.json")
    within(mse(rows, RETRACT, EXTEND[1]), NOISE**2, 0.15, "airflow while it retracts: MSE, (l/s)\u00b2")
    result = replay_json(with_set(throttle_extend=0.023))
    expect(result["match"][END]["mse"] == 0, f"with the true throttle: {result['match'][END]}")
    within(result["match"][AIR]["mse"], NOISE**2, 0.1, "airflow with the true throttle: MSE, (l/s)\u00b2")


def test_the_tighter_the_slower():
    arrivals = [changes(replay_csv(with_set(throttle_extend=opening)), END)[0][0] for opening in (0.01, 0.015, 0.02, 0.03)]
    expect(arrivals == sorted(set(arrivals), reverse=True), f"arrivals: {arrivals}")


def test_a_closed_centre_holds_the_cylinder():
    """Without move_in the chambers are closed when move_out ends, so the cylinder does not move."""
    rows = replay_csv(with_set(move_in=False))
    expect(changes(rows, END) == [(1.015, 1)], f"{changes(rows, END)}")
    closed = [flow for time, flow in zip(rows["time"], rows[AIR]) if time <= EXTEND[0] or RETRACT < time <= EXTEND[1]]
    expect(closed and set(closed) == {0.0}, f"air flows out of closed chambers: {max(map(abs, closed))} l/s")


def test_a_valve_with_two_coils():
    """move_in is a separate signal: the negation of move_out has the effect of the spring."""
    header, *lines = (BENCH / "recording.csv").read_text(encoding="utf-8").splitlines()
    recording = scratch() / "coils.csv"
    recording.write_text("\n".join([f"{header},move_in", *(f"{line},{1 - int(line.split(',')[1])}" for line in lines)])
                         + "\n", encoding="utf-8")
    config = edited_config("cylinder/free.json", {
        "components": {"cylinder": {"set": {"move_in": None}}}, "plant": {"move_in": {"type": "boolean"}},
        "connect": [["plant.move_in", "cylinder.move_in"], ["plant.move_out", "cylinder.move_out"],
                    ["beam.F", "cylinder.F_ext"], ["cylinder.pos", "beam.pos"]]})
    coils, spring = replay_csv(config, "--recording", recording), replay_csv("cylinder/free.json")
    for column in (END, AIR):
        expect(coils[column] == spring[column], f"{column} differs from that with a spring")


def test_too_little_pressure_does_not_lift_the_beam():
    """134.9 N on 8.04 cm² are 1.68 bar; friction and the other chamber do not help."""
    expect(changes(replay_csv(with_set(power_supply=1.6)), END) == [], "1.6 bar extend the cylinder")
    expect(len(changes(replay_csv(with_set(power_supply=3)), END)) > 0, "3 bar do not extend the cylinder")


# ---- the beam ----

def potential_energy(length):
    """Energy of the beam and its mass, J, if the cylinder has this length: law of cosines at the hinge."""
    height, radius, gravity = 0.5, 0.4, 9.81
    sine = (length**2 - height**2 - radius**2) / (2 * height * radius)
    return (6 * 0.5 + 5 * 0.5) * gravity * sine


def test_the_beam_does_the_work_that_lifts_it():
    """Virtual work: the force is the derivative of the energy by the cylinder's length."""
    d = 1e-6
    rows = []
    for i in range(25):
        pos = 0.06 - 0.06 * math.cos(i / 4)
        length = 0.5 + pos
        force = (potential_energy(length + d) - potential_energy(length - d)) / (2 * d)
        rows.append((i, pos, force))
    recording = scratch() / "beam.csv"  # a step's input is the plant's output of the step before: the force a row later
    lines = [f"{i},{pos!r},{before!r}" for (i, pos, _), (_, _, before) in zip(rows[1:], rows)]
    recording.write_text("time,pos,force\n" + "\n".join(lines) + "\n", encoding="utf-8")
    config = write_config({
        "twinlock": 1, "name": "beam", "step_s": 1, "components": {"beam": {"fmu": "beam.fmu"}},
        "plant": {"pos": {"unit": "m"}, "force": {"unit": "N"}}, "connect": [["plant.pos", "beam.pos"]],
        "compare": {"beam.F": {"to": "plant.force"}}})
    result = replay_json(config, "--recording", recording)["match"]["beam.F"]
    expect(result["pairs"] > 20, f"pairs: {result['pairs']}")
    at_most(result["max"], 1e-6, "force less the derivative of the energy, N")


# ---- the plant ----

def test_the_recording_is_regenerated():
    """The command in config/cylinder/README.md makes config/cylinder/recording.csv."""
    made = scratch() / "recording.csv"
    run_well(["plant", BENCH / "plant.json", "--record", made, "--seed", "1"])
    expect(filecmp.cmp(made, BENCH / "recording.csv", False), "twinlock plant --seed 1 makes another recording")


main()
