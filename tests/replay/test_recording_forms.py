#!/usr/bin/env python3
"""Recordings as people have them: the same rows in other forms give the same twin, bit by bit."""
import csv
import gzip
import json
import lzma
from datetime import datetime, timedelta, timezone
from decimal import Decimal

from twinlock_test import BAD_DATA, SOURCE, edited_config, expect, expect_line, main, run, run_well, scratch

LOCK = SOURCE / "config/motor/lock.json"
COLUMNS = ("t", "omega", "M_brake")
BEGIN = datetime(2026, 10, 25, 0, 59, 58, tzinfo=timezone.utc)  # 2 s before the end of summer time in Europe
ROWS = [[row[name] for name in COLUMNS] for row in csv.DictReader((SOURCE / "config/motor/recording.csv").open(encoding="utf-8"))]


def comma(text):
    return text.replace(".", ",")


def date(t, form="%Y-%m-%dT%H:%M:%S", zone=0, point="."):
    """The date of a time of the recording, with nine digits of a second."""
    whole, nanoseconds = divmod(int(Decimal(t) * 10**9), 10**9)
    moment = BEGIN + timedelta(seconds=whole, hours=zone)
    return f"{moment.strftime(form)}{point}{nanoseconds:09d}"


def replayed(text, encoding="utf-8"):
    """Rows of the replay of a recording with this text, and what it printed."""
    folder = scratch()
    path, result = folder / "own.csv", folder / "result.csv"
    path.write_bytes(text.encode(encoding))
    code, _, err = run(["replay", LOCK, "--recording", path, "--csv", result])
    expect(code == 0, err)
    return result.read_bytes(), err


def expect_refused(path, parts):
    code, _, err = run(["replay", LOCK, "--recording", path])
    expect(code == BAD_DATA, f"ended with {code}")
    expect_line(err, f"{path}|{parts}")


def lines(rows, separator=",", end="\n"):
    return "".join(separator.join(row) + end for row in rows)


def expect_same(rows, form, **written):
    expected, _ = replayed(lines([COLUMNS, *ROWS]))
    result, err = replayed(lines(rows, **written))
    expect(result == expected, "another twin")
    expect_line(err, form)


def test_semicolons_and_decimal_commas():
    rows = [COLUMNS, *[[comma(cell) for cell in row] for row in ROWS]]
    expect_same(rows, "own.csv|semicolons", separator=";", end="\r\n")


def test_tabs_and_units_in_milliseconds():
    rows = [COLUMNS, ["ms", "rad/s", "Nm"], *[[str(Decimal(t) * 1000), *rest] for t, *rest in ROWS]]
    expect_same(rows, "own.csv|tabs|ms", separator="\t")


def test_dates_with_an_hour_that_comes_twice():
    rows = [COLUMNS]
    for t, *rest in ROWS:
        zone = 2 if Decimal(t) < 2 else 1
        rows.append([f"{date(t, zone=zone)}+0{zone}:00", *rest])
    expect_same(rows, "own.csv|dates")


def test_dates_of_a_spreadsheet():
    rows = [COLUMNS, *[[date(t, "%d.%m.%Y %H:%M:%S", point=","), *map(comma, rest)] for t, *rest in ROWS]]
    expect_same(rows, "own.csv|semicolons|UTC", separator=";")


def test_an_event_has_two_rows():
    """Simulation tools write the values before and after an event: the later row counts."""
    rows = [COLUMNS]
    for i, row in enumerate(ROWS):
        rows += [[row[0], "1e3", "5"], row] if i % 7 == 0 else [row]
    expected, _ = replayed(lines([COLUMNS, *ROWS]))
    result, _ = replayed(lines(rows))
    expect(result == expected, "another twin")


def scaled():
    """The configuration with a speed of 16 rad/s per cell, and its recording; both are exact."""
    folder = scratch()
    path = folder / "own.csv"
    rows = [COLUMNS, *[[t, str(Decimal(omega) / 16), rest] for t, omega, rest in ROWS]]
    path.write_text(lines(rows), encoding="utf-8")
    config = edited_config(LOCK, {"plant": {"omega": {"csv": {"column": "omega", "scale": 16}}}})
    return config, path


def test_a_scaled_column():
    expected, _ = replayed(lines([COLUMNS, *ROWS]))
    config, path = scaled()
    result = path.parent / "result.csv"
    code, _, err = run(["replay", config, "--recording", path, "--csv", result])
    expect(code == 0, err)
    expect(result.read_bytes() == expected, "another twin")


