"""Helpers for tests of `plant` and `run`: running programs, databases, and a Modbus device.

The helpers wait for an event, not for a length of time, where they can. A wait that times out fails
the test and prints the log.
"""
import os
import re
import signal
import socket
import sqlite3
import struct
import threading
import time
from contextlib import closing
from pathlib import Path

import twinlock_test
from twinlock_test import HUNG_S, NOT_LOCKED, Failure, describe, expect, finish, has_line, replay_json, scratch, start

PATIENCE = HUNG_S  # s, for events that take well under a second on an idle machine
POLL_S = float(os.environ.get("TL_POLL_S", "0.01"))  # an emulated box is slow: a test that polls often takes the time of the run

GOOD, STALE, OUT_OF_RANGE, NOT_A_NUMBER, NO_LINK, OUTLIER = range(6)  # master/base/signal.h
FIRST_GUESS, OPTIMISED, FREE_RUN, MADE_UP = 1, 2, 5, 6  # master/sync/record.h
STOP_TIME = 4


def wait_until(condition, what, explain=lambda: "", every=POLL_S):
    """Polls `condition` at intervals of `every` seconds, and returns its value once that is true.
    Fails after PATIENCE."""
    until = time.monotonic() + PATIENCE
    while True:
        value = condition()
        if value:
            return value
        if time.monotonic() > until:
            raise Failure(f"waited in vain for {what}\n{explain()}")
        time.sleep(every)


def count_lines(text, parts):
    """The number of lines that have all parts (see has_line())."""
    return sum(has_line(line, parts) for line in text.splitlines())


class Program:
    """A running twinlock, which the end of `with` kills. Its stderr goes to a file that can be read
    at any time."""

    def __init__(self, *args, **options):
        self.path = scratch() / "stderr"
        with open(self.path, "wb") as file:
            self.process = start(args, stderr=file, **options)
        self.pid = self.process.pid

    def __enter__(self):
        return self

    def __exit__(self, *unused):
        if self.process.poll() is None:
            self.kill()

    def log(self):
        return self.path.read_text(encoding="utf-8", errors="replace")

    def wait_for(self, parts, times=1):
        """Waits until so many lines of its log have all parts (see has_line()). Fails if the
        program ends before."""
        def said():
            ended = self.process.poll() is not None
            if count_lines(self.log(), parts) >= times:
                return True
            expect(not ended, f"{describe(self.process)} ended without \"{parts}\"\n{self.log()}")
            return False
        wait_until(said, f"\"{parts}\"", self.log)

    def signal(self, number):
        self.process.send_signal(number)

    def end(self, number=None):
        """Waits for its end, after a signal if one is given, and returns (exit code, stdout,
        stderr)."""
        if number is not None:
            self.signal(number)
        code, out, _ = finish(self.process, PATIENCE)
        log = self.log()
        expect("Sanitizer" not in log and "runtime error:" not in log, log)
        return code, out, log

    def kill(self):
        """Sends SIGKILL and ignores the exit code."""
        self.process.kill()
        self.process.communicate()


def end_well(program, number=None):
    """(report of --json, log) of a `run` that must end with 0, or with 3 because its twin was not
    in lock."""
    code, out, log = program.end(number)
    expect(code in (0, NOT_LOCKED), f"{describe(program.process)} ended with {code}\n{log}")
    return twinlock_test.json.loads(out), log


# ---- databases ----

def query(path, sql, *parameters):
    """All rows of a query. Another process may be writing the database. `parameters`: values, or
    one dictionary."""
    values = parameters[0] if parameters and isinstance(parameters[0], dict) else parameters
    with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True, timeout=10)) as database:
        return database.execute(sql, values).fetchall()


def number(path, sql, *parameters):
    return query(path, sql, *parameters)[0][0]


def committed_steps(path, run=1):
    """The number of recorded steps; 0 if there is no database yet."""
    return number(path, "SELECT count(*) FROM steps WHERE steps.run = ?", run) if path.exists() else 0


