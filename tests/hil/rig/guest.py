"""Boots the rig's guest and runs one command in it. script/rig is its command line; tests import it.

The guest sees the host's whole file system read-only under a tmpfs, so every program and library of the host is there
under its own path; only the folder rig in the build folder is written through, and a disk that is given. tests/hil/rig/init is what
happens inside.
"""
import contextlib
import json
import os
import re
import shlex
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path

import initramfs

SOURCE = Path(__file__).resolve().parents[3]
RIG = SOURCE / ".deps" / "rig"
DESCRIPTION = SOURCE / "tests" / "hil" / "rig.json"
CONSOLE_LINES = 25  # how much of the console is shown when something goes wrong

# Exit codes beside the command's own, those of timeout(1).
TIMED_OUT, NO_END = 124, 125


@dataclass
class Machine:
    """What differs between the kernels."""
    emulator: str
    options: list
    console: str


MACHINES = {
    # Two kvaser_pci on one bus are can0 and can1, with a bit rate and bus-off. The serial lines ttyS1 and ttyS2 are
    # joined to each other.
    "amd64": Machine(
        "qemu-system-x86_64",
        ["-machine", "q35,graphics=off", "-cpu", "max",
         "-object", "can-bus,id=bus", "-device", "kvaser_pci,canbus=bus", "-device", "kvaser_pci,canbus=bus",
         "-device", "i6300esb"],
        "ttyS0"),
}


@dataclass
class Outcome:
    """How a run ended. `exit_code` is the command's, None where the guest did not come to its end."""
    exit_code: int | None = None
    timed_out: bool = False
    console: str = ""
    events: list = field(default_factory=list)
    seconds: float = 0.0

    def reset_by(self):
        """The watchdog that reset the guest, or None."""
        if any(event["event"] == "WATCHDOG" for event in self.events):
            return "i6300esb"
        return "softdog" if "softdog: Initiating system reboot" in self.console else None

    def reason(self):
        """Why there is no exit code."""
        if self.timed_out:
            return f"the guest did not end within {self.seconds:.0f} s"
        if panic := re.search(r"Kernel panic - (.*)", self.console):
            return f"the guest's kernel panicked ({panic[1].strip()})"
        if self.reset_by():
            return f"the watchdog {self.reset_by()} reset the guest"
        return "the guest ended without an exit code"


class Events(threading.Thread):
    """Collects what QEMU tells through QMP, until it ends."""

    def __init__(self):
        super().__init__(daemon=True)
        self.ours, self.its = socket.socketpair()
        self.found = []

    def run(self):
        with self.ours, self.ours.makefile(encoding="utf-8") as lines, contextlib.suppress(ConnectionError):
            self.ours.sendall(b'{"execute": "qmp_capabilities"}\n')
            for line in lines:
                message = json.loads(line)
                if "event" in message:
                    self.found.append(message)


class Pump(threading.Thread):
    """Hands what the guest writes to `target`, a binary file, as it comes."""

    def __init__(self, target):
        super().__init__(daemon=True)
        self.source, self.sink = os.pipe()
        self.target = target

    def run(self):
        with open(self.source, "rb", buffering=0) as source, contextlib.suppress(BrokenPipeError):
            while block := source.read(65536):
                self.target.write(block)
                self.target.flush()


