#!/usr/bin/env python3
"""`twinlock tune`: the candidates that it keeps, how it continues, and what the recommended one does on another recording."""
import functools
import importlib.util
import json
import os
import signal
import sys
import time

from twinlock_test import (BAD_DATA, BAD_USAGE, EMULATED, PROGRAM, SOURCE, Skip, at_most, expect, expect_line, finish, main, run,
                           run_well, scratch, start)

if EMULATED or importlib.util.find_spec("optuna") is None:
    raise Skip("Optuna is missing, or the program is emulated: script/bootstrap installs Optuna for tests")
sys.path.insert(0, str(SOURCE / "script"))
import tune  # noqa: E402

TRY_AGAIN = 75


def example():
    """A folder with tclab.json as `init` writes it, and two recordings; the twin has three times the heat capacity."""
    folder = scratch()
    for seed in (1, 2):
        run_well(["plant", SOURCE / "config/tclab/plant.json", "--record", folder / f"{seed}.csv", "--seed", seed])
    run_well(["init", "tclab.fmu", "--recording", folder / "1.csv", "--output", folder / "tclab.json"])
    document = json.loads((folder / "tclab.json").read_text(encoding="utf-8"))
    document["components"]["tclab"]["set"] = {"mCp": 6, "T1_start": 294.0, "T2_start": 293.1}
    (folder / "tclab.json").write_text(json.dumps(document), encoding="utf-8")
    return folder


FOLDER = example()


def search(name, *args, code=0):
    """(rows of the results, standard output and error). `code` None: with or without a recommended one."""
    ended, out, err = run(["tune", FOLDER / "tclab.json", "--results", FOLDER / f"{name}.jsonl", *args], cwd=FOLDER)
    expect(ended in ((0, tune.NOT_LOCKED) if code is None else (code,)), f"ended with {ended}, wanted {code}: {err}")
    return rows_of(name), out + err


def rows_of(name):
    path = FOLDER / f"{name}.jsonl"
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()[1:]] if path.exists() else []


def keys(rows):
    return [json.dumps(row["settings"], sort_keys=True) for row in rows]


def by_number(rows):
    return {row["number"]: (row["settings"], row["values"]) for row in rows}


@functools.cache
def whole():
    """Rows and output of a search, which also writes sub.json. Its start is fixed: that of check depends on the machine's load."""
    run(["tune", FOLDER / "tclab.json", "--results", FOLDER / "key.jsonl", "--trials", "1"], cwd=FOLDER)
    start = {**first_line("key"), "proposal": {"synchronise": {"horizon": {"prediction": 8}}}, "release_s": 74}
    (FOLDER / "whole.jsonl").write_text(json.dumps(start) + "\n", encoding="utf-8")
    return search("whole", "--trials", "24", "--output", "sub.json", "--plot", "whole.svg")


def first_line(name):
    return json.loads((FOLDER / f"{name}.jsonl").read_text(encoding="utf-8").splitlines()[0])


def test_pareto():
    figures = [[3, 1, 5], [1, 4, 5], [2, 2, 5], [2, 3, 5], [1, 4, 6], [2, 2, 5], [4, 4, 1]]
    rows = [{"number": index, "values": values} for index, values in enumerate(figures)]
    found = [row["number"] for row in tune.pareto(rows)]
    expect(found == [1, 2, 0, 6], f"{found}")


def test_the_recommended_one_follows_the_readings():
    """Of equal released errors, not the one that is quiet because it corrects nothing."""
    rows = [{"values": [1.0, 2, 1], "locked": 0.3, "worst_s": 0}, {"values": [1.01, 4, 6], "locked": 0.02, "worst_s": 0},
            {"values": [1.01, 5, 6], "locked": 0.015, "worst_s": 0}, {"values": [1.1, 1, 1], "locked": 0.001, "worst_s": 0}]
    found = tune.recommended(rows, 1, 10, {"values": [1.0, 2, 5]})
    expect(found is rows[1], f"{found}")


def test_the_table_and_the_recommended_one():
    rows, out = whole()
    expect(len(rows) == 24 and len(set(keys(rows))) == 24, f"{len(rows)} candidates, {len(set(keys(rows)))} different")
    good = [row for row in rows if row["values"]]
    expect(len(good) >= 12, f"{len(rows) - len(good)} failed")
    expect(max(map(len, out.splitlines())) <= 80 or not out.isascii(), "wider than 80 columns")
    expect_line(out, "24 candidates")
    run_well(["check", FOLDER / "sub.json"])


