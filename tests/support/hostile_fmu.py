"""FMUs that harm their importer, compiled from tests/fmu/hostile. Importing this module skips a test that cannot run here.

Such an FMU is fmus/lag (input u, output y, tunable T) whose functions first run the code of a file in that folder.
"""
import functools
import os
import subprocess
import sys

from twinlock_test import EMULATED, SKIPPED, SOURCE, expect, merge, scratch, write_config

if EMULATED:
    print("skipped: the program is for another machine than the compiled FMUs")
    sys.exit(SKIPPED)

FOLDER = SOURCE / "tests" / "fmu" / "hostile"
COMMON = SOURCE / "fmus" / "common"
OWN_STATE = [COMMON / f"{name}.c" for name in ("instance", "life", "values", "state")]
GOOD = [*OWN_STATE, SOURCE / "fmus" / "lag" / "model.c"]
DESCRIPTION = SOURCE / "fmus" / "lag" / "modelDescription.xml"
PLATFORMS = {"x86_64": "linux64", "aarch64": "aarch64-linux", "armv7l": "aarch32-linux"}


def compile_with(*command):
    """Runs a command; the test fails if it does."""
    done = subprocess.run([str(word) for word in command], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
    expect(done.returncode == 0, f"{' '.join(map(str, command))}\n{done.stdout}")


def machine():
    """The name of the processor, a key of PLATFORMS."""
    return os.uname().machine


FLAGS = ("-std=gnu99", "-D_GNU_SOURCE", "-O1", "-g0", "-fPIC", "-fvisibility=hidden", "-I", SOURCE, "-isystem", SOURCE / ".deps" / "fmi2")
COMPILER = os.environ.get("CC", "cc")


def describe(header, description=DESCRIPTION):
    """Writes the header about variables for the sources of fmus/common."""
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
    """The path of an FMU with the behaviour `name`: tests/fmu/hostile/NAME.c, or all sources of the folder NAME.

    A str as macro becomes a C string, or C code if it ends with ";". True defines the macro without a value."""
    folder = scratch()
    binary = folder / "lag.so"
    sources = sorted((FOLDER / name).glob("*.c")) or [FOLDER / f"{name}.c"]
    compile_shared(binary, [*sources, FOLDER / "frame.c", *_good()], macros)
    fmu = folder / f"{name}.fmu"
    package(fmu, DESCRIPTION, binary)
    return fmu


def compile_shared(binary, sources, macros, *folders):
    """Links a library of sources and objects; macros as for make(); `folders` have headers."""
    defined = [f"-D{macro}={_text(value)}" for macro, value in macros.items()]
    compile_with(COMPILER, *FLAGS, *defined, *(word for folder in folders for word in ("-I", folder)), "-shared", "-pthread", "-o", binary, *sources, "-lm")


def package(fmu, description, binary, *companions):
    """`companions`: pairs of a folder, relative to the binary, and a file."""
    platform = f"binaries/{PLATFORMS[machine()]}"
    compile_with(sys.executable, COMMON / "package.py", fmu, f"modelDescription.xml={description}", f"{platform}/lag.so={binary}",
                 *(f"{os.path.normpath(f'{platform}/{folder}/{file.name}')}={file}" for folder, file in companions))


def _text(value):
    if value is True:
        return ""
    return f'"{value}"' if isinstance(value, str) and not value.endswith(";") else value


@functools.cache
def recording(steps=100):
    """A recording with constant u and y, in steps of 10 ms."""
    path = scratch() / "recording.csv"
    path.write_text("time,u,y\n" + "".join(f"{i / 100},1,0.5\n" for i in range(steps + 1)), encoding="utf-8")
    return path


def config(fmu, changes=None):
    """A configuration for each verb; its only component "hostile" is that FMU."""
    return write_config(merge({
        "twinlock": 1, "name": "hostile", "step_s": 0.01, "components": {"hostile": {"fmu": str(fmu)}},
        "sources": {"rows": {"csv": {"file": str(recording())}}},
        "plant": {name: {"csv": {"source": "rows"}} for name in ("u", "y")},
        "recording": {"file": str(recording())}, "connect": [["plant.u", "hostile.u"]],
        "compare": {"hostile.y": {"to": "plant.y"}}, "emulate": {"columns": {"y": {"from": "hostile.y"}}},
    }, changes or {}))


# Changes of config() with which twinlock synchronises the FMU, so that it saves and restores states.
LOCKED = {"compare": None, "synchronise": {"adjust": {"hostile.T": {"step": 0.01}},
                                           "match": {"hostile.y": {"to": "plant.y", "tolerance": 0.01}}}}
