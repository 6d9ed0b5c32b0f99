#!/usr/bin/env python3
"""Bad input through the command line: wrong configurations, FMUs, recordings, outputs and options.

Each must end with the right exit code and a message with the object and the value. twinlock_test.run() checks that nothing
crashes and that no temporary file is left. No file of the user may be lost."""
import copy
import os
import random
import re
import resource
import signal
import socket
import subprocess
import zipfile

from twinlock_test import (FMUS, PLAIN_BOX, SOURCE, edited_config, expect, expect_line, expect_no_line, has_line, main, read_config,
                           run, run_well, scratch, write_config)

BAD_DATA, BAD_USAGE, FMU_FAILED, TRY_AGAIN = 65, 2, 70, 75
FREE = SOURCE / "config" / "motor" / "free.json"
LIVE = SOURCE / "config" / "motor" / "live.json"
RECORDING = SOURCE / "config" / "motor" / "recording.csv"
VERBS = ("check", "replay", "run", "plant", "show")
LINES = {"torque": ["plant.torque", "motor.M_w"], "current": ["drive.u_R", "motor.I_in"],
         "omega": ["motor.omega", "drive.y"]}


def connect(**changes):
    """The connections of the motor bench with `changes`; None removes one."""
    lines = {**LINES, **changes}
    return {"connect": [line for line in lines.values() if line is not None]}


def expect_refused(args, code, *parts):
    """Ends with `code`; for each of `parts` a line of the log has them (has_line()). Returns the log's lines."""
    found, _, err = run(args)
    expect(found == code, f"twinlock {' '.join(map(str, args))} ended with {found}, wanted {code}:\n{err}")
    for wanted in parts:
        expect_line(err, wanted)
    return err.splitlines()


def expect_problem(edits, parts, base="motor/lock.json"):
    """`check` and `replay` reject the configuration with one line, which has the line number and `parts`."""
    config = edited_config(base, edits)
    for verb in ("check", "replay"):
        lines = expect_refused([verb, config], BAD_DATA, f"{config}|{parts}")
        expect(len(lines) == 1, f"{verb}: {len(lines)} lines instead of one:\n" + "\n".join(lines))
        expect(re.search(r"line \d+", lines[0]), f"no line is named: {lines[0]}")


# ---- names, types, units, structure ----

def test_unknown_names():
    for edits, parts in (
            (connect(torque=["plant.force", "motor.M_w"]), "connect[0][0]|plant.force|torque, omega"),
            (connect(omega=["engine.omega", "drive.y"]), "connect[2][0]|engine.omega|drive, motor"),
            (connect(omega=["motor.speed", "drive.y"]), "connect[2]|motor.speed|check --variables"),
            ({"components": {"drive": {"set": {"reff": 1}}}}, "components.drive.set.reff|check --variables"),
            ({"synchronise": {"match": {"motor.nothing": {"to": "plant.omega", "tolerance": 1}}}},
             "synchronise.match.motor.nothing|\"nothing\"|check --variables")):
        expect_problem(edits, parts)


def test_names_that_are_nearly_right():
    """The message suggests the similar name: of a key, a component, a signal, a variable."""
    for edits, parts in (
            ({"synchronize": {}}, "\"synchronize\"|\"synchronise\""),
            (connect(torque=["plant.torqe", "motor.M_w"]), "connect[0][0]|plant.torqe|plant.torque"),
            (connect(omega=["moter.omega", "drive.y"]), "connect[2][0]|moter.omega|motor.omega"),
            (connect(omega=["motor.Omega", "drive.y"]), "connect[2]|\"Omega\"|\"omega\""),
            ({"components": {"drive": {"set": {"reff": 1}}}}, "components.drive.set.reff|\"ref\"")):
        expect_problem(edits, parts)


