"""For tests of the network: twinlock-serve with plants that have a control socket but no twin, and
HTTPS clients."""
import contextlib
import hashlib
import http.client
import json
import os
import re
import signal
import ssl
import subprocess
import time
from pathlib import Path

from twinlock_test import BUILD, PROGRAM, Failure, Skip, expect, program, scratch

SERVE = str(Path(PROGRAM).parent / "twinlock-serve")
MOTOR = "/api/v1/plants/motor"
FIRST = b'{"synchronise": {"margin": 1.5}}\n'


def need_serve():
    if not Path(SERVE).exists():
        raise Skip("twinlock-serve was not built (TL_SERVE)")


def wait_for(condition, what, seconds=10):
    """Waits until `condition` is true, and returns its value."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        value = condition()
        if value:
            return value
        time.sleep(0.01)
    raise Failure(f"{what}: not within {seconds} s")


def end(process):
    """Stops a process by SIGTERM and returns its output. Any exit code but 0, and a sanitizer
    report, is a failure."""
    if process.poll() is None:
        process.send_signal(signal.SIGTERM)
    try:
        code = process.wait(20)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
        raise Failure(f"{process.args[0]} does not end") from None
    process.log.seek(0)
    said = process.log.read()
    expect(code == 0 and "Sanitizer" not in said and "runtime error" not in said, f"{process.args[0]} ended with {code}\n{said}")
    return said


def begin(args, **options):
    """Starts a process; its output goes to the file `log`."""
    log = open(scratch() / "log", "w+", encoding="utf-8", errors="backslashreplace")  # pylint: disable=consider-using-with
    process = subprocess.Popen([str(arg) for arg in args], stdin=subprocess.DEVNULL, stdout=log, stderr=log, **options)
    process.log = log
    return process


def said_by(process):
    return Path(process.log.name).read_text(encoding="utf-8", errors="backslashreplace")


class Answer:
    """An HTTP response: status, headers, body, and its JSON lines."""

    def __init__(self, response):
        self.status, self.headers = response.status, response.headers
        self.body = response.read()

    @property
    def lines(self):
        return [json.loads(line) for line in self.body.decode("utf-8").splitlines()]

    @property
    def end(self):
        return self.lines[-1]


class Box:
    """Plants, tokens and a server, for `with Box() as box`. `options`: of twinlock-serve."""

    def __init__(self, *options, plants=("motor",), **popen):
        need_serve()
        self.folder = scratch()
        self.options, self.popen = options, popen
        self.plants = {name: None for name in plants}
        self.tokens = {}

    def __enter__(self):
        self.stack = contextlib.ExitStack()
        for part in ("state", "plants"):
            (self.folder / part).mkdir()
        for role in ("read", "retune", "commission"):
            self.tokens[role] = self.add_token(role, role)
        for name in self.plants:
            self.start_plant(name)
        self.start()
        return self

    def __exit__(self, kind, *rest):
        for process in [self.process, *self.plants.values()]:
            try:
                end(process)
            except Failure:
                if kind is None:
                    raise

    def start_plant(self, name):
        folder = self.folder / "plants" / name
        folder.mkdir(exist_ok=True)
        (self.folder / f"{name}.json").write_bytes(FIRST)
        self.plants[name] = begin([program("control_plant"), folder / "control", self.folder / f"{name}.json"])
        wait_for(lambda: "ready" in said_by(self.plants[name]), f"the plant {name}")

    def start(self):
        command = [SERVE, "--listen", "127.0.0.1:0", "--state", self.folder / "state", "--tokens", self.folder / "tokens",
                   "--plants", self.folder / "plants", *self.options]
        self.process = begin(command, **self.popen)
        said = wait_for(lambda: self.process.poll() is not None or re.search(r"port (\d+).*(sha256//\S+)", said_by(self.process)),
                        "the server")
        expect(said is not True, f"the server ended\n{said_by(self.process)}")
        self.port, self.pin = int(said[1]), said[2]

    def add_token(self, name, role):
        done = subprocess.run([SERVE, "token", "add", name, "--role", role, "--tokens", str(self.folder / "tokens")],
                              capture_output=True, encoding="utf-8", check=False)
        expect(done.returncode == 0, done.stderr)
        return done.stdout.strip()

    def log(self):
        return said_by(self.process)

    def memory(self):
        """Peak resident memory of the server, in bytes."""
        return 1024 * int(re.search(r"VmHWM:\s*(\d+)", Path(f"/proc/{self.process.pid}/status").read_text("ascii"))[1])

    def connect(self, address="127.0.0.1", timeout=20):
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
        return http.client.HTTPSConnection("127.0.0.1", self.port, timeout=timeout, context=context, source_address=(address, 0))

    def ask(self, method, target, role="commission", body=None, address="127.0.0.1", connection=None, **headers):
        """Sends a request and returns an Answer. Headers are keywords such as If_Match; a header
        that is None is omitted."""
        own = connection or self.connect(address)
        words = {"Authorization": f"Bearer {self.tokens[role]}" if role else None, **headers}
        words = {name.replace("_", "-"): word for name, word in words.items() if word is not None}
        own.request(method, target, body=body, headers=words)
        answer = Answer(own.getresponse())
        if connection is None:
            own.close()
        return answer

    def put(self, body, query="", role="commission", match="*", **options):
        return self.ask("PUT", f"/api/v1/plants/motor/configuration{query}", role, body, If_Match=match, **options)

    def requests(self, name="motor"):
        """The requests that the plant received, a dict each."""
        lines = said_by(self.plants[name]).splitlines()
        return [dict(re.findall(r"(\w+)=(.*?)(?= \w+=|$)", line)) for line in lines if line.startswith("verb=")]


def tag(text):
    return '"' + hashlib.sha256(text).hexdigest() + '"'


def build_has(name):
    return os.access(BUILD / "tests" / name, os.X_OK)
