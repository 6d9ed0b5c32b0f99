#!/usr/bin/env python3
"""Bad input through the command line: configurations, FMUs, recordings, outputs and options that are wrong.
Each must end with the right exit code and a text that says what is wrong, where, and what to do; nothing
crashes, nothing is left among the temporary files (twinlock_test.run() sees to both), and nothing of the
user's is lost."""
import copy
import os
import random
import re
import resource
import signal
import socket
import subprocess
import zipfile

from twinlock_test import PLAIN_BOX, FMUS, SOURCE, edited_config, expect, main, read_config, run, run_well, scratch, write_config

BAD_DATA, BAD_USAGE, FMU_FAILED, TRY_AGAIN = 65, 2, 70, 75
FREE = SOURCE / "config" / "motor" / "free.json"
LIVE = SOURCE / "config" / "motor" / "live.json"
RECORDING = SOURCE / "config" / "motor" / "recording.csv"
VERBS = ("check", "replay", "run", "plant", "show")
LINES = {"torque": ["plant.torque", "motor.M_w"], "current": ["drive.u_R", "motor.I_in"],
         "omega": ["motor.omega", "drive.y"]}


def connect(**changes):
    """The connections of the motor bench, some of them others; None: not there."""
    lines = {**LINES, **changes}
    return {"connect": [line for line in lines.values() if line is not None]}


def expect_refused(args, code, *words):
    """Ends with `code` and a log that has all `words`. Returns the log's lines."""
    found, _, err = run(args)
    said = f"twinlock {' '.join(map(str, args))} ended with {found}, wanted {code}:\n{err}"
    expect(found == code, said)
    for word in words:
        expect(word in err, f"nothing says \"{word}\"; {said}")
    return err.splitlines()


def expect_problem(edits, *words, base="motor/lock.json"):
    """A configuration that every verb refuses with one problem, told with its line."""
    config = edited_config(base, edits)
    for verb in ("check", "replay"):
        lines = expect_refused([verb, config], BAD_DATA, str(config), *words)
        expect(len(lines) == 1, f"{verb}: {len(lines)} lines instead of one:\n" + "\n".join(lines))
        expect(re.search(r"line \d+", lines[0]), f"no line is named: {lines[0]}")


# ---- names, types, units, structure ----

def test_unknown_names():
    for edits, *words in (
            (connect(torque=["plant.force", "motor.M_w"]), "connect[0][0]", "plant.force", "torque, omega"),
            (connect(omega=["engine.omega", "drive.y"]), "connect[2][0]", "engine.omega", "drive, motor"),
            (connect(omega=["motor.speed", "drive.y"]), "connect[2]", "motor.speed", "check --variables"),
            ({"components": {"drive": {"set": {"reff": 1}}}}, "drive.set.reff", "check --variables")):
        expect_problem(edits, *words)
    expect_problem({"synchronise": {"match": {"motor.nothing": {"to": "plant.omega", "tolerance": 1}}}},
                   "synchronise.match.motor.nothing", "no variable \"nothing\"")


def test_names_that_are_nearly_right():
    """The one that was probably meant is told: a key, a component, a signal, a variable."""
    for edits, *words in (
            ({"synchronize": {}}, "the unknown key \"synchronize\"", "expected \"synchronise\""),
            (connect(torque=["plant.torqe", "motor.M_w"]), "connect[0][0]", "for example \"plant.torque\""),
            (connect(omega=["moter.omega", "drive.y"]), "connect[2][0]", "for example \"motor.omega\""),
            (connect(omega=["motor.Omega", "drive.y"]), "connect[2]", "no variable \"Omega\", perhaps \"omega\" is meant"),
            ({"components": {"drive": {"set": {"reff": 1}}}}, "drive.set.reff", "perhaps \"ref\" is meant")):
        expect_problem(edits, *words)


def test_files_with_other_letters_case():
    folder = scratch()
    for name in ("Lock.json", "Steps.csv", "Twin.db"):
        (folder / name).write_bytes(RECORDING.read_bytes() if name == "Steps.csv" else b"{}")
    for args, name in ((["check", folder / "lock.json"], "Lock.json"), (["run", folder / "LOCK.JSON"], "Lock.json"),
                       (["replay", FREE, "--recording", folder / "steps.csv"], "Steps.csv"),
                       (["plant", FREE, "--record", folder / "x", "--recording", folder / "STEPS.csv"], "Steps.csv"),
                       (["plant", FREE, "--for", folder / "lock.JSON"], "Lock.json"),
                       (["show", folder / "twin.db"], "Twin.db")):
        expect_refused(args, BAD_DATA, "No such file", f"there is {name} beside it, with other letters' case")
    fmu = folder / "Motor.fmu"
    fmu.touch()
    expect_problem({"components": {"motor": {"fmu": str(folder / "motor.fmu")}}},
                   "no file", "there is Motor.fmu beside it, with other letters' case")
    lines = expect_refused(["check", folder / "other.json"], BAD_DATA, "No such file")
    expect("beside it" not in lines[0], lines[0])


