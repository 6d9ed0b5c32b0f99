#!/usr/bin/env python3
"""The CSV FMU in another master (FMPy), in real time, reads the FIFO of the emulated plant.

The FMU must deliver the plant's values in their order, and no step may wait.
"""
import os
import time

import fmpy
from fmpy import fmi2
from twinlock_test import FMUS, SANITIZER, edited_config, expect, finish, main, read_table, run_well, scratch, start

SECONDS, STEP_S = 1.5, 0.005
NOTHING = -1.0  # the output before the first row
STROKE = 0.265  # s: stroke time of the true cylinder, after the valve's command at 0.5 s


def reader(fifo):
    """An instance of the FMU that is ready for its first step, and the value references of y1 and
    y2."""
    folder = fmpy.extract(str(FMUS / "csv.fmu"), str(scratch()))
    description = fmpy.read_model_description(folder)
    references = {variable.name: variable.valueReference for variable in description.modelVariables}
    slave = fmi2.FMU2Slave(guid=description.guid, unzipDirectory=folder, instanceName="reader", modelIdentifier="csv")
    slave.instantiate()
    for name, text in {"file": str(fifo), "time_column": "t", "column1": "airflow", "column2": "extended"}.items():
        slave.setString([references[name]], [text])
    slave.setReal([references["initial1"]], [NOTHING])
    slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    return slave, [references["y1"], references["y2"]]


def wait_for_first_row(slave, outputs):
    """Reads rows by steps of size 0, so that time stands still."""
    deadline = time.monotonic() + 10
    while slave.getReal(outputs)[0] == NOTHING:
        expect(time.monotonic() < deadline, "the plant has written nothing for 10 s")
        time.sleep(0.001)
        slave.doStep(0.0, 0.0)


def follow(slave, outputs):
    """(values of each step, longest step) of a real-time run from the first row on."""
    wait_for_first_row(slave, outputs)
    values, longest, begun = [], 0.0, time.monotonic()
    for step in range(round(SECONDS / STEP_S)):
        time.sleep(max(0.0, begun + (step + 1) * STEP_S - time.monotonic()))
        before = time.monotonic()
        slave.doStep(step * STEP_S, STEP_S)
        longest = max(longest, time.monotonic() - before)
        values.append(slave.getReal(outputs))
    return values, longest


def in_order(found, sent):
    """True if all values of `found` are in `sent`, in the same order."""
    rest = iter(sent)
    return all(value in rest for value in found)


def test_what_the_plant_sends_is_delivered():
    config = edited_config("cylinder/plant.json", {"duration_s": SECONDS})
    recorded, fifo = scratch() / "sent.csv", scratch() / "fifo"
    run_well(["plant", config, "--record", recorded])
    sent = read_table(recorded)
    os.mkfifo(fifo)
    slave, outputs = reader(fifo)
    plant = start(["plant", config, "--fifo", fifo])
    values, longest = follow(slave, outputs)
    finish(plant)

    airflow = [value for value, before in zip([row[0] for row in values], [None, *(row[0] for row in values)])
               if value != before]
    print(f"    {len(airflow)} of {len(sent['airflow'])} values, longest step {1e3 * longest:.3g} ms")
    expect(in_order(airflow, sent["airflow"]), "the FMU delivered other values, or in another order")
    expect(len(airflow) >= len(sent["airflow"]) // 2, f"only {len(airflow)} values were delivered")
    expect([row[1] for row in values].count(1.0) >= (SECONDS - 0.5 - STROKE) / STEP_S - 20, "the end signal is late")
    expect(SANITIZER or longest < 0.1, f"a step took {longest} s")


main()
