#!/usr/bin/env python3
"""`twinlock init`: a first configuration, which passes `check` and locks onto a recording."""
import contextlib
import json
import math
import signal
import subprocess

from twinlock_test import (BAD_DATA, BAD_USAGE, SOURCE, expect, expect_line, finish, main, read_config, replay_json, run,
                           run_well, scratch, start)

RECORDING = SOURCE / "config/motor/recording.csv"


def recording(*replacements):
    """The motor's recording with other names in its header."""
    header, rows = RECORDING.read_text(encoding="utf-8").split("\n", 1)
    for old, new in replacements:
        header = header.replace(old, new)
    path = scratch() / "own.csv"
    path.write_text(header + "\n" + rows, encoding="utf-8")
    return path


def init(*args, code=0):
    """The new configuration as a document, its path, and what the command printed."""
    path = scratch() / "new.json"
    ended, out, err = run(["init", *args, "--output", path])
    expect(ended == code, f"ended with {ended}: {err}")
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else None, path, out + err


def connected(document):
    return sorted(map(tuple, document["connect"]))


def test_a_recording():
    """By name; the drive by units, because its names differ. The twin locks without an edit."""
    document, path, out = init("drive.fmu", "motor.fmu", "--recording", recording(("M_brake", "M_w")), "--step", "0.01")
    expect(document["components"]["motor"]["set"] == {"omega_start": "plant.omega"}, f"set: {document['components']['motor']}")
    expect("plant.omega → motor.omega_start" in out, out)
    expect(connected(document) == [("drive.u_R", "motor.I_in"), ("motor.omega", "drive.y"), ("plant.M_w", "motor.M_w")],
           f"connected: {document['connect']}")
    expect(list(document["synchronise"]["adjust"]) == ["motor.d"], f"adjusted: {document['synchronise']['adjust']}")
    match = document["synchronise"]["match"]
    expect(list(match) == ["motor.omega"] and match["motor.omega"]["to"] == "plant.omega", f"matched: {match}")
    expect(set(document["fill_in"]) == {"components.drive.set.ref", "connect motor.I_in", "connect drive.y"},
           f"to fill in: {document['fill_in']}")
    expect(document["step_s"] == 0.01 and document["components"]["drive"]["set"]["ref"] == 10, "step or constant")
    code, out, err = run(["check", path])
    expect(code == 0, err)
    expect_line(out, "fill_in|components.drive.set.ref")
    summary = replay_json(path)
    expect(summary["lock"]["percent"] > 99, f"in lock: {summary['lock']['percent']} %")


def test_a_variable_that_does_not_lock():
    """The plant has three times the inertia of the FMU. Friction, within the guessed bounds, cannot accelerate the motor, so the current is adjusted,
    although the plant measures it."""
    folder = scratch()
    plant = read_config(SOURCE / "config/motor/plant.json")
    plant["components"]["motor"]["set"]["J"] = 0.0045
    brake = "".join(f"{i},{1.3 * (i % 2)}\n" for i in range(16))
    (folder / "brake.csv").write_text(f"t,torque\n{brake}", encoding="utf-8")
    plant["emulate"] = {"columns": {"omega": {"from": "motor.omega", "noise": 0.3}, "M_w": {"from": "plant.torque"}, "I_in": {"from": "drive.u_R"}}}
    (folder / "plant.json").write_text(json.dumps(plant), encoding="utf-8")
    run_well(["plant", folder / "plant.json", "--record", folder / "own.csv"])
    document, path, _ = init("motor.fmu", "--recording", folder / "own.csv", "--step", "0.01")
    expect(list(document["synchronise"]["adjust"]) == ["motor.I_in"], f"adjusted: {document['synchronise']['adjust']}")
    expect("synchronise.adjust.motor.I_in" in document["fill_in"], f"to fill in: {document['fill_in']}")
    summary = replay_json(path)
    expect(summary["lock"]["percent"] > 99, f"in lock: {summary['lock']['percent']} %")


