"""The motor bench for measurements: its configurations, the solvers, and the figures of a replay.
For scenarios.py, campaign.py and the tests."""
import filecmp
import json
import math
import subprocess
from pathlib import Path

from study import NOT_LOCKED, ROOT, Trouble

FOLDER = ROOT / "config" / "motor"
SOLVERS = ("secant", "nelder-mead", "bobyqa", "l-bfgs")
SCENARIOS = tuple("abcdefghij")

# ε in (rad/s)² for solvers other than the one in the file; default: that of the file. Each needs the fewest executions of all
# tested values, or nearly so, at an MSE below 1.5 on each of a dozen recordings.
EPSILON = {
    "c": {"nelder-mead": 36, "bobyqa": 36, "l-bfgs": 36},
    "d": {"nelder-mead": 33, "bobyqa": 30, "l-bfgs": 25},
    "e": {"nelder-mead": 10, "bobyqa": 12, "l-bfgs": 10},
    "f": {"nelder-mead": 3, "bobyqa": 3},
    "g": {"nelder-mead": 3, "bobyqa": 3},
    "i": {"nelder-mead": 25, "bobyqa": 25, "l-bfgs": 20},
    "j": {"nelder-mead": 8, "bobyqa": 7, "l-bfgs": 4},
}


# ---- configurations ----

def read(name):
    """A configuration of the motor bench that can be used from any folder."""
    document = json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    document["recording"]["file"] = str(FOLDER / document["recording"]["file"])
    return document


def with_solver(name, solver, epsilon=None):
    """A configuration with another solver, and with ε in place of its tolerance."""
    document = read(name)
    synchronise = document["synchronise"]
    synchronise["algorithm"] = solver
    if epsilon is not None:
        synchronise["match"]["motor.omega"].pop("tolerance", None)
        synchronise["epsilon"] = epsilon
    return document


def scenario(letter, solver):
    """A scenario of table 5.5 with a solver and its best ε."""
    return with_solver(letter, solver, EPSILON.get(letter, {}).get(solver))


def epsilon_of(document):
    synchronise = document["synchronise"]
    return synchronise.get("epsilon") or synchronise["match"]["motor.omega"]["tolerance"] ** 2


# ---- one run ----

class Bench:
    """The program, and a folder for intermediate files."""

    def __init__(self, program, folder):
        self.program, self.folder = program, Path(folder)

    def replay(self, config, recording, *options):
        """(summary, CSV file of all steps) of one replay."""
        path = self.folder / ("plain.csv" if "--plain" in options else "steps.csv")
        command = [self.program, "replay", config, "--recording", recording, "--json", "--csv", path, *options]
        done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)
        if done.returncode not in (0, NOT_LOCKED):
            raise Trouble(done.stderr.strip() or f"{self.program}: exit code {done.returncode}")
        return json.loads(done.stdout), path

    def measure(self, document, recording):
        """The figures of one configuration, with its saving and without saving."""
        config = self.folder / "config.json"
        config.write_text(json.dumps(document), encoding="utf-8")
        saved, steps = self.replay(config, recording)
        plain, plain_steps = self.replay(config, recording, "--plain")
        return figures(saved, plain, filecmp.cmp(steps, plain_steps, False))


def figures(saved, plain, same_steps):
    """The figures of a replay with saving, and the same replay without."""
    match, least = saved["match"]["motor.omega"], (len(saved["executions"]) - 1) * saved["steps"]
    counts = {"without": plain["executions"]["total"], "with": saved["executions"]["total"]}
    return {
        "mse": match["mse"], "max": match["max"], "steps": saved["steps"], "evaluations": saved["evaluations"],
        **counts, **{f"ratio_{which}": count / least for which, count in counts.items()},
        "same": same_steps and saved["evaluations"] == plain["evaluations"],
        "off": max(ledger_off(saved), ledger_off(plain), key=abs),
    }


def ledger_off(summary):
    """The largest difference of executions from the prediction of the ledger, over all components."""
    ledger, executions = summary["ledger"], summary["executions"]
    if not ledger["complete"]:
        return math.inf
    return max((executions[name] - entry["predicted"] - entry["repeated"]
                for name, entry in ledger["components"].items()), key=abs)


def is_sound(result):
    return result["same"] and result["off"] == 0


# ---- words ----

def yes_or_no(value):
    return "yes" if value else "NO"


def exact_or_off(off):
    return "exact" if off == 0 else f"{off:+g}"