def test_fmus_that_are_no_files():
    """What is there instead is told; nobody waits for the other end of a FIFO, or reads a device for ever."""
    folder = scratch()
    os.mkfifo(folder / "fifo.fmu")
    (folder / "folder.fmu").mkdir()
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(folder / "socket.fmu"))
        for path, what in ((folder / "fifo.fmu", "a FIFO"), (folder / "folder.fmu", "a folder"),
                           (folder / "socket.fmu", "a socket"), ("/dev/zero", "a device")):
            expect_problem({"components": {"motor": {"fmu": str(path)}}}, "components.motor", f"no file \"{path}\"",
                           f"what is there is {what}, and an FMU is a file: name the .fmu file itself")
    lines = expect_refused(["check", edited_config("motor/lock.json", {"components": {"motor": {"fmu": "/no.fmu"}}})],
                           BAD_DATA, "no file \"/no.fmu\"")
    expect("what is there" not in lines[0], lines[0])


def places_of_texts(document, path=()):
    """Every key and every text of a document: the way to it, and whether it is a key."""
    entries = document.items() if isinstance(document, dict) else enumerate(document)
    for key, value in entries:
        if isinstance(document, dict):
            yield (*path, key), True
        if isinstance(value, (dict, list)):
            yield from places_of_texts(value, (*path, key))
        elif isinstance(value, str):
            yield (*path, key), False


def with_text(base, path, is_key, text):
    """The document with something behind a key or a text."""
    document = copy.deepcopy(base)
    *way, last = path
    at = document
    for key in way:
        at = at[key]
    if is_key:
        entries = [(key + text if key == last else key, value) for key, value in at.items()]
        at.clear()
        at.update(entries)
    else:
        at[last] += text
    return document


def test_texts_that_command_a_terminal():
    """Escape sequences, of one byte or two, and what turns or breaks a line: shown as text, wherever they stand."""
    base = read_config(SOURCE / "config" / "motor" / "lock.json")
    commands = "\x1b[31m\x9b31m\u202e\u2028\U000e0041"
    seen = 0
    for path, is_key in places_of_texts(base):
        config = write_config(with_text(base, path, is_key, commands))
        code, out, err = run(["check", config])
        raw = [character for character in commands if not character.isprintable() and character in out + err]
        expect(code != 0, f"{path}: is taken")
        expect(not raw, f"{path}: {raw} reach the terminal:\n{out}{err}")
        seen += "\\x1B[31m\\u{9B}31m\\u{202E}\\u{2028}" in err
    expect(seen > 40, f"only {seen} of them are shown")


def test_types_that_do_not_fit():
    integer = {"plant": {"torque": {"type": "integer"}}}
    expect_problem(integer, "connect[0]", "plant.torque is Integer", "motor.M_w is Real")
    expect_problem({"components": {"drive": {"set": {"Z_p": 1.5}}}}, "drive.Z_p is Integer", "a whole number")
    expect_problem({"components": {"drive": {"set": {"ref": "ten"}}}}, "drive.ref is Real", "a number")
    expect_problem({"components": {"drive": {"set": {"Z_p": True}}}}, "drive.Z_p is Integer")


def test_units_that_do_not_fit():
    for unit in ("m", "rad/s", "furlong"):
        edits = {"plant": {"torque": {"unit": unit}}}
        expect_problem(edits, "connect[0]", f'"{unit}"', '"N.m"', "correct the unit")
    edits = {"plant": {"omega": {"unit": "kg"}}}
    expect_problem(edits, "synchronise.match.motor.omega", '"kg"', '"rad/s"')


def test_inputs_without_a_connection():
    edits = connect(torque=None)
    expect_problem(edits, "components.motor", "motor.M_w is not connected", "connect it, or give it")
    held = {**connect(torque=None), "components": {"motor": {"set": {"M_w": 0.5}}}}
    run_well(["check", edited_config("motor/lock.json", held)])


