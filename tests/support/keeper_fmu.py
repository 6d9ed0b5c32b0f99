"""FMUs with state in all kinds of memory, compiled from tests/fmu/keeper.

Importing this module skips a test that cannot run here."""
import functools
import zipfile

import hostile_fmu
from twinlock_test import FMUS, SOURCE, expect, scratch, write_config

KEEPER = SOURCE / "tests" / "fmu" / "keeper"
STEPS = 100
PAGES = 300  # that an FMU changes in each step, so that a copy takes long


@functools.cache
def make(**macros):
    """The path of one. `macros`: further resources, and from which step on, see keeper.c. With OWN_STATE it has an incomplete state."""
    folder = scratch()
    binary = folder / "lag.so"
    hostile_fmu.compile_shared(binary, [KEEPER / "keeper.c"], macros)
    description = hostile_fmu.DESCRIPTION.read_text(encoding="utf-8")
    description = description.replace(' canSerializeFMUstate="true"', "")
    if "OWN_STATE" not in macros:
        description = description.replace(' canGetAndSetFMUstate="true"', "")
    (folder / "modelDescription.xml").write_text(description, encoding="utf-8")
    fmu = folder / "keeper.fmu"
    hostile_fmu.package(fmu, folder / "modelDescription.xml", binary)
    return fmu


@functools.cache
def make_late(step):
    """The path of one whose states are right in its first `step` inner steps: see late.c. They are far faster than copies of its
    memory."""
    return _make_model("late", LATE=step, TOUCHES=PAGES)


@functools.cache
def make_mode(limit, pages=0):
    """The path of one whose states lack a mode, which an input above `limit` enters: see mode.c."""
    return _make_model("mode", LIMIT=limit, TOUCHES=pages)


@functools.cache
def make_masked(limit, pages=0):
    """The path of one whose output, limited to `limit`, hides that its states are wrong: see masked.c."""
    folder = scratch()
    text = hostile_fmu.DESCRIPTION.read_text(encoding="utf-8")
    internal = '<ScalarVariable name="x" valueReference="5" causality="local" variability="continuous"><Real/></ScalarVariable>'
    (folder / "modelDescription.xml").write_text(text.replace("</ModelVariables>", internal + "</ModelVariables>"), encoding="utf-8")
    return _make_model("masked", folder / "modelDescription.xml", LIMIT=limit, TOUCHES=pages)


@functools.cache
def make_later(name, step):
    """The path of one that is exact until this step; `name` is "late", "cold", "clock" or "ring", see these sources.
    Its states are far faster than copies of its memory."""
    return _make_model(name, LATE=step, TOUCHES=PAGES)


@functools.cache
def make_false(lie, **macros):
    """The path of one whose states are wrong, see tests/fmu/hostile/states.c for `lie`."""
    folder = scratch()
    hostile_fmu.describe(folder / "description.h")
    ours = []
    for source in hostile_fmu.OWN_STATE:
        ours.append(folder / f"{source.stem}.o")
        hostile_fmu.compile_with(hostile_fmu.COMPILER, *hostile_fmu.FLAGS, "-I", folder, "-include", hostile_fmu.FOLDER / "other_state.h", "-c", source, "-o", ours[-1])
    hostile_fmu.compile_shared(folder / "lag.so", [hostile_fmu.FOLDER / "states.c", *ours], {"LIE": lie, **macros}, folder)
    fmu = folder / f"{lie}.fmu"
    hostile_fmu.package(fmu, hostile_fmu.DESCRIPTION, folder / "lag.so")
    return fmu


@functools.cache
def make_runaway(**macros):
    """The path of one whose output grows without limit: see runaway.c."""
    return _make_model("runaway", **macros)


@functools.cache
def make_limits(**macros):
    """The path of one with limits of its input and instants without an output: see limits.c."""
    return _make_model("limits", **macros)


@functools.cache
def make_by_name(searched=".", *macros):
    """The path of one that opens its library by name in the first step: see by_name.c. The library lies in the folder `searched`,
    relative to the FMU's binary, and is found by the binary's search path. `macros`: of by_name.c, as for a compiler."""
    folder = scratch()
    hostile_fmu.describe(folder / "description.h")
    hostile_fmu.compile_shared(folder / "libcount.so", [KEEPER / "count.c"], {})
    hostile_fmu.compile_with(hostile_fmu.COMPILER, *hostile_fmu.FLAGS, *macros, "-I", folder, "-shared", f"-Wl,-rpath,$ORIGIN/{searched}",
                             "-o", folder / "lag.so", KEEPER / "by_name.c", *hostile_fmu.OWN_STATE, "-lm")
    hostile_fmu.package(folder / "by_name.fmu", hostile_fmu.DESCRIPTION, folder / "lag.so", (searched, folder / "libcount.so"))
    return folder / "by_name.fmu"


@functools.cache
def make_cpp_locale():
    """The path of one that sets the global locale of C++: see cpp_locale.c. It needs no compiler for C++."""
    folder = scratch()
    hostile_fmu.describe(folder / "description.h")
    hostile_fmu.compile_with(hostile_fmu.COMPILER, *hostile_fmu.FLAGS, "-I", folder, "-shared", "-o", folder / "lag.so",
                             KEEPER / "cpp_locale.c", *hostile_fmu.OWN_STATE, "-lm", "-l:libstdc++.so.6")
    hostile_fmu.package(folder / "cpp_locale.fmu", hostile_fmu.DESCRIPTION, folder / "lag.so")
    return folder / "cpp_locale.fmu"