def test_run_waits_for_what_is_to_fill_in():
    document, path, _ = init("motor.fmu", "--modbus", "127.0.0.1:1502")
    expect(document["sources"]["plc"]["modbus_tcp"] == {"host": "127.0.0.1", "port": 1502}, "no device")
    expect({"step_s", "plant.omega.modbus", "plant.M_w.modbus", "plant.I_in.modbus"} < set(document["fill_in"]),
           f"to fill in: {document['fill_in']}")
    code, _, err = run(["run", path])
    expect(code == BAD_DATA, f"ended with {code}")
    expect_line(err, "fill_in|step_s")
    code, _, err = run(["check", path])
    expect(code == 0, err)


def test_addresses_of_ipv6():
    for text, wanted in (("[::1]:502", {"host": "::1", "port": 502}), ("::1", {"host": "::1"}), ("[::1]", {"host": "::1"})):
        document, _, _ = init("lag.fmu", "--modbus", text)
        expect(document["sources"]["plc"]["modbus_tcp"] == wanted, f"{text}: {document['sources']}")


def test_names_as_people_write_them():
    """Units in brackets, other case, the description of the variable."""
    document, _, out = init("motor.fmu", "--recording", recording(("omega", "Speed [rad/s]"), ("M_brake", "motor m_w (N.m)")))
    expect(document["plant"]["Speed"] == {"unit": "rad/s", "csv": {"column": "Speed [rad/s]"}} | document["plant"]["Speed"],
           f"plant: {document['plant']}")
    expect(connected(document) == [("plant.motor_m_w", "motor.M_w")], f"connected: {document['connect']}")
    expect(document["synchronise"]["match"]["motor.omega"]["to"] == "plant.Speed", out)
    expect(not any(key.endswith(".unit") for key in document["fill_in"]), f"to fill in: {document['fill_in']}")


def test_a_word_of_a_description():
    document, _, _ = init("drive.fmu", "motor.fmu", "--recording", recording(("M_brake", "torque")))
    expect(("plant.torque", "motor.M_w") in connected(document), f"connected: {document['connect']}")
    expect("connect motor.M_w" in document["fill_in"], f"to fill in: {document['fill_in']}")


def scaled_recording(header, column, factor):
    """The motor's recording with another header and one column in another unit."""
    lines = RECORDING.read_text(encoding="utf-8").splitlines()
    at = lines[0].split(",").index(column)
    rows = [line.split(",") for line in lines[1:]]
    for row in rows:
        row[at] = repr(float(row[at]) / factor)
    path = scratch() / "own.csv"
    path.write_text("\n".join([header, *[",".join(row) for row in rows], ""]), encoding="utf-8")
    return path


def test_another_unit_is_converted():
    """Tolerances are estimated in the FMU's unit, and the twin locks without an edit."""
    rpm = math.pi / 30
    header = RECORDING.read_text(encoding="utf-8").splitlines()[0]
    names = header.replace("omega", "omega [rpm]").replace("M_brake", "M_w")
    document, path, out = init("drive.fmu", "motor.fmu", "--recording", scaled_recording(names, "omega", rpm), "--step",
                               "0.01")
    csv = document["plant"]["omega"]["csv"]
    expect(csv["column"] == "omega [rpm]" and math.isclose(csv["scale"], rpm) and "offset" not in csv, f"csv: {csv}")
    expect(document["plant"]["omega"]["unit"] == "rad/s", f"unit: {document['plant']['omega']}")
    expect_line(out, "plant.omega.csv|rpm -> rad/s: 0.10472;")
    expect("plant.omega.unit" not in document["fill_in"], f"to fill in: {document['fill_in']}")
    plain, _, _ = init("drive.fmu", "motor.fmu", "--recording", recording(("M_brake", "M_w")), "--step", "0.01")
    tolerance = [one["synchronise"]["match"]["motor.omega"]["tolerance"] for one in (document, plain)]
    expect(math.isclose(*tolerance, rel_tol=0.01), f"tolerances: {tolerance}")
    summary = replay_json(path)
    expect(summary["lock"]["percent"] > 99, f"in lock: {summary['lock']['percent']} %")


def test_one_unit_with_two_names_needs_no_scale():
    document, _, _ = init("motor.fmu", "--recording", recording(("M_brake", "M_w [Nm]")))
    expect(document["plant"]["M_w"]["csv"] == {"column": "M_w [Nm]"}, f"plant: {document['plant']['M_w']}")
    expect(not any(key.startswith("plant.M_w") for key in document["fill_in"]), f"to fill in: {document['fill_in']}")


