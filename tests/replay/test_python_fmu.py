#!/usr/bin/env python3
"""FMUs of PythonFMU, made from tests/fmu/python, together with our own.

Their results have the bits of an independent loop of FMPy. They are synchronised by their states, by their memory, which all of them share, or by replay.
If something is missing, the message names it."""
import csv
import functools
import math
import os
import re
import sqlite3
import subprocess
import sys
from contextlib import closing

import fmpy
from fmpy.fmi2 import FMU2Slave

from python_fmu import LIBRARY, export
from twinlock_test import (BUILD, FMUS, SANITIZER, Skip, expect, expect_line, expect_no_line, has_line, main, merge, read_table, replay_csv, replay_json,
                           run, run_well, scratch, write_config)

STEP_NS = 10_000_000
STEPS = 1000
RESET = 300  # step


# ---- FMUs and recordings ----

@functools.cache
def recording(steps=STEPS):
    """A recording of jumps of the set-point, a closed valve and changes of the controller's stage."""
    path = scratch() / "recording.csv"
    with open(path, "w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["time", "ref", "open", "stage", "y"])
        for i in range(steps + 1):
            writer.writerow([i / 100, 0.8 if i // 250 % 2 else 0.2, int(not 600 <= i < 650), 1 + i // 400 % 2,
                             0.5 + 0.3 * math.sin(i / 50)])
    return path


def loop(changes=None):
    """A configuration with controller and plant of PythonFMU, and our own lag as the sensor between them."""
    return merge({
        "twinlock": 1, "name": "loop of two exporters", "step_s": STEP_NS / 1e9,
        "components": {
            "controller": {"fmu": str(export("controller", "--handle-state")), "set": {"law": "PI", "K": 1.5},
                           "libraries": [LIBRARY]},
            "process": {"fmu": str(export("plant", "--handle-state"))},
            "sensor": {"fmu": "lag.fmu", "set": {"T": 0.05}},
        },
        "plant": {"ref": {}, "y": {}, "open": {"type": "boolean", "initial": True},
                  "stage": {"type": "integer", "initial": 1}},
        "recording": {"file": str(recording())},
        "connect": [["plant.ref", "controller.ref"], ["plant.open", "controller.enable"],
                    ["plant.stage", "controller.stage"], ["sensor.y", "controller.y"], ["plant.open", "process.open"],
                    ["controller.u", "process.u"], ["process.y", "sensor.u"]],
        "compare": {name: {"to": f"plant.{signal}"} for name, signal in COMPARED.items()},
    }, changes or {})


COMPARED = {"controller.u": "y", "controller.limited": "open", "controller.hits": "stage", "process.y": "y",
            "process.above": "open", "process.count": "stage", "sensor.y": "y"}  # each with a signal of its type


def alone(fmu, changes=None):
    """A configuration of one FMU with an output y."""
    return merge({
        "twinlock": 1, "name": "alone", "step_s": STEP_NS / 1e9, "duration_s": 0.2, "plant": {"y": {}},
        "components": {"slave": {"fmu": str(fmu), "libraries": [LIBRARY]}},
        "recording": {"file": str(recording())}, "compare": {"slave.y": {"to": "plant.y"}},
    }, changes or {})


TUNED = {"compare": None, "duration_s": None, "synchronise": {
    "adjust": {"slave.gain": {"step": 0.1}}, "match": {"slave.y": {"to": "plant.y", "tolerance": 0.001}}}}

SLAVE = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real

class Slave(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.y, self.gain, self.hidden = 0.0, 1.0, 0.0
        self.register_variable(Real("y", causality=Fmi2Causality.output))
        self.register_variable(Real("gain", causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable))

    def do_step(self, current_time, step_size):
        {body}
        return True

    def terminate(self):
        print("terminated")
"""


def slave_that(body):
    """An FMU with this code as its step."""
    return export("slave", "--handle-state", source=SLAVE.replace("{body}", body))


def refused(document, code, *parts, folder=None):
    """`check` and `replay` end with `code`; for each of `parts` a line of the log has them."""
    for verb in ("check", "replay"):
        found, _, err = run([verb, write_config(document, folder)])
        expect(found == code, f"{verb} ended with {found}, wanted {code}\n{err}")
        for wanted in parts:
            expect_line(err, wanted)


# ---- the search path of Python ----

LOOK = """import os, site, sys
        sys.path.append(site.getusersitepackages())
        import of_the_user
        assert os.environ["HOME"] == os.getcwd() and sys.dont_write_bytecode
        try:
            open("{home}/.local/share")
            assert False
        except PermissionError:
            self.y = of_the_user.Y"""


def test_home_and_packages_of_the_user():
    """HOME is a temporary folder. OpenTURNS, for example, needs HOME or else the list of users, which is closed. Packages of the
    user are found all the same."""
    home = scratch()
    packages = home / ".local" / "lib" / f"python{sys.version_info.major}.{sys.version_info.minor}" / "site-packages"
    packages.mkdir(parents=True)
    packages.joinpath("of_the_user.py").write_text("Y = 0.25\n", encoding="utf-8")
    home.joinpath(".local", "share").write_text("not for FMUs", encoding="utf-8")
    before = os.environ["HOME"]
    os.environ["HOME"] = str(home)
    try:
        rows = replay_csv(write_config(alone(slave_that(LOOK.replace("{home}", str(home))))))
    finally:
        os.environ["HOME"] = before
    expect(rows["slave.y"][-1] == 0.25, rows["slave.y"])


# ---- the loop of FMPy ----

class Peer:
    """One FMU, stepped by FMPy."""

    def __init__(self, path, name, start):
        # PythonFMU leaves the variability of Booleans and Integers to FMI's default, "continuous", which is wrong for them.
        description = fmpy.read_model_description(str(path), validate=False)
        self.variables = {variable.name: variable for variable in description.modelVariables}
        self.fmu = FMU2Slave(guid=description.guid, unzipDirectory=fmpy.extract(str(path), str(scratch())),
                             modelIdentifier=description.coSimulation.modelIdentifier, instanceName=name)
        self.fmu.instantiate()
        for variable, value in start.items():
            self.set(variable, value)
        self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def set(self, name, value):
        variable = self.variables[name]
        getattr(self.fmu, f"set{variable.type}")([variable.valueReference], [value])

    def get(self, name):
        variable = self.variables[name]
        return getattr(self.fmu, f"get{variable.type}")([variable.valueReference])[0]

    def step(self, i):
        self.fmu.doStep(currentCommunicationPoint=i * STEP_NS / 1e9, communicationStepSize=STEP_NS / 1e9)


def simulate(document, steps):
    """The compared outputs after each step; all inputs have their values from the start of the step."""
    table = read_table(recording())
    files = {name: part["fmu"] for name, part in document["components"].items()}
    peers = {name: Peer(FMUS / file if file == "lag.fmu" else file, name, document["components"][name].get("set", {}))
             for name, file in files.items()}
    types = {"ref": float, "y": float, "open": bool, "stage": int}
    found = {name: [] for name in COMPARED}
    for i in range(steps):
        values = {}
        for origin, target in document["connect"]:
            part, name = origin.split(".")
            values[target] = types[name](table[name][i]) if part == "plant" else peers[part].get(name)
        for target, value in values.items():
            part, name = target.split(".")
            peers[part].set(name, value)
        for peer in peers.values():
            peer.step(i)
        for name in COMPARED:
            part, variable = name.split(".")
            found[name].append(float(peers[part].get(variable)))
    return found


def test_the_same_as_an_independent_loop_to_the_bit():
    document = loop()
    rows = replay_csv(write_config(document))
    expect(len(rows["step"]) == STEPS, f"{len(rows['step'])} steps")
    wanted = simulate(document, STEPS)
    for name in COMPARED:
        moves = len(set(wanted[name]))
        expect(moves > 1, f"{name} does not move")
        expect(rows[name] == wanted[name], f"{name} differs from FMPy's")
        print(f"    {name}: {moves} values, the same bits")


def test_several_instances_of_one_fmu():
    """Three controllers do not affect each other: an equal one has equal outputs, one with another parameter does not."""
    others = {"second": {"fmu": str(export("controller", "--handle-state")), "set": {"law": "PI", "K": 1.5}},
              "third": {"fmu": str(export("controller", "--handle-state")), "set": {"law": "P", "K": 1.5}}}
    inputs = {"ref": "plant.ref", "enable": "plant.open", "stage": "plant.stage", "y": "sensor.y"}
    connect = loop()["connect"] + [[origin, f"{name}.{one}"] for name in others for one, origin in inputs.items()]
    rows = replay_csv(write_config(loop({"components": others, "connect": connect,
                                         "compare": {f"{name}.u": {"to": "plant.y"} for name in others}})))
    expect(rows["second.u"] == rows["controller.u"], "an equal instance differs")
    expect(rows["third.u"] != rows["controller.u"], "law is not set")


def test_a_reset_in_the_middle_of_a_run():
    """After a reset of all FMUs the values are those of a run that starts there."""
    path, database, cut = write_config(loop()), scratch() / "run.db", scratch() / "cut.csv"
    run_well(["replay", path, "--db", database])
    with closing(sqlite3.connect(database)) as connection, connection:
        connection.execute(f"UPDATE steps SET flags = flags | 32 WHERE step = {RESET}")
    header, *lines = recording().read_text(encoding="utf-8").splitlines(keepends=True)
    cut.write_text(header + "".join(lines[RESET:]), encoding="utf-8")
    whole, found = replay_csv(path), replay_csv(path, "--recording", database)
    wanted = replay_csv(write_config(loop({"recording": {"file": str(cut)}})))
    for name in COMPARED:
        expect(found[name][RESET:] == wanted[name], f"{name} differs from a run that starts there")
        expect(found[name] != whole[name], f"{name} is not reset")


# ---- synchronised ----

LOCK = {"compare": None, "synchronise": {
    "adjust": {"process.gain": {"step": 0.2, "min": 0.2, "max": 3}},
    "match": {"process.y": {"to": "plant.y", "tolerance": 0.001}}}}
STRONGER = 1.3  # the true plant's gain; the twin's is 1


@functools.cache
def true_plant():
    """The recording, with the y of a plant that has a higher gain than its twin."""
    rows = replay_csv(write_config(loop({"components": {"process": {"set": {"gain": STRONGER}}}})))
    table = read_table(recording())
    table["y"] = [0.0, *rows["process.y"]]
    path = scratch() / "true.csv"
    with open(path, "w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([table, *zip(*table.values())])
    return path


def test_it_is_synchronised_and_rolled_back():
    """Adjusts a tunable parameter, then an input. Restored or executed again, the bits are the same. Executions are saved with
    the FMUs' own states; copied together, no execution is saved."""
    by_states = {"components": {name: {"rollback": "state"} for name in ("controller", "process")}}
    free = replay_json(write_config(loop({"recording": {"file": str(true_plant())}})))["match"]["process.y"]["mse"]
    for adjusted, settings in {"process.gain": {"step": 0.2, "min": 0.2, "max": 3}, "process.u": {"step": 0.2}}.items():
        changes = {"recording": {"file": str(true_plant())}, "synchronise": {"adjust": {"process.gain": None, adjusted: settings}}}
        config = write_config(loop(merge(LOCK, merge(changes, by_states))))
        together = write_config(loop(merge(LOCK, changes)))
        saved, plain = replay_csv(config), replay_csv(config, "--plain")
        expect(saved == plain, f"{adjusted}: with and without saving executions differ")
        expect(saved == replay_csv(together), f"{adjusted}: by states and by memory, the results differ")
        expect(SANITIZER or replay_json(together)["executions"]["process"] == all_executions(config), "executions are saved")
        told, all_told = replay_json(config), replay_json(config, "--plain")
        executions = told["executions"]["process"], all_told["executions"]["process"]
        mse = told["match"]["process.y"]["mse"]
        print(f"    {adjusted}: MSE {mse:.2g}, free {free:.2g}; executions {executions}")
        expect(executions[0] < executions[1], f"executions {executions}")
        expect(told["ledger"]["total"]["difference"] == 0, f"ledger {told['ledger']['total']}")
        expect(mse < free / 100, f"MSE {mse}, free {free}")
        if adjusted == "process.gain":
            last = saved["process.gain"][-100:]
            expect(all(abs(gain - STRONGER) < 0.1 for gain in last), f"the gain is not found: {last[-1]}")


def all_executions(config):
    return replay_json(config, "--plain")["executions"]["process"]


def resident_peak(document):
    """The most memory of a replay, kB."""
    read, write = os.pipe()
    with os.fdopen(read) as result:
        code = f"""if True:
            import os, resource, subprocess, sys
            subprocess.run(sys.argv[2:], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=True)
            os.write(int(sys.argv[1]), str(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss).encode())"""
        subprocess.run([sys.executable, "-c", code, str(write), os.environ["TWINLOCK"], "replay", write_config(document)],
                       env={**os.environ, "TWINLOCK_FMU_PATH": str(FMUS), "TMPDIR": str(scratch())}, pass_fds=[write],
                       check=True)
        os.close(write)
        return int(result.read())


def test_memory_of_states_does_not_grow():
    """PythonFMU allocates a new state although it should reuse one, and leaks the old one; so twinlock frees each state first.

    A state of 200 variables has 10 kB, so 1,000 steps would leak 10 MB. Both replays fill the rings of 1,024 ticks and results."""
    if SANITIZER:
        raise Skip("a sanitizer keeps memory that was freed")
    variables = "for i in range(200): self.register_variable(Real('x' + str(i), getter=lambda: 1.0))\n        "
    source = SLAVE.replace("{body}", "self.y = self.gain").replace("self.register", variables + "self.register", 1)
    fmu = export("slave", "--handle-state", source=source)
    short, long = (resident_peak(alone(fmu, merge(TUNED, {"duration_s": duration, "recording": {"file": str(recording(2500))}}))) for duration in (15, 25))
    print(f"    {short} kB after 1500 steps, {long} kB after 2500")
    expect(long - short < STEPS, f"memory has grown by {long - short} kB")


def need_memory():
    if SANITIZER:
        raise Skip("no memory copies of FMUs with a sanitizer's allocator")


def test_without_states_it_is_rolled_back_by_memory():
    process = {"fmu": str(export("plant"))}
    refused(loop(merge(LOCK, {"components": {"process": {**process, "rollback": "state"}}})), 65, "line 17|components.process|canGetAndSetFMUstate")
    need_memory()
    code, out, err = run(["check", write_config(loop(merge(LOCK, {"components": {"process": process}})))])
    expect(code == 0, f"exit code {code}\n{out}{err}")
    expect_line(out, "rolled back|memory")


def test_a_state_that_is_not_registered_is_found():
    """PythonFMU saves registered variables only. An FMU with another state claims to support states, but does not."""
    fmu = slave_that("self.hidden += self.gain; self.y = self.hidden")
    code, _, err = run(["replay", write_config(merge(alone(fmu, TUNED), {"components": {"slave": {"rollback": "state"}}}))])
    expect(code == 70, f"exit code {code}\n{err}")
    expect_line(err, 'error|slave.y|1|step|"rollback"')
    expect_method(alone(fmu, TUNED), "memory")


# ---- rolled back by memory ----

def expect_method(document, *methods, notices=()):
    """`check` names the rollback method of each FMU, and reports the notices."""
    need_memory()
    code, out, err = run(["check", write_config(document)])
    expect(code == 0, f"exit code {code}\n{out}{err}")
    found = [re.split("[:,]", line.split(" by ")[1].removeprefix("its "))[0] for line in out.splitlines() if "rolled back by " in line]
    expect(found == list(methods), f"rolled back by {found}, wanted {methods}\n{out}{err}")
    for notice in notices:
        expect_line(err, notice)


def expect_exact(document, *methods, notices=()):
    """Rolled back by these methods, the results have the bits of --plain; those of replay if there is another method."""
    expect_method(document, *methods, notices=notices)
    rows, plain = replay_csv(write_config(document)), replay_csv(write_config(document), "--plain")
    expect(rows == plain, "with and without saving, the results differ")
    if "memory" in methods:
        by_replay = merge(document, {"components": {name: {"rollback": "replay"} for name in document["components"]}})
        expect(rows == replay_csv(write_config(by_replay)), "by memory and by replay, the results differ")


MEMORY = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real
{top}
class {name}(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.y, self.gain, self.u, self.x, self.k = 0.0, 1.0, 0.0, 0.0, 0
        self.register_variable(Real("y", causality=Fmi2Causality.output))
        self.register_variable(Real("u", causality=Fmi2Causality.input))
        self.register_variable(Real("gain", causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable))

    def do_step(self, current_time, step_size):
        self.k += 1
        {body}
        self.x += step_size * (self.gain * self.u - self.x)
        self.y = self.x
        return True
"""


def lag(body="pass", top="", name="Lag", states=False):
    """An FMU with first-order dynamics whose state is not registered, and this code in its steps."""
    source = MEMORY.replace("{body}", body).replace("{top}", top).replace("{name}", name)
    return export(name.lower(), *(["--handle-state"] if states else []), source=source)


def chain(*fmus):
    """The FMUs in series; the gain of the first is found with Nelder-Mead over five steps, for 0.6 s."""
    names = [f"c{i}" for i in range(len(fmus))]
    return {"twinlock": 1, "name": "chain", "step_s": STEP_NS / 1e9, "duration_s": 0.6, "plant": {"y": {}, "ref": {}},
            "components": {name: {"fmu": str(fmu), "libraries": [LIBRARY]} for name, fmu in zip(names, fmus)},
            "recording": {"file": str(recording())},
            "connect": [["plant.ref", "c0.u"]] + [[f"{a}.y", f"{b}.u"] for a, b in zip(names, names[1:])],
            "synchronise": {"algorithm": "nelder-mead", "horizon": {"prediction": 5},
                            "adjust": {"c0.gain": {"step": 0.2, "min": 0.2, "max": 3}},
                            "match": {f"{names[-1]}.y": {"to": "plant.y", "tolerance": 0.001}}}}


def with_packages(test):
    """Runs it with the packages of this Python: numpy is found by the first python3 in PATH."""
    def run_test():
        path = os.environ["PATH"]
        os.environ["PATH"] = os.path.dirname(sys.executable) + ":" + path
        try:
            test()
        finally:
            os.environ["PATH"] = path
    run_test.__doc__ = test.__doc__
    return run_test


NUMPY = "v = numpy.roll(getattr(self, 'v', numpy.zeros(20)), 1); v[0] = self.x; self.v = v; self.x += 1e-3 * float(v @ v)"
LAZY = "import decimal, random, zlib; self.x += 1e-3 * random.Random(self.k).random()"


def test_components_in_python_go_back_together():
    """They share one interpreter: two FMUs, the same FMU twice, and one whose states would not be exact."""
    one, other = lag(), lag(name="Other", states=True)
    for fmus in (one, other), (one, one), (other, other):
        expect_exact(chain(*fmus), "memory", "memory")


def test_what_two_instances_share_goes_back_too():
    """A counter of the class belongs to both. Nothing is saved in their twin, so even that is exact."""
    need_memory()
    fmu = lag("type(self).n = getattr(type(self), 'n', 0) + 1; self.x += 1e-3 * (type(self).n % 7)")
    rows, plain = (replay_csv(write_config(chain(fmu, fmu)), *options) for options in ([], ["--plain"]))
    expect(rows == plain, "with and without saving, the results differ")


@with_packages
def test_numpy_goes_back():
    expect_exact(chain(lag(NUMPY, "import numpy")), "memory")
    expect_exact(chain(lag(NUMPY, "import numpy"), lag(NUMPY, "import numpy", "Other")), "memory", "memory")


@with_packages
def test_a_library_that_a_step_opens():
    """In the first steps, and later. What the proof's steps leave in the script's module does not stay there."""
    expect_exact(chain(lag(LAZY)), "memory")
    expect_exact(chain(lag("import numpy; " + NUMPY), lag(name="Other")), "memory", "memory")
    expect_exact(chain(lag(f"if current_time > 0.3:\n            {LAZY}")), "memory")
    counted = "import decimal, zlib; COUNT.append(0); self.x += 1e-3 * (len(COUNT) - self.k)"
    rows = replay_csv(write_config(chain(lag(counted, top="COUNT = []"))))
    expect(rows == replay_csv(write_config(chain(lag()))), "steps of the proof are counted")


def test_what_cannot_be_copied():
    """A thread of the script, and a file that it keeps open: all components go by replay."""
    thread = "import threading, time\nthreading.Thread(target=time.sleep, args=(5,), daemon=True).start()"
    expect_exact(chain(lag(top=thread)), "replay", notices=["warning|FMU Lag|memory|thread"])
    file = "import tempfile; self.file = getattr(self, 'file', None) or tempfile.TemporaryFile()"
    expect_exact(chain(lag(file), lag(name="Other")), "replay", "replay", notices=["warning|FMU Lag|open file"])
    expect_exact(chain(lag(), lag(file, name="Other")), "replay", "replay", notices=["warning|FMU Lag|open file"])


def test_what_cannot_be_copied_later():
    """A thread that is started after the proof: the message names a rollback method that works."""
    need_memory()
    late = "if self.k == 40: threading.Thread(target=threading.Event().wait, daemon=True).start()"
    document = chain(lag(late, top="import threading"))
    code, _, err = run(["replay", write_config(document)])
    expect(code == 70, f"exit code {code}\n{err}")
    expect_line(err, 'error|FMU Lag|memory|thread|"rollback": "replay"')
    document = merge(document, {"components": {"c0": {"rollback": "replay"}}})
    expect(replay_csv(write_config(document)) == replay_csv(write_config(document), "--plain"), "the results differ")


def test_methods_of_several():
    """By memory all of them, or no component."""
    need_memory()
    document = chain(lag(), lag(name="Other"))
    mixed = merge(document, {"components": {"c0": {"rollback": "memory"}, "c1": {"rollback": "replay"}}})
    refused(mixed, 65, 'components.c0|"memory"|in all')
    expect_method(merge(document, {"components": {"c1": {"rollback": "replay"}}}), "replay", "replay")
    expect_method(merge(document, {"components": {"c0": {"rollback": "memory"}}}), "memory", "memory")


def test_a_trial_that_the_script_refuses():
    need_memory()
    document = chain(lag("if self.gain > 1.1: return False"))
    found = replay_json(write_config(document))
    expect(found["refused_trials"] > 0, found)
    expect(replay_csv(write_config(document)) == replay_csv(write_config(document), "--plain"), "the results differ")


def test_a_module_shared_by_two_instances_causes_a_warning():
    """Python loads each module once in a process, so two instances share its variables."""
    counts = slave_that("type(self).calls = getattr(type(self), 'calls', 0) + 1; self.y = float(type(self).calls)")
    code, out, err = run(["check", write_config(alone(counts))])
    expect(code == 0, f"{code}\n{out}{err}")
    expect_line(" ".join(out.partition("\ndeterminism\n")[2].split()), "components.slave|process|step 0|y")
    code, out, err = run(["check", write_config(alone(slave_that("self.y += 1.0")))])
    expect(code == 0, f"{code}\n{out}{err}")
    expect_line(out, "two instances|steps")
    expect_no_line(out, "components.slave")


# ---- errors ----

def test_without_the_key():
    document = loop({"components": {"controller": {"libraries": None}}})
    refused(document, 65, 'line 6|components.controller|Controller.fmu|_Py_NoneStruct|"libraries": ["libpython3.11.so.1.0"]')


def test_a_missing_library():
    place = "line 13|components.controller.libraries[0]"
    refused(loop({"components": {"controller": {"libraries": ["libpython3.99.so.1.0"]}}}), 65,
            f"{place}|libpython3.99.so.1.0|No such file|package libpython3.99")
    refused(loop({"components": {"controller": {"libraries": ["./libmissing.so"]}}}), 65, f"{place}|/libmissing.so|No such file|\"./libmodel.so\"")
    for name in "x" * 5000, "./" + "x" * 5000:
        refused(loop({"components": {"controller": {"libraries": [name]}}}), 65, f"{place}|path|too long")


def test_two_pythons():
    """The first one is a link beside the configuration to a file made for tests/unit/firmware/fmu/test_library.c."""
    folder = scratch()
    (folder / "lib").mkdir()
    (folder / "lib" / "old.so").symlink_to(BUILD / "tests" / "interpreter-3.8.1.so")
    refused(loop({"components": {"controller": {"libraries": ["lib/old.so", LIBRARY]}}}), 65,
            f'line 14|components.controller.libraries[1]|"{LIBRARY}"|Python {sys.version.split()[0]}|Python 3.8.1', folder=folder)


def test_a_key_at_any_component_serves_all():
    document = loop({"components": {"controller": {"libraries": None}, "sensor": {"libraries": [LIBRARY, LIBRARY]}}})
    found, wanted = replay_csv(write_config(document)), replay_csv(write_config(loop()))
    expect(all(found[name] == wanted[name] for name in COMPARED), "the results differ")


def test_two_modules_of_one_name():
    """Python would import the module of the first FMU for both."""
    first, second = (slave_that(f"self.y = {value}") for value in (1.0, 2.0))
    document = alone(first, {"components": {"other": {"fmu": str(second)}}, "compare": {"other.y": {"to": "plant.y"}}})
    refused(document, 65, f'line 17|components.other|{first}|{second}|Python module|"slave"|rename')


def test_messages_of_python_are_logged():
    """A missing module, an exception in a step, and a text with printf formats."""
    refuses = export("slave", source=SLAVE.replace("{body}", "pass").replace(
        "self.register", "if '/twinlock-fmu-' in self.resources: import nowhere_to_be_found\n        self.register", 1))
    refused(alone(refuses), 70, "line 10|components.slave|fmi2Instantiate", "error|FMU Slave|'nowhere_to_be_found'")
    fails = slave_that("raise ValueError('100%s %n off')")
    code, _, err = run(["replay", write_config(alone(fails))])
    expect(code == 70 and "ValueError" not in err, f"exit code {code}\n{err}")
    expect_line(err, 'error|slave|fmi2DoStep|fmi2Fatal|"logging": true')
    code, _, err = run(["replay", write_config(alone(fails, {"components": {"slave": {"logging": True}}}))])
    expect(code == 70 and "ValueError('100%s %n off')" in err, f"exit code {code}\n{err}")


# ---- the interpreter ----

def test_a_denied_call_is_the_cause_only_of_its_own_call():
    """Python asks for a socket on import of uuid, for example."""
    ask = "import socket\ntry: socket.socket()\nexcept OSError: pass\n"
    for top, body, named in (ask, "", False), ("import socket\n", "socket.socket()", True):
        fmu = export("slave", source=top + SLAVE.replace("{body}", f"{body}\n        return current_time < 0.1"))
        code, _, err = run(["replay", write_config(alone(fmu))])
        expect(code == 70, f"exit code {code}\n{err}")
        expect_line(err, "warning|socket denied")
        expect(has_line(err, "warning|denied|--unconfined") == named, err)


def test_extension_modules_work_until_the_end():
    """numpy is found by the first python3 in PATH. Its binaries resolve Python's symbols in the library, also at the end of the
    process."""
    fmu = slave_that("import numpy; self.y = float(numpy.array([0.25, current_time]).sum()); print('stepped')")
    path = os.environ["PATH"]
    os.environ["PATH"] = os.path.dirname(sys.executable) + ":" + path
    try:
        table = scratch() / "steps.csv"
        code, out, err = run(["replay", write_config(alone(fmu)), "--csv", table])
    finally:
        os.environ["PATH"] = path
    expect(code == 0, f"exit code {code}\n{err}")
    found = read_table(table)["slave.y"]
    expect(found == [0.25 + i / 100 for i in range(21)], f"numpy gave {found}")
    expect(err.count("stepped") == 21 and err.count("terminated") == 1 and "stepped" not in out, f"output of the FMU is lost or in the result\n{out}\n{err}")


# ---- what steps do only after the proof ----

def later(body, top="", **options):
    """A twin of one FMU that executes this code from its step 25 on."""
    return chain(lag(f"if self.k > 24: {body}", top, **options))


def test_libraries_of_the_program_that_a_later_step_uses():
    """hashlib and sqlite3 use libraries that the program has loaded too. Their data belong to the FMU."""
    expect_exact(later("import hashlib; self.x += hashlib.sha256(str(self.x).encode()).digest()[0] * 1e-6"), "memory")
    limit = "self.x += 1e-9 * c.execute('PRAGMA soft_heap_limit=' + str(90000 + self.k * int(100 * self.gain))).fetchone()[0]"
    expect_exact(later(limit, "import sqlite3\nc = sqlite3.connect(':memory:')"), "memory")


@with_packages
def test_a_package_that_a_later_step_imports():
    expect_exact(later("import numpy; self.x += 1e-6 * float(numpy.linalg.det(numpy.eye(9) * self.x))"), "memory")


COUNTER = """#include <stdlib.h>
static double *sum;
__attribute__((constructor)) static void begin(void) { sum = calloc(1, sizeof *sum); }
double add(double x) { return *sum += x; }
"""

ADD = """
import ctypes

def add(x):
    function = ctypes.CDLL({path}).add
    function.argtypes, function.restype = [ctypes.c_double], ctypes.c_double
    return function(x)
"""


def library(source):
    """The path of a library made of this text."""
    folder = scratch()
    (folder / "counter.c").write_text(source, encoding="utf-8")
    path = folder / "libcounter.so"
    subprocess.run([os.environ.get("CC", "cc"), "-shared", "-fPIC", "-O1", folder / "counter.c", "-o", path], check=True)
    return path


def test_a_library_of_the_configuration():
    """Its variables belong to the state of the FMU, also if it is used only later."""
    path = library("static double sum;\ndouble add(double x) { return sum += x; }\n")
    document = merge(later("self.x += 1e-4 * add(self.gain)", ADD.replace("{path}", "None")),
                     {"components": {"c0": {"libraries": [LIBRARY, str(path)]}}})
    expect_method(document, "memory")
    rows, again = replay_csv(write_config(document)), replay_csv(write_config(merge(document, {"synchronise": {"verify_every": 1}})))
    expect(rows == again, "the results depend on verifications, which execute steps too")


def test_a_late_library_whose_constructor_allocates():
    """That memory is not part of a copy."""
    need_memory()
    path = library(COUNTER)
    document = merge(later("self.x += 1e-4 * add(self.gain)", ADD.replace("{path}", repr(str(path)))),
                     {"components": {"c0": {"read": [str(path.parent)]}}})
    _, _, err = run(["replay", write_config(document)])
    expect_line(err, "warning|opens a library|constructors")


def test_states_of_a_script_at_rest():
    """The FMU is at rest until step 30, so that the proof cannot see what its own states lack. Copies are preferred."""
    path = scratch() / "rest.csv"
    table = read_table(recording())
    with open(path, "w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["time", "ref", "y"])
        writer.writerows([time, 0.0 if i < 30 else 0.2, y] for i, (time, y) in enumerate(zip(table["time"], table["y"])))
    document = chain(lag("self.x += 1e-3 * self.k if self.u else 0.0", states=True))
    expect_exact(merge(document, {"recording": {"file": str(path)}}), "memory")


def test_a_file_that_stays_open():
    """The position in the file is not part of a copy. The twin ends before a wrong result; by replay it is right."""
    body = "self.x += 1e-6 * len(self.lines.readline()) if self.k > 25 else setattr(self, 'lines', open(os.__file__)) or 0"
    document = later(body, "import os")
    rows = replay_csv(write_config(merge(document, {"components": {"c0": {"rollback": "replay"}}})))
    expect(len(rows["step"]) > 55, f"{len(rows['step'])} steps")
    need_memory()
    code, _, err = run(["replay", write_config(document)])
    expect(code == 70, f"exit code {code}\n{err}")
    expect_line(err, "error|open file|os.py")


def test_a_file_that_is_written():
    need_memory()
    _, _, err = run(["replay", write_config(later("open(os.path.join(os.environ['HOME'], 'log'), 'a').write('x')", "import os"))])
    expect_line(err, "warning|writes|files|rollback")


def test_an_exception_in_a_trial():
    """PythonFMU returns fmi2Fatal. The script's memory is restored, so only the trial is refused."""
    need_memory()
    document = chain(lag("self.x += 0.0 if self.gain < 2 else 1 / 0"))
    rows = replay_csv(write_config(document))
    expect(rows == replay_csv(write_config(document), "--plain"), "with and without saving, the results differ")
    expect(len(rows["step"]) > 55 and max(rows["c0.gain"]) < 2, rows["c0.gain"])
    expect(replay_json(write_config(document))["refused_trials"] > 0, "no trial was refused")


try:
    main()
except SystemExit as end:
    # FMPy loaded FMUs of PythonFMU into this process. At its end they would end a second time, in freed memory.
    sys.stdout.flush()
    os._exit(end.code or 0)
