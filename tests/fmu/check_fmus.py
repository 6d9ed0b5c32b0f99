#!/usr/bin/env python3
"""Tests our FMUs with FMPy.

Usage: check_fmus.py FMU ...                    exit 1 and a line for each difference
       check_fmus.py --write-reference FMU ...  writes fmus/<model>/reference.csv anew

For each FMU: its description is valid and agrees with the binary; it gives fmus/<model>/reference.csv from
fmus/<model>/input.csv; a state restored, or serialised and read back by another instance, goes on with the same bits;
what FMI forbids is refused and changes nothing.

How an FMU is stepped here, and so what reference.csv means (FMPy's own simulate_fmu interpolates, this does not):
  1. Instantiate; initialise with the start values of modelDescription.xml. Row 0 is the outputs now, at time 0.
  2. For i = 0, 1, ...: set all columns of the newest row of input.csv with time <= t_i; one fmi2DoStep from
     t_i = i * T over T; row i + 1 is the outputs now, at time t_(i+1).
The macro step T is 0.01 s, or twelve inner steps if those are longer; a run ends with the last row of input.csv.
Numbers are written so that reading them gives the same bits.
"""

import argparse
import csv
import faulthandler
import struct
import sys
import tempfile
from ctypes import byref, c_void_p
from pathlib import Path

try:
    import fmpy
    from fmpy import fmi2
except ImportError as missing:
    sys.exit(f"{sys.executable} has no FMPy ({missing}). Run script/bootstrap.")

MODELS = Path(__file__).resolve().parents[2] / "fmus"
STEP_S = 0.01
RELATIVE = 1e-12
UNKNOWN_REFERENCE = 9999
SETTABLE_WHILE_STEPPING = {("input", "continuous"), ("input", "discrete"), ("parameter", "tunable")}


class Fmu:
    """One unzipped FMU, its description, and access to values of its types."""

    def __init__(self, path, folder):
        self.path = str(path)
        self.folder = fmpy.extract(self.path, folder)
        self.description = fmpy.read_model_description(self.path, validate=False)
        self.name = self.description.modelName
        self.variables = {variable.name: variable for variable in self.description.modelVariables}
        self.outputs = [name for name, variable in self.variables.items() if variable.causality == "output"]
        self.results = [name for name, variable in self.variables.items()
                        if variable.causality in ("output", "local")]
        self.messages = []
        inner_s = float(self.variables["t_step"].start) if "t_step" in self.variables else 0.0
        self.step_s = STEP_S if inner_s <= STEP_S else 12 * inner_s

    def instantiate(self, logger=True, guid=None):
        callbacks = fmi2.fmi2CallbackFunctions()
        if logger:
            callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(
                lambda environment, name, status, category, message: self.messages.append(message.decode()))
        slave = fmi2.FMU2Slave(guid=guid or self.description.guid, unzipDirectory=self.folder, instanceName="oracle",
                               modelIdentifier=self.description.coSimulation.modelIdentifier)
        slave.instantiate(callbacks=callbacks)
        return slave

    def start(self, **options):
        """A slave before its first step."""
        slave = self.instantiate(**options)
        initialise(slave)
        return slave

    def get(self, slave, names):
        values = []
        for name in names:
            variable = self.variables[name]
            values += getattr(slave, "get" + variable.type)([variable.valueReference])
        return [value if isinstance(value, float) else int(value) for value in values]

    def set(self, slave, name, value):
        variable = self.variables[name]
        convert = float if variable.type == "Real" else int
        getattr(slave, "set" + variable.type)([variable.valueReference], [convert(value)])


def start_value(variable):
    """The start value of the description as a number; 1 or 0 for a Boolean."""
    text = str(variable.start)
    return {"true": 1, "false": 0}[text.lower()] if variable.type == "Boolean" else float(text)


def initialise(slave):
    slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
    slave.exitInitializationMode()


def status_of(call, *arguments):
    """The FMI status with which a call of FMPy's ended."""
    try:
        call(*arguments)
        return fmi2.fmi2OK
    except fmpy.fmi1.FMICallException as failed:
        return failed.status


def bits(values):
    return [struct.pack("<d", value) for value in values]


