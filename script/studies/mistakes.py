"""Makes mistakes of a commissioning engineer, and judges the messages: see the command mistakes, which builds and starts this."""
import argparse
import asyncio
import json
import os
import re
import shutil
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from pathlib import Path

from mistake_list import MISTAKES, NOBODY
from study import PROGRAM, ROOT, Progress, merge, print_figures, run_command

VERDICTS = ("silent", "symptom", "cause", "cure")
CONFIG = ROOT / "config"
OMEGA = struct.unpack(">HH", struct.pack(">f", 62.981))  # rad/s, in two registers
LIMIT_S = 120  # for one command


class Kit:
    """A new folder in which one mistake is made, and what runs beside it."""

    def __init__(self, program, fmus):
        self.program, self.fmus, self.folder = program, fmus, Path(tempfile.mkdtemp(prefix="twinlock-mistake-"))
        self.folder.chmod(0o755)
        self.open, self.processes, self.loop = [], [], None
        self.env = {**os.environ, "TWINLOCK_FMU_PATH": str(fmus)}

    # -- files --

    def write(self, name, data):
        (self.folder / name).write_bytes(data)
        return self.folder / name

    def config(self, base):
        return CONFIG / base

    def text(self, base):
        return self.config(base).read_text(encoding="utf-8")

    def edit(self, base, *edits):
        self.recording()
        text = self.text(base)
        for old, new in edits:
            assert text.count(old) == 1, f"{old} is {text.count(old)} times in {base}"
            text = text.replace(old, new)
        return self.write("motor.json", text.encode())

    def patch(self, base, *changes, name="motor.json"):
        """A configuration with merge patches, one after the other."""
        document = json.loads(self.text(base))
        if "file" in document.get("recording", {}):
            document["recording"]["file"] = str(self.config(base).with_name(document["recording"]["file"]))
        for change in changes:
            document = merge(document, change)
        return self.write(name, json.dumps(document, indent=2, ensure_ascii=False).encode())

    def fmu(self, name):
        return shutil.copy(self.fmus / name, self.folder / name) and self.folder / name

    def recording(self, change=None):
        rows = (CONFIG / "motor" / "recording.csv").read_text(encoding="utf-8").splitlines()
        return self.write("recording.csv", "".join(f"{row}\n" for row in (change(rows) if change else rows)).encode())

    def word(self, text):
        if text == "CONFIG":
            return self.patch("motor/lock.json", {})
        return self.folder / text if "." in text else text

    # -- programs --

    def as_nobody(self, *words):
        """The command without the rights of root."""
        return ["setpriv", f"--reuid={NOBODY}", f"--regid={NOBODY}", "--clear-groups", self.program, *words] if os.getuid() == 0 else [*words]

    def run(self, words):
        """(exit code, output) of a command of twinlock, or of a whole command line."""
        line = words if words[0] == "setpriv" else [self.program, *words]
        found = subprocess.run([*map(str, line)], cwd=self.folder, env=self.env, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                               stderr=subprocess.STDOUT, timeout=LIMIT_S, check=False)
        return found.returncode, found.stdout.decode(errors="replace")

    def start(self, words, awaited):
        """Starts a command, and waits for a file of it."""
        self.processes.append(subprocess.Popen([*map(str, [self.program, *words])], cwd=self.folder, env=self.env, stdin=subprocess.DEVNULL,
                                               stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))
        until = time.monotonic() + LIMIT_S
        while not awaited.exists() and time.monotonic() < until:
            time.sleep(0.05)
        time.sleep(1)  # for its first steps

    def keep(self, *things):
        self.open += things

    def serve(self, address=0, torque=542, slow_s=0):
        """The port of a pymodbus server with speed and torque in its input registers; unit 1, the others are silent."""
        from pymodbus.server import ModbusTcpServer
        from pymodbus.simulator import DataType, SimData, SimDevice
        import logging
        logging.disable(logging.CRITICAL)
        bits = [[SimData(9, values=[False], datatype=DataType.BITS)] for _ in (1, 2)]
        values = [[SimData(9000, values=[0], datatype=DataType.REGISTERS)],
                  [SimData(address, values=[*OMEGA, torque & 0xFFFF], datatype=DataType.REGISTERS)]]
        ready, ports = threading.Event(), []
        self.loop = asyncio.new_event_loop()

        def trace(sending, pdu):
            if sending and pdu.dev_id != 1:
                pdu.exception_code = None
            if sending and slow_s:
                time.sleep(slow_s)
            return pdu

        async def begin():
            self.server = ModbusTcpServer([SimDevice(1, simdata=(*bits, *values))], address=("127.0.0.1", 0), trace_pdu=trace, ignore_missing_devices=True)
            await self.server.serve_forever(background=True)
            ports.append(self.server.transport.sockets[0].getsockname()[1])
            ready.set()

        def work():
            asyncio.set_event_loop(self.loop)
            self.loop.create_task(begin())
            self.loop.run_forever()
        threading.Thread(target=work, daemon=True).start()
        assert ready.wait(30), "the Modbus server does not start"
        return ports[0]

    def close(self):
        for process in self.processes:
            process.terminate()
            process.wait()
        if self.loop:
            asyncio.run_coroutine_threadsafe(self.server.shutdown(), self.loop).result(30)
            self.loop.call_soon_threadsafe(self.loop.stop)
        for thing in self.open:
            thing.close() if isinstance(thing, socket.socket) else os.close(thing)
        shutil.rmtree(self.folder, ignore_errors=True)


