"""An FMU that gives its process a locale with a decimal comma, and that locale."""
import os
import subprocess
from contextlib import contextmanager

from twinlock_test import BUILD, scratch

STEP_S = 0.01


def comma_config(**more):
    """A configuration with the FMU (tests/replay/comma) and a plant of one signal, u."""
    return {"twinlock": 1, "name": "comma", "step_s": STEP_S, "plant": {"u": {}}, "connect": [["plant.u", "comma.u"]],
            "components": {"comma": {"fmu": str(BUILD / "tests" / "replay" / "comma.fmu")}},
            "compare": {"comma.y": {"to": "plant.u"}, "comma.commas": {"to": "plant.u"}}, **more}


def write_rows(path, count):
    """A recording of u whose every value has a fraction; the values."""
    values = [1.5 + i / 7 for i in range(count)]
    rows = [f"{i * STEP_S:.2f},{value!r}" for i, value in enumerate(values)]
    path.write_text("\n".join(["time,u", *rows]) + "\n", encoding="utf-8")
    return values


@contextmanager
def comma_locale():
    """What is started within finds de_DE.UTF-8, out of Debian's package `locales`: a machine need not have it."""
    folder = scratch()
    subprocess.run(["localedef", "-i", "de_DE", "-f", "UTF-8", folder / "de_DE.UTF-8"], check=True)
    # The C library's newlocale() forgets some bytes for each LOCPATH that it reads.
    more = {"LOCPATH": str(folder), "ASAN_OPTIONS": os.environ.get("ASAN_OPTIONS", "") + ":detect_leaks=0"}
    before = dict(os.environ)
    os.environ.update(more)
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)