def wait_for_steps(program, database, count, run=1):
    def there():
        expect(program.process.poll() is None, f"{describe(program.process)} has ended\n{program.log()}")
        return committed_steps(database, run) >= count
    wait_until(there, f"{count} steps in the database", program.log)


def check_database(path):
    expect(query(path, "PRAGMA integrity_check") == [("ok",)], f"{path}: not intact")


def check_rows(path, run=1):
    """Checks that no step, tick or value is missing, and that each t_ns is right. Returns the
    number of steps."""
    step_ns = number(path, "SELECT step_ns FROM runs WHERE runs.run = ?", run)
    steps = query(path, "SELECT step, t_ns FROM steps WHERE steps.run = ? ORDER BY step", run)
    wrong = [row for i, row in enumerate(steps) if row != (i, (i + 1) * step_ns)]
    expect(not wrong, f"step and t_ns are wrong from {wrong[:1]}")
    for table in "outputs", "adjustments":
        rows = query(path, f"SELECT step FROM {table} WHERE run = ? ORDER BY step", run)
        expect([row[0] for row in rows] == list(range(len(steps))),
               f"{table} has {len(rows)} rows, steps {len(steps)}")
    ticks = query(path, "SELECT DISTINCT tick FROM samples own WHERE own.run = ? ORDER BY tick", run)
    holes = [(before, after) for (before,), (after,) in zip([(-1,), *ticks], ticks) if after != before + 1]
    expect(not holes, f"ticks are missing in samples of run {run}, {len(steps)} steps: between {holes[:5]}; runs and entries lost: "
           f"{query(path, 'SELECT run, verb, steps_written, samples_written, entries_lost FROM runs')}")
    for value in "applied", "nominal", "simulated", "measured":
        table = "adjustments" if value in ("applied", "nominal") else "outputs"
        bad = number(path, f"SELECT count(*) FROM {table} WHERE run = ? AND typeof({value}) <> 'real'", run)
        expect(bad == 0, f"{bad} rows of {value} are no numbers")
    return len(steps)


def check_ledger(told, candidate_steps):
    """Checks the ledger of --json: it agrees with the executions, and predicts each of them.

    `candidate_steps`: the number of committed steps, plus T_P for each evaluation.
    """
    ledger, executions = told["ledger"], told["executions"]
    expect(ledger["complete"], f"the ledger has forgotten candidates: {ledger}")
    entries = {**ledger["components"], "total": ledger["total"]}
    expect(entries.keys() == executions.keys(), f"components: {list(entries)} and {list(executions)}")
    for name, entry in entries.items():
        plain = candidate_steps * (len(ledger["components"]) if name == "total" else 1)
        expect(entry["plain"] == plain, f"{name}: {entry['plain']} executions without saving, wanted {plain}")
        expect(entry["executions"] == executions[name], f"{name}: {executions[name]} executions, ledger {entry}")
        expect(entry["predicted"] == entry["executions"] - entry["repeated"] and entry["difference"] == 0,
               f"{name} was executed otherwise than predicted: {entry}")
        expect(entry["saved"] == entry["plain"] - entry["executions"], f"{name}: what was saved is wrong: {entry}")
    expect(told["cache"]["saved"] == ledger["total"]["saved"], f"{told['cache']} and {ledger['total']}")


LEDGER = "SELECT component, plain, predicted, executions, repeated, difference FROM v_ledger WHERE run = ?"


def check_recorded_ledger(told, database, run):
    """Checks that the database has the same ledger as --json, for each component."""
    components = told["ledger"]["components"]
    wanted = [(name, *(entry[key] for key in ("plain", "predicted", "executions", "repeated", "difference")))
              for name, entry in components.items()]
    found = query(database, LEDGER, run)
    expect(found == wanted, f"the ledger in the database is {found}, told was {wanted}")