def test_files_with_other_letters_case():
    folder = scratch()
    for name in ("Lock.json", "Steps.csv", "Twin.db"):
        (folder / name).write_bytes(RECORDING.read_bytes() if name == "Steps.csv" else b"{}")
    for args, name in ((["check", folder / "lock.json"], "Lock.json"), (["run", folder / "LOCK.JSON"], "Lock.json"),
                       (["replay", FREE, "--recording", folder / "steps.csv"], "Steps.csv"),
                       (["plant", FREE, "--record", folder / "x", "--recording", folder / "STEPS.csv"], "Steps.csv"),
                       (["plant", FREE, "--for", folder / "lock.JSON"], "Lock.json"),
                       (["show", folder / "twin.db"], "Twin.db")):
        expect_refused(args, BAD_DATA, f"No such file|{name}")
    fmu = folder / "Motor.fmu"
    fmu.touch()
    expect_problem({"components": {"motor": {"fmu": str(folder / "motor.fmu")}}}, "components.motor|motor.fmu|Motor.fmu")
    other, = expect_refused(["check", folder / "other.json"], BAD_DATA, f"{folder / 'other.json'}|No such file")
    for name in ("Lock.json", "Steps.csv", "Twin.db", "Motor.fmu"):
        expect_no_line(other, name)


def test_fmus_that_are_no_files():
    """The message has the type of the file. The program neither waits for a writer of a FIFO nor reads an endless device."""
    folder = scratch()
    os.mkfifo(folder / "fifo.fmu")
    (folder / "folder.fmu").mkdir()
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(folder / "socket.fmu"))
        for path, what in ((folder / "fifo.fmu", "FIFO"), (folder / "folder.fmu", "folder"),
                           (folder / "socket.fmu", "socket"), ("/dev/zero", "device")):
            expect_problem({"components": {"motor": {"fmu": str(path)}}}, f"components.motor|\"{path}\"|a {what}|.fmu file")
    absent, = expect_refused(["check", edited_config("motor/lock.json", {"components": {"motor": {"fmu": "/no.fmu"}}})],
                             BAD_DATA, "components.motor|\"/no.fmu\"")
    for what in ("FIFO", "folder", "socket", "device", ".fmu file"):
        expect_no_line(absent, what)


def places_of_texts(document, path=()):
    """Every key and every text of a document: its path, and whether it is a key."""
    entries = document.items() if isinstance(document, dict) else enumerate(document)
    for key, value in entries:
        if isinstance(document, dict):
            yield (*path, key), True
        if isinstance(value, (dict, list)):
            yield from places_of_texts(value, (*path, key))
        elif isinstance(value, str):
            yield (*path, key), False


def with_text(base, path, is_key, text):
    """The document with `text` appended to a key or a text."""
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
    """Escape sequences of one byte or two, direction marks and line separators are printed as text, in each key and each text."""
    base = read_config(SOURCE / "config" / "motor" / "lock.json")
    commands = "\x1b[31m\x9b31m\u202e\u2028\U000e0041"
    seen = 0
    for path, is_key in places_of_texts(base):
        config = write_config(with_text(base, path, is_key, commands))
        code, out, err = run(["check", config])
        raw = [character for character in commands if not character.isprintable() and character in out + err]
        expect(code != 0, f"{path}: is accepted")
        expect(not raw, f"{path}: {raw} reach the terminal:\n{out}{err}")
        seen += "\\x1B[31m\\u{9B}31m\\u{202E}\\u{2028}" in err
    expect(seen > 40, f"only {seen} of them are shown")


def test_types_that_do_not_fit():
    integer = {"plant": {"torque": {"type": "integer"}}}
    expect_problem(integer, "connect[0]|plant.torque|Integer|motor.M_w|Real")
    expect_problem({"components": {"drive": {"set": {"Z_p": 1.5}}}}, "components.drive.set.Z_p|Integer|whole number")
    expect_problem({"components": {"drive": {"set": {"ref": "ten"}}}}, "components.drive.set.ref|Real|number")
    expect_problem({"components": {"drive": {"set": {"Z_p": True}}}}, "components.drive.set.Z_p|Integer|whole number")


def test_units_that_do_not_fit():
    for unit in ("m", "rad/s", "furlong"):
        edits = {"plant": {"torque": {"unit": unit}}}
        expect_problem(edits, f'connect[0]|plant.torque|"{unit}"|motor.M_w|"N.m"|scale')
    edits = {"plant": {"omega": {"unit": "kg"}}}
    expect_problem(edits, 'synchronise.match.motor.omega|plant.omega|"kg"|"rad/s"')


def test_inputs_without_a_connection():
    edits = connect(torque=None)
    expect_problem(edits, "components.motor|motor.M_w|not connected|components.motor.set")
    held = {**connect(torque=None), "components": {"motor": {"set": {"M_w": 0.5}}}}
    run_well(["check", edited_config("motor/lock.json", held)])