@functools.cache
def make_needed():
    """The path of one like make_by_name(), and its library. The library is no part of the FMU, and has to be opened before it."""
    folder = scratch()
    hostile_fmu.describe(folder / "description.h")
    hostile_fmu.compile_shared(folder / "libcount.so", [KEEPER / "count.c"], {})
    hostile_fmu.compile_shared(folder / "lag.so", [KEEPER / "by_name.c", *hostile_fmu.OWN_STATE], {"NEEDED": 1}, folder)
    hostile_fmu.package(folder / "needed.fmu", hostile_fmu.DESCRIPTION, folder / "lag.so")
    return folder / "needed.fmu", folder / "libcount.so"


@functools.cache
def make_met(**macros):
    """The path of one whose instances have different results: see met.c."""
    return _make_model("met", **macros)


@functools.cache
def make_address():
    """The path of one whose results depend on addresses: see address.c."""
    return _make_model("address")


@functools.cache
def make_slow(**macros):
    """The path of one whose states are exact but slow: see slow.c."""
    return _make_model("slow", **macros)


def slow_states(name, fmu, pause=500000):
    """Writes `fmu`, the built FMU `name` whose restore takes `pause` ns: see slow_states.c."""
    folder, model = scratch(), SOURCE / "fmus" / name
    hostile_fmu.describe(folder / "description.h", model / "modelDescription.xml")
    *others, state = [model / "model.c", *hostile_fmu.OWN_STATE]
    _rename(folder, state, "other_set_state.h")
    hostile_fmu.compile_shared(folder / "slow.so", [KEEPER / "slow_states.c", *others, folder / "state.o"], {"PAUSE": pause}, folder)
    binary = f"binaries/{hostile_fmu.PLATFORMS[hostile_fmu.machine()]}/{name}.so"
    with zipfile.ZipFile(FMUS / f"{name}.fmu") as source, zipfile.ZipFile(fmu, "w") as changed:
        expect(binary in source.namelist(), f"{source.namelist()}")
        for entry in source.infolist():
            changed.writestr(entry, (folder / "slow.so").read_bytes() if entry.filename == binary else source.read(entry))


@functools.cache
def make_final():
    """The path of one whose result depends on whether a step is final: see final.c."""
    return _make_model("final")


def _rename(folder, source, header):
    """The object of a source of our FMUs, in which `header` renames a function."""
    made = folder / f"{source.stem}.o"
    hostile_fmu.compile_with(hostile_fmu.COMPILER, *hostile_fmu.FLAGS, "-I", folder, "-include", KEEPER / header, "-c", source, "-o", made)
    return made


# The sources of fmus/common, and the headers that rename the functions that these FMUs replace.
OWN_FUNCTIONS = {"cold": {"state": "other_set_state.h"}, "masked": {"state": "other_set_state.h"}, "slow": {"state": "other_set_state.h"}, "final": {"life": "other_do_step.h"},
                 "limits": {"life": "other_do_step.h", "values": "other_get_real.h"}}


def _make_model(name, description=hostile_fmu.DESCRIPTION, **macros):
    """The FMU of tests/fmu/keeper/NAME.c and the functions of fmus/common."""
    folder = scratch()
    hostile_fmu.describe(folder / "description.h", description)
    headers = OWN_FUNCTIONS.get(name, {})
    ours = [_rename(folder, source, headers[source.stem]) if source.stem in headers else source for source in hostile_fmu.OWN_STATE]
    sources = [KEEPER / f"{name}.c", *ours]
    hostile_fmu.compile_shared(folder / "lag.so", sources, macros, folder)
    hostile_fmu.package(folder / f"{name}.fmu", description, folder / "lag.so")
    return folder / f"{name}.fmu"


@functools.cache
def recording():
    """A recording whose y swings, in steps of 10 ms."""
    path = scratch() / "recording.csv"
    path.write_text("time,y\n" + "".join(f"{i / 100},{0.5 + 0.3 * (i % 20) / 20}\n" for i in range(STEPS + 1)), encoding="utf-8")
    return path


def config(fmu, way=None, components=1, evaluations=60):
    """A configuration with `components` of that FMU; the input of each is adjusted until its output matches the plant's. These
    FMUs count their calls or notice a restore, so there are no released twins."""
    names = [f"keeper{i}" for i in range(components)]
    rollback = {} if way is None else {"rollback": way}
    return write_config({
        "twinlock": 1, "name": "keeper", "step_s": 0.01,
        "components": {name: {"fmu": str(fmu), **rollback} for name in names},
        "plant": {"y": {"csv": {"column": "y"}}},
        "recording": {"file": str(recording())},
        "synchronise": {"horizon": {"prediction": 3}, "algorithm": "nelder-mead", "release_s": 0, "budget": {"evaluations": evaluations},
                        "adjust": {f"{name}.u": {"step": 0.1, "nominal": 1, "min": -20, "max": 20} for name in names},
                        "match": {f"{name}.y": {"to": "plant.y", "tolerance": 0.01} for name in names}},
    })