def test_an_unseen_recording():
    """Both released error and executions, against the configuration that the search started from."""
    whole()
    figures = []
    for name in ("tclab.json", "sub.json"):
        path, folder = FOLDER / name, scratch()
        worker = tune.Worker(folder, 600)
        worker.program = PROGRAM
        document = tune.moved(tune.read_config(path), FOLDER, folder)
        document["synchronise"]["release_s"] = 74
        recording = ("--recording", str(FOLDER / "2.csv"))
        reference = tune.Reference(worker, document, tune.find_starts(worker, path), recording, 37)
        units = {name: entry["step"] for name, entry in document["synchronise"]["adjust"].items()}
        figures.append(tune.Trial(worker, [reference], units).of(document)["values"])
    at_most(figures[1][0], 1.05 * figures[0][0], "released error")  # 24 candidates also fit noise
    at_most(figures[1][1], 1.1 * figures[0][1], "executions")


def test_it_continues():
    """In parts, with another number of jobs: the same candidates and values, none twice."""
    rows, _ = whole()
    path = FOLDER / "parts.jsonl"
    path.write_text(json.dumps(first_line("whole")) + "\n", encoding="utf-8")
    first, _ = search("parts", "--trials", "8", "--jobs", "1")
    expect(len(first) == 8, f"{len(first)} candidates")
    with open(path, "a", encoding="utf-8") as file:
        file.write('{"number": 8, "sett')  # as a kill leaves it
    both, _ = search("parts", "--trials", "24")
    expect(both[:8] == first and len(set(keys(both))) == 24, "a candidate was replayed again")
    expect(by_number(both) == by_number(rows), "another search than without the interruption")


def test_the_stored_proposal():
    """A continued search starts from it, whatever check would propose now."""
    whole()
    first = first_line("whole")
    first["proposal"].setdefault("synchronise", {}).setdefault("horizon", {})["prediction"] = 3
    first["release_s"] = 20
    (FOLDER / "stored.jsonl").write_text(json.dumps(first) + "\n", encoding="utf-8")
    rows, _ = search("stored", "--trials", "1", code=None)
    expect(first_line("stored") == first, "the first line has changed")
    expect(rows[0]["settings"]["prediction"] == 3, f"{rows[0]['settings']}")


def test_the_output_is_written_before_the_plot():
    whole()
    (FOLDER / "plot.jsonl").write_bytes((FOLDER / "whole.jsonl").read_bytes())
    (FOLDER / "folder.svg").mkdir()
    code = BAD_DATA if importlib.util.find_spec("matplotlib") else 0
    search("plot", "--trials", "24", "--output", "plot.json", "--plot", "folder.svg", code=code)
    expect((FOLDER / "plot.json").read_bytes() == (FOLDER / "sub.json").read_bytes(), "another output")


def test_foreign_results():
    """They stay as they are."""
    path = FOLDER / "foreign.jsonl"
    for data in (b'{"mine": 1}', b'{"mine": 1}\n', b'{"mine": 1}\n{"mi', b"\xff\xfe\x00", b"\xff\n", b"[]\n", b"7\n", b"\n",
                 b'{"tune": "key"}', b'{"tune": "key"}\n', b'{"tune": "key", "proposal": {}, "release_s": 1}'):
        path.write_bytes(data)
        try:
            tune.Results(path, "key")
            expect(False, f"{data} is accepted")
        except tune.Refused as refused:
            expect(refused.code == BAD_USAGE and "foreign.jsonl" in str(refused), f"{data}: {refused}")
        expect(path.read_bytes() == data, f"{data} became {path.read_bytes()}")
    path.write_bytes(b"\xff\xfe\x00")
    code, _, err = run(["tune", FOLDER / "tclab.json", "--results", path], cwd=FOLDER)
    expect(code == BAD_USAGE and path.read_bytes() == b"\xff\xfe\x00", f"{code}: {err}")
    expect_line(err, "error|foreign.jsonl|--results")


def test_interrupted():
    path = FOLDER / "long.jsonl"
    process = start(["tune", FOLDER / "tclab.json", "--results", path, "--trials", "5000", "--output", FOLDER / "never.json"],
                    cwd=FOLDER)
    while process.poll() is None and (not path.exists() or path.read_bytes().count(b"\n") <= 10):
        time.sleep(0.05)
    os.kill(process.pid, signal.SIGINT)
    code, out, err = finish(process)
    expect(code == TRY_AGAIN, f"ended with {code}: {err}")
    expect_line(out, f"{len(rows_of('long'))} candidates")
    expect(not (FOLDER / "never.json").exists(), "written")