def read_table(path):
    """[{column: number}] of a CSV file."""
    with open(path, encoding="utf-8", newline="") as file:
        return [{name: float(text) for name, text in row.items()} for row in csv.DictReader(file)]


class Inputs:
    """The values of input.csv at a time."""

    def __init__(self, fmu):
        self.rows = read_table(MODELS / fmu.name / "input.csv")
        self.steps = round(self.rows[-1]["time"] / fmu.step_s)
        self.fmu = fmu

    def apply(self, slave, time):
        row = [row for row in self.rows if row["time"] <= time][-1]
        for name, value in row.items():
            if name != "time":
                self.fmu.set(slave, name, value)


def run(fmu, slave, inputs, first, last, names, sizes=None):
    """Steps `first` to `last` - 1; the values of `names` after each."""
    rows = []
    for i in range(first, last):
        inputs.apply(slave, i * fmu.step_s)
        slave.doStep(i * fmu.step_s, sizes(i) if sizes else fmu.step_s)
        rows.append(fmu.get(slave, names))
    return rows


def simulate(fmu):
    """The rows of reference.csv, without their header."""
    inputs = Inputs(fmu)
    slave = fmu.start()
    rows = [fmu.get(slave, fmu.outputs)] + run(fmu, slave, inputs, 0, inputs.steps, fmu.outputs)
    slave.terminate()
    slave.freeInstance()
    return [[i * fmu.step_s, *row] for i, row in enumerate(rows)]