def test_an_input_connected_twice():
    edits = connect(again=["plant.torque", "motor.M_w"])
    expect_problem(edits, "connect[3][1]", "connect[0]", "at most once")


def test_no_path():
    """The adjusted controller does not reach the motor that is matched: its current is held."""
    edits = {**connect(current=None), "components": {"motor": {"set": {"I_in": 0.3}}},
             "synchronise": {"adjust": {"motor.d": None, "drive.P": {"step": 1}}}}
    expect_problem(edits, "synchronise.adjust.drive.P", "no path leads from drive.P", "correct nothing")


def test_no_path_to_one_match():
    edits = {**connect(omega=["plant.omega", "drive.y"]),
             "synchronise": {"match": {"drive.e": {"to": "plant.omega", "tolerance": 1}}}}
    expect_problem(edits, "synchronise.match.drive.e", "no path leads", "\"weight\": 0")


def test_what_cannot_be_adjusted():
    for variable, *words in (("motor.J", "fixed parameter", "tunable"),
                             ("motor.omega", "continuous output", "an input or a tunable parameter"),
                             ("drive.Z_p", "Integer", "that is Real or Boolean")):
        edits = {"synchronise": {"adjust": {variable: {"step": 1}}}}
        expect_problem(edits, f"synchronise.adjust.{variable}", *words)


def test_prediction_below_distance():
    adjust = {"motor.d": None, "drive.P": {"step": 1}}
    edits = {"synchronise": {"horizon": {"prediction": 1}, "adjust": adjust}}
    expect_problem(edits, "synchronise.horizon.prediction", "found 1, expected at least 2")
    edits = {"synchronise": {"horizon": {"prediction": 2}, "adjust": adjust}}
    expect("T_D = 2, T_P = 2" in run_well(["check", edited_config("motor/lock.json", edits)]), "T_D is not 2")


def test_all_problems_at_once():
    """Of the reader, then (where it has none) of the twin: a line for each, and the number of all."""
    reading = {"step_s": -1, "duration_s": "x", "nome": 3, "components": {"drive": {"fmu": 5}},
               "connect": [["a"]], "plant": {"torque": {"min": 5, "max": 1}}}
    building = {**connect(current=["drive.u_X", "motor.I_in"]), "components": {"drive": {"set": {"reff": 1}}},
                "plant": {"torque": {"unit": "m"}},
                "synchronise": {"adjust": {"motor.J": {"step": 1}},
                                "match": {"motor.nothing": {"to": "plant.omega", "tolerance": 1}}}}
    for edits, places in ((reading, ["step_s", "duration_s", "nome", "components.drive.fmu", "connect[0]",
                                     "plant.torque.max"]),
                          (building, ["connect[1]", "components.drive.set.reff", "connect[0]", "motor.J",
                                      "motor.nothing"])):
        config, count = edited_config("motor/lock.json", edits), len(places)
        lines = expect_refused(["check", config], BAD_DATA, f"{count} problems")
        expect(len(lines) == count + 1, f"{len(lines) - 1} lines instead of {count}:\n" + "\n".join(lines))
        for place in places:
            expect(sum(place in line for line in lines) >= 1, f"nothing about {place}:\n" + "\n".join(lines))


# ---- JSON ----

def test_malformed_and_hostile_json():
    good = FREE.read_text(encoding="utf-8")
    for text, *words in (
            ("", "end of the file"), (" \n\n", "line 3"), ("[]", "expected an object"), ("null", "an object"),
            ('{"twinlock": 1,', "end of the file"), ('{"twinlock": 1 "name"', "line 1, column 16"),
            (good.replace("0.01", "1e999"), "1e999", "line 4"), (good.replace("0.01", "NaN"), "NaN"),
            (good.replace("0.01", "01"), "no leading zeros"), (good.replace("0.01", "1" * 64), "line 4"),
            (good.replace("0.01", "null"), "step_s", "null"), (good + "x", "nothing after the end"),
            (good.replace('"step_s"', '"name"'), "found the key \"name\" again"),
            ("[" * 100_000, "at most 32"),
            ('{"a":' * 5000, "at most 32"), (good + " " * 256 * 1024, "256 KiB"),
            ("\ufeff" + good, "byte order mark"),
            (bytes(range(256)), "UTF-8"), (b'{"name": "\xff"}', "0xFF"), (b'{"name": "\xc0\xaf"}', "UTF-8"),
            (b'{"twinlock": \0 1}', "U+0000"), ('{"name": "\\ud800"}', "surrogate"),
            (b"PK\x03\x04" + bytes(500), "line 1")):
        config = write_config(text)
        lines = expect_refused(["check", config], BAD_DATA, str(config), *words)
        expect(all(len(line) < 1200 for line in lines), f"a line of {max(map(len, lines))} characters")