def check_summary(told, database, prediction=1, components=3, run=1):
    """Checks the --json report of a `run` that lost nothing against the database. Returns the
    number of steps."""
    rows = check_rows(database, run)
    caught_up = told["outcomes"]["caught up"]
    total = told["ledger"]["total"]
    expect(told["steps"] + told["skipped"] == told["ticks"],
           f"{told['steps']} steps + {told['skipped']} skipped are not {told['ticks']} ticks")
    expect(caught_up == told["skipped"], f"{caught_up} caught up, but {told['skipped']} skipped")
    expect(sum(told["outcomes"].values()) == rows == told["steps"] + caught_up,
           f"{rows} rows, told {told['outcomes']}")
    expect(len(told["ledger"]["components"]) == components, f"components: {told['ledger']}")
    check_ledger(told, rows + prediction * told["evaluations"])
    check_recorded_ledger(told, database, run)
    counted = query(database, "SELECT sum(evaluations), sum(executions), sum(predicted), sum(outcome = ?) "
                    "FROM steps WHERE steps.run = ?", MADE_UP, run)[0]
    wanted = (told["evaluations"], total["executions"], total["predicted"], caught_up)
    wanted = (None,) * 4 if rows == 0 else wanted
    expect(counted == wanted, f"the database has {counted}, told was {wanted}")
    return rows


def wait_for_lock(program, database, after=-1):
    """Waits until 20 steps after step `after` were within tolerance."""
    wait_for_steps(program, database, 1)
    sql = "SELECT count(*) FROM steps WHERE step > ? AND outcome IN (?, ?) AND run = 1"
    wait_until(lambda: number(database, sql, after, FIRST_GUESS, OPTIMISED) >= 20, "lock", program.log)


def wait_for_quality(program, database, signal, quality):
    """Waits until the newest sample has that quality."""
    wait_for_steps(program, database, 1)
    sql = SAMPLES + " ORDER BY samples.tick DESC LIMIT 1"
    wanted = {"run": 1, "name": "plant." + signal}
    wait_until(lambda: [row[1] for row in query(database, sql, wanted)] == [quality],
               f"quality {quality} of {signal}", program.log)


def last_step(database):
    return number(database, "SELECT max(step) FROM steps WHERE steps.run = 1")


RESULTS = """SELECT s.step, s.t_ns, s.outcome, s.evaluations, s.J, s.J_nominal, s.flags, s.held,
                    o.simulated, o.measured, o.quality, a.applied, a.nominal
             FROM steps s
             JOIN outputs o USING (run, step)
             JOIN adjustments a USING (run, step)
             WHERE run = ? ORDER BY step"""
COSTS = "SELECT step, executions, predicted FROM steps WHERE steps.run = ? ORDER BY step"


def bits(row):
    return tuple(struct.pack(">d", value) if isinstance(value, float) else value for value in row)


def expect_repeated(database, run, again, sql, rows):
    """Checks that the query gives the same bits of run `run` and of the replay, and `rows` rows."""
    found = [bits(row) for row in query(again, sql, 1)]
    wanted = [bits(row) for row in query(database, sql, run)]
    different = [i for i, pair in enumerate(zip(found, wanted)) if pair[0] != pair[1]]
    expect(len(found) == len(wanted) == rows,
           f"{len(found)} steps of run {run} replayed, {len(wanted)} recorded, {rows} told; last of both: "
           f"{[row[:3] for row in wanted[-2:]]}, {[row[:3] for row in found[-2:]]}, last tick "
           f"{number(database, 'SELECT max(tick) FROM samples WHERE samples.run = ?', run)}; runs: "
           f"{query(database, 'SELECT run, lead, steps_written, samples_written, entries_lost, ended_reason FROM runs')}")
    if different:
        first = query(database, sql, run)[different[0]], query(again, sql, 1)[different[0]]
        raise Failure(f"{len(different)} steps differ, the first is {first[0]}, replayed {first[1]}")