def write_reference(fmu):
    path = MODELS / fmu.name / "reference.csv"
    with open(path, "w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["time", *fmu.outputs])
        writer.writerows([repr(value) for value in row] for row in simulate(fmu))
    print(f"{fmu.name}: wrote {path}")


# Each check is a generator of what is wrong.


def check_description(fmu):
    for problem in fmpy.validation.validate_fmu(fmu.path):
        yield problem


def check_variables(fmu):
    """The binary knows the variables of the description, with their start values, and no others."""
    slave = fmu.instantiate()
    slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
    for name, variable in fmu.variables.items():
        value = fmu.get(slave, [name])[0]
        if variable.start is not None and value != start_value(variable):
            yield f"{name} starts at {value!r}, but modelDescription.xml says {variable.start}"
    slave.exitInitializationMode()
    for name, variable in fmu.variables.items():
        legal = (variable.causality, variable.variability) in SETTABLE_WHILE_STEPPING
        status = status_of(fmu.set, slave, name, fmu.get(slave, [name])[0])
        if (status == fmi2.fmi2OK) != legal:
            yield f"setting {name} ({variable.causality}, {variable.variability}) while stepping gave status {status}"
    for kind in ("Real", "Integer", "Boolean", "String"):
        used = [variable.valueReference for variable in fmu.variables.values() if variable.type == kind]
        for reference in (len(used), UNKNOWN_REFERENCE):
            if status_of(getattr(slave, "get" + kind), [reference]) != fmi2.fmi2Error:
                yield f"fmi2Get{kind} of the unknown value reference {reference} is not refused"
            if status_of(getattr(slave, "set" + kind), [reference], ["" if kind == "String" else 0]) != fmi2.fmi2Error:
                yield f"fmi2Set{kind} of the unknown value reference {reference} is not refused"
    slave.freeInstance()


def check_booleans(fmu):
    """Any number but 0 is true, and reads back as 1."""
    slave = fmu.start()
    for name, variable in fmu.variables.items():
        if variable.type == "Boolean" and variable.causality == "input":
            for value, wanted in ((2, 1), (-1, 1), (0, 0)):
                fmu.set(slave, name, value)
                if fmu.get(slave, [name]) != [wanted]:
                    yield f"{name} set to {value} reads {fmu.get(slave, [name])[0]}"
    slave.freeInstance()


def check_reference(fmu):
    path = MODELS / fmu.name / "reference.csv"
    expected = [list(row.values()) for row in read_table(path)]
    actual = simulate(fmu)
    if len(actual) != len(expected):
        yield f"{len(actual)} rows, but {path.name} has {len(expected)}"
    for row, expected_row in zip(actual, expected):
        for name, value, wanted in zip(["time", *fmu.outputs], row, expected_row):
            if not abs(value - wanted) <= RELATIVE * abs(wanted):
                yield f"at {row[0]:.2f} s {name} is {value!r}, but {path.name} says {wanted!r}"
                return


def check_repeatable(fmu):
    """The same bits after fmi2Reset, and with step sizes that have the rounding errors of a clock."""
    inputs = Inputs(fmu)
    slave = fmu.start()
    once = run(fmu, slave, inputs, 0, inputs.steps, fmu.results)
    slave.reset()
    initialise(slave)
    again = run(fmu, slave, inputs, 0, inputs.steps, fmu.results, lambda i: (i + 1) * fmu.step_s - i * fmu.step_s)
    if list(map(bits, once)) != list(map(bits, again)):
        yield "a second run after fmi2Reset, with step sizes as differences of times, gives other values"
    slave.freeInstance()


def check_rollback(fmu):
    """Save, step, restore, step: same bits, also in a second instance with the serialised state."""
    inputs = Inputs(fmu)
    middle, end = inputs.steps // 2, inputs.steps
    slave = fmu.start()
    run(fmu, slave, inputs, 0, middle, [])
    at_middle = fmu.get(slave, fmu.results)
    state = slave.getFMUstate()
    serialised = slave.serializeFMUstate(state)
    wanted = list(map(bits, run(fmu, slave, inputs, middle, end, fmu.results)))

    slave.setFMUstate(state)
    if bits(fmu.get(slave, fmu.results)) != bits(at_middle):
        yield "values read after fmi2SetFMUstate are not those at fmi2GetFMUstate"
    if list(map(bits, run(fmu, slave, inputs, middle, end, fmu.results))) != wanted:
        yield "steps after fmi2SetFMUstate give other bits"

    address = state.value
    slave.fmi2GetFMUstate(slave.component, byref(state))
    if state.value != address:
        yield "fmi2GetFMUstate does not reuse a handle that is not NULL"

    other = fmu.instantiate()
    copy = other.deSerializeFMUstate(serialised)
    if other.serializeFMUstate(copy) != serialised:
        yield "a state read back and serialised again gives other bytes"
    other.setFMUstate(copy)
    if list(map(bits, run(fmu, other, inputs, middle, end, fmu.results))) != wanted:
        yield "steps after fmi2DeSerializeFMUstate in another instance give other bits"

    for wrong in (serialised[:-1], bytes(len(serialised))):
        if status_of(other.deSerializeFMUstate, wrong) != fmi2.fmi2Error:
            yield "fmi2DeSerializeFMUstate accepts wrong bytes"
    other.freeFMUstate(copy)
    slave.freeFMUstate(state)
    for each in (slave, other):
        each.freeInstance()


def refusals(fmu, slave):
    """(what, status) of calls that are illegal while `slave` is stepping at time 0."""
    inputs = [variable for variable in fmu.variables.values()
              if (variable.causality, variable.variability) in SETTABLE_WHILE_STEPPING]
    for a_real in [variable.valueReference for variable in inputs if variable.type == "Real"][:1]:
        yield "fmi2SetReal of NaN", status_of(slave.setReal, [a_real], [float("nan")])
        yield "fmi2SetReal of infinity", status_of(slave.setReal, [a_real], [float("inf")])
    for kind in sorted({variable.type for variable in inputs}):
        known = next(variable.valueReference for variable in inputs if variable.type == kind)
        yield f"fmi2Set{kind} of a known and an unknown reference", status_of(
            getattr(slave, "set" + kind), [known, UNKNOWN_REFERENCE], [1, 0])
    yield "a step from another time", status_of(slave.doStep, 5.0, fmu.step_s)
    yield "a step of negative size", status_of(slave.doStep, 0.0, -fmu.step_s)
    yield "a step of size NaN", status_of(slave.doStep, 0.0, float("nan"))
    yield "fmi2SetupExperiment while stepping", status_of(slave.setupExperiment)
    yield "fmi2EnterInitializationMode while stepping", status_of(slave.enterInitializationMode)
    yield "fmi2ExitInitializationMode while stepping", status_of(slave.exitInitializationMode)
    yield "fmi2CancelStep", status_of(slave.cancelStep)
    yield "fmi2SetFMUstate of NULL", status_of(slave.setFMUstate, c_void_p())
    yield "an unknown log category", status_of(slave.setDebugLogging, True, ["logNothing"])


def check_refusals(fmu):
    """Illegal calls give fmi2Error and a message, and do not change the instance."""
    for logger in (True, False):
        slave = fmu.start(logger=logger)
        before = slave.serializeFMUstate(slave.getFMUstate())
        for what, status in refusals(fmu, slave):
            if status != fmi2.fmi2Error:
                yield f"{what} gave status {status}, not fmi2Error"
            if logger and not fmu.messages:
                yield f"{what} is refused without a message"
            fmu.messages.clear()
        if slave.serializeFMUstate(slave.getFMUstate()) != before:
            yield "a refused call has changed the instance"
        slave.terminate()
        if status_of(slave.doStep, 0.0, fmu.step_s) != fmi2.fmi2Error:
            yield "a step after fmi2Terminate is not refused"
        slave.freeInstance()


def check_life(fmu):
    """A step before initialisation, a step past the stop time, and a wrong GUID are refused."""
    slave = fmu.instantiate()
    if status_of(slave.doStep, 0.0, fmu.step_s) != fmi2.fmi2Error:
        yield "a step before initialisation is not refused"
    slave.setupExperiment(startTime=0.0, stopTime=1.5 * fmu.step_s)
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    slave.doStep(0.0, fmu.step_s)
    if status_of(slave.doStep, fmu.step_s, fmu.step_s) != fmi2.fmi2Error:
        yield "a step past the stop time is not refused"
    if status_of(slave.doStep, fmu.step_s, 0.5 * fmu.step_s) != fmi2.fmi2OK:
        yield "a shorter step up to the stop time is refused"
    slave.freeInstance()
    try:
        fmu.instantiate(guid="{00000000-0000-0000-0000-000000000000}")
        yield "a wrong GUID is accepted"
    except Exception:  # FMPy has no class of its own for this
        pass


def check_divergence(fmu):
    """A step that overflows ends with fmi2Error. Then calls fail until a state is restored."""
    slave = fmu.start()
    inputs = Inputs(fmu)
    state = slave.getFMUstate()
    wanted = bits(run(fmu, slave, inputs, 0, 1, fmu.results)[0])
    slave.setFMUstate(state)
    for name, variable in fmu.variables.items():
        if variable.causality == "input" and variable.type == "Real":
            fmu.set(slave, name, 1e308)
    statuses = [status_of(slave.doStep, i * fmu.step_s, fmu.step_s) for i in range(100)]
    if any(abs(value) == float("inf") or value != value for value in fmu.get(slave, fmu.results)):
        if statuses[-1] != fmi2.fmi2Error:
            yield "a step that overflows does not end with fmi2Error"
        if status_of(slave.setReal, [], []) != fmi2.fmi2Error:
            yield "an overflowed instance can still be set"
    slave.setFMUstate(state)
    if bits(run(fmu, slave, inputs, 0, 1, fmu.results)[0]) != wanted:
        yield "a restored state does not undo a step that overflowed"
    slave.freeFMUstate(state)
    slave.freeInstance()


CHECKS = [check_description, check_variables, check_booleans, check_reference, check_repeatable, check_rollback, check_refusals,
          check_life, check_divergence]


def differences(fmu, one):
    """The findings of one check; an unexpected exception ends it."""
    try:
        yield from one(fmu)
    except Exception as failed:
        yield f"{failed} {' '.join(fmu.messages[-1:])}".strip()


def check(fmu):
    """The number of differences, each printed."""
    count = 0
    for one in CHECKS:
        for wrong in differences(fmu, one):
            print(f"{fmu.name}: {one.__name__}: {wrong}")
            count += 1
    print(f"{fmu.name}: {len(CHECKS)} checks, {count} differences")
    return count


def main():
    parser = argparse.ArgumentParser(description="Tests our FMUs with FMPy.")
    parser.add_argument("--write-reference", action="store_true", help="write fmus/<model>/reference.csv")
    parser.add_argument("fmus", metavar="FMU", nargs="+", type=Path)
    arguments = parser.parse_args()
    faulthandler.enable()
    count = 0
    for path in arguments.fmus:
        with tempfile.TemporaryDirectory() as folder:
            fmu = Fmu(path, folder)
            count += (write_reference if arguments.write_reference else check)(fmu) or 0
    return 1 if count else 0


if __name__ == "__main__":
    sys.exit(main())
