"""What the tests from outside share: running the program, folders for a test, changed configurations, a
reporter.

A test file is a list of functions `test_…`; it ends with `twinlock_test.main()`, which runs them in their
order, prints one line for each, and ends with 0, with 1 where one failed, and with 77 where all were
skipped. A test fails by any exception; `expect` and `within` raise one that says what was found. Only what
CTest sets is needed (tests/CMakeLists.txt): TWINLOCK the program, TL_BUILD whose folder `fmus` has the FMUs,
TL_SOURCE the repository.
"""
import atexit
import csv
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import traceback
from pathlib import Path

SOURCE = Path(os.environ["TL_SOURCE"])
BUILD = Path(os.environ["TL_BUILD"])
FMUS = BUILD / "fmus"
PROGRAM = os.environ["TWINLOCK"]
EMULATED = os.environ.get("TL_EMULATED")  # folder of programs that start the build's in an emulator, or None
HUNG_S = 300  # for what ends by itself in seconds: whatever a busy machine makes of them, it does not hang before
PATIENCE = int(os.environ.get("TL_PATIENCE", "1"))  # times as long for everything that ends by itself
SANITIZER = os.environ.get("TL_SANITIZER", "")
BAD_USAGE = 2
NOT_LOCKED = 3
IN_LOCK = ("locked", "corrected")  # states of the lock
BAD_DATA = 65
PLANT_DOWN = 69
FORBIDDEN = 77  # of reload: firmware/retune/control.h
EXIT_CODES = (0, 2, NOT_LOCKED, 65, 69, 70, 75, FORBIDDEN)  # firmware/cli/options.c
SKIPPED = 77


class Failure(AssertionError):
    """What a test found wrong."""


class Skip(SystemExit):
    """The test cannot run here. Not caught by main(), it ends the program with 77."""

    def __init__(self, why):
        super().__init__(SKIPPED)
        self.why = why


def expect(condition, text):
    if not condition:
        raise Failure(text)


def has_line(text, parts):
    """True if one line of `text` has all parts, which "|" separates: "plant.level|18.55|0|5". A part matches whole words and
    numbers only. Tests hold objects and values, and at most three words in a row, so that the wording can be improved."""
    patterns = [re.compile((r"(?<!\w)(?<!\w\.)" if re.match(r"\w", part) else "") + re.escape(part)
                           + (r"(?!\w)(?!\.\w)" if re.search(r"\w$", part) else "")) for part in parts.split("|")]
    return any(all(pattern.search(line) for pattern in patterns) for line in text.splitlines())


def expect_line(text, parts):
    expect(has_line(text, parts), f"no line with {parts}:\n{text}")


def expect_no_line(text, parts):
    expect(not has_line(text, parts), f"a line with {parts}:\n{text}")


def within(value, wanted, relative, what):
    """Prints the figure, and fails where it is further than `relative` from `wanted`."""
    print(f"    {what}: {value:.6g} (wanted {wanted:g} \u00b1 {100 * relative:g} %)")
    expect(abs(value - wanted) <= relative * abs(wanted), f"{what}: found {value!r}, wanted {wanted:g}")


def at_most(value, limit, what):
    print(f"    {what}: {value:.6g} (at most {limit:g})")
    expect(value <= limit, f"{what}: found {value!r}, wanted at most {limit:g}")


def at_least(value, limit, what):
    print(f"    {what}: {value:.6g} (at least {limit:g})")
    expect(value >= limit, f"{what}: found {value!r}, wanted at least {limit:g}")


# ---- folders ----

_root = None


def scratch():
    """A new empty folder; gone when the test ends."""
    global _root
    if _root is None:
        _root = Path(tempfile.mkdtemp(prefix="twinlock-test-"))
        atexit.register(shutil.rmtree, _root, ignore_errors=True)
    return Path(tempfile.mkdtemp(dir=_root))


# ---- the program ----

def program(name):
    """The path of one of the tests' programs, to be started."""
    return str(Path(EMULATED or BUILD / "tests") / name)