def test_an_input_connected_twice():
    edits = connect(again=["plant.torque", "motor.M_w"])
    expect_problem(edits, "connect[3][1]|motor.M_w|connect[0]|one connection")


def test_no_path():
    """The adjusted controller cannot affect the matched motor, because the motor's current is constant."""
    edits = {**connect(current=None), "components": {"motor": {"set": {"I_in": 0.3}}},
             "synchronise": {"adjust": {"motor.d": None, "drive.P": {"step": 1}}}}
    expect_problem(edits, "synchronise.adjust.drive.P|no path|matched")


def test_no_path_to_one_match():
    edits = {**connect(omega=["plant.omega", "drive.y"]),
             "synchronise": {"match": {"drive.e": {"to": "plant.omega", "tolerance": 1}}}}
    expect_problem(edits, "synchronise.match.drive.e|no path|\"weight\"|0")


def test_what_cannot_be_adjusted():
    for variable, parts in (("motor.J", "fixed parameter|input|tunable"), ("motor.omega", "continuous output|input|tunable"),
                            ("drive.Z_p", "Integer|input|tunable|Real|Boolean")):
        edits = {"synchronise": {"adjust": {variable: {"step": 1}}}}
        expect_problem(edits, f"synchronise.adjust.{variable}|{parts}")


def test_prediction_below_distance():
    adjust = {"motor.d": None, "drive.P": {"step": 1}}
    edits = {"synchronise": {"horizon": {"prediction": 1}, "adjust": adjust}}
    expect_problem(edits, "synchronise.horizon.prediction|1|2")
    edits = {"synchronise": {"horizon": {"prediction": 2}, "adjust": adjust}}
    expect_line(run_well(["check", edited_config("motor/lock.json", edits)]), "T_D = 2|T_P = 2")


def test_all_problems_at_once():
    """A line for each problem, and one with their number: those of the file or, if it has none, those of the twin."""
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
        lines = expect_refused(["check", config], BAD_DATA, f"error|{count} problems")
        expect(len(lines) == count + 1, f"{len(lines) - 1} lines instead of {count}:\n" + "\n".join(lines))
        for place in places:
            expect(any(place in line for line in lines), f"nothing about {place}:\n" + "\n".join(lines))


# ---- JSON ----

def test_malformed_and_hostile_json():
    good = FREE.read_text(encoding="utf-8")
    for text, parts in (
            ("", "line 1|end of|file"), (" \n\n", "line 3|end of|file"), ("[]", "line 1|array|object"),
            ("null", "line 1|null|object"), ('{"twinlock": 1,', "line 1, column 16|end of|file"),
            ('{"twinlock": 1 "name"', "line 1, column 16|}"), (good.replace("0.01", "1e999"), "line 4|1e999|1.7e308"),
            (good.replace("0.01", "NaN"), "line 4|NaN"), (good.replace("0.01", "01"), "line 4|01|zeros"),
            (good.replace("0.01", "1" * 64), "line 4|63"), (good.replace("0.01", "null"), "line 4|step_s|null"),
            (good + "x", "line 22, column 1|x"), (good.replace('"step_s"', '"name"'), "line 4|\"name\"|line 3"),
            ("[" * 100_000, "line 1|32"), ('{"a":' * 5000, "line 1|32"), (good + " " * 256 * 1024, "256 KiB"),
            ("\ufeff" + good, "line 1|byte order mark|UTF-8"), (bytes(range(256)), "UTF-8"),
            (b'{"name": "\xff"}', "line 1|0xFF|UTF-8"), (b'{"name": "\xc0\xaf"}', "line 1|0xC0|UTF-8"),
            (b'{"twinlock": \0 1}', "line 1|U+0000"), ('{"name": "\\ud800"}', "line 1|surrogate"),
            (b"PK\x03\x04" + bytes(500), "line 1|PK")):
        config = write_config(text)
        lines = expect_refused(["check", config], BAD_DATA, f"{config}|{parts}")
        expect(all(len(line) < 1200 for line in lines), f"a line of {max(map(len, lines))} characters")


def mutated(rng, good, pieces):
    """A copy of bytes with some of them replaced by one of `pieces`, or by any byte."""
    mutant = bytearray(good)
    for _ in range(rng.choice([1, 1, 2, 8])):
        at = rng.randrange(len(mutant))
        mutant[at:at + rng.choice([0, 1, 1, 30])] = rng.choice([*pieces, bytes([rng.randrange(256)])])
    return bytes(mutant)


