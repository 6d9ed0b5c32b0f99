"""An FMU with a state of a given size, compiled from tests/fmu/sized. Importing this module skips a test that cannot run here."""
import functools

import hostile_fmu
from twinlock_test import SOURCE, scratch

SIZED = SOURCE / "tests" / "fmu" / "sized" / "sized.c"


@functools.cache
def make(size, pages=2):
    """The path of one with `size` bytes of state; a step writes to `pages` pages. Its state cannot be serialised."""
    folder = scratch()
    binary, description, fmu = folder / "lag.so", folder / "modelDescription.xml", folder / f"sized{size}.fmu"
    hostile_fmu.compile_shared(binary, [SIZED], {"SIZE": size, "PAGES": pages})
    description.write_text(hostile_fmu.DESCRIPTION.read_text(encoding="utf-8").replace(' canSerializeFMUstate="true"', ""), encoding="utf-8")
    hostile_fmu.package(fmu, description, binary)
    return fmu
