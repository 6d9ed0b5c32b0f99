"""Emulates a plant of config/ for hours, and compares twins with its true outputs, minute by minute. For days.py and systems.py."""
import csv
import json
import os
import subprocess
from pathlib import Path

from study import NOT_LOCKED, PROGRAM, ROOT, Trouble

SHORTEST, LONGEST = 0.02, 1000.0  # h
SLACK = 1.2  # times the error of the twin left alone


class Plant:
    """Files in a folder: `recording` with noise, and the true values of each step. `commands`: inputs of the plant, (column names, rows)."""

    def __init__(self, system, folder, commands, seconds, seed, edit=lambda plant: plant):
        self.home, self.folder, self.seconds = ROOT / "config" / system, Path(folder), seconds
        self.recording, self.true = self.folder / "recording.csv", self.folder / "true.csv"
        plant = edit(self.read("plant"))
        self.step_s = plant["step_s"]
        plant["duration_s"] = seconds
        plant["recording"]["file"] = str(self.folder / "commands.csv")
        self._write_commands(*commands)
        self._make(plant, self.recording, seed)
        for column in plant["emulate"]["columns"].values():
            column.pop("noise", None)
        plant["emulate"].pop("message_s", None)
        self._make(plant, self.true, seed)

    def read(self, name):
        return json.loads((self.home / f"{name}.json").read_text(encoding="utf-8"))

    def _write_commands(self, names, rows):
        with open(self.folder / "commands.csv", "w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(names)
            writer.writerows(rows)

    def _write(self, document):
        path = self.folder / "config.json"
        path.write_text(json.dumps(document), encoding="utf-8")
        return path

    def _make(self, plant, path, seed):
        subprocess.run([PROGRAM, "plant", self._write(plant), "--record", path, "--seed", str(seed)], check=True, capture_output=True)

    def replay(self, document):
        """(JSON object of the replay, {matched variable: [its MSE against the true value in each minute]})."""
        document["duration_s"] = self.seconds - 1
        document["recording"]["file"] = str(self.recording)
        part = document.get("synchronise", {}).get("match") or document["compare"]
        columns = {variable: match["to"].removeprefix("plant.") for variable, match in part.items()}
        read, write = os.pipe()
        with subprocess.Popen([PROGRAM, "replay", self._write(document), "--json", "--csv", f"/dev/fd/{write}"], pass_fds=(write,),
                              stdout=subprocess.PIPE, stderr=subprocess.PIPE) as run:
            os.close(write)
            minutes = self._minutes(read, columns)
            out, err = run.communicate()
        if run.returncode not in (0, NOT_LOCKED):
            raise Trouble(err.decode().strip())
        return json.loads(out), minutes

    def _minutes(self, read, columns):
        """Reads both files step by step, because a day of them is too large for memory."""
        steps_of_minute = round(60 / self.step_s)
        minutes, squares, count = {variable: [] for variable in columns}, dict.fromkeys(columns, 0.0), 0
        with open(read, encoding="utf-8", newline="") as steps, open(self.true, encoding="utf-8", newline="") as true:
            there, truly = csv.reader(steps), csv.reader(true)
            names, true_names = next(there), next(truly)
            columns_of = [(variable, names.index(f"{variable} simulated"), true_names.index(column)) for variable, column in columns.items()]
            next(truly)  # t = 0 is not the end of a step
            for row, values in zip(there, truly):
                for variable, column, true_column in columns_of:
                    squares[variable] += (float(row[column]) - float(values[true_column])) ** 2
                count += 1
                if count == steps_of_minute:
                    for variable in columns:
                        minutes[variable].append(squares[variable] / count)
                    squares, count = dict.fromkeys(columns, 0.0), 0
        return minutes


def require(option, value, least, most):
    """Checks the number of an option."""
    if not least <= value <= most:
        raise Trouble(f"{option}: found {value:g}, expected a number from {least:g} to {most:g}")


def left_alone(document):
    document["compare"] = {variable: {"to": match["to"]} for variable, match in document.pop("synchronise")["match"].items()}
    return document


def figures_of(told, minutes, alone, allowed):
    """Figures of one variable. `allowed`: MSE that a minute may have in any case."""
    limits = [max(SLACK * other, allowed) for other in alone]
    bad = sum(minute > limit for minute, limit in zip(minutes, limits))
    of_limits = [minute / limit for minute, limit in zip(minutes, limits) if limit > 0]
    return {"mean": sum(minutes) / len(minutes), "worst": max(minutes), "bad": bad, "worst_of_limit": max(of_limits, default=0.0),
            "minutes": len(minutes), "rested": told.get("free_twin", {}).get("rested_steps", 0) / told["steps"],
            "executions": told["executions"]["total"] / ((len(told["executions"]) - 1) * told["steps"])}


def show(results):
    """{name: figures_of()} as a table."""
    width = max(map(len, results)) + 2
    print(f"{'':{width}}{'true MSE':>11}{'worst minute':>14}{'of its limit':>14}{'bad minutes':>16}{'executions':>12}{'rests':>8}")
    for name, row in results.items():
        bad = f"{row['bad']} of {row['minutes']}"
        print(f"{name:{width}}{row['mean']:11.4g}{row['worst']:14.4g}{row['worst_of_limit']:14.2f}{bad:>16}{row['executions']:12.4f}{100 * row['rested']:6.0f} %")