def test_mutants_of_a_configuration():
    """The program accepts a mutant or rejects it with a message."""
    rng, good = random.Random(1), (SOURCE / "config" / "motor" / "lock.json").read_bytes()
    for _ in range(60):
        mutant = mutated(rng, good, [b"", b'"', b"{", b"9", b","])
        code, _, err = run(["check", write_config(mutant)])
        expect(code in (0, BAD_DATA, FMU_FAILED) and (code == 0 or err), f"{code}: {err}\n{mutant!r}")


# ---- FMUs ----

def changed_fmu(name, path, change):
    """Writes a changed copy of an FMU to `path`: `change` edits {entry: bytes}."""
    with zipfile.ZipFile(FMUS / f"{name}.fmu") as archive:
        entries = {entry: archive.read(entry) for entry in archive.namelist()}
    change(entries)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for entry, content in entries.items():
            archive.writestr(entry, content)


def expect_fmu_refused(change, parts, base="motor/free.json", code=BAD_DATA, edits=None):
    """`check` and `replay` reject the FMU; `change` as for changed_fmu(), `edits` change the configuration."""
    config = edited_config(base, edits)
    fmu = config.parent / "drive.fmu"
    changed_fmu("drive", fmu, change)
    for verb in ("check", "replay"):
        expect_refused([verb, config], code, f"{config}|line 7|components.drive|{parts}")


def binaries(entries):
    """The names of the shared objects, one for each machine of this build."""
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
    expect_problem({"components": {"drive": {"fmu": "nowhere.fmu"}}}, "components.drive|\"nowhere.fmu\"|TWINLOCK_FMU_PATH")
    expect_problem({"components": {"drive": {"fmu": str(FMUS)}}}, f"components.drive|\"{FMUS}\"|folder")


def test_broken_zips():
    good = (FMUS / "drive.fmu").read_bytes()
    middle = len(good) // 2
    for content in (b"", b"no zip at all", good[:middle], good[:-5], bytes(len(good)),
                    good[:middle] + bytes(64) + good[middle + 64:]):
        config = edited_config("motor/free.json")
        (config.parent / "drive.fmu").write_bytes(content)
        expect_refused(["check", config], BAD_DATA, f"components.drive|{config.parent / 'drive.fmu'}")


def test_mutants_of_an_fmu():
    """Nothing crashes if the bytes of the ZIP directory or the description change. The shared object stays as it is, because
    a loaded one can do anything."""
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
    expect_fmu_refused(lambda entries: entries.update({description: b""}), f"{description}|XML")
    expect_fmu_refused(lambda entries: entries.update({description: b"<fmiModelDescription>"}), f"{description}|fmiVersion")
    expect_fmu_refused(replace(description, b'fmiVersion="2.0"', b'fmiVersion="1.0"'), f"{description}|FMI 1.0|FMI 2.0")
    expect_fmu_refused(replace(description, b"<CoSimulation", b"<ModelExchange"), f"{description}|Model Exchange|Co-Simulation")


def test_a_wrong_guid():
    def change(entries):
        text = entries["modelDescription.xml"]
        entries["modelDescription.xml"] = re.sub(rb'guid="[^"]*"', b'guid="{another}"', text)

    expect_fmu_refused(change, "fmi2Instantiate|GUID|{another}", code=FMU_FAILED)


def test_another_machine():
    expect_fmu_refused(set_machine(8), "MIPS")
    expect_fmu_refused(move_to_windows, "win64")
    expect_fmu_refused(lambda entries: entries.update({name: b"MZ" for name in binaries(entries)}), "drive.so|ELF shared object")


def test_no_state():
    """An FMU without states runs free, but "rollback": "state" is rejected. test_rollback.py has the other methods."""
    change = replace("modelDescription.xml", b'canGetAndSetFMUstate="true"', b'canGetAndSetFMUstate="false"')
    expect_fmu_refused(change, "canGetAndSetFMUstate|\"rollback\": \"state\"", base="motor/lock.json",
                       edits={"components": {"drive": {"rollback": "state"}}})
    config = edited_config("motor/free.json")
    changed_fmu("drive", config.parent / "drive.fmu", change)
    run_well(["replay", config])