def mutated(rng, good, pieces):
    """A copy of bytes with some of them replaced by one of `pieces`, or by any byte."""
    mutant = bytearray(good)
    for _ in range(rng.choice([1, 1, 2, 8])):
        at = rng.randrange(len(mutant))
        mutant[at:at + rng.choice([0, 1, 1, 30])] = rng.choice([*pieces, bytes([rng.randrange(256)])])
    return bytes(mutant)


def test_mutants_of_a_configuration():
    """Whatever becomes of its bytes: it is taken, or refused with a text."""
    rng, good = random.Random(1), (SOURCE / "config" / "motor" / "lock.json").read_bytes()
    for _ in range(60):
        mutant = mutated(rng, good, [b"", b'"', b"{", b"9", b","])
        code, _, err = run(["check", write_config(mutant)])
        expect(code in (0, BAD_DATA, FMU_FAILED) and (code == 0 or err), f"{code}: {err}\n{mutant!r}")


# ---- FMUs ----

def changed_fmu(name, path, change):
    """A copy of an FMU: `change` gets {entry: bytes} and may do anything with it."""
    with zipfile.ZipFile(FMUS / f"{name}.fmu") as archive:
        entries = {entry: archive.read(entry) for entry in archive.namelist()}
    change(entries)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for entry, content in entries.items():
            archive.writestr(entry, content)


def expect_fmu_refused(change, *words, base="motor/free.json", code=BAD_DATA, edits=None):
    """Refused by `check` and `replay`; `change` as for changed_fmu(), `edits` of the configuration."""
    config = edited_config(base, edits)
    fmu = config.parent / "drive.fmu"
    changed_fmu("drive", fmu, change)
    for verb in ("check", "replay"):
        expect_refused([verb, config], code, "components.drive", "line 7", *words)


def binaries(entries):
    """One for each machine that this build knows."""
    return [entry for entry in entries if entry.startswith("binaries/") and entry.endswith(".so")]


def replace(entry, old, new):
    def change(entries):
        expect(old in entries[entry], f"the test is wrong: no {old!r} in {entry}")
        entries[entry] = entries[entry].replace(old, new)
    return change


def set_machine(machine):
    def change(entries):
        for name in binaries(entries):
            content = bytearray(entries[name])
            content[18:20] = machine.to_bytes(2, "little")
            entries[name] = bytes(content)
    return change


def move_to_windows(entries):
    for name in binaries(entries):
        entries["binaries/win64/drive.dll"] = entries.pop(name)


def test_no_fmu():
    expect_problem({"components": {"drive": {"fmu": "nowhere.fmu"}}}, "components.drive", "\"nowhere.fmu\"",
                   "TWINLOCK_FMU_PATH")
    expect_problem({"components": {"drive": {"fmu": str(FMUS)}}}, "components.drive", str(FMUS))


def test_broken_zips():
    good = (FMUS / "drive.fmu").read_bytes()
    middle = len(good) // 2
    for content in (b"", b"no zip at all", good[:middle], good[:-5], bytes(len(good)),
                    good[:middle] + bytes(64) + good[middle + 64:]):
        config = edited_config("motor/free.json")
        (config.parent / "drive.fmu").write_bytes(content)
        expect_refused(["check", config], BAD_DATA, "components.drive", "drive.fmu")


def test_mutants_of_an_fmu():
    """Whatever becomes of the bytes of its directory and its description, nothing crashes. Its binary is left
    alone: code is believed once it is loaded."""
    rng = random.Random(2)
    config = edited_config("motor/free.json")
    fmu = config.parent / "drive.fmu"
    good = (FMUS / "drive.fmu").read_bytes()
    directory = good.index(b"PK\x01\x02")
    for _ in range(30):
        mutant = bytearray(good)
        for _ in range(rng.choice([1, 2, 4])):
            mutant[rng.randrange(directory, len(mutant))] = rng.randrange(256)
        fmu.write_bytes(mutant)
        run(["check", config])

    def scramble(entries):
        text = entries["modelDescription.xml"]
        entries["modelDescription.xml"] = mutated(rng, text, [b"", b"<", b'"', b"/>", b"&x;", b"-1", b"\xff"])

    for _ in range(30):
        changed_fmu("drive", fmu, scramble)
        run(["check", config])


