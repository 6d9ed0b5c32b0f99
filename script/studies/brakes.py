"""Other brakes for the motor bench than the recorded one: shapes that depend on a seed."""
import json
import math
import random
import subprocess
from pathlib import Path

from study import ROOT

MOTOR = ROOT / "config" / "motor"
SECONDS, SAMPLE_S = 14.3, 0.02


def _pulses(choice, shortest, longest, torque):
    """[(begin, end, torque)] one after the other, with pauses."""
    pulses, begin = [], choice.uniform(0.5, 1.5)
    while begin < SECONDS:
        end = begin + choice.uniform(shortest, longest)
        pulses.append((begin, end, choice.uniform(0.3, 1.0) * torque))
        begin = end + choice.uniform(shortest, longest)
    return pulses


def _trapezoids(choice, pulses, shortest, longest):
    """Pulses with straight edges."""
    edges = [(begin, end, torque, choice.uniform(shortest, longest)) for begin, end, torque in pulses]

    def at(time):
        rises = [torque * min(1.0, (time - begin) / edge, (end + edge - time) / edge)
                 for begin, end, torque, edge in edges if begin < time < end + edge]
        return max(rises, default=0.0)
    return at


def rest(_choice):
    """No brake."""
    return lambda time: 0.0


def steps(choice):
    """Pulled and released within some tenths of a second, as by hand."""
    return _trapezoids(choice, _pulses(choice, 0.5, 2.0, choice.uniform(0.4, 0.9)), 0.15, 0.4)


def ramps(choice):
    """Slowly up and slowly down."""
    return _trapezoids(choice, _pulses(choice, 1.0, 2.5, choice.uniform(0.4, 0.9)), 0.7, 1.0)


def sine(choice):
    """A sine that begins at 0."""
    torque, hertz = choice.uniform(0.3, 0.7), choice.uniform(0.2, 0.6)
    return lambda time: 0.5 * torque * (1.0 - math.cos(2.0 * math.pi * hertz * max(0.0, time - 0.5)))


def hand(choice):
    """Some sines of different periods, never below 0."""
    parts = [(choice.uniform(0.05, 0.2), choice.uniform(0.1, 0.8), choice.uniform(0.0, 6.0)) for _ in range(4)]
    return lambda time: min(1.0, time) * max(0.0, 0.3 + sum(a * math.sin(2.0 * math.pi * f * time + p)
                                                          for a, f, p in parts))


def walk(choice):
    """A random walk between 0 and its largest torque, with a time constant of about a second."""
    torque, at, values = choice.uniform(0.3, 0.8), 0.0, []
    for _ in range(round(SECONDS / SAMPLE_S) + 1):
        at += 0.3 * SAMPLE_S * (0.5 * torque - at) + choice.gauss(0.0, 0.05) * torque
        at = min(max(at, 0.0), torque)
        values.append(at)
    return lambda time: values[round(time / SAMPLE_S)]


def saw(choice):
    """Rises in a straight line, then falls within a tenth of a second; periodic."""
    torque, period, fall = choice.uniform(0.3, 0.8), choice.uniform(1.0, 3.0), 0.1

    def at(time):
        phase = max(0.0, time - 0.5) % period
        return torque * min(phase / (period - fall), (period - phase) / fall)
    return at


def pulses(choice):
    """Short pulses of two to five tenths of a second."""
    return _trapezoids(choice, _pulses(choice, 0.2, 0.5, choice.uniform(0.2, 0.5)), 0.1, 0.2)


def hard(choice):
    """Edges within one sample."""
    return _trapezoids(choice, _pulses(choice, 0.5, 2.0, choice.uniform(0.2, 0.5)), SAMPLE_S, SAMPLE_S)


SHAPES = {"rest": rest, "steps": steps, "ramps": ramps, "sine": sine, "hand": hand, "walk": walk, "saw": saw,
          "pulses": pulses, "hard": hard}


def write_brake(path, shape, seed, force):
    """Writes a brake in the format of config/motor/brake.csv, `force` times as strong as usual."""
    torque = SHAPES[shape](random.Random(f"{shape} {seed}"))
    with open(path, "w", encoding="utf-8") as file:
        file.write("t,torque\n")
        for i in range(round(SECONDS / SAMPLE_S) + 1):
            file.write(f"{i * SAMPLE_S:.2f},{force * torque(i * SAMPLE_S):.4f}\n")


def make_recording(program, folder, seed, shape="own", brake=None, force=1.0, exact=False):
    """Makes a recording in `folder` with `twinlock plant` and a seed, and returns its path. The brake is a file, the bench's own
    (config/motor/brake.csv), or one of the shapes, `force` times as strong. `exact`: the true values without noise, a row for each
    step."""
    document = json.loads((MOTOR / "plant.json").read_text(encoding="utf-8"))
    if brake is None and shape in SHAPES:
        brake = folder / "brake.csv"
        write_brake(brake, shape, seed, force)
    document["recording"]["file"] = str(Path(brake or MOTOR / "brake.csv").resolve())
    if exact:
        document["emulate"] = {"columns": {name: {"from": column["from"]}
                                           for name, column in document["emulate"]["columns"].items()}}
    config, made = folder / "plant.json", folder / f"{shape}-{seed}.csv"
    config.write_text(json.dumps(document), encoding="utf-8")
    subprocess.run([program, "plant", config, "--record", made, "--seed", str(seed)], check=True, capture_output=True)
    return made
