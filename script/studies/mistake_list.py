"""The mistakes of script/studies/mistakes: each with the texts that a message must have, written before any message was read.

`place`: object or key, and value, in one message. `cure`: one of these must be in the same message. "|" separates in both.
`make(kit)` makes the mistake in a new folder and returns the commands in the order in which a user gives them.
"""
import lzma
import os
import socket
import zipfile
from collections import namedtuple

Mistake = namedtuple("Mistake", "group name place cure make needs_device", defaults=(False,))
MISTAKES = []
LOCK, LIVE, TCLAB = "motor/lock.json", "motor/live.json", "tclab/lock.json"
NOBODY = 65534


def add(group, name, place, cure, make, needs_device=False):
    MISTAKES.append(Mistake(group, name, place, cure, make, needs_device))


# ---- (a) JSON and keys ----

def text(old, new):
    """`check` of config/motor/lock.json with an edited text."""
    return lambda kit: [["check", kit.edit(LOCK, (old, new))]]


def raw(content, name="motor.json"):
    return lambda kit: [["check", kit.write(name, content(kit) if callable(content) else content)]]


def original(kit):
    return kit.text(LOCK).encode()


def unreadable(kit):
    path = kit.edit(LOCK)
    path.chmod(0)
    return [kit.as_nobody("check", path)]


def folder(kit):
    (kit.folder / "motor").mkdir()
    return [["check", kit.folder / "motor"]]


A = "JSON and keys"
add(A, "comma before }", "line 22|comma", "comma", text('"step": 0.12, "min": -1, "max": 1 }', '"step": 0.12, "min": -1, "max": 1, }'))
add(A, "decimal comma", "line 4|0,01", "decimal point|0.01", text("0.01", "0,01"))
add(A, "missing quote", "line 4|line break", 'quote|the "', text('"step_s"', '"step_s'))
add(A, "single quotes", "line 3|'", 'double quotes|in "', text('"name"', "'name'"))
add(A, "comment", "line 8|/", "comment|comments", text('"J": 0.0515 }', '"J": 0.0515 } // inertia'))
add(A, "missing comma", "line 5", "comma", text('"step_s": 0.01,', '"step_s": 0.01'))
add(A, "True for true", "line 2|True", "true", text('"twinlock": 1,', '"twinlock": True,'))
add(A, "closing brace missing", "line 32|end of the file", "}", lambda kit: [["check", kit.write("motor.json", kit.text(LOCK).rstrip().removesuffix("}").encode())]])
add(A, "byte order mark", "motor.json|byte order mark", "remove|without|UTF-8", raw(lambda kit: b"\xef\xbb\xbf" + original(kit)))
add(A, "UTF-16 file", "motor.json|0xFF", "UTF-8", raw(lambda kit: kit.text(LOCK).encode("utf-16")))
add(A, "Latin-1 file", "motor.json|line 3", "UTF-8", raw(lambda kit: kit.text(LOCK).replace("bench", "Prüfstand").encode("latin-1")))
add(A, "empty file", "motor.json|end of the file", "init|{", raw(b""))
add(A, "a folder", "motor|directory", ".json|file", folder)
add(A, "no right to read", "motor.json|Permission denied", "chmod|right to read|chown|read permission", unreadable)
add(A, "an FMU as configuration", "motor.fmu", "init|JSON", lambda kit: [["check", kit.fmu("motor.fmu")]])
add(A, "a recording as configuration", "recording.csv", "--recording|JSON", lambda kit: [["check", kit.recording()]])
add(A, "key twice", "line 5|step_s", "remove|once|one of", text('"duration_s": 14,', '"step_s": 0.02,'))
add(A, "key misspelled", "toleranse", "tolerance", text('"tolerance"', '"toleranse"'))
add(A, "section misspelled", "synchronize", "synchronise", text('"synchronise"', '"synchronize"'))
add(A, "text for a number", 'step_s|"0.01"', "number|without quotes", text('"step_s": 0.01', '"step_s": "0.01"'))
add(A, "text for true", 'synchronise.rest|"true"', "without quotes|true or false", text('"algorithm"', '"rest": "true", "algorithm"'))
add(A, "number for true", "synchronise.rest|1", "true or false|true", text('"algorithm"', '"rest": 1, "algorithm"'))
add(A, "required key missing", "step_s", "required|add|expected", text('"step_s": 0.01,', ""))
add(A, "unit misspelled", "rad/sec|plant.omega", "rad/s", text('"unit": "rad/s"', '"unit": "rad/sec"'))
add(A, "key at the wrong level", "synchronise.tolerance", "synchronise.match.OUTPUT", text('"algorithm": "secant"', '"algorithm": "secant", "tolerance": 1'))
add(A, "signal without plant.", 'synchronise.match.motor.omega.to|"omega"', "plant.omega", text('"to": "plant.omega"', '"to": "omega"'))
add(A, "Windows path", "line 7|\\models", "/|\\\\", text('"fmu": "drive.fmu"', '"fmu": "C:\\models\\drive.fmu"'))


