#!/usr/bin/env python3
"""Compares the co-simulation with an independent one: FMPy steps the same FMUs, and the test exchanges their values.

Both must agree to 1e-12 relative: for the motor with its control loop on the product's recording, and for each FMU alone, driven
by fmus/*/input.csv. The latter must also agree with reference.csv."""
import xml.etree.ElementTree

import fmpy
from fmpy.fmi2 import FMU2Slave

from twinlock_test import (FMUS, SOURCE, config_path, edited_config, expect, main, read_config, read_table,
                           replay_csv, replay_json, scratch, write_config)

RELATIVE = 1e-12
STEP_NS = 10_000_000


class Component:
    """One FMU, stepped by FMPy."""

    def __init__(self, name):
        path = str(FMUS / f"{name}.fmu")
        description = fmpy.read_model_description(path)
        self.references = {variable.name: variable.valueReference for variable in description.modelVariables}
        self.fmu = FMU2Slave(guid=description.guid, unzipDirectory=fmpy.extract(path, str(scratch())),
                             modelIdentifier=description.coSimulation.modelIdentifier, instanceName=name)
        self.fmu.instantiate()

    def set(self, name, value):
        self.fmu.setReal([self.references[name]], [value])

    def get(self, name):
        return self.fmu.getReal([self.references[name]])[0]

    def initialise(self):
        self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def step(self, i):
        self.fmu.doStep(currentCommunicationPoint=i * STEP_NS / 1e9, communicationStepSize=STEP_NS / 1e9)

    def close(self):
        self.fmu.terminate()
        self.fmu.freeInstance()


class Recording:
    """Finds the newest row at or before a tick; tick 0 is at the first row. Ticks must be requested in ascending order."""

    def __init__(self, path, time_column):
        self.columns = read_table(path)
        self.times = [round(time * 1e9) for time in self.columns[time_column]]
        self.row = 0

    def at(self, column, tick):
        while self.row + 1 < len(self.times) and self.times[self.row + 1] <= self.times[0] + tick * STEP_NS:
            self.row += 1
        return self.columns[column][self.row]


def recording_of(document):
    described = document["recording"]
    return Recording(config_path("motor") / described["file"], described["time_column"])


def simulate_motor(document, steps):
    """Speed after each step: all step with the inputs they hold, then all inputs are assigned."""
    recording = recording_of(document)
    torque = document["plant"]["torque"]["csv"]["column"]
    components = {name: Component(name) for name in document["components"]}
    for name, component in components.items():
        for variable, value in document["components"][name]["set"].items():
            component.set(variable, value)
        component.initialise()
    drive, motor = components["drive"], components["motor"]
    speeds = []
    for i in range(steps):
        current, speed = drive.get("u_R"), motor.get("omega")
        motor.set("I_in", current)
        motor.set("M_w", recording.at(torque, i))
        drive.set("y", speed)
        drive.step(i)
        motor.step(i)
        speeds.append(motor.get("omega"))
    for component in components.values():
        component.close()
    return speeds


def expect_equal(found, wanted, what):
    expect(len(found) == len(wanted), f"{what}: {len(found)} rows, wanted {len(wanted)}")
    worst = max(abs(a - b) / abs(b) if b != 0.0 else abs(a) for a, b in zip(found, wanted))
    print(f"    {what}: {len(found)} values differ by at most {worst:.1e} relative")
    expect(worst <= RELATIVE, f"{what} differs by {worst:.3e} relative")


def test_motor_and_drive():
    document = read_config("motor/free.json")
    expect(document["step_s"] == STEP_NS / 1e9, "this test is written for steps of 10 ms")
    rows = replay_csv("motor/free.json")
    expect_equal(rows["motor.omega"], simulate_motor(document, len(rows["step"])), "motor.omega")
    expect(max(rows["motor.omega"]) - min(rows["motor.omega"]) > 10, "the recording does not move the motor")


