#!/usr/bin/env python3
"""`twinlock explain`: plants of our own break, and the true cause is the answer, or belongs to it, with its size."""
import csv
import hashlib
import json
import random
import re
import signal
import time

from twinlock_test import BAD_DATA, BAD_USAGE, NOT_LOCKED, SOURCE, at_least, at_most, expect, expect_line, finish, main, merge, run, run_well, scratch, start, write_config

LENGTH, AT = 6500, 4000  # steps of 1 s



class Vessels:
    """Two lags in series, as fmus/lag; both are measured."""
    parameters, start = {"first.T": 60.0, "second.T": 40.0}, [1.0, 1.0]
    inputs, outputs, noise, held = {"q": "first.u"}, ["first", "second"], 0.01, (100, 400)

    def draw(self, choice):
        return [choice.uniform(0.5, 2)]

    def step(self, of, u, x):
        return [x[0] + (u[0] - x[0]) / of["first.T"], x[1] + (x[0] - x[1]) / of["second.T"]]

    def read(self, x):
        return x

    def config(self):
        lags = {name: {"fmu": "lag.fmu", "set": {"T": self.parameters[f"{name}.T"], "x_start": 1, "t_step": 1}} for name in self.outputs}
        return {"twinlock": 1, "name": "vessels", "step_s": 1, "components": lags, "plant": {name: {"unit": "1"} for name in ("q", *self.outputs)},
                "connect": [["plant.q", "first.u"], ["first.y", "second.u"]], "recording": {"time_column": "time"},
                "synchronise": {"adjust": {"first.u": {"step": 0.1, "min": 0, "max": 4}}, "horizon": {"prediction": 30},
                                "match": {"second.y": {"to": "plant.second", "tolerance": 0.03}, "first.y": {"to": "plant.first", "tolerance": 0.03, "weight": 0}}}}


class Heaters:
    """The equations of fmus/tclab with steps of 1 s: the model has 0.01 s, so that it is never exact."""
    start, inputs, outputs = [294.0, 293.1, 294.0, 293.1], {"Q1": "board.Q1", "Q2": "board.Q2"}, ["T1", "T2"]
    noise, held = 0.05, (300, 1200)

    def __init__(self):
        text = (SOURCE / "fmus" / "tclab" / "modelDescription.xml").read_text(encoding="utf-8")
        values = re.findall(r'name="(\w+)"[^>]*>\s*<Real [^>]*?start="([^"]+)"', text)
        self.parameters = {f"board.{name}": float(value) for name, value in values} | {"board.mCp": 2.0, "board.Ta": 296.8}

    def draw(self, choice):
        return [choice.uniform(20, 70), choice.uniform(20, 70)]

    def step(self, of, u, x):
        def flow(name, area, hot, cold):
            return of[f"board.{area}"] * (of[f"board.{name}"] * (hot - cold) + of["board.epsilon"] * 5.67e-8 * (hot ** 4 - cold ** 4))
        across = flow("U_s", "A_s", x[1], x[0])
        heat = [flow("U", "A", of["board.Ta"], x[0]) + across + of["board.alpha1"] * u[0],
                flow("U", "A", of["board.Ta"], x[1]) - across + of["board.alpha2"] * u[1]]
        return [x[0] + heat[0] / of["board.mCp"], x[1] + heat[1] / of["board.mCp"],
                x[2] + (x[0] - x[2]) / of["board.tau"], x[3] + (x[1] - x[3]) / of["board.tau"]]

    def read(self, x):
        return x[2:]

    def config(self):
        document = json.loads((SOURCE / "config" / "tclab" / "lock.json").read_text(encoding="utf-8"))
        plain = {"tolerance": 0.5}
        match = {f"board.{name}": {"to": f"plant.{name}", **plain} for name in self.outputs}
        document["synchronise"]["match"] = match
        for name in self.outputs:
            del document["plant"][name]["every_s"]
        return merge(document, {"components": {"board": {"set": {"mCp": 2}}}})