# ---- (b) FMU ----

def patch(change, base=LOCK):
    """`check` of a configuration with a merge patch."""
    return lambda kit: [["check", kit.patch(base, change(kit) if callable(change) else change)]]


def lines(*more, drop=()):
    pairs = [["plant.torque", "motor.M_w"], ["drive.u_R", "motor.I_in"], ["motor.omega", "drive.y"]]
    return patch({"connect": [pair for pair in pairs if pair not in drop] + list(more)})


def adjust(name, **keys):
    return patch({"synchronise": {"adjust": {"motor.d": None, name: {"step": 0.1, **keys}}}})


def synchronise(**keys):
    return patch({"synchronise": keys})


def repacked(edit):
    """A motor.fmu with edit(name, bytes) for each member: (name, bytes) or None."""
    def change(kit):
        with zipfile.ZipFile(kit.fmu("motor.fmu")) as old, zipfile.ZipFile(kit.folder / "other.fmu", "w") as new:
            for name in old.namelist():
                member = edit(name, old.read(name))
                if member is not None:
                    new.writestr(*member)
        return {"components": {"motor": {"fmu": "other.fmu"}}}
    return patch(change)


def in_description(old, new):
    def edit(name, data):
        return (name, data.replace(old.encode(), new.encode()) if name == "modelDescription.xml" else data)
    return repacked(edit)


def model_exchange(name, data):
    return name, data.replace(b"<CoSimulation", b"<ModelExchange").replace(b"</CoSimulation", b"</ModelExchange") if name == "modelDescription.xml" else data


def corrupt(kit):
    kit.write("other.fmu", kit.fmu("motor.fmu").read_bytes()[:9000])
    return {"components": {"motor": {"fmu": "other.fmu"}}}


def slow_steps(kit):
    config = kit.patch(LOCK, {"step_s": 10, "synchronise": {"budget": None}})
    return [["check", config], ["replay", config], ["check", config, "--recording", kit.recording()]]


B = "FMU"
add(B, "file missing", "components.motor|moter.fmu", "motor.fmu|TWINLOCK_FMU_PATH|beside", patch({"components": {"motor": {"fmu": "moter.fmu"}}}))
add(B, "component misspelled", "connect[2][0]|motr.omega", "motor.omega", lines(["motr.omega", "drive.y"], drop=[["motor.omega", "drive.y"]]))
add(B, "variable misspelled", 'connect[2]|"omga"', "omega", lines(["motor.omga", "drive.y"], drop=[["motor.omega", "drive.y"]]))
add(B, "letter case", 'connect[2]|"Omega"', "omega", lines(["motor.Omega", "drive.y"], drop=[["motor.omega", "drive.y"]]))
add(B, "output to output", "connect[3]|motor.omega|output", "input", lines(["drive.u_R", "motor.omega"]))
add(B, "pair reversed", "connect[2][1]|plant.torque", "swap|exchange|reverse|other way|reversed|from, to|[from, to]",
    lines(["motor.M_w", "plant.torque"], drop=[["plant.torque", "motor.M_w"]]))