class Guest:
    """A guest that is booted anew for every run(). `disk`: an image of ext4, which it has as /disk. With `reboots` a reset
    boots it again, which runs the command again; else it is the end."""

    def __init__(self, kernel="amd64", source=SOURCE, build=None, root="/", timeout=120, disk=None, reboots=False):
        self.machine = MACHINES[kernel]
        self.folder = RIG / kernel
        self.source = Path(source).resolve()
        self.build = Path(build or self.source / "build" / "host").resolve()
        self.results = self.build / "rig"
        self.root = root
        self.timeout = timeout
        self.disk = disk
        self.reboots = reboots
        self.emulator = None

    def script(self, command):
        """The lines of what the guest runs: the command in the environment that CTest gives a test."""
        environment = {
            "PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin:/run/busybox",
            "HOME": "/root", "LANG": "C.UTF-8", "PYTHONDONTWRITEBYTECODE": "1",
            "PYTHONPATH": self.source / "tests" / "support", "TL_SOURCE": self.source, "TL_BUILD": self.build,
            "TWINLOCK": self.build / "bin" / "twinlock", "TL_RIG": DESCRIPTION}
        lines = [f"export {name}={shlex.quote(str(value))}" for name, value in environment.items()]
        lines += [f"cd {shlex.quote(str(self.source))} || exit 127", "exec " + shlex.join(map(str, command))]
        return lines

    def shares(self, work):
        folders = {"root": self.root, "tools": self.folder / "tools", "results": self.results,
                   "control": work / "control"}
        for tag, path in folders.items():
            access = "readonly=on" if tag in ("root", "tools") else "readonly=off"
            yield from ("-fsdev", f"local,id={tag},path={escaped(path)},security_model=none,multidevs=remap,{access}",
                        "-device", f"virtio-9p-pci,fsdev={tag},mount_tag={tag}")

    def drive(self):
        """The disk. What QEMU has been given is safe when it is killed, whether it was flushed or not, so nothing waits for
        the host's disk (cache=unsafe)."""
        if self.disk is None:
            return []
        return ["-drive", f"file={escaped(Path(self.disk).resolve())},if=none,id=disk,format=raw,cache=unsafe",
                "-device", "virtio-blk-pci,drive=disk"]

    def arguments(self, work, out, err, qmp):
        """QEMU's command line. The guest's output goes to the pipes `out` and `err`, QEMU's events to `qmp`."""
        line, firmware = escaped(work / "line"), RIG / "host/usr/share"
        return [
            "setpriv", "--pdeathsig", "KILL", self.machine.emulator,
            "-L", firmware / "qemu", "-L", firmware / "seabios",
            "-no-user-config", "-nodefaults", "-display", "none", *([] if self.reboots else ["-no-reboot"]),
            *self.machine.options, *self.drive(),
            "-accel", "tcg", "-smp", "1", "-m", "1024",
            "-kernel", self.folder / "kernel", "-initrd", work / "initramfs",
            "-append", f"console={self.machine.console} quiet panic=-1 rdinit=/init",
            "-chardev", f"file,id=console,path={escaped(work / 'console')}", "-serial", "chardev:console",
            "-chardev", f"socket,id=here,path={line},server=on,wait=off", "-serial", "chardev:here",
            "-chardev", f"socket,id=there,path={line}", "-serial", "chardev:there",
            "-chardev", f"socket,id=qmp,fd={qmp}", "-mon", "chardev=qmp,mode=control",
            "-device", "virtio-serial-pci", *port("stdout", out), *port("stderr", err), *self.shares(work)]

    def make_initramfs(self, path):
        files = [("init", 0o755, Path(__file__).with_name("init").read_bytes()),
                 ("bin/busybox", 0o755, (self.folder / "busybox").read_bytes())]
        files += [(f"modules/{module.name}", 0o644, module.read_bytes())
                  for module in sorted((self.folder / "modules").iterdir())]
        path.write_bytes(initramfs.archive(["bin", "modules"], files))

    def write_control(self, folder, command):
        """What the guest finds in /control."""
        chip = json.loads(DESCRIPTION.read_text(encoding="utf-8"))["gpio"]
        lines = {"results": [self.results], "gpio": [chip["chip"], *chip["lines"]], "run": self.script(command)}
        if self.disk is not None:
            lines["disk"] = ["/disk"]
        folder.mkdir()
        for name, content in lines.items():
            (folder / name).write_text("".join(f"{line}\n" for line in content), encoding="utf-8")

    def run(self, command, stdout=None, stderr=None):
        """Boots, runs the command, and gives its Outcome. Its output goes to two binary files, or to ours."""
        self.results.mkdir(exist_ok=True)
        with tempfile.TemporaryDirectory(prefix="twinlock-rig-") as folder:
            work = Path(folder)
            self.write_control(work / "control", command)
            self.make_initramfs(work / "initramfs")
            return self.boot(work, stdout or sys.stdout.buffer, stderr or sys.stderr.buffer)

    def cut_power(self):
        """Ends a guest that another thread runs, as it is. What it has said until then is handed on."""
        self.emulator.kill()

    def boot(self, work, stdout, stderr):
        outcome, begun = Outcome(), time.monotonic()
        pumps, events = [Pump(stdout), Pump(stderr)], Events()
        handed = [pumps[0].sink, pumps[1].sink, events.its.detach()]
        # A signal that ends this program before `try` would leave QEMU, for which the program would wait.
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM))
        with open(work / "emulator", "wb") as log, subprocess.Popen(
                [str(word) for word in self.arguments(work, *handed)], env=emulator_environment(), pass_fds=handed,
                stdin=subprocess.DEVNULL, stdout=log, stderr=log) as emulator:
            try:
                signal.pthread_sigmask(signal.SIG_SETMASK, mask)
                for end in handed:
                    os.close(end)
                self.emulator = emulator
                for thread in (*pumps, events):
                    thread.start()
                emulator.wait(self.timeout)
            except subprocess.TimeoutExpired:
                outcome.timed_out = True
            finally:
                emulator.kill()
        for thread in (*pumps, events):
            thread.join()
        outcome.seconds = time.monotonic() - begun
        outcome.console = read(work / "emulator") + read(work / "console")
        outcome.events = events.found
        exit_code = read(work / "control/exit").strip()
        outcome.exit_code = int(exit_code) if exit_code else None
        return outcome


def escaped(path):
    """A path as part of an option of QEMU's, where a comma ends it."""
    return str(path).replace(",", ",,")


def port(name, pipe):
    """A virtio port of that name, whose other end is a pipe of ours."""
    return ["-add-fd", f"fd={pipe},set={pipe}",
            "-chardev", f"file,id={name},path=/dev/fdset/{pipe},append=on",
            "-device", f"virtserialport,chardev={name},name={name}"]


def emulator_environment():
    """Where QEMU and its libraries are: the machine's, else those that rig/prepare has unpacked."""
    libraries = ":".join(str(path) for path in sorted(RIG.glob("host/usr/lib/*-linux-gnu")))
    return {**os.environ, "PATH": f"{os.environ['PATH']}:{RIG / 'host/usr/bin'}", "LD_LIBRARY_PATH": libraries}


def read(path):
    return path.read_text(encoding="utf-8", errors="replace") if path.exists() else ""


def report(outcome):
    console = re.sub(r"\x1b(c|\[[0-9;?]*[A-Za-z])", "", outcome.console.replace("\r", ""))
    print(f"rig: error: {outcome.reason()}; the end of its console:", file=sys.stderr)
    print("\n".join(f"  | {line}" for line in console.splitlines()[-CONSOLE_LINES:]), file=sys.stderr)