def check_replay(config, database, rows, run=1, costs=True):
    """Checks that a replay of a run gives the same bits and events. Returns its --json report.

    Without `costs` the replay may take fewer executions, because the run may have stopped a long
    horizon early.
    """
    again = scratch() / "again.db"
    told = replay_json(config, "--recording", database, "--db", again, timeout=PATIENCE)
    expect_repeated(database, run, again, RESULTS, rows)
    if costs:
        expect_repeated(database, run, again, COSTS, rows)
    expect_same_events(database, run, again)
    return told


# Without the events of drivers and of the recorder, which have no tick, without findings, which the
# recorder reports ahead of other events, and without those of the cycle: how it counts missed ticks
# together depends on how many it catches up at once. A run that was cut short may lack its last sample, but not the events before it.
EVENTS = """SELECT tick, severity, source, text FROM events
            WHERE run = ? AND source NOT IN ('cycle', 'finding') AND tick IS NOT NULL
            AND (tick <= (SELECT max(tick) FROM samples WHERE run = ?)
                 OR (SELECT coalesce(ended_reason, 'not ended cleanly') FROM runs WHERE run = ?) <> 'not ended cleanly')
            ORDER BY event"""

CALENDAR_TIME = re.compile(r"(?<=since )[-0-9: ]+UTC \((t = [^)]*)\)")  # a replay has only the time in brackets


def expect_same_events(live, run, again):
    """Checks that run and replay have the same events, in the order of ticks."""
    told, repeated = ([(tick, severity, source, CALENDAR_TIME.sub(r"\1", text)) for tick, severity, source, text in query(path, EVENTS.replace("?", str(number)))]
                      for path, number in ((live, run), (again, 1)))
    expect(told == repeated, f"events of the run:\n{told}\nof its replay:\n{repeated}")
    ticks = [event[0] for event in told]
    expect(ticks == sorted(ticks), f"events are not in the order of ticks: {told}")


def expect_reasons(path, *reasons):
    """Checks why each run of a database has ended: `reasons` are lists of parts (see
    has_line())."""
    found = [row[0] for row in query(path, "SELECT ended_reason FROM runs ORDER BY run")]
    expect(len(found) == len(reasons) and all(has_line(text or "", parts) for text, parts in zip(found, reasons)),
           f"the runs ended: {found}, wanted {list(reasons)}")


def changes(values):
    """[1, 1, 2, 1] → [1, 2, 1]"""
    return [value for i, value in enumerate(values) if i == 0 or value != values[i - 1]]


SAMPLES = """SELECT tick, quality, value FROM samples JOIN signals USING (run, signal)
             WHERE run = :run AND kind = 'plant' AND name = :name"""


def qualities(database, signal, run=1):
    """The sequence of qualities of a plant signal, without repetitions."""
    rows = query(database, SAMPLES + " ORDER BY tick", {"run": run, "name": "plant." + signal})
    return changes([quality for _, quality, _ in rows])


def expect_in_order(found, wanted, what):
    """Checks that `found` has all items of `wanted` in this order. Other items may be between
    them."""
    rest = iter(found)
    expect(all(item in rest for item in wanted), f"{what}: found {found}, wanted {wanted} in this order")


def events(database):
    """[(severity, text)] of the events of run 1."""
    return query(database, "SELECT severity, text FROM v_events WHERE run = 1")


def expect_events(database, *wanted):
    """Checks that these events are in this order. Others may be between them. Each is a severity
    and parts of the text."""
    rest = iter(events(database))
    for severity, parts in wanted:
        expect(any(found == severity and has_line(text, parts) for found, text in rest),
               f"no event {severity} \"{parts}\" in its place in {events(database)}")