def environment(temporary):
    """What the program runs with: our FMUs, and a folder of its own for temporary files."""
    return {**os.environ, "TWINLOCK_FMU_PATH": str(FMUS), "TMPDIR": str(temporary)}


def start(args, **options):
    """Starts the program with `args`; its output comes as text in pipes. For tests that watch it run."""
    temporary = scratch()
    pipes = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE,
             "encoding": "utf-8", "errors": "backslashreplace"}
    process = subprocess.Popen([PROGRAM, *map(str, args)], env=environment(temporary), **{**pipes, **options})
    process.temporary = temporary
    return process


def finish(process, timeout=HUNG_S):
    """(exit code, stdout, stderr) of a started program at its end, which must be an orderly one."""
    try:
        out, err = process.communicate(timeout=timeout * PATIENCE)
    except subprocess.TimeoutExpired:
        process.kill()
        out, err = process.communicate()
        said = f"{describe(process)} has not ended after {timeout * PATIENCE} s\n{out or ''}{err or ''}"
        raise Failure(said) from None
    said = f"{describe(process)} ended with {process.returncode}\n{err or ''}"
    expect(process.returncode in EXIT_CODES, said)
    expect("Sanitizer" not in (err or "") and "runtime error:" not in (err or ""), said)
    left = sorted(path.name for path in process.temporary.iterdir())
    expect(not left, f"{describe(process)} has left in TMPDIR: {', '.join(left)}")
    return process.returncode, out, without_confinement(err)


# The notice of missing confinement features (tl_confine_describe() of firmware/process/confine.c).
NOT_CONFINED = re.compile(r"^twinlock: notice: (?=.*\bFMUs?\b)(?=.*\b(?:Landlock|seccomp|limit)\b).*\n", re.M)


def without_confinement(err):
    """The log without that notice under an emulator or a sanitizer, for tests that count lines."""
    return NOT_CONFINED.sub("", err) if err and (EMULATED or SANITIZER) else err


def describe(process):
    return "twinlock " + " ".join(process.args[1:])


def run(args, timeout=HUNG_S, **options):
    """(exit code, stdout, stderr) of the program. A crash, an unknown exit code, a report of a sanitizer, or
    anything left among the temporary files is a failure."""
    return finish(start(args, **options), timeout)


def run_well(args, timeout=HUNG_S, wells=(0,)):
    """Standard output of the program, which must succeed."""
    code, out, err = run(args, timeout)
    expect(code in wells, f"twinlock {' '.join(map(str, args))} ended with {code}\n{err}")
    return out


def replay_json(config, *options, timeout=HUNG_S):
    """What `replay --json` tells; `config` as for config_path(). A twin may be one that never is in lock: its figures tell."""
    return json.loads(run_well(["replay", config_path(config), "--json", *options], timeout, (0, NOT_LOCKED)))


def replay_csv(config, *options, timeout=HUNG_S):
    """What `replay --csv` writes, as read_table() gives it; the same of the twin."""
    path = scratch() / "steps.csv"
    run_well(["replay", config_path(config), "--csv", path, *options], timeout, (0, NOT_LOCKED))
    return read_table(path)


VALUE = re.compile(r" (simulated|measured|applied)$")


def _value(text):
    try:
        return float(text or "nan")
    except ValueError:
        return text


def read_table(path):
    """{column: [value]} of a CSV file: numbers where they are, NaN for an empty field, else texts. The columns
    "X simulated", "X measured" and "X applied" are X."""
    with open(path, encoding="utf-8", newline="") as file:
        names, *rows = csv.reader(file)
    return {VALUE.sub("", name): [_value(row[i]) for row in rows] for i, name in enumerate(names)}


# ---- configurations ----

def merge(value, change):
    """JSON merge patch (RFC 7396): objects are merged, None deletes a key, anything else replaces."""
    if not isinstance(change, dict):
        return change
    merged = dict(value) if isinstance(value, dict) else {}
    for key, inner in change.items():
        if inner is None:
            merged.pop(key, None)
        else:
            merged[key] = merge(merged.get(key), inner)
    return merged