def test_an_fmu_that_refuses():
    """The FMU's own error ends the run with exit code 70, and its message is logged."""
    config = edited_config("motor/free.json", {"components": {"drive": {"set": {"t_step": -1}}}})
    expect_refused(["replay", config], FMU_FAILED, "error|drive|fmi2ExitInitializationMode|t_step|-1", "error|drive|fmi2Error")


# ---- recordings ----

def expect_recording_refused(content, parts, config=FREE):
    path = scratch() / "plant.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    expect_refused(["replay", config, "--recording", path], BAD_DATA, f"{path}|{parts}")


def test_recordings():
    expect_recording_refused("", "empty|columns")
    expect_recording_refused("t,omega,M_brake\n", "header|row")
    expect_recording_refused("t,omega\n0,1\n", "line 1|column|\"M_brake\"|t, omega")
    expect_recording_refused("time,omega,M_brake\n0,1,2\n", "line 1|column|\"t\"|time, omega, M_brake")
    expect_recording_refused("t,omega,omega,M_brake\n0,1,2,3\n", "line 1|column|\"omega\"|2")
    expect_recording_refused("t,omega,M_brake\n0,1,2\n1,1,2\n0.5,1,2\n", "line 4|0.500000000 s|1.000000000 s")
    expect_recording_refused("t,omega,M_brake\n0,1\n", "line 2|2 cells|3")
    expect_recording_refused("t,omega,M_brake\nnoon,1,2\n", "line 2|\"noon\"|seconds|-4.6e9|4.6e9")
    expect_recording_refused("t,omega,M_brake\n1e300,1,2\n", "line 2|\"1e300\"|-4.6e9|4.6e9")
    expect_recording_refused("t,omega,M_brake\nnan,1,2\n", "line 2|\"nan\"|-4.6e9|4.6e9")
    expect_recording_refused(bytes(10_000), "line 1|column|\"t\"")
    expect_recording_refused(b"SQLite format 3\0" + bytes(8000), "SQLite|another program")
    expect_recording_refused(b"SQLite format 3\0", "database|16 bytes")
    expect_recording_refused("t,omega,M_brake\n0," + "1" * 2_000_000 + ",2\n", "line 2|65536 bytes")


def test_values_that_are_no_numbers_are_left_out():
    """In a recording such a value is a sample of bad quality, not an error. The twin counts them and continues."""
    path = scratch() / "plant.csv"
    rows = [f"{i * 0.01:.2f},{'n/a' if 20 <= i < 40 else 62.9},0.01" for i in range(101)]
    path.write_text("t,omega,M_brake\n" + "\n".join(rows) + "\n", encoding="utf-8")
    lock = edited_config("motor/lock.json", {"delays": None, "synchronise": {"match": {"motor.omega": {"between": "last", "condition": None}}}})
    out = run_well(["replay", lock, "--recording", path, "--verbose"])
    expect_line(out, "20 of 100|measurements")
    expect_line(out, "steps|20 free run")
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
        expect_refused([verb, folder / "absent"], BAD_DATA, f"{folder / 'absent'}|No such file")
    from_absent = ["--recording", folder / "absent.csv"]
    expect_refused(["replay", FREE, *from_absent], BAD_DATA, "absent.csv|No such file")
    expect_refused(["plant", FREE, *from_absent, "--record", folder / "new.csv"], BAD_DATA, "absent.csv|No such file")
    expect_refused(["plant", FREE, "--for", folder / "absent.json"], BAD_DATA, "absent.json|No such file", "absent.json|--for")
    expect(not list(folder.iterdir()), "a file was made")


def test_sources_that_are_not_played():
    config = edited_config("motor/live.json", {"sources": {"inverter": {"modbus_tcp": {"framing": "rtu"}}}})
    expect_refused(["plant", config], BAD_USAGE, "inverter|framing rtu", f"{config}|Modbus TCP|--for")


def test_folders_instead_of_files():
    folder = scratch()
    for verb in ("check", "replay", "run", "plant"):
        expect_refused([verb, folder], BAD_DATA, f"{folder}|Is a directory")
    expect_refused(["show", folder], BAD_DATA, str(folder))
    expect_refused(["replay", FREE, "--recording", folder], BAD_DATA, f"{folder}|no files")
    expect_refused(["replay", FREE, "--csv", folder], TRY_AGAIN, f"{folder}|Is a directory")
    expect_refused(["replay", FREE, "--db", folder], BAD_DATA, str(folder))