# ---- judging ----

def messages(output):
    """The messages: a line of the log, or lines of a page with those that are indented below them."""
    found, indent = [], 0
    for line in output.splitlines():
        own = len(line) - len(line.lstrip())
        signal = re.match(r"plant\.(\w+)\.modbus: (likely|perhaps|cannot be told)", line)
        rows = [i for i, message in enumerate(found) if signal and message.split()[:1] == [signal[1]]]
        if found and indent and own > indent and found[-1] and line.strip():
            found[-1] += " " + line.strip()
        elif rows:  # probe: the proposal for a signal
            found[rows[-1]] += " " + line
        else:
            found.append(line)
            indent = own
    return found


def holds(message, part):
    """True if the message has the part as whole words or numbers."""
    pattern = (r"(?<!\w)(?<!\w\.)" if re.match(r"\w", part) else "") + re.escape(part) + (r"(?!\w)(?!\.\w)" if re.search(r"\w$", part) else "")
    return re.search(pattern, message) is not None


def is_warned(output):
    return re.search(r"^twinlock: (warning|error)|^warnings$|never in lock|locked, but", output, re.M) is not None


def judge(mistake, code, output):
    found = [line for line in messages(output) if all(holds(line, part) for part in mistake.place.split("|"))]
    is_cured = any(holds(line, part) for line in found for part in mistake.cure.split("|"))
    if code == 0 and not is_warned(output) and not is_cured:
        return "silent"
    return "cure" if is_cured else "cause" if found else "symptom"


def pointer(words):
    """What a verb must print to lead to the next command."""
    verb = str(words[0])
    return "check --recording" if verb == "check" and "--recording" in words else verb


def leads_to(output, words):
    return any(text in " ".join(output.split()) for text in (f"`{pointer(words)}", f"twinlock {pointer(words)}", f"let {pointer(words)}"))


def measure(program, fmus, mistake):
    """{"verdict", "code", "output"}: of the first command that finds the mistake. A later one counts if the one before leads to it."""
    kit = Kit(program, fmus)
    best, seen = None, ""
    try:
        for words in mistake.make(kit):
            if best and not leads_to(seen, words):
                break
            code, output = kit.run(words)
            output = output.replace(str(kit.folder) + "/", "")
            seen += output
            verdict = judge(mistake, code, output)
            row = {"group": mistake.group, "name": mistake.name, "verdict": verdict, "code": code,
                   "command": " ".join(Path(str(word)).name for word in words if str(word) != str(program)), "output": output}
            if best is None or VERDICTS.index(verdict) > VERDICTS.index(best["verdict"]):
                best = row
            if verdict == "cure":
                break
    finally:
        kit.close()
    return best


def find_weak(program, fmus, mistakes):
    """The mistakes that are judged as found in the output of a right configuration: their texts say too little."""
    kit = Kit(program, fmus)
    try:
        config, recording = kit.patch("motor/lock.json"), kit.recording()
        output = "".join(kit.run(words)[1] for words in (["check", config], ["replay", config], ["check", config, "--recording", recording]))
        return [mistake.name for mistake in mistakes if judge(mistake, 0, output) == "cure"]
    finally:
        kit.close()


def count(rows):
    found = Counter(row["verdict"] for row in rows)
    return {verdict: found[verdict] for verdict in VERDICTS}


# ---- command ----

def first_message(row):
    lines = [line for line in row["output"].splitlines() if re.search(r"error:|warning:|never in lock|not used", line)] or [""]
    return re.sub(r"^twinlock: ", "", lines[0].strip())


def show(figures):
    group = None
    for row in figures["mistakes"]:
        if row["group"] != group:
            group = row["group"]
            print(f"\n{group}")
        print(f"  {row['verdict']:8}{row['name']:34} exit {row['code']:2}  {row['command'].split()[0]}")
        if figures["verbose"] or row["verdict"] != "cure":
            print(f"          {first_message(row)}")
    print(f"\n{len(figures['mistakes'])} mistakes: " + ", ".join(f"{number} {verdict}" for verdict, number in figures["counts"].items()))


def main():
    options = argparse.ArgumentParser(prog="mistakes")
    options.add_argument("--only", default="")
    options.add_argument("--group", default="")
    options.add_argument("--least", type=int, default=0)
    options.add_argument("--verbose", action="store_true")
    options.add_argument("--json", action="store_true")
    options.add_argument("--program", type=Path, default=PROGRAM)
    chosen = options.parse_args()
    wanted = [mistake for mistake in MISTAKES if chosen.only in mistake.name and chosen.group in mistake.group]
    progress, rows = Progress(len(wanted)), []
    for mistake in wanted:
        progress.say(mistake.name)
        rows.append(measure(chosen.program, chosen.program.parents[1] / "fmus", mistake))
    progress.end()
    counts = count(rows)
    print_figures({"mistakes": rows, "counts": counts, "verbose": chosen.verbose}, chosen.json, show)
    weak = find_weak(chosen.program, chosen.program.parents[1] / "fmus", wanted)
    if weak:
        print("found in the output of a right configuration: " + ", ".join(weak), file=sys.stderr)
    return 1 if counts["silent"] or weak or counts["cure"] < chosen.least else 0


if __name__ == "__main__":
    sys.exit(run_command("mistakes", main, 65))
