"""Compares two builds: see script/compare, which starts this."""
import argparse
import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import compare_cases
import compare_facts as facts
from compare_facts import ALLOWABLE, KINDS, Fact
from study import Progress, Trouble

ROOT = Path(__file__).resolve().parent.parent
TIMEOUT_S = 120  # of a call, which may run in an emulator on a busy machine
SUCCESS = ("0", "3")  # 3: the replay is complete, but its twin was never in lock
# With FMA the C library's tanh, exp and others differ in the last bit. Without it all x86-64 processors compute the same.
SAME_BITS = {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4"}


# ---- one build ----

class Build:
    """A build folder, and the FMUs that it uses."""

    def __init__(self, label, folder, fmus):
        self.label, self.folder, self.fmus = label, folder, fmus
        self.program = folder / "bin" / "twinlock"
        for path in (self.program, fmus):
            if not path.exists():
                raise Trouble(f"{path}: no such file: run script/build first")

    def call(self, args, folder):
        """(exit code, stdout, stderr, number of temporary files left) of the program, run in a folder."""
        temporary = folder.parent / f"{folder.name}-temporary"
        temporary.mkdir(exist_ok=True)
        environment = {**os.environ, **SAME_BITS, "TWINLOCK_FMU_PATH": str(self.fmus), "TMPDIR": str(temporary),
                       "LC_ALL": "C.UTF-8", "TZ": "UTC"}
        process = subprocess.Popen([str(self.program), *map(str, args)], cwd=folder, env=environment, stdin=subprocess.DEVNULL,
                                   stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        try:
            out, err = process.communicate(timeout=TIMEOUT_S)
            code = str(process.returncode)
        except subprocess.TimeoutExpired:
            process.kill()
            out, err = process.communicate()
            code = f"none within {TIMEOUT_S} s"
        left = len(os.listdir(temporary))
        shutil.rmtree(temporary)
        # Messages of an FMU come through a separate pipe, so their position among ours is random.
        errors = "\n".join(sorted(self.text(err, folder).splitlines()))
        return code, self.text(out, folder), errors, left

    def text(self, content, folder):
        """The text with the same paths for both builds."""
        text = content.decode("utf-8", "backslashreplace")
        for path, name in ((folder, "HERE"), (self.fmus, "FMUS"), (self.folder, "BUILD")):
            text = text.replace(str(path), name)
        return text


def files_of(folder):
    """{name: its status, which changes if the file is written} of all files of a folder."""
    return {entry.name: entry.stat()[:7] + (entry.stat().st_mtime_ns,) for entry in os.scandir(folder) if entry.is_file()}


def facts_of(build, call, folder, kept=None):
    """The facts of a call. `kept`: the name under which its output stays in the folder."""
    before = files_of(folder)
    code, out, err, left = build.call(call.args, folder)
    place = " ".join(Path(word).name if os.path.isabs(word) else str(word) for word in call.args) or "no argument"
    if call.needed and code not in SUCCESS:
        raise Trouble(f"{build.program} {place}: exit code {code}: {err.strip()}")
    after = files_of(folder)
    touched = [f"{name} {'changed' if name in before else 'made'}" for name, found in sorted(after.items())
               if before.get(name) != found]
    gone = [f"{name} gone" for name in sorted(set(before) - set(after))]
    found = [Fact("codes", f"{place}, exit code", [code]), Fact("codes", f"{place}, files", touched + gone),
             Fact("codes", f"{place}, left in TMPDIR", [str(left)])]
    found += call.out(place, out) + (facts.page if code in SUCCESS else facts.words)(f"{place}, stderr", err)
    for name, read_facts in call.files.items():
        path = folder / name
        text = build.text(path.read_bytes(), folder) if path.exists() else ""
        found += read_facts(f"{place}, {name}", text)
    if kept:
        (folder / f"{kept}.out").write_text(out, encoding="utf-8")
        (folder / f"{kept}.err").write_text(err, encoding="utf-8")
    return found


# ---- one case ----

class Comparison:
    """Both builds and a folder to work in."""

    def __init__(self, before, after, folder, options):
        self.builds, self.folder, self.options = (before, after), folder, options
        self.own_fmus = before.fmus != after.fmus

    def compare(self, case):
        """([(kind, text)], digests of A's committed steps) of one case."""
        place = self.folder / case.name.replace("/", "-")
        folders = [place / build.label for build in self.builds]
        both = [self._run(case, build, folder) for build, folder in zip(self.builds, folders)]
        found = facts.differences(*both)
        digests = self._digests(case, folders[0]) if self.options.digests else []
        if case.database and not self.options.quick:
            differ = bool(found)
            found += self._show(compare_cases.shown(case.database, case.brief), folders[0], "A's database: ")
            if differ:
                found += self._show(compare_cases.shown(case.database, True), folders[1], "B's database: ")
        if self.options.keep is None:
            shutil.rmtree(place)
        return found, digests

    def _digests(self, case, folder):
        recorded = [facts.recorded(path) for path in sorted(folder.glob("plant-*.csv"))]
        return (facts.committed(folder / case.database) if case.database else []) + recorded

    def _run(self, case, build, folder):
        folder.mkdir(parents=True)
        if case.prepare:
            case.prepare(folder)
        found = []
        for i, call in enumerate(case.calls):
            found += facts_of(build, call, folder, f"call-{i}" if self.options.keep else None)
        if case.database:
            found += facts.database("database", folder / case.database, self.own_fmus)
        return found

    def _show(self, calls, folder, what):
        """Compares how both builds show one database."""
        both = []
        for build in self.builds:
            both.append([fact for call in calls for fact in facts_of(build, call, folder)])
            (folder / "show.html").unlink(missing_ok=True)
        return [(kind, what + text) for kind, text in facts.differences(*both)]


# ---- all of them ----

def compare_all(comparison, cases, jobs):
    """{name of a case: (its differences, its digests)}, in the order of the cases."""
    progress = Progress(len(cases))
    pool = ThreadPoolExecutor(jobs)
    try:
        futures = [pool.submit(comparison.compare, case) for case in cases]
        found = {}
        for case, future in zip(cases, futures):
            progress.say(case.name)
            found[case.name] = future.result()
    finally:
        pool.shutdown(cancel_futures=True)
        progress.end()
    return found


def report(found, is_all):
    """Prints the first difference of each kind in each case, or all."""
    for name, differences in found.items():
        for kind in KINDS:
            texts = [text for its_kind, text in differences if its_kind == kind]
            for text in texts if is_all else texts[:1]:
                print(f"{name}: {kind}: {text}")
            if len(texts) > 1 and not is_all:
                print(f"{name}: {kind}: and {len(texts) - 1} more")


def summary(found, cases, allowed, seconds):
    """(True if nothing differs that must not, one line)"""
    counts = Counter(kind for differences in found.values() for kind, _ in differences)
    listed = ", ".join(f"{counts[kind]} {kind}{' (allowed)' if kind in allowed else ''}" for kind in KINDS if counts[kind])
    calls = sum(len(case.calls) for case in cases)
    base = f"{len(cases)} cases, {calls} calls of each build ({seconds:.0f} s)"
    same = not set(counts) - allowed
    if not counts:
        return same, f"compare: same; {base}"
    return same, f"compare: {'same but for' if same else 'DIFFERENT:'} {listed}, in {len(found)} cases; {base}"


# ---- command line ----

def kinds(text):
    chosen = set(text.split(","))
    if not chosen <= set(ALLOWABLE):
        raise argparse.ArgumentTypeError(f"expected {' or '.join(ALLOWABLE)}; values and codes are always compared")
    return chosen


def parse(arguments):
    parser = argparse.ArgumentParser(prog="script/compare", usage="script/compare BUILD_A BUILD_B [options]; see --help",
                                     add_help=False, allow_abbrev=False)
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--only", type=re.compile, default=re.compile(""))
    parser.add_argument("--allow", type=kinds, default=set())
    parser.add_argument("--own-fmus", action="store_true")
    parser.add_argument("--recordings", type=Path)
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--all", action="store_true")
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--digests", type=Path)
    options = parser.parse_args(arguments)
    if options.jobs < 1:
        parser.error(f"--jobs {options.jobs}: expected 1 or more")
    if options.recordings is not None and not options.recordings.is_dir():
        parser.error(f"--recordings {options.recordings}: no such folder")
    return options


def recordings_of(options):
    """The folder of recordings that are not part of the product, or None."""
    folder = options.recordings or Path(os.environ.get("TL_SHARED") or ROOT.parent / "shared" / "recordings")
    return folder.resolve() if folder.is_dir() else None


def work(options, folder):
    """Returns 0 if both builds give the same, else 1."""
    began = time.monotonic()
    a, b = options.before.resolve(), options.after.resolve()
    before, after = Build("A", a, a / "fmus"), Build("B", b, (b if options.own_fmus else a) / "fmus")
    inputs = folder / "inputs"
    inputs.mkdir()
    cases = compare_cases.all_cases(inputs, recordings_of(options), options.quick, options.only)
    if not cases:
        raise Trouble(f"--only {options.only.pattern}: no case has a matching name")
    results = compare_all(Comparison(before, after, folder, options), cases, options.jobs)
    if options.digests:
        lines = [" ".join([name, *digests]) for name, (_, digests) in results.items() if digests]
        options.digests.write_text("\n".join(lines) + "\n", encoding="utf-8")
    found = {name: differences for name, (differences, _) in results.items() if differences}
    report(found, options.all)
    same, line = summary(found, cases, options.allow, time.monotonic() - began)
    print(line)
    return 0 if same else 1


@contextlib.contextmanager
def folder_of(options):
    """A new folder to work in, which stays with --keep."""
    if options.keep is None:
        with tempfile.TemporaryDirectory(prefix="twinlock-compare-") as folder:
            yield Path(folder)
    else:
        options.keep.mkdir(parents=True)
        yield options.keep.resolve()


def main():
    options = parse(sys.argv[1:])
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    try:
        with folder_of(options) as folder:
            return work(options, folder)
    except (Trouble, OSError) as trouble:
        print(f"compare: {trouble}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("compare: interrupted", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