add(B, "two sources of one input", "drive.y|connect[3]", "remove|only one|one of|at most one", lines(["plant.omega", "drive.y"]))
add(B, "input not connected", "motor.M_w", "connect|components.motor.set", lines(drop=[["plant.torque", "motor.M_w"]]))
add(B, "output adjusted", "synchronise.adjust.motor.omega|output", "input|tunable", adjust("motor.omega"))
add(B, "fixed parameter adjusted", "synchronise.adjust.motor.J|fixed", "tunable", adjust("motor.J"))
add(B, "nominal of a connected input", "synchronise.adjust.motor.I_in|nominal", "remove|omit", adjust("motor.I_in", nominal=1))
add(B, "no output matched", "synchronise.match.motor.M_w|input", "output", synchronise(match={"motor.omega": None, "motor.M_w": {"to": "plant.torque", "tolerance": 1}}))
add(B, "start value of an output", "components.motor.set.omega|output", "input|parameter", patch({"components": {"motor": {"set": {"omega": 3}}}}))
add(B, "text as start value", 'components.motor.set.J|"0.05"', "number|without quotes", patch({"components": {"motor": {"set": {"J": "0.05"}}}}))
add(B, "binary of another platform", "components.motor|win64", "linux64", repacked(lambda name, data: (name.replace("linux64", "win64"), data)))
add(B, "FMI 3.0", "components.motor|3.0", "2.0", in_description('fmiVersion="2.0"', 'fmiVersion="3.0"'))
add(B, "Model Exchange only", "components.motor|Model Exchange", "co-simulation|Co-Simulation", repacked(model_exchange))
add(B, "cut zip", "components.motor|other.fmu", "copy|export|again", patch(corrupt))
add(B, "zip without description", "components.motor|modelDescription.xml", "export|again",
    repacked(lambda name, data: None if name == "modelDescription.xml" else (name, data)))
add(B, "min above max", "synchronise.adjust.motor.d.max|1|-1", "min < max|swap|exchange|more than min", text('"min": -1, "max": 1', '"min": 1, "max": -1'))
add(B, "nominal outside the bounds", "synchronise.adjust.motor.d|0.0031|0.01", "widen|expected|inside|correct", text('"min": -1', '"min": 0.01'))
add(B, "signal's unit is another", "plant.omega|bar|rad/s", "scale", text('"unit": "rad/s"', '"unit": "bar"'))
add(B, "step_s 0", "step_s|0", "1e-05|1e-5|0.00001", text('"step_s": 0.01', '"step_s": 0'))
add(B, "step_s negative", "step_s|-0.01", "1e-05|1e-5|0.00001", text('"step_s": 0.01', '"step_s": -0.01'))
add(B, "step_s 10 for 0.01", "step_s|10", "0.01|shorter|smaller|interval|0.0323", slow_steps)
add(B, "T_P 0", "synchronise.horizon.prediction|0", "1|1 … 1000", text('"prediction": 1', '"prediction": 0'))
add(B, "tolerance 0", "synchronise.match.motor.omega.tolerance|0", "> 0|above 0|noise|greater than 0", text('"tolerance": 1.0', '"tolerance": 0'))
add(B, "algorithm misspelled", "synchronise.algorithm|nelder_mead", "nelder-mead", text('"secant"', '"nelder_mead"'))


# ---- (c) devices ----

def probe(change=None, **server):
    """check and probe of config/motor/live.json at a Modbus server with its registers."""
    def make(kit):
        port = kit.serve(**server)
        inner = change(kit) if callable(change) else change or {}
        source = {"sources": {"inverter": {"modbus_tcp": {"port": port}}}, "plant": {"omega": {"stale_s": 5}, "torque": {"stale_s": 5}}}
        config = kit.patch(LIVE, source, inner)
        return [["check", config], ["probe", config, "--duration", "2"]]
    return make


def omega(**keys):
    return {"plant": {"omega": {"modbus": keys}}}


def both(omega_keys, torque_keys):
    return {"plant": {"omega": {"modbus": omega_keys}, "torque": {"modbus": torque_keys}}}


def tcp(**keys):
    return {"sources": {"inverter": {"modbus_tcp": keys}}}


def other_source(kind, keys, **signal):
    """A source of another kind for one signal."""
    name = {"modbus_rtu": "modbus"}.get(kind, kind)
    return {"sources": {"line": {kind: keys}},
            "plant": {"omega": {**({"modbus": None} if name != "modbus" else {}), name: {"source": "line", **signal}}}}


def stream(file):
    def change(kit):
        path = file(kit)
        return {"sources": {"line": {"csv": {"file": str(path), "time_column": "t"}}}, "plant": {"omega": {"modbus": None, "csv": {"source": "line"}}}}
    return change


def fifo(kit):
    os.mkfifo(kit.folder / "values")
    return kit.folder / "values"


def closed_port(_kit):
    with socket.create_server(("127.0.0.1", 0)) as listening:
        return tcp(port=listening.getsockname()[1])


