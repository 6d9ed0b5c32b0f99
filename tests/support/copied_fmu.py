"""FMUs with their state in a global variable, compiled from tests/fmu/copies. Importing this module skips a test that cannot run here.

Each has the description of fmus/lag (input u, output y, tunable T), and its results if no other component shares the global.
"""
import functools
import sys

from hostile_fmu import COMMON, COMPILER, DESCRIPTION, FLAGS, GOOD, PLATFORMS, SOURCE, compile_with, machine
from twinlock_test import scratch, write_config

FOLDER = SOURCE / "tests" / "fmu" / "copies"


@functools.cache
def library(soname, *sources, name=None, needs=(), flags=()):
    """The path of a shared library of sources of the folder. `needs`: libraries that it is linked with, in its own folder."""
    binary = scratch() / (name or soname)
    named = [f"-Wl,-soname,{soname}"] if soname else []
    compile_with(COMPILER, *FLAGS, *flags, "-shared", "-o", binary, *named, "-Wl,-rpath,$ORIGIN", *sources,
                 *(word for need in needs for word in (f"-L{need.parent}", f"-l:{need.name}")), "-lm")
    return binary


@functools.cache
def make(name="lag", sources=("integral.c",), companions=(), others=(), needed=(), flags=(), once=False):
    """The path of an FMU. Its binary has `sources` and needs `companions`. `others` are packed, too. `needed` are needed but not
    packed. `once`: the description permits one instance per process."""
    folder = scratch()
    said = "<CoSimulation " + ('canBeInstantiatedOnlyOncePerProcess="true" ' if once else "")
    description = folder / "modelDescription.xml"
    description.write_text(DESCRIPTION.read_text(encoding="utf-8").replace("<CoSimulation ", said), encoding="utf-8")
    compile_with(sys.executable, COMMON / "description.py", DESCRIPTION, folder / "description.h")
    common = [source for source in GOOD if source.parent == COMMON]
    binary = library(None, FOLDER / "model.c", *common, *(FOLDER / source for source in sources), name="lag.so", needs=(*companions, *needed),
                     flags=("-I", folder, *flags))
    fmu = folder / f"{name}.fmu"
    platform = f"binaries/{PLATFORMS[machine()]}"
    compile_with(sys.executable, COMMON / "package.py", fmu, f"modelDescription.xml={description}",
                 *(f"{platform}/{file.name}={file}" for file in (binary, *companions, *others)))
    return fmu


STEPS = 100


def config(fmus):
    """A configuration with a component a0, a1, … for each FMU; their inputs are 1, 2, 3, …"""
    recording = scratch() / "recording.csv"
    names = [f"a{i}" for i in range(len(fmus))]
    rows = [",".join(["time", *(f"u{i}" for i in range(len(fmus)))])]
    rows += [",".join([str(k / 100), *(str(1 + i) for i in range(len(fmus)))]) for k in range(STEPS + 1)]
    recording.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return write_config({
        "twinlock": 1, "name": "copies", "step_s": 0.01,
        "components": {name: {"fmu": str(fmu)} for name, fmu in zip(names, fmus)},
        "sources": {"rows": {"csv": {"file": str(recording)}}},
        "plant": {f"u{i}": {"csv": {"source": "rows"}} for i in range(len(fmus))},
        "recording": {"file": str(recording)},
        "connect": [[f"plant.u{i}", f"{name}.u"] for i, name in enumerate(names)],
        "compare": {f"{name}.y": {"to": f"plant.u{i}"} for i, name in enumerate(names)},
    })
