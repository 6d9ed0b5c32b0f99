#!/usr/bin/env python3
"""An FMU that calls setlocale() changes no number that is read or written."""
from comma_locale import comma_config, comma_locale, write_rows
from twinlock_test import expect, main, read_table, run_well, scratch, write_config

ROWS = 50


def replay(folder, name, *options):
    """The steps of a replay."""
    steps = folder / f"{name}.csv"
    run_well(["replay", folder / "config.json", "--csv", steps, *options])
    return read_table(steps)


def replay_twice(folder, name):
    """The steps of a replay from CSV, which records a database, and of a replay of this database."""
    database = folder / f"{name}.db"
    return [replay(folder, name, "--db", database), replay(folder, f"{name} again", "--recording", database)]


def test_replay():
    folder = scratch()
    values = write_rows(folder / "recording.csv", ROWS)
    write_config(comma_config(recording={"file": "recording.csv"}), folder)
    plain = replay_twice(folder, "plain")
    with comma_locale():
        comma = replay_twice(folder, "comma")
    for steps, same in zip(plain, comma):
        expect(steps["comma.commas"][-1] == 0, "the FMU found the locale without its being made")
        expect(same["comma.commas"] == [float(i + 1) for i in range(ROWS - 1)], "the FMU did not find the locale")
        expect(steps["comma.y"] == values[:-1], f"not what was recorded: {steps['comma.y']}")
        expect(same["comma.y"] == steps["comma.y"], f"other outputs: {same['comma.y']}")


main()