def forbidden_line(kit):
    control, line = os.openpty()
    kit.keep(control, line)
    path = os.ttyname(line)
    os.chmod(path, 0o600)
    os.chown(path, 0, 0)
    config = kit.patch(LIVE, other_source("modbus_rtu", {"device": path}))
    return [kit.as_nobody("probe", config, "--duration", "2")]


RTU = {"table": "input", "address": 0, "type": "float32"}
C = "devices"
add(C, "host wrong", "omega|192.0.2.1", "check host|check the host|host", probe(tcp(host="192.0.2.1")), True)
add(C, "host name does not resolve", "omega|plc7.invalid", "check host|check the host|host|IP address", probe(tcp(host="plc7.invalid")), True)
add(C, "port closed", "omega|refused", 'check port|port|"port": 502', probe(closed_port), True)
add(C, "unit id wrong", "omega|9", '"unit_id": 1', probe(both({"unit_id": 9}, {"unit_id": 9})), True)
add(C, "address as 30001", "omega|30001", 'count from 0|"address": 0', probe(both({"address": 30001}, {"address": 30003})), True)
add(C, "address one too high", "omega|0", '"address": 0', probe(both({"address": 1}, {"address": 3})), True)
add(C, "address one too low", "omega|0", '"address": 1', probe(address=1), True)
add(C, "wrong table", "omega|holding", '"table": "input"', probe(both({"table": "holding"}, {"table": "holding"})), True)
add(C, "wrong word order", "omega|427B EC8B", '"words": "big"', probe(omega(words="little")), True)
add(C, "int16 for float32", "omega|17019", "type", probe(omega(type="int16")), True)
add(C, "unsigned for signed", "torque|64.994", "type|int16", probe({"plant": {"torque": {"modbus": {"type": "uint16"}}}}, torque=-542), True)
add(C, "scale 100 times too large", "torque|54.2", "scale", probe({"plant": {"torque": {"modbus": {"scale": 0.1}}}}), True)
add(C, "coil type for a register", "plant.omega.modbus.bit|nothing", "whole number", probe(omega(type="bit")), True)
add(C, "type misspelled", 'plant.omega.modbus.type|"float"', "float32", probe(omega(type="float")), True)
add(C, "source misspelled", 'plant.omega.modbus.source|"invertor"', "inverter", probe(omega(source="invertor")), True)
add(C, "signal without source", "plant.omega", "modbus|can|csv", probe({"plant": {"omega": {"modbus": None}}}), True)
add(C, "register past the end", "plant.omega.modbus.address|65535", "65534", probe(omega(address=65535)), True)
add(C, "period shorter than the answers", "torque|period_s|0.005", "raise", probe(tcp(period_s=0.005, timeout_s=1), slow_s=0.08), True)
add(C, "timeout shorter than the answers", "timeout_s|0.02", "timeout_s|raise", probe(tcp(timeout_s=0.02), slow_s=0.1), True)
add(C, "serial line missing", "omega|/dev/ttyUSB7", "/dev/serial/by-id|plug|check device|device", probe(other_source("modbus_rtu", {"device": "/dev/ttyUSB7"}, **RTU)), True)
add(C, "serial line without rights", "/dev/pts|Permission denied", "dialout|group", forbidden_line, True)
add(C, "a file as serial line", "omega|recording.csv", "serial line|/dev/tty|/dev/serial",
    probe(lambda kit: other_source("modbus_rtu", {"device": str(kit.recording())}, **RTU)), True)
add(C, "CAN without its modules", "omega|can7", "modprobe can-raw|ip link", probe(other_source("can", {"interface": "can7"}, id=1, start=0, type="float32", length=32)), True)
add(C, "GPIO chip missing", "omega|gpiochip7", "gpiodetect|chip", probe(other_source("gpio", {"chip": "gpiochip7"}, offset=3)), True)
add(C, "one GPIO line twice", "plant.omega.gpio.offset|plant.torque", "remove|another|one signal|only one|no other signal", probe(
    {"sources": {"line": {"gpio": {"chip": "gpiochip7"}}}, "plant": {name: {"modbus": None, "gpio": {"source": "line", "offset": 3}} for name in ("omega", "torque")}}), True)
add(C, "FIFO without writer", "omega|values", "writer|writes|program that writes", probe(stream(fifo)), True)
add(C, "stream's file missing", "omega|values.csv", "csv.file|file|create", probe(stream(lambda kit: kit.folder / "values.csv")), True)
add(C, "stream's column missing", "omega|speed", "csv.column", probe(stream(lambda kit: kit.recording(lambda rows: [rows[0].replace("omega", "speed"), *rows[1:]]))), True)


