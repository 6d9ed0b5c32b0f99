#!/usr/bin/env python3
"""The table of script/demo has the figures of its runs. Replays of the motor bench replace its live
run."""
import json
import shutil
import subprocess

from twinlock_test import SOURCE, expect, main, replay_json, scratch, write_config

CONFIG = SOURCE / "config" / "motor"
NAMES = {"free": "free.json", "own": "b.json"}


def summaries():
    """{name: --json report} of the runs of the demo."""
    made = {name: replay_json(CONFIG / file) for name, file in NAMES.items()}
    config = json.loads((CONFIG / "b.json").read_text(encoding="utf-8"))
    config["synchronise"]["algorithm"] = "nelder-mead"
    folder = scratch()
    shutil.copy(CONFIG / "recording.csv", folder)
    made["nelder_mead"] = replay_json(write_config(config, folder))
    return made


def test_table():
    folder, made = scratch(), summaries()
    made["live"] = {**made["own"], "ticks": 1234, "skipped": 5, "deadline_misses": 6}
    files = [folder / f"{name}.json" for name in ("free", "nelder_mead", "live")]
    for file in files:
        file.write_text(json.dumps(made[file.stem]), encoding="utf-8")
    done = subprocess.run(["/usr/bin/python3", SOURCE / "script" / "demo_table.py", *files], stdout=subprocess.PIPE, check=True, encoding="utf-8")
    rows = {line[:32].strip(): line[32:].split() for line in done.stdout.splitlines()}
    columns = [made[name] for name in ("free", "nelder_mead", "live")]
    expect(rows["MSE of the speed, (rad/s)²"] == [f"{one['match']['motor.omega']['mse']:.3f}" for one in columns], done.stdout)
    expect(rows["executions of components (N)"] == [str(one["executions"]["total"]) for one in columns], done.stdout)
    expect(rows["evaluations"][0] == "0" and rows["mean Δu of motor.d, N.m.s/rad"][0] == "-", done.stdout)
    expect(rows["ticks / skipped"] == ["-", "-", "1234", "/", "5"] and rows["missed deadlines"] == ["-", "-", "6"], done.stdout)
    expect("replays of what the live run recorded" in done.stdout and "left alone   Nelder-Mead    own solver" in done.stdout, done.stdout)
    values = [float(cell) for cell in rows["MSE of the speed, (rad/s)²"]]
    expect(values[0] > 50 > 1 > values[1] > values[2], f"{values}")


def test_the_other_solver_is_the_only_change():
    """The demo edits the solver in its configuration, and the scheduling if SCHED_FIFO is not
    permitted."""
    text = (CONFIG / "live.json").read_text(encoding="utf-8")
    expect(text.count('"algorithm": "secant"') == 1, "config/motor/live.json has another solver now; script/demo must know")
    expect(text.count('"priority": 50, "lock_memory": true') == 1, "config/motor/live.json has another realtime; script/demo must know")
    text = (SOURCE / "config" / "vessels" / "live.json").read_text(encoding="utf-8")
    expect(text.count('"twinlock": 1,') == 1 and '"realtime"' not in text, "config/vessels/live.json has a realtime now; script/demo must know")


def test_usage():
    for arguments, code in ((["--help"], 0), (["15"], 2), (["1", "2"], 2)):
        done = subprocess.run([SOURCE / "script" / "demo", *arguments], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False)
        expect(done.returncode == code and b"usage: script/demo [SECONDS]" in done.stdout, f"{arguments}: {done.returncode}")


main()