def test_a_survey_of_a_scaled_column():
    config, path = scaled()
    plain = path.parent / "plain" / "own.csv"
    plain.parent.mkdir()
    plain.write_text(lines([COLUMNS, *ROWS]), encoding="utf-8")
    pages = []
    for checked, recording in ((LOCK, plain), (config, path)):
        code, out, err = run(["check", checked, "--recording", recording])
        expect(code == 0, err)
        pages.append([line for line in out.splitlines() if "plant.omega" in line or "rad/s" in line])
    expect(pages[0] and pages[0] == pages[1], f"surveys differ: {pages}")


def test_a_played_recording_is_not_scaled_twice():
    """`plant --record` writes cells that the same configuration reads to the same values."""
    config, path = scaled()
    played = path.parent / "played.csv"
    code, _, err = run(["plant", config, "--recording", path, "--record", played])
    expect(code == 0, err)
    column = [float(row["omega"]) for row in csv.DictReader(played.open(encoding="utf-8"))]
    expect(column == [float(row[1]) / 16 for row in ROWS], "other cells")


def test_local_times_go_back():
    rows = [COLUMNS, *[[date(t, zone=2 if Decimal(t) < 2 else 1), *rest] for t, *rest in ROWS]]
    path = scratch() / "own.csv"
    path.write_text(lines(rows), encoding="utf-8")
    expect_refused(path, "before|+01:00")


def test_nanoseconds_since_a_start_are_no_unix_times():
    """As microseconds since 1970, such a number is a date of 2016."""
    path = scratch() / "own.csv"
    rows = [COLUMNS, *[[str(1_452_000_000_000_000 + i * 30_000_000), *row[1:]] for i, row in enumerate(ROWS)]]
    path.write_text(lines(rows), encoding="utf-8")
    expect_refused(path, "30 s|row|ms")


def test_a_clock_of_whole_seconds():
    path = scratch() / "own.csv"
    path.write_text(lines([COLUMNS, *[[str(int(Decimal(t))), *rest] for t, *rest in ROWS]]), encoding="utf-8")
    expect_refused(path, "line 6|0.000000000 s|fractions")


def write_days(folder):
    """The recording as three files: the first in UTF-16, the last compressed."""
    folder.mkdir()
    third = len(ROWS) // 3
    parts = [lines([COLUMNS, *ROWS[begin:end]]) for begin, end in ((0, third), (third, 2 * third), (2 * third, None))]
    (folder / "day8.csv").write_bytes(parts[0].encode("utf-16"))
    (folder / "day9.csv").write_text(parts[1], encoding="utf-8")
    (folder / "day10.csv.gz").write_bytes(gzip.compress(parts[2].encode()))
    return folder


def test_compressed_wide_and_split():
    expected, _ = replayed(lines([COLUMNS, *ROWS]))
    folder = scratch()
    path, result = folder / "own.csv.gz", folder / "result.csv"
    path.write_bytes(gzip.compress(lines([COLUMNS, *ROWS]).encode("utf-16")))
    for recording, form in ((path, ["own.csv.gz|gzip, UTF-16"]), (write_days(folder / "days"), ["days|3 files", "days|gzip"])):
        code, _, err = run(["replay", LOCK, "--recording", recording, "--csv", result])
        expect(code == 0, err)
        expect(result.read_bytes() == expected, "another twin")
        for parts in form:
            expect_line(err, parts)


def test_init_and_check_read_a_folder():
    folder = scratch()
    days = write_days(folder / "days")
    made = folder / "made.json"
    code, _, err = run(["init", "motor.fmu", "--recording", days, "--output", made])
    expect(code == 0, err)
    expect_line(err, "days|3 files")
    document = json.loads(made.read_text(encoding="utf-8"))
    expect(document["recording"] == {"file": "days", "time_column": "t"}, document["recording"])
    expect("omega" in document["plant"], document["plant"])
    said = json.loads(run_well(["check", LOCK, "--recording", days, "--json"]))
    plain = json.loads(run_well(["check", LOCK, "--recording", SOURCE / "config/motor/recording.csv", "--json"]))
    expect(said["signals"] == plain["signals"] and said["proposal"] == plain["proposal"], "other proposals")


def test_other_compressions_name_the_command():
    path = scratch() / "own.csv.xz"
    path.write_bytes(lzma.compress(lines([COLUMNS, *ROWS]).encode()))
    expect_refused(path, "xz -dc")


def test_files_that_overlap():
    days = write_days(scratch() / "days")
    (days / "day11.csv").write_text(lines([COLUMNS, *ROWS[-2:]]), encoding="utf-8")
    code, _, err = run(["replay", LOCK, "--recording", days])
    expect(code == BAD_DATA, f"ended with {code}")
    expect_line(err, f"day11.csv, line 2|{float(ROWS[-2][0]):.9f} s|{float(ROWS[-1][0]):.9f} s|day10.csv.gz|overlap")


main()