# ---- (d) recordings and files ----

def replay(change=None, name="monday.csv", patches=None):
    """replay of a changed recording: change(rows) → rows, or bytes."""
    def make(kit):
        rows = kit.recording().read_text(encoding="utf-8").splitlines()
        changed = change(rows) if callable(change) else change
        data = changed if isinstance(changed, bytes) else "".join(f"{row}\n" for row in changed).encode()
        config = kit.patch(LOCK, patches or {})
        path = kit.write(name, data)
        return [["replay", config, "--recording", path], ["check", config, "--recording", path]]
    return make


def cells(column, change):
    """The rows with change(text) in one column, without the header."""
    def edit(rows):
        split = [row.split(",") for row in rows[1:]]
        return [rows[0], *(",".join(change(cell) if i == column else cell for i, cell in enumerate(row)) for row in split)]
    return edit


def header(line):
    return lambda rows: [line, *rows[1:]]


def milliseconds(time):
    return f"{1000 * float(time):.3f}"


def clock(time):
    return f"14:02:{float(time):09.6f}"


def other_database(kit):
    other = kit.folder / "tclab.db"
    kit.run(["replay", kit.patch(TCLAB, {"duration_s": 20}, name="tclab.json"), "--db", other])
    return [["replay", kit.patch(LOCK, {}), "--recording", other]]


def closed_folder(kit):
    (kit.folder / "data").mkdir(mode=0o555)
    return [kit.as_nobody("replay", kit.patch(LOCK, {}), "--db", kit.folder / "data" / "twin.db")]


def second_run(kit):
    port = kit.serve()
    config = kit.patch(LIVE, tcp(port=port))
    kit.start(["run", config, "--duration", "60"], kit.folder / "twin.db")
    return [["run", config, "--duration", "2"]]


D = "recordings and files"
add(D, "file missing", "tuesday.csv", "monday.csv|--recording", lambda kit: [["replay", kit.patch(LOCK, {}), "--recording", kit.write("monday.csv", b"t\n").with_name("tuesday.csv")]])
add(D, "column missing", "omega|speed", "csv.column", replay(header("t,speed,M_brake")))
add(D, "time column missing", '"t"|time', "recording.time_column|time_column", replay(header("time,omega,M_brake")))
add(D, "decimal comma, comma as separator", "line 2", "decimal point|decimal commas|semicolons", replay(lambda rows: [rows[0], *(row.replace(".", ",") for row in rows[1:])]))
add(D, "time in milliseconds", "monday.csv|time|milliseconds", "seconds|divide|/ 1000", replay(cells(0, milliseconds)))
add(D, "time of day", "line 2|14:02:00.000000", "seconds|date", replay(cells(0, clock)))
add(D, "time descending", "line 3|14.195008000 s", "sort|ascending|export|order", replay(lambda rows: [rows[0], *reversed(rows[1:])]))
add(D, "no header", "line 1|monday.csv", "header|first line|names", replay(lambda rows: rows[1:]))
add(D, "header again in the middle", "line 101|\"t\"", "remove|header", replay(lambda rows: rows[:100] + rows[:1] + rows[100:]))
add(D, "empty file", "monday.csv|empty", "header|rows|first line", replay(b""))
add(D, "only a header", "monday.csv|no row|header", "record|give", replay(lambda rows: rows[:1]))
add(D, "texts in a column", "plant.omega|ERROR", "number", replay(cells(1, lambda _: "ERROR")))
add(D, "NaN everywhere", "plant.omega|not a number", "csv.column|check|number", replay(cells(1, lambda _: "NaN")))
add(D, "empty column", "plant.omega|no value", "csv.column|check|number", replay(cells(1, lambda _: "")))
add(D, "compressed by xz", "monday.csv.xz|compressed", "xz -dc", replay(lambda rows: lzma.compress("\n".join(rows).encode()), "monday.csv.xz"))
add(D, "a workbook", "monday.xlsx", "CSV", replay(lambda _: b"PK\x03\x04\x14\0\x06\0\x08\0" + bytes(3000), "monday.xlsx"))
add(D, "recording of another twin", "recording.csv|Q1", "csv.column|another recording", lambda kit: [["replay", kit.patch(LOCK, {}), "--recording", kit.config(TCLAB).with_name("recording.csv")]])
add(D, "recording shorter than the horizon", "recording|61 ticks|108", "longer|prediction", replay(lambda rows: rows[:20], patches={"synchronise": {"horizon": {"prediction": 100}}}))
add(D, "database of another twin", "tclab.db|plant.Q1|plant.torque", "configuration of|must be the same", other_database)
add(D, "database in a folder without rights", "data/twin.db", "rights|chown|permission|write|folder", closed_folder)
add(D, "record file is no database", "monday.csv", "another|move|--db|new name", lambda kit: [["replay", kit.patch(LOCK, {}), "--db", kit.write("monday.csv", b"t,omega\n0,1\n" * 100)]])
add(D, "folder of the report missing", "reports/monday.html", "mkdir|create|folder", lambda kit: [["replay", kit.patch(LOCK, {}), "--report", kit.folder / "reports" / "monday.html"]])
add(D, "disk full", "/dev/full|No space", "free|another", lambda kit: [["replay", kit.patch(LOCK, {}), "--csv", "/dev/full"]])
add(D, "second run of the same twin", "twin.db", "stop|--db|other run|another run", second_run, True)