def test_a_fifo_is_no_recording():
    fifo = scratch() / "fifo"
    os.mkfifo(fifo)
    expect_refused(["replay", FREE, "--recording", fifo], BAD_DATA, f"{fifo}|FIFO|twinlock run")


def test_a_recording_of_one_row():
    short = scratch() / "short.csv"
    short.write_text("t,omega,M_brake\n0,62.9,0\n", encoding="utf-8")
    expect_refused(["replay", FREE, "--recording", short], BAD_DATA, "recording|too short|1|0.01 s|2")


def test_a_result_that_cannot_be_written():
    for args in (["replay", FREE], ["replay", FREE, "--json"], ["check", FREE]):
        with open("/dev/full", "w", encoding="utf-8") as full:
            done = subprocess.run([os.environ["TWINLOCK"], *map(str, args)], stdout=full, stderr=subprocess.PIPE,
                                  text=True, check=False, env={**os.environ, "TWINLOCK_FMU_PATH": str(FMUS)})
        expect(done.returncode == TRY_AGAIN and has_line(done.stderr, "error|No space left on device"),
               f"{args}: {done.returncode}, {done.stderr}")


def test_no_recording():
    config = SOURCE / "config" / "emps" / "free.json"
    for args in (["replay", config], ["plant", config, "--record", scratch() / "new.csv"]):
        expect_refused(args, BAD_USAGE, f"{config}|--recording FILE")


def test_outputs_that_cannot_be_written():
    nowhere = scratch() / "absent"
    expect_refused(["replay", FREE, "--csv", nowhere / "x.csv"], TRY_AGAIN, "x.csv|No such file")
    expect_refused(["replay", FREE, "--csv", "/dev/full"], TRY_AGAIN, "/dev/full|No space left on device")
    expect_refused(["replay", FREE, "--db", nowhere / "x.db"], TRY_AGAIN, "x.db|No such file")
    expect_refused(["run", LIVE, "--db", nowhere / "x.db"], TRY_AGAIN, "x.db|No such file")
    code, _, err = run(["plant", FREE, "--record", nowhere / "x.csv"])
    expect(code in (BAD_DATA, TRY_AGAIN) and has_line(err, "x.csv|No such file"), f"{code}: {err}")
    expect(not nowhere.exists(), "a folder was made")


def test_a_reader_that_leaves():
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write, "w") as gone:
        code, _, err = run(["replay", FREE, "--csv", "-"], stdout=gone)
    expect(code == TRY_AGAIN and err.count("\n") == 1 and has_line(err, "error|Broken pipe") and "space" not in err, f"{code}: {err}")


