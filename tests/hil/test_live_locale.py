#!/usr/bin/env python3
"""A live CSV source and its replay, although an FMU sets a locale with a decimal comma in the
process."""
from comma_locale import comma_config, comma_locale, write_rows
from live_test import GOOD, qualities
from twinlock_test import expect, main, read_table, run_well, scratch, write_config

ROWS = 50


def test_run():
    folder = scratch()
    values = write_rows(folder / "live.csv", ROWS)
    database, steps = folder / "run.db", folder / "steps.csv"
    config = write_config(comma_config(sources={"file": {"csv": {"file": "live.csv"}}}, duration_s=0.6,
                                       plant={"u": {"csv": {"source": "file"}}}), folder)
    with comma_locale():
        run_well(["run", config, "--db", database])
        run_well(["replay", config, "--recording", database, "--csv", steps])
    table = read_table(steps)
    read = set(table["comma.y"])
    expect(table["comma.commas"][-1] > 0, "the FMU has set no locale")
    expect(read <= {0.0, *values} and len(read) > 5, f"other values than in the file: {table['comma.y']}")
    expect(qualities(database, "u")[-1] == GOOD, f"qualities: {qualities(database, 'u')}")


main()