def check_free_run(database):
    """Checks that the twin ran free in exactly the steps without a good measurement, and kept the
    last good one."""
    rows = query(database, f"""SELECT s.step, s.outcome, o.quality, o.measured, p.quality, p.value
                               FROM steps s
                               JOIN outputs o USING (run, step)
                               JOIN ({SAMPLES}) p ON p.tick = s.step + 1
                               WHERE s.run = :run ORDER BY s.step""", {"run": 1, "name": "plant.omega"})
    good = None
    for step, outcome, quality, y_hat, sampled, value in rows:
        expect(quality == sampled, f"step {step}: quality {quality}, its sample has {sampled}")
        expect(outcome == MADE_UP or (outcome == FREE_RUN) == (quality != GOOD),
               f"step {step}: outcome {outcome} at quality {quality}")
        good = value if quality == GOOD else good
        expect(good is None or y_hat == good, f"step {step}: y_hat {y_hat}, the last good one is {good}")


# ---- devices ----

def free_port():
    with closing(socket.socket()) as listener:
        listener.bind(("127.0.0.1", 0))
        return listener.getsockname()[1]


def refused_writes(log):
    """The number of write requests that `twinlock plant` counted, from the line that it logs at its
    end."""
    found = re.findall(r"\b(\d+) requests\b\D*\b(\d+)\b.*\bwrit", log)
    expect(len(found) == 1 and int(found[0][0]) > 0, f"not one count of requests, above 0\n{log}")
    return int(found[0][1])


class Device:
    """A Modbus TCP server with the input registers 0 … 2 of the motor bench: omega as float32,
    torque as int16.

    `functions` collects the function codes of all requests. `silent`: the device does not answer.
    """

    def __init__(self, omega, torque=0, port=0):
        self.omega, self.torque, self.silent = omega, torque, False
        self.functions = set()
        self.listener = socket.socket()
        self.listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self.listener.bind(("127.0.0.1", port))
        self.listener.listen()
        self.port = self.listener.getsockname()[1]
        threading.Thread(target=self._accept, daemon=True).start()

    def __enter__(self):
        return self

    def __exit__(self, *unused):
        self.listener.shutdown(socket.SHUT_RDWR)  # else the accepting thread keeps the port
        self.listener.close()

    def _accept(self):
        while True:
            try:
                client, _ = self.listener.accept()
            except OSError:
                return
            threading.Thread(target=self._serve, args=(client,), daemon=True).start()

    def _serve(self, client):
        with client, client.makefile("rb") as requests:
            try:
                while len(header := requests.read(7)) == 7:
                    transaction, protocol, length, unit = struct.unpack(">HHHB", header)
                    request = requests.read(length - 1)
                    self.functions.add(request[0])
                    if not self.silent:
                        reply = self._reply(request)
                        head = struct.pack(">HHHB", transaction, protocol, len(reply) + 1, unit)
                        client.sendall(head + reply)
            except OSError:
                return

    def _reply(self, request):
        function, address, count = struct.unpack(">BHH", request[:5])
        data = struct.pack(">fh", self.omega, self.torque)[2 * address:2 * (address + count)]
        if function != 4 or len(data) != 2 * count:
            return bytes((function | 0x80, 2))
        return bytes((function, len(data))) + data


def title(pid):
    """The title of a process as in ps; "" if it is dead."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_text(encoding="utf-8").partition("\0")[0]
    except OSError:
        return ""


def children(pid):
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="utf-8").split()]


def member(program, role, other_than=0):
    """The process of a run that has this role ("twin", "io", "recorder"), other than the process
    `other_than`."""
    def found():
        return [pid for pid in children(program.pid) if pid != other_than and title(pid).startswith(f"twinlock: {role}")]
    return wait_until(found, f"a process \"{role}\"", program.log)[0]


def is_stopped(pid):
    return Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0] == "T"


def stop(pid):
    """Sends SIGSTOP and waits until the process has stopped."""
    os.kill(pid, signal.SIGSTOP)
    wait_until(lambda: is_stopped(pid), "the stop of a process")
