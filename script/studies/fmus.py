"""Tests how FMUs can be rolled back: see the command script/fmus, which builds and starts this."""
import argparse
import contextlib
import json
import os
import signal
import subprocess
import sys
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import exactness
import public_fmus
from foreign import describe
from study import PROGRAM, ROOT, Progress, Trouble, print_figures, run_command

PROBE = ROOT / "build" / "host" / "tests" / "fmu" / "rollback_probe"
WAYS = "state", "memory", "replay"
BESIDE = "copy", "library"  # of another instance


def exporter_of(fmu):
    with zipfile.ZipFile(fmu) as archive:
        root = ElementTree.fromstring(archive.read("modelDescription.xml"))
    claims = (root.find("CoSimulation").attrib if root.find("CoSimulation") is not None else {}).get("canGetAndSetFMUstate")
    return root.get("generationTool", ""), claims in ("true", "1")


def probe(program, fmu, way, step, steps, limit):
    """The result of rollback_probe, or its error."""
    with subprocess.Popen([str(program), str(fmu), way, repr(step), str(steps)], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
                          start_new_session=True) as process:
        try:
            output, _ = process.communicate(timeout=limit)
            return json.loads(output.decode(errors="replace").strip().rpartition("\n")[2])
        except subprocess.TimeoutExpired:
            return {"error": f"did not end within {limit:g} s"}
        except ValueError:
            return {"error": f"ended with {process.returncode}"}
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)  # with its children, one of which may hang


def test_fmu(fmu, arguments):
    description = describe(fmu)
    if description is None:
        return {"fmu": fmu.name, "exporter": "", "ways": {}, "error": "no FMU that can be read"}
    exporter, claims = exporter_of(fmu)
    steps = max(1, min(arguments.steps, int(min(description.most_steps, arguments.steps))))
    ways = {way: probe(arguments.probe, fmu, way, description.step, steps, arguments.limit) for way in WAYS + BESIDE if way != "state" or claims}
    return {"fmu": fmu.name, "exporter": exporter, "ways": ways, "error": ways["memory"].get("error")}


def is_exact(found):
    return not found.get("error") and found["way"] != "none" and found["differs"] is None


def is_rolled_back(result):
    return any(is_exact(result["ways"].get(way, {"error": "none"})) for way in WAYS)


def describe_result(found):
    if found is None:
        return "none"
    if found.get("error"):
        return "hangs" if found["error"].startswith("did not end") else "crashes" if "signal" in found["error"] else "fails"
    if not found["steady"]:
        return "unsteady"
    return "exact" if is_exact(found) else f"differs in step {found['differs'] + 1}"


def exact_method(arguments):
    """A function that returns the first method by which an FMU is rolled back exactly, for studies/exactness.py."""
    def first_exact(fmu, step, steps):
        for way in "memory", "state", "replay":
            if is_exact(probe(arguments.probe, fmu, way, step, max(1, min(steps, 400)), arguments.limit)):
                return way
        return "none"
    return first_exact


def has_run(result):
    return any(not found.get("error") and found["steps"] > 0 for found in result["ways"].values())


def describe_time(us):
    return f"{us / 1e3:.2g} ms" if us >= 1e3 else f"{us:.3g} µs"


def print_table(figures):
    print("FMU | exporter | steps | by its state | by its memory | by replay | beside another, each with a library of its own | of one library | bytes | save + restore")
    print(" | ".join(["---"] * 10))
    for result in figures["fmus"]:
        memory = result["ways"].get("memory", {})
        if not has_run(result):
            print(f"{result['fmu']} | {result['exporter']} | does not run: {result['error']}")
            continue
        print(f"{result['fmu']} | {result['exporter']} | {memory.get('steps', 0)} | "
              f"{' | '.join(describe_result(result['ways'].get(way)) for way in WAYS + BESIDE)} | {memory.get('bytes', 0)} | {describe_time(memory.get('save_us', 0) + memory.get('restore_us', 0))}")
    exact = figures["exact"]
    print(f"\n{figures['run']} of {len(figures['fmus'])} run; {exact['memory']} come back exactly by their memory, and "
          f"{exact['state']} of {figures['claim']} that declare a state by that; {exact['replay']} by replay")
    print(f"the same beside another instance: {exact['copy']} with a library of their own, {exact['library']} of one library")


def list_folder(arguments):
    fmus = sorted(path for path in arguments.fmus.glob("*.fmu") if arguments.only in path.name)
    if not fmus:
        raise Trouble(f"there is no *.fmu in {arguments.fmus}")
    return fmus


def name_fmu(path, name):
    try:
        return exactness.Fmu(path, name, exporter_of(path)[0])
    except (zipfile.BadZipFile, KeyError, ElementTree.ParseError):
        return exactness.Fmu(path, name, "")


def study_twins(arguments):
    """A campaign with the FMUs of a folder, or of a list that is fetched first."""
    if arguments.public:
        entries = [entry for entry in public_fmus.read_list(arguments.list) if arguments.only in f"{entry.url} {entry.path}"]
        there = public_fmus.fetch(entries, arguments.public)
        if not there:
            raise Trouble(f"{arguments.list}: no FMU could be fetched")
        fmus = [name_fmu(public_fmus.place_of(arguments.public, entry), entry.name) for entry in there]
        results = arguments.public / "results"
    else:
        entries = fmus = [name_fmu(path, path.name) for path in list_folder(arguments)]
        results = arguments.results
    options = exactness.Options(arguments.program, arguments.steps or exactness.STEPS, arguments.limit, arguments.swing, exact_method(arguments))
    figures = exactness.judge_all(fmus, options, arguments.jobs, results)
    figures["not_fetched"] = len(entries) - len(fmus)
    print_figures(figures, arguments.json, exactness.print_table)
    return 0 if exactness.is_sound(figures) else 1


def study(arguments):
    fmus = list_folder(arguments)
    arguments.steps = arguments.steps or 200
    progress = Progress(len(fmus))
    results = []
    for fmu in fmus:
        progress.say(fmu.name)
        results.append(test_fmu(fmu, arguments))
    progress.end()
    ran = [result for result in results if has_run(result)]
    figures = {"fmus": results, "run": len(ran), "claim": sum("state" in result["ways"] for result in ran),
               "exact": {way: sum(is_exact(result["ways"].get(way, {"error": "none"})) for result in ran) for way in WAYS + BESIDE}}
    print_figures(figures, arguments.json, print_table)
    return 0 if all(map(is_rolled_back, ran)) else 1


def main():
    parser = argparse.ArgumentParser(prog="script/fmus")
    parser.add_argument("--fmus", type=Path)
    parser.add_argument("--twins", action="store_true")
    parser.add_argument("--public", type=Path)
    parser.add_argument("--list", type=Path, default=public_fmus.LIST)
    parser.add_argument("--results", type=Path)
    parser.add_argument("--swing", type=float, default=1.0)
    parser.add_argument("--program", type=Path, default=PROGRAM)
    parser.add_argument("--jobs", type=int, choices=(1, 2), default=2)
    parser.add_argument("--only", default="")
    parser.add_argument("--steps", type=int)
    parser.add_argument("--limit", type=float, default=60.0)
    parser.add_argument("--probe", type=Path, default=PROBE)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    if bool(arguments.fmus) == bool(arguments.public):
        parser.error("give either a folder of FMUs or --public")
    return run_command("fmus", lambda: (study_twins if arguments.twins or arguments.public else study)(arguments), 65)


if __name__ == "__main__":
    sys.exit(main())