def test_other_variables():
    rows, _ = search("others", "--trials", "8", "--variables", "tclab.mCp", "--also", "step,algorithm", code=None)
    expect(all({"adjust tclab.mCp", "step", "algorithm"} <= set(row["settings"]) for row in rows), f"{rows[0]}")
    document = tune.read_config(FOLDER / "tclab.json")
    for values in (row["settings"] for row in rows):
        made = tune.settings_of(document, {"tclab.mCp": {"step": 0.6}}, {"tclab.Ta": 296}, values)
        adjusted, constants = made["synchronise"]["adjust"], made["components"]["tclab"]["set"]
        expect(("mCp" in constants) != ("tclab.mCp" in adjusted), "a constant that is adjusted, or neither")


def test_a_replay_that_dies_is_repeated_once():
    folder = scratch()
    worker = tune.Worker(folder, 600)
    worker.program = folder / "program"
    for ending, calls in (("kill -9 $$", 2), ("exit 70", 2), ("exit 65", 1), ("echo '{}'", 1)):
        worker.program.write_text(f"#!/bin/sh\necho call >>{folder}/calls\n{ending}\n", encoding="utf-8")
        worker.program.chmod(0o700)
        (folder / "calls").write_text("", encoding="utf-8")
        summary, _ = worker.replay({}, [])
        expect((summary is None) == (ending != "echo '{}'"), ending)
        found = len((folder / "calls").read_text(encoding="utf-8").splitlines())
        expect(found == calls, f"{ending}: {found} calls, wanted {calls}")


def test_a_replay_that_takes_too_long_is_not_repeated():
    worker, calls = tune.Worker(scratch(), 0.1), []
    worker.program = worker.folder / "program"
    worker.program.write_text("#!/bin/sh\nsleep 600\n", encoding="utf-8")
    worker.program.chmod(0o700)
    once = worker.run
    worker.run = lambda *words: calls.append(words) or once(*words)
    summary, why = worker.replay({}, [])
    expect(summary is None and why == "took 0.1 s" and len(calls) == 1, f"{summary}, {why}, {len(calls)} calls")


def test_a_folder_is_one_recording():
    folder = scratch()
    for name, text in (("b.csv", "2"), ("a.csv", "1")):
        (folder / name).write_text(text, encoding="utf-8")
    expect(tune.content_of(folder) == b"12" and tune.content_of(folder / "b.csv") == b"2", "other bytes")


def test_usage():
    whole()
    own = FOLDER / "tclab.json"
    for args in ([], [own, "--trials", "0"], [own, "--also", "x"], [own, "--seed", "x"], [own, own], [own, "--nonsense"],
                 [own, "--output", own], [own, "--output", "nowhere/a.json"], [own, "--results", "nowhere/a.jsonl"],
                 [own, "--plot", "nowhere/a.svg"], [own, "--plot", "a.xyz"], [own, "--variables", "tclab.nothing"]):
        code, out, err = run(["tune", *args], cwd=FOLDER)
        expect(code == BAD_USAGE and err.startswith("twinlock: error: "), f"{args}: {code}, {out}{err}")
    code, _, err = run(["tune", own, "--results", FOLDER / "whole.jsonl", "--seed", "2"], cwd=FOLDER)
    expect(code == BAD_USAGE, f"results of another search: {code}")
    expect_line(err, "whole.jsonl|--results")


def test_bad_configurations():
    document = json.loads((FOLDER / "tclab.json").read_text(encoding="utf-8"))
    synchronise = document.pop("synchronise")
    for name, change, what in (("nowhere", None, "nowhere.json"),
                               ("array", {"synchronise": [1]}, "synchronise|object"),
                               ("number", {"synchronise": {**synchronise, "horizon": 5}}, "synchronise.horizon|object"),
                               ("text", {"synchronise": {**synchronise, "match": "x"}}, "synchronise.match|object")):
        if change is not None:
            (FOLDER / f"{name}.json").write_text(json.dumps({**document, **change}), encoding="utf-8")
        code, _, err = run(["tune", FOLDER / f"{name}.json"], cwd=FOLDER)
        expect(code == BAD_DATA and "Traceback" not in err, f"{name}: {code}: {err}")
        expect_line(err, what)
    code, _, err = run(["tune", SOURCE / "config/tclab/free.json"], cwd=FOLDER)
    expect(code == BAD_DATA, f"a twin that is not corrected: {code}: {err}")
    expect_line(err, "synchronise.adjust")


if __name__ == "__main__":
    main()