def test_another_unit_is_to_fill_in():
    """Neither an unknown unit nor one of another dimension is converted."""
    for unit in ("furlong/h", "bar"):
        document, _, _ = init("motor.fmu", "--recording", recording(("omega", f"omega [{unit}]"), ("M_brake", "M_w")))
        expect("plant.omega.unit" in document["fill_in"], f"to fill in: {document['fill_in']}")
        expect("scale" not in document["plant"]["omega"]["csv"], f"plant: {document['plant']['omega']}")


def test_the_last_signal_and_the_last_input():
    document, _, _ = init("drive.fmu", "motor.fmu", "--recording", recording(("M_brake", "brake")))
    expect("plant.brake" in document["fill_in"], "two inputs are left: nothing to guess")
    document, _, _ = init("emps.fmu", "--recording", column_file("v", "current"))
    expect(connected(document) == [("plant.current", "emps.F")] and "connect emps.F" in document["fill_in"],
           f"connected: {document['connect']}; to fill in: {document['fill_in']}")


def column_file(*names):
    path = scratch() / "own.csv"
    rows = [f"{i / 100},{','.join(str((i % 7) / 7) for _ in names)}" for i in range(400)]
    path.write_text("\n".join([",".join(["time", *names]), *rows, ""]), encoding="utf-8")
    return path


def test_a_logger_with_many_columns():
    """The columns that fit are used, wherever they are; the header may have a comma in a unit."""
    names = [f"x{i}" for i in range(80)]
    rows = [line.split(",") for line in RECORDING.read_text(encoding="utf-8").splitlines()]
    path = scratch() / "logger.csv"
    rows[0][1:] = ["omega, rad/s", "M_w"]
    path.write_text("".join(";".join([row[0], *(names if i == 0 else ["1"] * 80), *row[1:]]) + "\n" for i, row in enumerate(rows)),
                    encoding="utf-8")
    document, _, out = init("drive.fmu", "motor.fmu", "--recording", path, "--step", "0.01")
    expect(("plant.M_w", "motor.M_w") in connected(document), f"connected: {document['connect']}")
    expect(len(document["plant"]) <= 64, f"{len(document['plant'])} signals")
    expect_line(out, "notice|signals|left out")


def test_a_header_in_latin_1():
    path = scratch() / "latin.csv"
    path.write_bytes("t,omega [°/s]\n0,1\n1,2\n".encode("latin-1"))
    document, _, out = init("motor.fmu", "--recording", path, code=BAD_DATA)
    expect(document is None, "written")
    expect_line(out, "latin.csv|UTF-8|iconv")


def test_nothing_fits():
    document, path, _ = init("motor.fmu", "--recording", column_file("a", "b"))
    expect({"plant.a", "plant.b", "synchronise.match"} < set(document["fill_in"]), f"to fill in: {document['fill_in']}")
    expect("synchronise" not in document and "compare" not in document, "matched")
    code, _, err = run(["check", path])
    expect(code == 0, err)


def test_two_of_one_fmu():
    """Each variable reacts alone; an output that nothing adjusted reaches is only compared."""
    document, path, _ = init("motor.fmu", "motor.fmu")
    expect(set(document["components"]) == {"motor", "motor_2"}, "components")
    expect(len(document["synchronise"]["adjust"]) == 2, f"adjusted: {document['synchronise']['adjust']}")
    code, _, err = run(["check", path])
    expect(code == 0, err)


def test_signals_of_a_file():
    """Sources and signals that are known, for example of a DBC file."""
    given = read_config(SOURCE / "config/motor/can.json")
    path = scratch() / "signals.json"
    path.write_text(json.dumps({"sources": given["sources"], "plant": given["plant"]}), encoding="utf-8")
    document, _, _ = init("motor.fmu", "--plant", path, "--step", "0.01")
    expect(document["sources"] == given["sources"] and document["plant"] == given["plant"], "not as given")
    expect(list(document["synchronise"]["match"]) == ["motor.omega"], "not matched")
    for text, wrong in (('{"plant": {}}', "plant"), ("{", "signals.json"), ('{"plant": 1}', "plant")):
        path.write_text(text, encoding="utf-8")
        document, _, out = init("motor.fmu", "--plant", path, code=BAD_DATA)
        expect(document is None, "written")
        expect_line(out, f"error|{wrong}")


