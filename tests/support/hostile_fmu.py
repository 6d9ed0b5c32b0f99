"""FMUs that do to their importer what no FMU should: made here from tests/fmu/hostile, with the machine's compiler. To import this
ends a test that cannot run here.

Such an FMU is fmus/lag (input u, output y, tunable T) whose functions first do what a file of that folder says.
"""
import functools
import os
import subprocess
import sys

from twinlock_test import EMULATED, SKIPPED, SOURCE, expect, merge, scratch, write_config

if EMULATED:
    print("skipped: FMUs are compiled here for this machine, and the program is for another one")
    sys.exit(SKIPPED)

FOLDER = SOURCE / "tests" / "fmu" / "hostile"
COMMON = SOURCE / "fmus" / "common"
OWN_STATE = [COMMON / f"{name}.c" for name in ("instance", "life", "values", "state")]
GOOD = [*OWN_STATE, SOURCE / "fmus" / "lag" / "model.c"]
DESCRIPTION = SOURCE / "fmus" / "lag" / "modelDescription.xml"
PLATFORMS = {"x86_64": "linux64", "aarch64": "aarch64-linux", "armv7l": "aarch32-linux"}


def compile_with(*command):
    """Runs a command that makes something; its failure is the test's."""
    done = subprocess.run([str(word) for word in command], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
    expect(done.returncode == 0, f"{' '.join(map(str, command))}\n{done.stdout}")


def machine():
    """What the processor is called, as PLATFORMS knows it."""
    return os.uname().machine


FLAGS = ("-std=gnu99", "-D_GNU_SOURCE", "-O1", "-g0", "-fPIC", "-fvisibility=hidden", "-I", SOURCE, "-isystem", SOURCE / ".deps" / "fmi2")
COMPILER = os.environ.get("CC", "cc")


def describe(header, description=DESCRIPTION):
    """What the sources of fmus/common want to know of the variables."""
    compile_with(sys.executable, COMMON / "description.py", description, header)


@functools.cache
def _good():
    """The objects of the good FMU."""
    folder = scratch()
    describe(folder / "description.h")
    made = [folder / f"{source.stem}.o" for source in GOOD]
    for source, binary in zip(GOOD, made):
        compile_with(COMPILER, *FLAGS, "-include", FOLDER / "inner.h", "-I", folder, "-c", source, "-o", binary)
    return made


@functools.cache
def make(name, **macros):
    """The path of an FMU with the behaviour `name`: tests/fmu/hostile/NAME.c, or all sources of the folder NAME. A macro's text is a C text where its value is a str that
    is no statement (which ends with ";"), its value else; True: only defined."""
    folder = scratch()
    binary = folder / "lag.so"
    sources = sorted((FOLDER / name).glob("*.c")) or [FOLDER / f"{name}.c"]
    compile_shared(binary, [*sources, FOLDER / "frame.c", *_good()], macros)
    fmu = folder / f"{name}.fmu"
    package(fmu, DESCRIPTION, binary)
    return fmu


def compile_shared(binary, sources, macros, *folders):
    """A library of these sources and objects; macros as those of make(); folders with headers."""
    defined = [f"-D{macro}={_text(value)}" for macro, value in macros.items()]
    compile_with(COMPILER, *FLAGS, *defined, *(word for folder in folders for word in ("-I", folder)), "-shared", "-pthread", "-o", binary, *sources, "-lm")


def package(fmu, description, binary):
    compile_with(sys.executable, COMMON / "package.py", fmu, f"modelDescription.xml={description}",
         f"binaries/{PLATFORMS[machine()]}/lag.so={binary}")


def _text(value):
    if value is True:
        return ""
    return f'"{value}"' if isinstance(value, str) and not value.endswith(";") else value


@functools.cache
def recording(steps=100):
    """Of a plant whose y stands still, in steps of 10 ms."""
    path = scratch() / "recording.csv"
    path.write_text("time,u,y\n" + "".join(f"{i / 100},1,0.5\n" for i in range(steps + 1)), encoding="utf-8")
    return path


def config(fmu, changes=None):
    """A configuration whose only component, "hostile", is that FMU: for every verb."""
    return write_config(merge({
        "twinlock": 1, "name": "hostile", "step_s": 0.01, "components": {"hostile": {"fmu": str(fmu)}},
        "sources": {"rows": {"csv": {"file": str(recording())}}},
        "plant": {name: {"csv": {"source": "rows"}} for name in ("u", "y")},
        "recording": {"file": str(recording())}, "connect": [["plant.u", "hostile.u"]],
        "compare": {"hostile.y": {"to": "plant.y"}}, "emulate": {"columns": {"y": {"from": "hostile.y"}}},
    }, changes or {}))


# What makes twinlock correct it, and so save and restore its states.
LOCKED = {"compare": None, "synchronise": {"adjust": {"hostile.T": {"step": 0.01}},
                                           "match": {"hostile.y": {"to": "plant.y", "tolerance": 0.01}}}}