def test_motor_and_drive_metrics():
    """MSE and MAX (thesis, eq. 5.2 and 5.3) from the trajectory."""
    path = edited_config("motor/free.json")
    rows, match = replay_csv(path), replay_json(path)["match"]["motor.omega"]
    differences = [y - y_hat for y, y_hat in zip(rows["motor.omega"], rows["plant.omega"])]
    expect_equal([match["mse"]], [sum(one * one for one in differences) / (len(differences) - 1)], "MSE")
    expect_equal([match["max"]], [max(map(abs, differences))], "MAX")


def test_pairing():
    """The twin is compared with the newest row of the recording at the end of each step."""
    recording = recording_of(read_config("motor/free.json"))
    rows = replay_csv("motor/free.json")
    wanted = [recording.at("omega", i + 1) for i in range(len(rows["step"]))]
    expect(rows["plant.omega"] == wanted, "plant.omega is not the newest row at the end of each step")
    expect(rows["step"] == list(range(1401)), "steps are not 0 \u2026 1400")
    ends = [round((i + 1) * 0.01, 9) for i in range(1401)]
    expect(rows["time"] == ends, "times differ from the ends of the steps")


def configure_alone(name):
    """(configuration of one FMU driven by fmus/NAME/input.csv, names of its inputs, names of its outputs)."""
    description = xml.etree.ElementTree.parse(SOURCE / "fmus" / name / "modelDescription.xml")
    variables = {one.get("name"): one for one in description.iter("ScalarVariable")}
    inputs = [one for one, variable in variables.items() if variable.get("causality") == "input"]
    outputs = [one for one, variable in variables.items() if variable.get("causality") == "output"]
    plant = {one: {"unit": variables[one].find("Real").get("unit")} for one in inputs}
    plant["anything"] = {"csv": {"column": inputs[0]}}
    document = {
        "twinlock": 1, "name": name, "step_s": STEP_NS / 1e9,
        "components": {name: {"fmu": f"{name}.fmu"}},
        "plant": plant,
        "recording": {"file": str(SOURCE / "fmus" / name / "input.csv")},
        "connect": [[f"plant.{one}", f"{name}.{one}"] for one in inputs],
        "compare": {f"{name}.{one}": {"to": "plant.anything"} for one in outputs},
    }
    return write_config(document), inputs, outputs


def simulate_alone(name, inputs, outputs, steps):
    """Each output after each step."""
    recording = Recording(SOURCE / "fmus" / name / "input.csv", "time")
    component = Component(name)
    component.initialise()
    found = {one: [] for one in outputs}
    for i in range(steps):
        for one in inputs:
            component.set(one, recording.at(one, i))
        component.step(i)
        for one in outputs:
            found[one].append(component.get(one))
    component.close()
    return found


def steps_until_parameters_change(table, inputs):
    """The number of steps until reference.csv first changes a tunable parameter, which no connection can do."""
    changes = [time for name, values in table.items() if name not in ("time", *inputs)
               for time, value in zip(table["time"], values) if value != values[0]]
    return int(min(changes) * 1e9) // STEP_NS


def check_alone(name):
    config, inputs, outputs = configure_alone(name)
    rows, reference = replay_csv(config), read_table(SOURCE / "fmus" / name / "reference.csv")
    expect(len(rows["step"]) == len(reference["time"]) - 1, f"{len(rows['step'])} steps")
    wanted = simulate_alone(name, inputs, outputs, len(rows["step"]))
    same = steps_until_parameters_change(read_table(SOURCE / "fmus" / name / "input.csv"), inputs)
    expect(same >= 30, f"only {same} steps can be compared with reference.csv")
    for one in outputs:
        found = rows[f"{name}.{one}"]
        expect(len(set(found)) >= 50, f"{one} hardly moves")
        expect_equal(found, wanted[one], f"{name}.{one} and FMPy")
        expect_equal(found[:same], reference[one][1:same + 1], f"{name}.{one} and reference.csv")


def test_motor_alone():
    check_alone("motor")


def test_drive_alone():
    check_alone("drive")


def test_emps_alone():
    check_alone("emps")


def test_lag_alone():
    check_alone("lag")


main()