def test_units_of_given_signals():
    """The FMU's unit and its scale, after the driver's own scale; `fill_in` says so."""
    path = scratch() / "signals.json"
    plant = {"omega": {"unit": "rpm", "modbus": {"source": "plc", "table": "input", "address": 0, "type": "int16", "scale": 0.5}},
             "M_w": {"unit": "furlong", "modbus": {"source": "plc", "table": "input", "address": 1, "type": "int16"}}}
    path.write_text(json.dumps({"sources": {"plc": {"modbus_tcp": {"host": "192.0.2.1"}}}, "plant": plant}), encoding="utf-8")
    document, new, _ = init("motor.fmu", "--plant", path, "--step", "0.01")
    omega = document["plant"]["omega"]
    expect(omega["unit"] == "rad/s" and abs(omega["modbus"]["scale"] / 0.05235987755982989 - 1) < 1e-12, f"omega: {omega}")
    expect(document["plant"]["M_w"]["unit"] == "N.m" and "scale" not in document["plant"]["M_w"]["modbus"], "M_w")
    expect({"plant.omega.unit", "plant.M_w.unit"} < set(document["fill_in"]), f"to fill in: {document['fill_in']}")
    code, _, err = run(["check", new])
    expect(code == 0, err)


def test_a_given_plant_that_is_wrong():
    path = scratch() / "signals.json"
    for plant in ({"omega": 5, "M_w": [1, 2]}, {"x" * 64: {}}, {"omega": {"csv": {"column": 7}}}):
        path.write_text(json.dumps({"plant": plant}), encoding="utf-8")
        document, _, out = init("motor.fmu", "--plant", path, code=BAD_DATA)
        expect(document is None, "written")
        expect_line(out, "error|signals.json")
        expect(out.count("error") <= len(plant) + 1, out)


def test_files_that_cannot_be_used():
    path = scratch() / "bad.fmu"
    path.write_bytes(b"no archive")
    for args, what in (([path], "bad.fmu"), (["nowhere.fmu"], "nowhere.fmu"),
                       (["motor.fmu", "--recording", "nowhere.csv"], "nowhere.csv"),
                       (["motor.fmu", "--recording", "/dev"], "/dev"), (["motor.fmu", "--plant", "nowhere.json"], "nowhere.json")):
        document, _, out = init(*args, code=BAD_DATA)
        expect(document is None, "written")
        expect_line(out, f"error|{what}")


def test_an_fmu_that_does_not_start():
    """What is known is written; the exit code and the FMU's message say that it does not pass a check."""
    document, _, out = init("csv.fmu", code=70)
    expect(document["components"]["csv"]["fmu"] == "csv.fmu", "not written")
    expect_line(out, "error|no file is named")


def test_usage():
    for args in ([], ["motor.fmu", "--step", "0"], ["motor.fmu", "--modbus", "box:0"], ["motor.fmu", "--modbus", "box:x"],
                 ["motor.fmu", "--modbus", ""], ["motor.fmu", "--modbus", ":502"], ["motor.fmu", "--modbus", "[::1"],
                 ["motor.fmu"] * 63):
        document, _, _ = init(*args, code=BAD_USAGE)
        expect(document is None, "written")


def test_an_existing_file_stays():
    folder = scratch()
    path = folder / "motor.json"
    path.write_text("mine", encoding="utf-8")
    code, _, err = run(["init", "motor.fmu"], cwd=folder)
    expect(code == BAD_USAGE and path.read_text(encoding="utf-8") == "mine", "overwritten")
    expect_line(err, "motor.json|--output")
    path.unlink()
    code, _, err = run(["init", "motor.fmu"], cwd=folder)
    expect(code == 0 and path.exists(), err)


def test_interrupted():
    """Nothing is left: neither a configuration nor a process."""
    folder = scratch()
    program = start(["init", "tennessee.fmu", "tennessee_control.fmu"], cwd=folder)
    with contextlib.suppress(subprocess.TimeoutExpired):
        program.wait(0.3)
    program.send_signal(signal.SIGINT)
    code, out, err = finish(program)
    expect(code != 0, f"{out}{err}")
    expect(not list(folder.iterdir()), "written")


if __name__ == "__main__":
    main()