# ---- (e) the lock ----

def tried(change, rows=None, base=LOCK):
    """What a user runs in turn: check, replay, check --recording."""
    def make(kit):
        recording = kit.recording(rows) if base == LOCK else kit.config(base).with_name("recording.csv")
        config = kit.patch(base, {"recording": {"file": str(recording)}}, change)
        return [["check", config], ["replay", config], ["check", config, "--recording", recording]]
    return make


def scaled(column, factor):
    return cells(column, lambda cell: repr(factor * float(cell)))


def match(**keys):
    return {"synchronise": {"match": {"motor.omega": keys}}}


def friction(**keys):
    return {"synchronise": {"adjust": {"motor.d": keys}}}


E = "the lock"
add(E, "tolerance within the noise", "motor.omega|tolerance|0.05|noise", "three times|raise|0.3|0.94", tried(match(tolerance=0.05)))
add(E, "tolerance far too large", "motor.omega|tolerance|1000", "noise|lower|smaller|three times", tried(match(tolerance=1000)))
add(E, "bounds too narrow", "synchronise.adjust.motor.d|-0.01|0.01", "widen|min|max", tried(friction(min=-0.01, max=0.01)))
add(E, "bounds missing", "synchronise.adjust.motor.I_in|\"min\"", "Set it|set", tried({"synchronise": {"adjust": {"motor.d": None, "motor.I_in": {"step": 5}}}}))
add(E, "two that act alike", "motor.d|motor.I_in", "remove|one of|only one|alike", tried({"synchronise": {"adjust": {"motor.I_in": {"step": 5, "min": -40, "max": 40}}}}))
add(E, "signals swapped", "plant.torque|62.9671|-20|20", "csv.column|check|column", tried({"plant": {"torque": {"csv": {"column": "omega"}}, "omega": {"csv": {"column": "M_brake"}}}}))
add(E, "horizon shorter than the reaction", "synchronise.adjust.board.Q1|0.032", "prediction|longer", tried({"synchronise": {"horizon": {"prediction": 1}}}, base=TCLAB))
add(E, "sign reversed", "motor.omega|-62.89", "sign|scale", tried({}, scaled(1, -1)))
add(E, "sign of an input reversed", "plant.torque|sign reversed", "sign", tried({}, scaled(2, -1)))
add(E, "scale of an input times 10", "plant.torque|10 times", "scale", tried({}, scaled(2, 10)))
add(E, "scale of an output times 10", "plant.omega|627.304|500", "scale", tried({}, scaled(1, 10)))
add(E, "scale of an output times 1.5", "motor.omega|94.33", "scale", tried({}, scaled(1, 1.5)))
add(E, "step 1000 times too large", "synchronise.adjust.motor.d|step|120", "smaller|lower|reduce|0.12", tried(friction(step=120)))
add(E, "step 1000 times too small", "synchronise.adjust.motor.d|step|0.00012", "larger|raise|0.12", tried(friction(step=0.00012)))
add(E, "stale_s below the interval", "plant.omega|stale_s|0.01", "raise|stale_s", tried({"plant": {"omega": {"stale_s": 0.01}}}))
add(E, "range too narrow", "plant.omega|50", "min|max|widen|range", tried({"plant": {"omega": {"min": -50, "max": 50}}}))
add(E, "gate too narrow", "synchronise.match.motor.omega|condition.gate|0.01", "raise|gate|remove|noise", tried(match(condition={"low_pass_s": None, "gate": 0.01})))
add(E, "low-pass too slow", "synchronise.match.motor.omega|condition.low_pass_s|2", "low_pass_s 0.0|shorter|reduce|lower", tried(match(condition={"low_pass_s": 2})))
add(E, "search time too short", "synchronise.budget|0.001 ms", "raise|time_s|longer", tried({"synchronise": {"budget": {"time_s": 1e-6}}}))


