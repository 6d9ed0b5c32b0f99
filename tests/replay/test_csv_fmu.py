#!/usr/bin/env python3
"""The CSV FMU as a component: its outputs have the bits of the plant's signals, and it can be rolled back."""
from twinlock_test import SOURCE, edited_config, expect, expect_line, main, replay_csv, replay_json, run

RECORDING = SOURCE / "config" / "motor" / "recording.csv"
MOTOR, READER = "motor.omega", {"fmu": "csv.fmu", "set": {"file": str(RECORDING), "time_column": "t", "column1": "M_brake"}}
CONNECT = [["brake.y1", "motor.M_w"], ["drive.u_R", "motor.I_in"], ["motor.omega", "drive.y"]]


def with_reader(name, **settings):
    """A configuration of the motor bench whose brake torque comes from the FMU."""
    reader = {**READER, "set": {**READER["set"], **settings}}
    return edited_config(f"motor/{name}.json", {"components": {"brake": reader}, "connect": CONNECT,
                                                "plant": {"torque": None}})


def test_the_same_as_the_plant_to_the_bit():
    by_plant, by_reader = replay_csv("motor/free.json"), replay_csv(with_reader("free"))
    expect(by_reader[MOTOR] == by_plant[MOTOR] and len(by_plant[MOTOR]) == 1401, "the motor's speed differs")


def test_it_is_rolled_back():
    """A synchronised twin repeats its steps. The results must be the same, executed or cached."""
    config = with_reader("lock")
    saved, plain = replay_csv(config), replay_csv(config, "--plain")
    expect(saved == plain, "with and without saving executions differ")
    by_plant = replay_csv("motor/lock.json")
    expect(saved[MOTOR] == by_plant[MOTOR], "the locked speed differs from that with the plant's signal")
    executions = replay_json(config, "--plain")["executions"]
    expect(executions["brake"] > 1401, f"executions: {executions}")


def test_its_errors_are_logged():
    for settings, parts in (({"file": "nothing.csv"}, "error|nothing.csv|No such file"), ({"column1": "x"}, 'error|column "x"')):
        code, _, err = run(["replay", with_reader("free", **settings)])
        expect(code == 70, f"exit code {code}\n{err}")
        expect_line(err, parts)


main()