def record(plant, path, fault, seed):
    """`fault`: (change, name, size), for example ("gain", "q", -0.1)."""
    change, name, size = fault
    choice = random.Random(f"{fault} {seed}")
    of, x, until, past, frozen = dict(plant.parameters), list(plant.start), 0, [], None
    with open(path, "w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["time", *plant.inputs, *plant.outputs])
        for i in range(LENGTH):
            if i >= until:
                u, until = plant.draw(choice), i + choice.uniform(*plant.held)
            is_broken = i >= AT
            past.append(dict(zip(plant.outputs, plant.read(x))))
            shown = dict(past[-1])
            if is_broken and name in shown:
                shown[name] = {"offset": shown[name] + size, "gain": shown[name] * (1 + size), "delay": past[i - int(size)][name]}.get(change, shown[name])
            shown = {key: value + choice.gauss(0, plant.noise) for key, value in shown.items()}
            if is_broken and change == "freeze":
                frozen = shown[name] if frozen is None else frozen
                shown[name] = frozen
            rows.writerow([i, *(f"{value:.6g}" for value in u), *(f"{value:.9g}" for value in shown.values())])
            if i == AT and name in of:
                of[name] *= 1 + size
            applied = dict(zip(plant.inputs, u))
            if is_broken and name in applied:
                applied[name] = applied[name] * (1 + size) if change == "gain" else applied[name] + size
            x = plant.step(of, list(applied.values()), x)


def recorded(plant, fault, seed=1):
    """A database in which the fault was found."""
    folder = scratch()
    record(plant, folder / "plant.csv", fault, seed)
    config = write_config(merge(plant.config(), {"detect": {"learn_s": 3000}}), folder)
    run_well(["replay", config, "--recording", folder / "plant.csv", "--db", folder / "run.db"], wells=(0, NOT_LOCKED))
    return folder / "run.db"


def explained(database, *options):
    return json.loads(run_well(["explain", database, "--json", *options]))


def expect_cause(plant, fault, alone=True):
    told = explained(recorded(plant, fault))
    change, name, size = fault
    print(told["text"])
    wanted = plant.inputs.get(name, name if name in plant.parameters else f"plant.{name}"), change
    possible = {(one["name"], one["change"]): one for one in told["candidates"] if one["possible"]}
    expect(told["verdict"] == "found" and wanted in possible, f"{wanted} is not in {list(possible)}")
    expect(not alone or len(possible) == 1, f"not alone: {list(possible)}")
    one = possible[wanted]
    if change != "freeze":
        truth = size * 100 if one["unit"] == "%" and change != "offset" else size
        at_most(abs(one["size"] - truth), 3 * one["size_spread"], "error of the size")
    at_least(one["explains"], 90, "share that it explains")
    return told


def test_pump():
    told = expect_cause(Vessels(), ("gain", "q", -0.1))
    at_most(abs(told["candidates"][0]["onset"] - AT), 3, "error of the onset, s")
    expect_cause(Vessels(), ("offset", "q", 0.05))


def test_resistance():
    expect_cause(Vessels(), ("value", "second.T", -0.2))


def test_sensors():
    expect_cause(Vessels(), ("offset", "second", 0.05))
    expect_cause(Vessels(), ("gain", "first", 0.05))
    expect_cause(Vessels(), ("freeze", "first", 0))
    expect_cause(Vessels(), ("delay", "second", 10))


def test_heater():
    """The heater and its factor are one product: a set."""
    told = expect_cause(Heaters(), ("gain", "Q1", -0.05), alone=False)
    expect({one["name"] for one in told["candidates"] if one["possible"]} == {"board.Q1", "board.alpha1"}, told["text"])


def test_heat_loss():
    expect_cause(Heaters(), ("value", "board.U", 0.1))


def test_thermometer():
    expect_cause(Heaters(), ("offset", "T2", -0.5), alone=False)


def test_nothing():
    """Nothing has changed: there is no finding; and with a time, there is no answer, although the model is 0.4 % off."""
    database = recorded(Heaters(), ("none", "", 0))
    code, _, err = run(["explain", database])
    expect(code == BAD_USAGE, code)
    expect_line(err, "has no finding|--since|--foresee")
    expect(explained(database, "--since", AT)["verdict"] == "nothing", "an answer without a change")


def test_page():
    """The first line answers, 80 columns are enough, and the database is only read."""
    database = recorded(Vessels(), ("gain", "q", -0.1))
    before = hashlib.sha256(database.read_bytes()).hexdigest()
    page = run_well(["explain", database])
    expect(re.match(r"first\.u gain -(9\.9|10\.0)\d* ± 0\.\d+ % since t = (3999|4000|4001) s explains it\.\n", page), page.splitlines()[0])
    at_most(max(map(len, page.splitlines())), 80, "columns")
    page = run_well(["explain", database, "--foresee"])
    expect_line(page, "first.u gain|%")
    at_most(max(map(len, page.splitlines())), 80, "columns")
    expect(hashlib.sha256(database.read_bytes()).hexdigest() == before, "the database was changed")


def test_save():
    """The sentence is stored with the finding if the user wants it, and is shown."""
    database = recorded(Vessels(), ("gain", "q", -0.1))
    run_well(["explain", database])
    finding = json.loads(run_well(["show", database, "--json"]))["findings"][0]
    expect(finding["explanation"] is None and finding["explained_at"] is None, finding)
    told = explained(database, "--save")
    finding = json.loads(run_well(["show", database, "--json"]))["findings"][0]
    expect(finding["explanation"] == told["text"] and re.fullmatch(r"20..-..-..T..:..:..\....Z", finding["explained_at"]), finding)
    page = run_well(["show", database])
    report = scratch() / "report.html"
    run_well(["show", database, "--report", report])
    expect_line(page, "explanation:|first.u gain")
    at_most(max(len(line) for line in page.splitlines() if line.startswith(" " * 7)), 80, "columns")
    expect_line(report.read_text(encoding="utf-8"), "first.u gain|explains it")
    code, _, err = run(["explain", database, "--save", "--since", "4000"])
    expect(code == BAD_USAGE, code)
    expect_line(err, "--save")


def test_foresee():
    """A change of twice the size that is noticed within R is named; R is 600 steps."""
    quiet = recorded(Vessels(), ("none", "", 0))
    sizes = {(one["name"], one["change"]): one["noticeable"] for one in explained(quiet, "--foresee")["candidates"]}
    database = recorded(Vessels(), ("gain", "q", -2 * sizes["first.u", "gain"] / 100))
    told = explained(database, "--since", AT)
    expect("first.u gain" in told["text"], told["text"])


def test_errors():
    database = recorded(Vessels(), ("gain", "q", -0.1))
    for words, wanted in ((["--finding", "99"], "--finding 99|no such finding"), (["--since", "2026-11-21"], "--since 2026-11-21|is a replay"),
                          (["--since", "6495"], "after the change|10"), (["--since", "20"], "before the change|60")):
        code, _, err = run(["explain", database, *words])
        expect(code != 0, words)
        expect_line(err, wanted)
    (database.parent / "lag.fmu").write_bytes(b"another one")
    code, _, err = run(["explain", database])
    expect(code == BAD_DATA, code)
    expect_line(err, "FMUs|--config")
    run_well(["explain", database, "--config", scratch() / "vessels.json"])


def test_interrupt():
    database = recorded(Heaters(), ("gain", "Q1", -0.05))
    process = start(["explain", database])
    time.sleep(0.3)
    process.send_signal(signal.SIGINT)
    code, _, err = finish(process)
    expect(code == 75, code)
    expect_line(err, "interrupted by SIGINT")


if __name__ == "__main__":
    main()
