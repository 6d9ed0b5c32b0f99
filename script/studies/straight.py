"""Leads an FMU straight on with FMPy, without confinement: straight.py FMU CASE. Prints its outputs after each step as JSON.

CASE is a JSON file: step_ns, start_s, stop_s; set: {variable: value before initialisation}; initial: {input: value in
initialisation}; inputs: {variable: value of each step}; outputs: names.
"""
import json
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import fmpy
from fmpy import fmi2


class Library:
    """A loaded library that has all functions; those that it lacks cannot be called."""

    def __init__(self, library):
        self._library = library

    def __getattr__(self, name):
        return getattr(self._library, name, None) or SimpleNamespace()


class FMU2Lenient(fmi2.FMU2Slave):
    """Also for FMUs that lack functions that a straight run does not need. FMPy expects this beginning of the name."""

    def _loadFunctions(self):
        library, self.dll = self.dll, Library(self.dll)
        super()._loadFunctions()
        self.dll = library


def read_description(folder):
    """(guid, model identifier, {variable: (type, reference)}), also of descriptions that FMPy refuses."""
    root = ElementTree.parse(Path(folder) / "modelDescription.xml").getroot()
    variables = {element.get("name"): ("Integer" if element[0].tag == "Enumeration" else element[0].tag, int(element.get("valueReference")))
                 for element in root.iterfind("ModelVariables/ScalarVariable") if len(element)}
    return root.get("guid"), root.find("CoSimulation").get("modelIdentifier"), variables


def write(slave, variable, value):
    kind, reference = variable
    convert = {"Real": float, "String": str}.get(kind, int)
    getattr(slave, f"set{kind}")([reference], [convert(value)])


def read(slave, variable):
    kind, reference = variable
    return float(getattr(slave, f"get{kind}")([reference])[0])


def lead(case, folder):
    guid, identifier, variables = read_description(folder)
    libraries = list(Path(folder, "binaries", "linux64").glob("*.so"))
    path = str(libraries[0]) if len(libraries) == 1 else None  # its name may differ from the identifier
    slave = FMU2Lenient(guid=guid, unzipDirectory=folder, instanceName="straight", modelIdentifier=identifier, libraryPath=path)
    slave.instantiate()
    for name, value in case["set"].items():
        write(slave, variables[name], value)
    slave.setupExperiment(startTime=case["start_s"], stopTime=case["stop_s"])
    slave.enterInitializationMode()
    for name, value in case["initial"].items():
        write(slave, variables[name], value)
    slave.exitInitializationMode()
    outputs = [variables[name] for name in case["outputs"]]
    step, rows = case["step_ns"], []
    for tick in range(case["steps"]):
        for name, values in case["inputs"].items():
            write(slave, variables[name], values[tick])
        slave.doStep(case["start_s"] + tick * step / 1e9, step / 1e9)
        rows.append([read(slave, variable) for variable in outputs])
    return rows


def main():
    fmu, case = sys.argv[1:]
    with tempfile.TemporaryDirectory(prefix="twinlock-straight-") as folder:
        rows = lead(json.loads(Path(case).read_text(encoding="utf-8")), fmpy.extract(fmu, folder))
    print("\n" + json.dumps(rows))


if __name__ == "__main__":
    main()