def config_path(path):
    """A path as it is where it is absolute, else that of a file in config/."""
    return Path(path) if os.path.isabs(path) else SOURCE / "config" / path


# The motor bench, locked by the last message: what config/motor/lock.json is, without what makes its steps wait.
PLAIN_LOCK = str(SOURCE / "tests" / "support" / "motor_lock.json")
# And live by Modbus TCP, each poll a reading: what config/motor/live.json is without that.
PLAIN_LIVE = str(SOURCE / "tests" / "support" / "motor_live.json")
# By CAN, and by all at once.
PLAIN_CAN = str(SOURCE / "tests" / "support" / "motor_can.json")
PLAIN_BOX = str(SOURCE / "tests" / "support" / "motor_box.json")


def read_config(path):
    with open(config_path(path), encoding="utf-8") as file:
        return json.load(file)


def keep_states(document):
    """A copy that keeps all states, where it does not say what is kept."""
    named = document.get("components") if isinstance(document, dict) else None
    known = {name: {**one, "keep": one.get("keep", "states")} for name, one in named.items() if isinstance(one, dict)} if isinstance(named, dict) else {}
    return {**document, "components": {**named, **known}} if known else document


def write_config(document, folder=None):
    """The path of a new configuration; `document` is an object, or a text or bytes as they are. An object keeps all states if
    it does not say otherwise, so that the number of executions is always the same."""
    path = (folder or scratch()) / "config.json"
    if not isinstance(document, (str, bytes)):
        document = json.dumps(keep_states(document), indent=1, ensure_ascii=False)
    path.write_bytes(document.encode() if isinstance(document, str) else document)
    return path


def edited_config(path, edits=None):
    """The path of a copy of a configuration with `edits` merged in (see merge()), alone in a new folder. Its
    recording is still that of the original; whatever it writes, it writes into the new folder."""
    document = read_config(path)
    recording = document.get("recording", {})
    if "file" in recording:
        recording["file"] = str((config_path(path).parent / recording["file"]).resolve())
    return write_config(merge(document, edits or {}))


def shared_recording(name):
    """The path of a recording that is not part of the product. Where it is absent the test is skipped; where
    CI=true it fails."""
    folder = Path(os.environ.get("TL_SHARED") or SOURCE.parent / "shared" / "recordings")
    if (folder / name).is_file():
        return folder / name
    why = f"{name} is absent: set TL_SHARED to the folder of recordings"
    expect(os.environ.get("CI") != "true", f"{why} (CI=true does not allow to skip it)")
    raise Skip(why)


# ---- reporter ----

def _run_one(name, function):
    """One of "ok", "skipped", "FAILED"."""
    begun = time.monotonic()
    try:
        function()
        verdict, text = "ok", ""
    except Skip as skip:
        verdict, text = "skipped", f": {skip.why}"
    except Failure as failure:
        verdict, text = "FAILED", f": {failure}"
    except Exception:
        verdict, text = "FAILED", "\n" + traceback.format_exc()
    print(f"{verdict:8}{name} ({time.monotonic() - begun:.2f} s){text}", flush=True)
    return verdict


def main():
    """Runs the tests of the calling file, or only those whose names contain a word of the command line."""
    module = vars(sys.modules["__main__"])
    tests = [(name, value) for name, value in module.items() if name.startswith("test_") and callable(value)]
    words = sys.argv[1:]
    chosen = [(name, test) for name, test in tests if not words or any(word in name for word in words)]
    verdicts = [_run_one(name, test) for name, test in chosen]
    failed, skipped = verdicts.count("FAILED"), verdicts.count("skipped")
    print(f"{len(verdicts)} tests, {failed} failed, {skipped} skipped")
    if failed or not verdicts:
        sys.exit(1)
    sys.exit(SKIPPED if skipped == len(verdicts) else 0)