def test_paths_that_lead_outside():
    target = scratch() / "evil.txt"
    for name in ("../evil.txt", "resources/../../evil.txt", str(target), "binaries/../../../evil.txt"):
        expect_fmu_refused(lambda entries, name=name: entries.update({name: b"evil"}), "evil.txt")
    expect(not list(target.parent.parent.rglob("evil.txt")), "a file was written outside of the FMU's folder")


def test_descriptions():
    description = "modelDescription.xml"
    expect_fmu_refused(lambda entries: entries.pop(description), description)
    expect_fmu_refused(lambda entries: entries.update({description: b""}), description)
    expect_fmu_refused(lambda entries: entries.update({description: b"<fmiModelDescription>"}), description)
    expect_fmu_refused(replace(description, b'fmiVersion="2.0"', b'fmiVersion="1.0"'), "1.0")
    expect_fmu_refused(replace(description, b"<CoSimulation", b"<ModelExchange"), "for Co-Simulation")


def test_a_wrong_guid():
    def change(entries):
        text = entries["modelDescription.xml"]
        entries["modelDescription.xml"] = re.sub(rb'guid="[^"]*"', b'guid="{another}"', text)

    expect_fmu_refused(change, "GUID", code=FMU_FAILED)


def test_another_machine():
    expect_fmu_refused(set_machine(8), "drive.so")  # MIPS
    expect_fmu_refused(move_to_windows, "win64")
    expect_fmu_refused(lambda entries: entries.update({name: b"MZ" for name in binaries(entries)}), "drive.so")


def test_no_state():
    """An FMU that cannot save its state can run free, but is not synchronised by that; what else there is see test_rollback.py."""
    change = replace("modelDescription.xml", b'canGetAndSetFMUstate="true"', b'canGetAndSetFMUstate="false"')
    expect_fmu_refused(change, "canGetAndSetFMUstate", base="motor/lock.json", edits={"components": {"drive": {"rollback": "state"}}})
    config = edited_config("motor/free.json")
    changed_fmu("drive", config.parent / "drive.fmu", change)
    run_well(["replay", config])


def test_an_fmu_that_refuses():
    """The FMU itself says no: exit code 70, and what it said is told."""
    config = edited_config("motor/free.json", {"components": {"drive": {"set": {"t_step": -1}}}})
    expect_refused(["replay", config], FMU_FAILED, "drive")


# ---- recordings ----

def expect_recording_refused(content, *words, config=FREE):
    path = scratch() / "plant.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    expect_refused(["replay", config, "--recording", path], BAD_DATA, str(path), *words)


def test_recordings():
    expect_recording_refused("", "is empty", "names of its columns")
    expect_recording_refused("t,omega,M_brake\n", "a header, but no row")
    expect_recording_refused("t,omega\n0,1\n", "line 1", "\"M_brake\"", "t, omega")
    expect_recording_refused("time,omega,M_brake\n0,1,2\n", "line 1", "\"t\"")
    expect_recording_refused("t,omega,omega,M_brake\n0,1,2,3\n", "line 1", "\"omega\"")
    expect_recording_refused("t,omega,M_brake\n0,1,2\n1,1,2\n0.5,1,2\n", "line 4", "0.5", "not after")
    expect_recording_refused("t,omega,M_brake\n0,1,2\n0,1,2\n", "line 3", "not after")
    expect_recording_refused("t,omega,M_brake\n0,1\n", "line 2", "2 cells", "has 3")
    expect_recording_refused("t,omega,M_brake\nnoon,1,2\n", "line 2", "\"noon\"", "seconds")
    expect_recording_refused("t,omega,M_brake\n1e300,1,2\n", "line 2")
    expect_recording_refused("t,omega,M_brake\nnan,1,2\n", "line 2")
    expect_recording_refused(bytes(10_000), "line 1")
    expect_recording_refused(b"SQLite format 3\0" + bytes(8000), "SQLite")
    expect_recording_refused(b"SQLite format 3\0", "not a twinlock database")
    expect_recording_refused("t,omega,M_brake\n0," + "1" * 2_000_000 + ",2\n", "line 2")