def limit_files():
    """Runs in the child before the program: writing more than 20 kB into a file fails, as on a full disk."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)


def test_a_disk_that_gets_full():
    path = scratch() / "new.csv"
    code, _, err = run(["plant", FREE, "--record", path], preexec_fn=limit_files, restore_signals=False)
    expect(code == TRY_AGAIN, f"{code}: {err}")
    expect_line(err, f"error|{path}|File too large|387")
    expect_no_line(err, "reader")
    expect(path.stat().st_size == 20_000, f"{path.stat().st_size} bytes")


def test_nothing_of_the_users_is_overwritten():
    """Neither a file that is no database, nor an existing recording, nor an input of the same run."""
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
        expect_refused(args, BAD_DATA, f"{notes}|twinlock database|SQLite")
    expect_refused(["plant", config, "--record", recording], BAD_DATA, f"{recording}|File exists|remove|mkfifo")
    for target in (recording, link, config, fmu):
        for option in ("--csv", "--report"):
            expect_refused(["replay", config, "--recording", recording, option, target], BAD_USAGE, f"{option}|{target}|overwrite")
    for path, content in kept.items():
        expect(path.read_bytes() == content, f"{path.name} was overwritten")


def test_a_database_replaces_no_other_file():
    """Neither a file at its path that is no database, nor a file with a similar name."""
    folder = scratch()
    fifo, dangling, empty, beside = folder / "fifo.db", folder / "link.db", folder / "empty.db", folder / "keep.db.new"
    os.mkfifo(fifo)
    dangling.symlink_to("absent")
    empty.touch()
    beside.write_text("mine", encoding="utf-8")
    for path, parts in ((fifo, "file"), (dangling, "symbolic link"), (empty, "twinlock database|0 bytes")):
        for args in (["replay", FREE, "--db", path], ["run", LIVE, "--db", path]):
            expect_refused(args, BAD_DATA, f"error|{path}|{parts}")
    expect_refused(["replay", FREE, "--db", ""], BAD_USAGE, "error|database|empty")
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
        expect_refused(["plant", config], TRY_AGAIN, f"127.0.0.1|{port}|Address already in use")


# ---- the command line ----

def test_wrong_usage():
    seeds = [["plant", FREE, "--seed", seed] for seed in ("x", "-1", "", "9" * 30, "1.5", "1 ")]
    for args in ([], ["nonsense"], ["--nonsense"], ["check", FREE, FREE], *([verb] for verb in VERBS),
                 *([verb, "--nonsense", FREE] for verb in VERBS), ["replay", FREE, "--recording"],
                 ["replay", FREE, "--json=yes"], ["plant", FREE, "--fifo", "a", "--record", "b"], *seeds):
        found, out, err = run(args)
        expect(found == BAD_USAGE and out == "" and err, f"twinlock {args}: {found}, {out!r}, {err!r}")
    expect_refused(["plant", FREE], BAD_USAGE, f"{FREE}|Modbus TCP|CAN|--for|--fifo|--record")


def test_what_was_probably_meant():
    """The message has the unknown word and the most similar known one, and nothing runs."""
    for args, parts in (
            (["rply", FREE], "verb|\"rply\"|replay"),
            (["help", "shw"], "verb|\"shw\"|show"),
            (["--json", "replay", FREE], "verb|\"--json\"|options"),
            (["run", LIVE, "--duraton", "3"], "option|--duraton|--duration"),
            (["run", LIVE, "--Status"], "option|--Status|--status"),
            (["replay", FREE, "--recordings=a.csv"], "option|--recordings|--recording"),
            (["run", LIVE, "--plain"], "option|--plain|replay"),
            (["check", FREE, "--csv", "a"], "option|--csv|replay, show"),
            (["plant", FREE, "--rec", "a"], "options|--rec|--recording|--record"),
            (["plant", FREE, "-s", "1"], "option|-s"),
            (["replay", FREE, "--quite-another"], "option|--quite-another"),
            (["replay", FREE, "--json=yes"], "--json|value|\"--json=yes\""),
            (["replay", FREE, "--recording"], "--recording|FILE"),
            (["check"], "configuration|none"),
            (["check", FREE, LIVE], f"configuration|\"{FREE}\"|\"{LIVE}\""),
            (["show", "a.db", "--json", "--report", "b"], "--json|--csv|--report"),
            (["plant", FREE, "--fifo", "a", "--record", "b"], "--fifo|--record")):
        lines = expect_refused(args, BAD_USAGE)
        expect_line(lines[0], parts)
        if args[0] in VERBS:
            help_line = f"usage: twinlock {args[0]} {'DATABASE' if args[0] == 'show' else 'CONFIG'} [options]"
            expect(len(lines) == 2 and lines[1].startswith(help_line), f"{args}: {lines}")


def test_a_plant_leaves_out_what_it_cannot_serve():
    """It reports GPIO lines and serial lines of the listener; they are no error."""
    lines = edited_config(PLAIN_BOX, {
        "sources": {"bus": None, "inverter": {"modbus_tcp": None, "modbus_rtu": {"device": "/dev/ttyS1"}}},
        "plant": {"omega": {"can": None}}})
    expect_refused(["plant", SOURCE / "config" / "motor" / "box_plant.json", "--for", lines], BAD_USAGE,
                   "notice|panel|GPIO", "notice|inverter|Modbus RTU", f"error|{lines}|Modbus TCP|CAN")


def test_values_in_messages_of_usage_and_start():
    for duration in ("1e300", "1e9", "0", "nan"):
        expect_refused(["run", LIVE, "--duration", duration], BAD_USAGE, f"--duration|\"{duration}\"|seconds|0|1e9")
    error, = expect_refused(["check", "/nope/x.json"], BAD_DATA, "error|/nope/x.json|No such file")
    expect(error.count("/nope/x.json") == 1, error)
    code, _, err = run(["run", SOURCE / "config" / "motor" / "lock.json"])
    expect(code == BAD_DATA and not has_line(err, '"record"'), f"{code}: {err}")
    for name, signals in (("plant.json", "1 signal"), ("lock.json", "2 signals")):
        expect_line(run_well(["check", SOURCE / "config" / "motor" / name]), signals)


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
