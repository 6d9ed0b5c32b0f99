"""FMUs that PythonFMU makes for tests. Importing this module skips a test that cannot run here."""
import functools
import os
import platform
import subprocess
import sys

from twinlock_test import EMULATED, SOURCE, expect, scratch, SANITIZER, SKIPPED

# FMUs of PythonFMU run in the library of the tests' own Python, which is Debian's.
LIBRARY = f"libpython{sys.version_info.major}.{sys.version_info.minor}.so.1.0"

if platform.machine() != "x86_64" or EMULATED:
    print(f"skipped: PythonFMU has binaries for x86-64 only, and this is {'another one' if EMULATED else platform.machine()}")
    sys.exit(SKIPPED)
if SANITIZER == "thread":
    print("skipped: ThreadSanitizer does not see how Python's own threads wait for each other")
    sys.exit(SKIPPED)


@functools.cache
def export(name, *options, source=None):
    """The path of an FMU that PythonFMU makes of tests/fmu/python/NAME.py, or of the text `source`."""
    folder = scratch()
    script = SOURCE / "tests" / "fmu" / "python" / f"{name}.py"
    if source is not None:
        script = folder / f"{name}.py"
        script.write_text(source, encoding="utf-8")
    done = subprocess.run([sys.executable, "-m", "pythonfmu", "build", "-f", script, "-d", folder, *options],
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=folder, check=False,
                          env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"})
    made = list(folder.glob("*.fmu"))
    expect(done.returncode == 0 and len(made) == 1, f"PythonFMU cannot export {script}\n{done.stdout}")
    return made[0]