def test_values_that_are_no_numbers_are_left_out():
    """In a recording that is a quality, not an error: the twin goes on, and says how many it left out."""
    path = scratch() / "plant.csv"
    rows = [f"{i * 0.01:.2f},{'n/a' if 20 <= i < 40 else 62.9},0.01" for i in range(101)]
    path.write_text("t,omega,M_brake\n" + "\n".join(rows) + "\n", encoding="utf-8")
    lock = edited_config("motor/lock.json", {"delays": None, "synchronise": {"match": {"motor.omega": {"between": "last", "condition": None}}}})
    out = run_well(["replay", lock, "--recording", path])
    expect("20 of 100 measurements were not good" in out and "20 free run" in out, out)
    expect(re.search(r"\b(nan|inf)", out, re.I) is None, out)


def test_mutants_of_a_recording():
    rng, good, path = random.Random(3), RECORDING.read_bytes()[:1500], scratch() / "plant.csv"
    for _ in range(40):
        mutant = mutated(rng, good, [b"", b",", b"\n", b'"', b"-", b"e9"])
        path.write_bytes(mutant)
        code, _, err = run(["replay", SOURCE / "config" / "motor" / "lock.json", "--recording", path])
        expect(code in (0, BAD_DATA) and (code == 0 or err), f"{code}: {err}\n{mutant!r}")


# ---- files ----

def test_missing_files():
    folder = scratch()
    for verb in VERBS:
        expect_refused([verb, folder / "absent"], BAD_DATA, str(folder / "absent"), "No such file")
    from_absent = ["--recording", folder / "absent.csv"]
    expect_refused(["replay", FREE, *from_absent], BAD_DATA, "absent.csv", "No such file")
    expect_refused(["plant", FREE, *from_absent, "--record", folder / "new.csv"], BAD_DATA, "absent.csv",
                   "No such file")
    expect_refused(["plant", FREE, "--for", folder / "absent.json"], BAD_DATA, "absent.json", "No such file")
    expect(not list(folder.iterdir()), "a file was made all the same")


def test_folders_instead_of_files():
    folder = scratch()
    for verb in ("check", "replay", "run", "plant"):
        expect_refused([verb, folder], BAD_DATA, str(folder), "Is a directory")
    expect_refused(["show", folder], BAD_DATA, str(folder))
    expect_refused(["replay", FREE, "--recording", folder], BAD_DATA, str(folder), "Is a directory")
    expect_refused(["replay", FREE, "--csv", folder], TRY_AGAIN, str(folder), "Is a directory")
    expect_refused(["replay", FREE, "--db", folder], BAD_DATA, str(folder), "no ordinary file")


def test_a_fifo_is_no_recording():
    fifo = scratch() / "fifo"
    os.mkfifo(fifo)
    expect_refused(["replay", FREE, "--recording", fifo], BAD_DATA, "fifo", "no regular file")


def test_a_recording_of_one_row():
    short = scratch() / "short.csv"
    short.write_text("t,omega,M_brake\n0,62.9,0\n", encoding="utf-8")
    expect_refused(["replay", FREE, "--recording", short], BAD_DATA, "ends before the first step")


def test_a_result_that_cannot_be_written():
    for args in (["replay", FREE], ["replay", FREE, "--json"], ["check", FREE]):
        with open("/dev/full", "w", encoding="utf-8") as full:
            done = subprocess.run([os.environ["TWINLOCK"], *map(str, args)], stdout=full, stderr=subprocess.PIPE,
                                  text=True, check=False, env={**os.environ, "TWINLOCK_FMU_PATH": str(FMUS)})
        expect(done.returncode == TRY_AGAIN and "could not be written" in done.stderr,
               f"{args}: {done.returncode}, {done.stderr}")


def test_no_recording():
    config = SOURCE / "config" / "emps" / "free.json"
    for args in (["replay", config], ["plant", config, "--record", scratch() / "new.csv"]):
        expect_refused(args, BAD_USAGE, "names no recording", "--recording FILE")


def test_outputs_that_cannot_be_written():
    nowhere = scratch() / "absent"
    expect_refused(["replay", FREE, "--csv", nowhere / "x.csv"], TRY_AGAIN, "x.csv", "cannot be written")
    expect_refused(["replay", FREE, "--csv", "/dev/full"], TRY_AGAIN, "/dev/full", "No space left on device")
    expect_refused(["replay", FREE, "--db", nowhere / "x.db"], TRY_AGAIN, "x.db", "No such file")
    expect_refused(["run", LIVE, "--db", nowhere / "x.db"], TRY_AGAIN, "x.db", "No such file")
    code, _, err = run(["plant", FREE, "--record", nowhere / "x.csv"])
    expect(code in (BAD_DATA, TRY_AGAIN) and "x.csv cannot be written" in err, f"{code}: {err}")
    expect(not nowhere.exists(), "a folder was made")