# ---- (f) operation ----

def command(*words):
    return lambda kit: [[kit.word(word) for word in words]]


def database(kit):
    kit.run(["replay", kit.patch(LOCK, {"duration_s": 2}), "--db", kit.folder / "twin.db"])
    return kit.folder / "twin.db"


def shown(*words):
    return lambda kit: [["show", database(kit), *words]]


def closed_socket(kit):
    control = socket.socket(socket.AF_UNIX)
    kit.keep(control)
    control.bind(str(kit.folder / "control"))
    control.listen()
    os.chmod(kit.folder / "control", 0)
    return [kit.as_nobody("reload", kit.patch(LOCK, {}), "--control", kit.folder / "control")]


def other_twin(kit):
    port = kit.serve()
    config = kit.patch(LIVE, tcp(port=port))
    kit.start(["run", config, "--supervise", "--state", kit.folder / "state", "--control", kit.folder / "control"], kit.folder / "control")
    return [["reload", kit.patch("vessels/live.json", {}, name="vessels.json"), "--control", kit.folder / "control", "--no-activate"]]


F = "operation"
add(F, "verb misspelled", "replai", "replay", command("replai", "CONFIG"))
add(F, "verb missing", "motor.json", "check|help", command("CONFIG"))
add(F, "option misspelled", "--recroding", "--recording", command("replay", "CONFIG", "--recroding", "x.csv"))
add(F, "option of another verb", "--duration", "run|help replay|replay", command("replay", "CONFIG", "--duration", "5"))
add(F, "option without its value", "--recording", "FILE|file", command("replay", "CONFIG", "--recording"))
add(F, "word for a number", "--duration|ten", "seconds|number", command("run", "CONFIG", "--duration", "ten"))
add(F, "two configurations", "other.json", "one|one CONFIG|only one", command("check", "CONFIG", "other.json"))
add(F, "configuration forgotten", "check", "CONFIG", command("check"))
add(F, "percent above 100", "--require-lock|200", "100", command("replay", "CONFIG", "--require-lock", "200"))
add(F, "configuration missing", "moter.json", "motor.json", lambda kit: [["check", kit.patch(LOCK, {}).with_name("moter.json")]])
add(F, "show of a missing database", "nothing.db", "record.file|--db|run", command("show", "nothing.db"))
add(F, "show of a configuration", "motor.json", ".db", command("show", "CONFIG"))
add(F, "--since nonsense", "--since|yesterday", "8h|2026-11-21", shown("--since", "yesterday"))
add(F, "unknown run number", "7|twin.db", "1|last|lists", shown("--run", "7"))
add(F, "unknown table", "--csv|signals", "outputs|samples", shown("--csv", "signals"))
add(F, "unknown finding", "9|twin.db", "show", lambda kit: [["finding", database(kit), "--acknowledge", "9"]])
add(F, "run without live source", "plant.torque", "modbus|can|csv", command("run", "CONFIG"))
add(F, "run with fill_in", "fill_in", "remove|fill in", lambda kit: [["run", kit.patch(LIVE, {"fill_in": {"plant.omega": "address"}})]])
add(F, "plant without recording", "motor.json|names no recording", "--recording|recording.file", lambda kit: [["plant", kit.patch(LIVE, {"recording": None})]])
add(F, "reload without a run", "control|no run", "start it|systemctl", command("reload", "CONFIG"))
add(F, "reload without rights", "control|permission denied", "sudo|group|root|user", closed_socket)
add(F, "reload of another twin", "motor bench|two vessels", "--control|another", other_twin, True)
add(F, "init without FMU", "init", "FMU", command("init"))
add(F, "unknown role", "--role", "commission", command("token", "add", "anna", "--role", "boss"))
add(F, "state without --supervise", "--state", "--supervise", command("run", "CONFIG", "--state", "state"))