def test_a_reader_that_leaves():
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write, "w") as gone:
        code, _, err = run(["replay", FREE, "--csv", "-"], stdout=gone)
    expect(code == TRY_AGAIN and "Broken pipe" in err and "disk" not in err, f"{code}: {err}")


def limit_files():
    """In the program to be: a file larger than that cannot be written, as on a full disk."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)


def test_a_disk_that_gets_full():
    path = scratch() / "new.csv"
    code, _, err = run(["plant", FREE, "--record", path], preexec_fn=limit_files, restore_signals=False)
    expect(code == TRY_AGAIN and f"{path}: cannot be written: File too large" in err and
           "want of a reader" not in err, f"{code}: {err}")
    expect(path.stat().st_size == 20_000, f"{path.stat().st_size} bytes")


def test_nothing_of_the_users_is_overwritten():
    """A database that is none, a recording that is there, and the inputs of the very run."""
    folder = scratch()
    notes, recording = folder / "notes.txt", folder / "plant.csv"
    config = edited_config("motor/free.json")
    fmu = config.parent / "motor.fmu"
    kept = {notes: b"dear diary\n" * 100, recording: RECORDING.read_bytes(), config: config.read_bytes(),
            fmu: (FMUS / "motor.fmu").read_bytes()}
    for path, content in kept.items():
        path.write_bytes(content)
    link = folder / "link.csv"
    link.symlink_to(recording)
    for args in (["replay", config, "--db", notes], ["show", notes]):
        expect_refused(args, BAD_DATA, "notes.txt", "not a twinlock database")
    expect_refused(["plant", config, "--record", recording], BAD_DATA, "plant.csv", "remove it")
    for target in (recording, link, config, fmu):
        for option in ("--csv", "--report"):
            expect_refused(["replay", config, "--recording", recording, option, target], BAD_USAGE, target.name)
    for path, content in kept.items():
        expect(path.read_bytes() == content, f"{path.name} was overwritten")


def test_a_database_takes_nobodys_place():
    """What is at its path and no database, or has a name like its own, is there afterwards."""
    folder = scratch()
    fifo, dangling, empty, beside = folder / "fifo.db", folder / "link.db", folder / "empty.db", folder / "keep.db.new"
    os.mkfifo(fifo)
    dangling.symlink_to("absent")
    empty.touch()
    beside.write_text("mine", encoding="utf-8")
    for path, text in ((fifo, "no ordinary file"), (dangling, "a file that is not there"),
                       (empty, "it has only 0 bytes")):
        for args in (["replay", FREE, "--db", path], ["run", LIVE, "--db", path]):
            expect_refused(args, BAD_DATA, str(path), text)
    expect_refused(["replay", FREE, "--db", ""], BAD_USAGE, "the name of the database is empty")
    run_well(["replay", FREE, "--db", folder / "keep.db"])
    expect(fifo.is_fifo() and dangling.is_symlink() and empty.stat().st_size == 0, "a path was replaced")
    expect(beside.read_text(encoding="utf-8") == "mine", "a neighbour was replaced")
    left = sorted(path.name for path in folder.iterdir())
    expect(left == ["empty.db", "fifo.db", "keep.db", "keep.db.new", "link.db"], f"{left}")


def test_a_port_in_use():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        config = edited_config("motor/live.json", {"sources": {"inverter": {"modbus_tcp": {"port": port}}}})
        expect_refused(["plant", config], TRY_AGAIN, str(port), "in use")


# ---- the command line ----

def test_wrong_usage():
    seeds = [["plant", FREE, "--seed", seed] for seed in ("x", "-1", "", "9" * 30, "1.5", "1 ")]
    for args in ([], ["nonsense"], ["--nonsense"], ["check", FREE, FREE], *([verb] for verb in VERBS),
                 *([verb, "--nonsense", FREE] for verb in VERBS), ["replay", FREE, "--recording"],
                 ["replay", FREE, "--json=yes"], ["plant", FREE, "--fifo", "a", "--record", "b"], *seeds):
        found, out, err = run(args)
        expect(found == BAD_USAGE and out == "" and err, f"twinlock {args}: {found}, {out!r}, {err!r}")
    expect_refused(["plant", FREE], BAD_USAGE, "reads nothing by Modbus TCP", "--for", "--record")


def test_what_was_probably_meant():
    """A word that is none is told with the one beside it, and nothing runs."""
    for args, *words in (
            (["rply", FREE], "there is no verb \"rply\": did you mean replay?"),
            (["help", "shw"], "there is no verb \"shw\": did you mean show?"),
            (["--json", "replay", FREE], "there is no verb \"--json\": options come behind the verb"),
            (["run", LIVE, "--duraton", "3"], "there is no option --duraton: did you mean --duration?"),
            (["run", LIVE, "--Status"], "did you mean --status?"),
            (["replay", FREE, "--recordings=a.csv"], "there is no option --recordings: did you mean --recording?"),
            (["run", LIVE, "--plain"], "there is no option --plain here: it is one of replay"),
            (["check", FREE, "--csv", "a"], "there is no option --csv here: it is one of replay, show"),
            (["plant", FREE, "--rec", "a"], "--rec is short for several options: --recording or --record"),
            (["plant", FREE, "-s", "1"], "there is no option -s"),
            (["replay", FREE, "--quite-another"], "there is no option --quite-another\n"),
            (["replay", FREE, "--json=yes"], "--json takes no value: found \"--json=yes\""),
            (["replay", FREE, "--recording"], "--recording: FILE is missing behind it"),
            (["check"], "expected exactly one configuration, found none"),
            (["check", FREE, LIVE], f"expected exactly one configuration, found \"{FREE}\" and \"{LIVE}\""),
            (["show", "a.db", "--json", "--report", "b"], "expected at most one of --json, --csv, --report"),
            (["plant", FREE, "--fifo", "a", "--record", "b"], "expected at most one of --fifo, --record")):
        lines = expect_refused(args, BAD_USAGE, *words)
        if args[0] in VERBS:
            help_line = f"usage: twinlock {args[0]} {'DATABASE' if args[0] == 'show' else 'CONFIG'} [options]"
            expect(len(lines) == 2 and lines[1].startswith(help_line), f"{args}: {lines}")


def test_a_plant_leaves_out_what_it_cannot_serve():
    """GPIO lines and serial lines of the listener are said, and are no error by themselves."""
    lines = edited_config(PLAIN_BOX, {
        "sources": {"bus": None, "inverter": {"modbus_tcp": None, "modbus_rtu": {"device": "/dev/ttyS1"}}},
        "plant": {"omega": {"can": None}}})
    expect_refused(["plant", SOURCE / "config" / "motor" / "box_plant.json", "--for", lines], BAD_USAGE,
                   "panel: signals of GPIO lines are not played", "inverter: signals by Modbus RTU are not played",
                   "reads nothing by Modbus TCP or CAN")


def test_words_of_usage_and_start():
    for duration in ("1e300", "1e9", "0", "nan"):
        expect_refused(["run", LIVE, "--duration", duration], BAD_USAGE, "expected seconds > 0 and below 1e9")
    code, _, err = run(["check", "/nope/x.json"])
    expect(code == BAD_DATA and err.count("/nope/x.json") == 1 and "cannot be read: No such file" in err, err)
    code, _, err = run(["run", SOURCE / "config" / "motor" / "lock.json"])
    expect(code == BAD_DATA and "nothing is recorded" not in err, f"{code}: {err}")
    for name, text in (("plant.json", " 1 signal\n"), ("lock.json", " 2 signals\n")):
        expect(text in run_well(["check", SOURCE / "config" / "motor" / name]), f"{name}: no{text}")


def test_help():
    of_verbs = [[verb, option] for verb in VERBS for option in ("--help", "-h")]
    for args in (["--help"], ["-h"], ["help"], *of_verbs):
        code, out, err = run(args)
        expect(code == 0 and err == "" and out.startswith("usage: twinlock"), f"{args}: {code}, {err}")
        for line in out.splitlines():
            expect(len(line) <= 100, f"twinlock {' '.join(args)}: a line of {len(line)} columns: {line}")
    for verb in VERBS:
        expect(run_well(["help", verb]) == run_well([verb, "--help"]), f"help {verb} is not {verb} --help")
        expect(f"\n  {verb} " in run_well(["--help"]), f"--help does not name {verb}")


def test_version():
    expect(re.fullmatch(r"twinlock \d+(\.\d+)+\S*\n", run_well(["--version"])), "no version")


main()
