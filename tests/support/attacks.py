"""Attacks by an FMU: the orders to the attacker (tests/fmu/hostile/attack), and the evidence of
their success.

The evidence does not rely on the attacker's own report. An attack is a row of a table:
Attack(label, function of the attacker, stage, calls). A stage gets the Ground. It returns the
attacker's arguments, and a function that tells after the run whether the attack had an effect.

`calls` are system calls that a process with FMUs does not need. The log must report that one of
them was refused. An attack without `calls` uses a call that all processes need; the kernel refuses
it because of its arguments.
"""
import ctypes
import fcntl
import functools
import json
import os
import re
import secrets
import shutil
import signal
import socket
import sqlite3
import subprocess
import sys
import termios
import time
import zipfile
from contextlib import closing
from pathlib import Path

import hostile_fmu
import live_test
import twinlock_test
from twinlock_test import PATIENCE, PROGRAM, Failure, expect, has_line, scratch

PLAIN_USER = 47110  # not in /etc/passwd
REFUSAL = re.compile(r"\bFMU ([^\s:]+):.*?\b(\w+) denied in (\w[^\s,]*).*")  # FMU, system call, FMI function
REPORT = re.compile(r"attack ([^:\n]+): (succeeded|E\w+)")
NEW_PROCESS = ("clone", "clone3", "fork", "vfork")


class Attack:
    def __init__(self, label, function, stage, calls=(), only=None):
        """`only`: whether it can succeed on a Ground, unconfined. Some attacks need root or a
        kernel option."""
        self.label, self.function, self.stage, self.calls, self.only = label, function, stage, calls, only or always


def always(_):
    return True


def as_root(ground):
    return ground.user == 0


def attributes(ground):
    """Whether the file system supports extended attributes of users."""
    try:
        os.setxattr(ground.folder, "user.test", b"")
    except OSError:
        return False
    return True


def elsewhere(_):
    """The terminal and TMPDIR belong to the parent. FMUs run in another process, so they have
    neither, even unconfined."""
    return False


# ---- where it takes place ----

def users():
    """Root and a plain user if this is root; else the current user."""
    return (0, PLAIN_USER) if os.geteuid() == 0 else (os.geteuid(),)


# Like a container without privileges: a user namespace whose only user is root there, without
# capabilities.
IN_CONTAINER = ["unshare", "--user", "--map-root-user", "--", "setpriv", "--bounding-set=-all", "--inh-caps=-all", "--no-new-privs", "--"]
in_container = False


def as_user(user):
    if in_container:
        return IN_CONTAINER
    return [] if user == os.geteuid() else ["setpriv", f"--reuid={user}", f"--regid={user}", "--clear-groups", "--"]


def program_for(user):
    """The path of a program that this user may start: other users may have no access to the build
    folder."""
    if user == os.geteuid():
        return PROGRAM
    copy = scratch() / "twinlock"
    shutil.copy(PROGRAM, copy)
    open_to_all(copy)
    return str(copy)


def open_to_all(path):
    """Lets all users enter the folders above `path`. Test folders are closed by default."""
    for folder in path.parents:
        if "twinlock-test-" not in str(folder):
            break
        folder.chmod(0o711)


@functools.cache
def attacker():
    """The FMU without orders: that of TL_ATTACKER, or a new one."""
    made = os.environ.get("TL_ATTACKER", "")
    return Path(made) if os.path.exists(made) else hostile_fmu.make("attack")


class Ground:
    """A user's folder with the FMU, its configuration and the attacked files; and the attacked
    process."""

    def __init__(self, user, where="fmi2DoStep", confined=False, verb="replay"):
        self.user, self.where, self.confined, self.verb = user, where, confined, verb
        self.changes = None  # to the configuration
        self.folder = scratch()
        self.others, self.temporary = self.folder / "others", self.folder / "temporary"
        self.home = self.folder / "home"
        for folder in (self.others, self.temporary, self.home):
            folder.mkdir()
        self.secret = secrets.token_hex(16)
        self.kept, self.orders, self.evidence = [], [], {}
        self._victim = None
        self.code = self.out = self.log = None
        self.screen = self.typed = b""
        self.mebibytes = 0  # the largest memory of one process

    def __enter__(self):
        return self

    def __exit__(self, *unused):
        for kept in reversed(self.kept):
            kept()
        for pid in self.left():
            os.kill(pid, signal.SIGKILL)
        shutil.rmtree(self.folder, ignore_errors=True)

    def keep(self, thing):
        """Closes `thing` at the end."""
        self.kept.append(thing.close)
        return thing

    def own(self):
        """Gives all files in the folder to the user. Files that are the user's already keep their
        times."""
        open_to_all(self.folder / "x")
        for path in (self.folder, *self.folder.rglob("*")):
            if path.lstat().st_uid != self.user:
                os.chown(path, self.user, self.user, follow_symlinks=False)

    def victim(self):
        if self._victim is None:
            self._victim = Victim(self)
            self.kept.append(self._victim.close)
        return self._victim

    def order(self, attack, where=None):
        words, reached = attack.stage(self)
        self.orders.append("\t".join(map(str, (where or self.where, attack.label, attack.function, *words))))
        self.evidence[attack] = reached or (lambda: self.reports().get(attack.label) == "succeeded")

    # -- the run --

    def config(self, changes=None):
        self.home.joinpath("attack.txt").write_text("\n".join(self.orders) + "\n", encoding="utf-8")
        fmu = self.home / "attack.fmu"
        shutil.copy(attacker(), fmu)
        with zipfile.ZipFile(fmu, "a") as archive:
            archive.write(self.home / "attack.txt", "resources/attack.txt")
        recording = self.home / "recording.csv"
        shutil.copy(hostile_fmu.recording(), recording)
        path = hostile_fmu.config(fmu, twinlock_test.merge(
            {"recording": {"file": str(recording)}, "sources": {"rows": {"csv": {"file": str(recording)}}}}, changes or {}))
        return Path(shutil.copy(path, self.home / "config.json"))

    def command(self, *options):
        mode = () if self.confined else ("--unconfined",)
        results = {"run": ("--db", self.home / "run.db", "--duration", "2"),
                   "plant": ("--record", self.home / "rows.csv"),
                   "replay": ("--csv", self.home / "rows.csv", "--db", self.home / "run.db", "--report", self.home / "page.html")}
        config = self.config(self.changes)
        self.own()
        program = [program_for(self.user), self.verb, config, *results.get(self.verb, ()), *options, *mode]
        # The shell is the parent that such a process attacks; it is no process of the test.
        return [*as_user(self.user), "sh", "-c", "\"$@\"; exit $?", "sh", *map(str, program)]

    def environment(self):
        """A small environment, because the attacker prints what it reads."""
        known = ("PATH", "LANG", "ASAN_OPTIONS", "LSAN_OPTIONS", "TSAN_OPTIONS", "UBSAN_OPTIONS", "TWINLOCK_FMU_PATH", "TMPDIR")
        everything = twinlock_test.environment(self.temporary)
        return {**{name: everything[name] for name in known if name in everything}, "TWINLOCK_ATTACK": str(self.folder), "ATTACK_SECRET": self.secret}

    def run(self, *options, timeout=60):
        """Runs the program in a shell without a terminal, until all its processes have ended but
        the attacker's."""
        with open(self.folder / "out", "wb") as out, open(self.folder / "log", "wb") as log:
            process = subprocess.Popen(self.command(*options), env=self.environment(), cwd=self.home, stdin=subprocess.DEVNULL,
                                       stdout=out, stderr=log, start_new_session=True)
            try:
                self._wait(process, timeout)
            except subprocess.TimeoutExpired:
                raise Failure(f"{self}: has not ended after {timeout * PATIENCE} s\n{self._text('log')}") from None
            finally:
                for pid in self.left():
                    if comm(pid) == "twinlock":
                        os.kill(pid, signal.SIGKILL)
        self.code, self.out, self.log = process.returncode, self._text("out"), self._text("log")
        return self

    def _wait(self, process, timeout):
        """Waits for the shell, and then for the program, if an attack has killed the shell only."""
        until = time.monotonic() + timeout * PATIENCE
        ended = 0
        while ended == 0 or any(comm(pid) == "twinlock" for pid in self.left()):
            if time.monotonic() > until:
                raise subprocess.TimeoutExpired("twinlock", timeout)
            if ended == 0:
                ended, status, usage = os.wait4(process.pid, os.WNOHANG)
                process.returncode = os.waitstatus_to_exitcode(status) if ended else None
                self.mebibytes = usage.ru_maxrss / 1024
            time.sleep(0.005)

    def _text(self, name):
        """The text of a file; only its beginning and end if it is long."""
        with open(self.folder / name, "rb") as file:
            text = file.read(1 << 20)
            file.seek(max(file.tell(), os.fstat(file.fileno()).st_size - (1 << 20)))
            return (text + file.read()).decode("utf-8", "backslashreplace")

    # -- results --

    def __str__(self):
        how = "confined" if self.confined else "unconfined"
        return f"{self.verb} by {'root' if self.user == 0 else 'a plain user'}, {self.where}, {how}"

    def said(self):
        """The log, shortened for the text of a failure."""
        return self.log if len(self.log) < 8000 else f"{self.log[:4000]}\n ... \n{self.log[-4000:]}"

    def reports(self):
        return dict(REPORT.findall(self.log))

    def refusals(self):
        """The system calls that the log reports as refused, once for each report."""
        return [call for _, call, _ in REFUSAL.findall(self.log)]

    def rows(self):
        """The results of the run and the attributes of their files; None if the verb has none."""
        return None if self.verb == "check" else (kept_file(self.home / "rows.csv"), kept_database(self.home / "run.db"))

    def is_obeyed(self):
        """Whether log or output contain control characters that a terminal obeys."""
        return any(OBEYED.search((self.folder / name).read_bytes()) for name in ("out", "log"))

    def faults(self):
        """The errors in the format of the results. Their values do not count."""
        found = []
        table, database = self.home / "rows.csv", self.home / "run.db"
        if table.exists():
            widths = {line.count(b",") for line in table.read_bytes().splitlines()}
            found += [f"rows.csv has rows of {sorted(widths)} commas"] if len(widths) > 1 else []
        if database.exists():
            state_of_it = query(database, "PRAGMA integrity_check")
            found += [f"run.db: {state_of_it}"] if state_of_it != [("ok",)] else []
        return found

    def events(self):
        """The texts of the refusals in the database."""
        return [text for text, in query(self.home / "run.db", "SELECT text FROM events") if REFUSAL.search(text)]

    def left(self):
        """The processes of this run that still exist."""
        marked = []
        for path in Path("/proc").glob("[0-9]*/environ"):
            try:
                if f"TWINLOCK_ATTACK={self.folder}".encode() in path.read_bytes().split(b"\0") and comm(path.parent.name):
                    marked.append(int(path.parent.name))
            except OSError:
                pass
        return marked

    @functools.cache
    def terminal(self):
        """Both ends of the terminal for on_terminal()."""
        master, slave = os.openpty()
        os.chown(os.ttyname(slave), self.user, self.user)
        self.kept.append(lambda: (os.close(slave), os.close(master)))
        return master, slave

    def on_terminal(self, *options, timeout=60):
        """As run(), on its own controlling terminal. `screen` has the output, `typed` the input."""
        master, slave = self.terminal()
        process = subprocess.Popen(self.command(*options), env=self.environment(), cwd=self.home, stdin=slave, stdout=slave, stderr=slave,
                                   start_new_session=True, preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0))
        screen = bytearray()
        os.set_blocking(master, False)
        os.set_blocking(slave, False)
        until = time.monotonic() + timeout * PATIENCE
        ended = False
        while not ended:
            ended = process.poll() is not None
            expect(time.monotonic() < until, f"{self}: has not ended on a terminal\n{bytes(screen)}")
            screen += readable(master)
            time.sleep(0.005)
        self.typed, self.screen = readable(slave), bytes(screen)
        self.code, self.out, self.log = process.returncode, "", screen.decode("utf-8", "backslashreplace").replace("\r\n", "\n")
        return self

    def left_files(self):
        return sorted(path.name for path in self.temporary.iterdir())


def readable(descriptor):
    """All bytes that can be read now."""
    got = bytearray()
    try:
        while part := os.read(descriptor, 1 << 20):
            got += part
    except BlockingIOError:
        pass
    return bytes(got)


def kept_file(path):
    """Mode, owner, attributes and content of a result; None if it does not exist."""
    found = state(path)
    return found and (*found[:3], *found[-2:])


def query(path, sql):
    with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as database:
        return database.execute(sql).fetchall()


def kept_database(path):
    """As kept_file() for a database, with its steps instead of its bytes, or with SQLite's
    error."""
    found = state(path)
    if found is None:
        return None
    try:
        steps = [query(path, sql) for sql in ("PRAGMA integrity_check", "SELECT step, t_ns FROM steps", "SELECT step, simulated, measured FROM outputs")]
    except sqlite3.DatabaseError as error:
        steps = str(error)
    return (*found[:3], found[-2], found[-1].endswith(b"attack"), steps)


def comm(pid):
    """The name of a process; "" if it is gone."""
    try:
        status = Path(f"/proc/{pid}/status").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
    return "" if "State:\tZ" in status else status.split("\n", 1)[0].removeprefix("Name:\t")


# ---- an independent process ----

VICTIM = """
import ctypes, json, os, signal, sys
ctypes.CDLL(None).prctl(0x59616d61, ctypes.c_ulong(-1), 0, 0, 0)  # all processes may trace it
got = set()
for number in range(signal.SIGRTMIN, signal.SIGRTMAX + 1):
    signal.signal(number, lambda number, frame: got.add(number))
memory = ctypes.create_string_buffer(sys.argv[1].encode())
print(os.getpid(), ctypes.addressof(memory), flush=True)
while sys.stdin.readline():
    print(json.dumps([sorted(got), memory.raw.hex()]), flush=True)
"""


WRITTEN = 64  # bytes of its memory, from FIRST_WRITTEN on, that attacks write; they read the others
FIRST_WRITTEN = 32


class Victim:
    """A process of the same user that reports its signals and its memory."""

    def __init__(self, ground):
        self.words = secrets.token_hex(16), secrets.token_hex(16)
        self.word = self.words[0] + "-" * WRITTEN + self.words[1]
        self.process = subprocess.Popen([*as_user(ground.user), sys.executable, "-c", VICTIM, self.word], stdin=subprocess.PIPE,
                                        stdout=subprocess.PIPE, text=True, cwd="/", env={"VICTIM": ground.secret})
        self.pid, self.place = map(int, self.process.stdout.readline().split())
        self.number = signal.SIGRTMIN
        self._told = None

    def next_signal(self):
        self.number += 1
        expect(self.number <= signal.SIGRTMAX, "more attacks than signals")
        return self.number

    def tell(self):
        if self._told is None:
            print(file=self.process.stdin, flush=True)
            numbers, memory = json.loads(self.process.stdout.readline())
            self._told = set(numbers), bytes.fromhex(memory)
        return self._told

    def close(self):
        self.process.stdin.close()
        self.process.wait(30)


# ---- stages: the network ----

class Plant(live_test.Device):
    """A Modbus device that accepts write requests and stores their values."""

    def __init__(self):
        self.registers = {}
        super().__init__(0.0)

    def _reply(self, request):
        if request[0] != 6:
            return super()._reply(request)
        self.registers[int.from_bytes(request[1:3], "big")] = int.from_bytes(request[3:5], "big")
        return request

    def close(self):
        self.listener.close()


def modbus_plant(ground):
    device = ground.keep(Plant())
    return ("127.0.0.1", device.port), lambda: device.registers == {7: 4711}


def received(listener):
    """Whether bytes or a connection wait at a socket."""
    listener.setblocking(False)
    try:
        return bool(listener.accept() if listener.type == socket.SOCK_STREAM else listener.recv(100))
    except BlockingIOError:
        return False


def listening(ground, family, kind, address):
    listener = ground.keep(socket.socket(family, kind))
    listener.bind(address)
    if kind == socket.SOCK_STREAM:
        listener.listen()
    return listener


def datagrams(ground):
    listener = listening(ground, socket.AF_INET, socket.SOCK_DGRAM, ("127.0.0.1", 0))
    return ("127.0.0.1", listener.getsockname()[1]), lambda: received(listener)


def datagrams_6(ground):
    listener = listening(ground, socket.AF_INET6, socket.SOCK_DGRAM, ("::1", 0))
    return ("::1", listener.getsockname()[1]), lambda: received(listener)


def abstract_socket(ground):
    name = f"attack-{ground.secret}"
    listener = listening(ground, socket.AF_UNIX, socket.SOCK_STREAM, f"\0{name}")
    return (f"@{name}",), lambda: received(listener)


def socket_in_folder(kind):
    def stage(ground):
        path = ground.others / f"socket{kind}"
        listener = listening(ground, socket.AF_UNIX, kind, str(path))
        return (path,), lambda: received(listener)
    return stage


def ethernet(ground):
    """The loopback interface. Only root may listen there. All processes use it, so a frame carries
    our secret."""
    if os.geteuid() != 0:
        return ("1", ground.secret), lambda: False
    listener = ground.keep(socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(0x88B5)))
    listener.bind(("lo", 0x88B5))
    listener.setblocking(False)

    def reached():
        try:
            while ground.secret.encode() not in listener.recv(100):
                pass
            return True
        except BlockingIOError:
            return False
    return (socket.if_nametoindex("lo"), ground.secret), reached


# ---- stages: devices ----

def serial_line(ground):
    """A pseudo-terminal: the test reads at the other end what the attacker writes."""
    master, slave = os.openpty()
    name = os.ttyname(slave)
    os.chown(name, ground.user, ground.user)
    os.set_blocking(master, False)
    ground.kept.append(lambda: (os.close(master), os.close(slave)))

    def reached():
        try:
            return b"attack" in os.read(master, 100)
        except BlockingIOError:
            return False
    return (name, "attack"), reached


def kernel_log(*before):
    def stage(ground):
        log = os.open("/dev/kmsg", os.O_RDONLY | os.O_NONBLOCK) if os.access("/dev/kmsg", os.R_OK) else os.open("/dev/null", os.O_RDONLY)
        os.lseek(log, 0, os.SEEK_END)
        ground.kept.append(lambda: os.close(log))
        word = f"attack-{secrets.token_hex(8)}"
        return (*before, word), lambda: any(word.encode() in line for line in lines(log))
    return stage


def lines(log):
    """The lines of the kernel's log. The kernel shows its last line only after the next one, so
    this writes one."""
    if os.access("/dev/kmsg", os.W_OK):
        Path("/dev/kmsg").write_text("twinlock's test has read the log\n", encoding="utf-8")
    while True:
        try:
            line = os.read(log, 8192)
        except BlockingIOError:
            return
        except BrokenPipeError:
            continue
        if not line:
            return
        yield line


# ---- stages: files ----

def state(path):
    """All attributes and the content of a file; None if it does not exist."""
    try:
        about = path.lstat()
        names = os.listxattr(path)
    except FileNotFoundError:
        return None
    content = path.read_bytes() if path.is_file() else b""
    return about.st_mode, about.st_uid, about.st_gid, about.st_size, about.st_mtime_ns, about.st_ctime_ns, about.st_ino, names, content


def changed_file(ground):
    path = ground.others / f"file-{len(ground.orders)}"
    path.write_text("another owner's", encoding="utf-8")
    os.chown(path, ground.user, ground.user)
    before = state(path)
    return (path, f"{path}.away"), lambda: state(path) != before


def new_file(ground):
    path = ground.others / f"new-{len(ground.orders)}"
    return (path,), path.exists


def temporary_leavings(ground):
    return (), lambda: bool(ground.left_files())


def secret_in(name, folder="others"):
    def stage(ground):
        word = secrets.token_hex(16)
        path = getattr(ground, folder) / name
        path.write_text(word, encoding="utf-8")
        path.chmod(0o600)
        return (path,), lambda: word in ground.log + ground.out
    return stage


def connections(ground):
    """A listening socket in /proc/self/net."""
    listener = listening(ground, socket.AF_INET, socket.SOCK_STREAM, ("127.0.0.1", 0))
    return ("/proc/self/net/tcp",), lambda: f"0100007F:{listener.getsockname()[1]:04X}" in ground.log


def names_in(folder):
    def stage(ground):
        word = secrets.token_hex(16)
        path = getattr(ground, folder)
        path.joinpath(word).touch()
        return (path,), lambda: word in ground.log + ground.out
    return stage


# ---- stages: processes ----

def signalled(ground):
    victim = ground.victim()
    number = victim.next_signal()
    return (victim.pid, number), lambda: number in victim.tell()[0]


def written_memory(word):
    """Each attack writes to another address in the victim's memory."""
    def stage(ground):
        victim = ground.victim()
        at = FIRST_WRITTEN + 8 * len(ground.orders) % WRITTEN
        return (victim.pid, hex(victim.place + at)), lambda: victim.tell()[1][at:at + len(word)] == word
    return stage


def read_memory(which):
    def stage(ground):
        victim = ground.victim()
        return (victim.pid, hex(victim.place + victim.word.index(victim.words[which]))), lambda: victim.words[which] in ground.log
    return stage


def read_environment(ground):
    victim = ground.victim()
    return (victim.pid, "environ", "VICTIM"), lambda: f"VICTIM={ground.secret}" in ground.log


def parents_environment(ground):
    return ("parent", "environ", "ATTACK_SECRET"), lambda: f"ATTACK_SECRET={ground.secret}" in ground.log


def parents_memory(_):
    return ("parent", "maps", "[stack]"), None


def changed_process(look):
    def stage(ground):
        pid = ground.victim().pid
        before = look(pid)
        return (pid,), lambda: look(pid) != before
    return stage


def message_limit(pid):
    text = Path(f"/proc/{pid}/limits").read_text(encoding="utf-8")
    return next(line for line in text.splitlines() if line.startswith("Max msgqueue"))


def many_processors(_):
    return os.cpu_count() > 1


# ---- stages: programs and bombs ----

def told(*words):
    """An attack whose only evidence is the attacker's report."""
    return lambda ground: (words, None)


def told_or_seen(parts, *words):
    """An attack whose evidence is the attacker's report, or a line of the log with all parts (see
    has_line()).

    The parent may end the process before the attacker reports. For a run with only this attack.
    """
    return lambda ground: (words, lambda: "succeeded" in ground.reports().values() or has_line(ground.log, parts))


def system_v(ground):
    key = 1 + secrets.randbelow(1 << 30)

    def there():
        rows = Path("/proc/sysvipc/shm").read_text(encoding="utf-8").splitlines()[1:]
        return str(key) in [row.split()[0] for row in rows]
    ground.kept.append(lambda: there() and subprocess.run(["ipcrm", "-M", str(key)], check=True))
    return (key,), there


def left_processes(count):
    return lambda ground: ((count,), lambda: [comm(pid) for pid in ground.left()].count("attack-left") >= count)


def ring(_):
    setting = Path("/proc/sys/kernel/io_uring_disabled")
    return not setting.exists() or setting.read_text(encoding="utf-8").strip() == "0"


def programs_of_32_bits(_):
    """Whether the kernel still accepts system calls by int 0x80; a child process tries one."""
    code = bytes((0xB8, 20, 0, 0, 0, 0xCD, 0x80, 0xC3))  # getpid()
    child = os.fork()
    if child == 0:
        import mmap
        memory = mmap.mmap(-1, 4096, prot=mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC)
        memory.write(code)
        call = ctypes.CFUNCTYPE(ctypes.c_int)(ctypes.addressof(ctypes.c_char.from_buffer(memory)))
        os._exit(0 if call() == os.getpid() else 1)
    return os.uname().machine == "x86_64" and os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


def never(_):
    """No current kernel has it. The test tries it anyway."""
    return False


# ---- stages: other features of the kernel ----

def keyrings(_):
    """Whether the kernel has keyrings and this user may use them."""
    keys = Path("/proc/keys")
    return keys.exists() and not in_container


def watched_folder(ground):
    return (ground.others,), None


def anothers_descriptor(ground):
    return (ground.victim().pid,), None


def escaped(ground):
    """Checks that no control characters reach log or output."""
    return (secrets.token_hex(8),), ground.is_obeyed


# ---- the table: attacks after which the run continues ----

ATTACKS = (
    Attack("Modbus function 6", "modbus", modbus_plant, ("socket", "connect")),
    Attack("UDP datagram", "datagram", datagrams, ("socket", "connect")),
    Attack("UDP datagram of IPv6", "datagram", datagrams_6, ("socket", "connect")),
    Attack("abstract Unix socket", "stream_socket", abstract_socket, ("socket", "connect")),
    Attack("Unix socket in a folder", "stream_socket", socket_in_folder(socket.SOCK_STREAM), ("socket", "connect")),
    Attack("Unix socket by a pair", "pair_socket", socket_in_folder(socket.SOCK_DGRAM), ("socketpair", "sendto")),
    Attack("Ethernet frame", "ethernet_frame", ethernet, ("socket",), as_root),
    Attack("interfaces by netlink", "interfaces", told(), ("socket",)),

    Attack("serial line", "write_device", serial_line),
    Attack("kernel's log", "write_device", kernel_log("/dev/kmsg"), (), as_root),
    Attack("device by a new name", "make_device", kernel_log(1, 11), ("mknod", "mknodat"), as_root),

    Attack("write", "write_file", changed_file),
    Attack("append", "append_file", changed_file),
    Attack("create", "create_file", new_file),
    Attack("O_TRUNC, read-only", "open_truncating", changed_file),
    Attack("O_TRUNC by openat2", "open_by_structure", changed_file),
    Attack("truncate", "truncate_file", changed_file),
    Attack("chmod", "chmod_file", changed_file, ("chmod", "fchmodat")),
    Attack("fchmod", "fchmod_file", changed_file),
    Attack("fchmod of what it may read", "fchmod_file", told("resources"), ("fchmod",)),
    Attack("chown", "chown_file", changed_file, ("chown", "fchownat")),
    Attack("utimes", "utimes_file", changed_file, ("utimes", "utimensat", "utimensat_time64")),
    Attack("futimens", "futimens_file", changed_file),
    Attack("futimens of what it may read", "futimens_file", told("resources"), ("utimensat", "utimensat_time64")),
    Attack("setxattr", "setxattr_file", changed_file, ("setxattr",), attributes),
    Attack("fsetxattr", "fsetxattr_file", changed_file, (), attributes),
    Attack("fsetxattr of what it may read", "fsetxattr_file", told("resources"), ("fsetxattr",), attributes),
    Attack("rename", "rename_file", changed_file),
    Attack("rename over", "rename_over", changed_file),
    Attack("unlink", "unlink_file", changed_file),
    Attack("link", "link_file", changed_file),
    Attack("symlink", "symlink_file", changed_file),
    Attack("mkdir", "make_folder", new_file),
    Attack("private key", "read_file", secret_in("key.pem")),
    Attack("file beside the configuration", "read_file", secret_in("password.txt", "home")),
    Attack("the machine's connections", "read_file", connections),
    Attack("names in a folder", "list_folder", names_in("others")),

    Attack("process_vm_writev", "write_by_call", written_memory(b"attack"), ("process_vm_writev",)),
    Attack("process_vm_readv", "read_by_call", read_memory(0), ("process_vm_readv",)),
    Attack("write of /proc/PID/mem", "write_by_file", written_memory(b"attack")),
    Attack("read of /proc/PID/mem", "read_by_file", read_memory(1)),
    Attack("read of /proc/PID/environ", "read_of_process", read_environment),
    Attack("parent's /proc/PID/environ", "read_of_process", parents_environment),
    Attack("parent's /proc/PID/maps", "read_of_process", parents_memory),
    Attack("signal by F_SETOWN", "send_by_pipe", signalled, ("fcntl", "fcntl64")),
    Attack("signal by a pidfd", "send_by_pidfd", signalled, ("pidfd_open",)),
    Attack("prlimit", "set_limit", changed_process(message_limit), ("prlimit64",)),
    Attack("sched_setaffinity", "set_affinity", changed_process(os.sched_getaffinity), ("sched_setaffinity",), many_processors),
    Attack("setpriority", "set_priority", changed_process(lambda pid: os.getpriority(os.PRIO_PROCESS, pid)), ("setpriority",)),
    Attack("sched_setscheduler", "set_scheduler", changed_process(os.sched_getscheduler), ("sched_setscheduler",)),

    Attack("system()", "call_system", new_file, NEW_PROCESS),
    Attack("popen()", "call_popen", new_file, NEW_PROCESS),
    Attack("posix_spawn()", "call_spawn", new_file, NEW_PROCESS),
    Attack("fork() and execve()", "call_fork", new_file, NEW_PROCESS),
    Attack("clone by its number", "call_raw_fork", new_file, NEW_PROCESS),
    Attack("program in memory", "execute_memory", new_file, (*NEW_PROCESS, "memfd_create")),
    Attack("code in memory", "map_memory", told(), ("memfd_create", "mmap", "mmap2")),
    Attack("file by io_uring", "create_by_ring", new_file, ("io_uring_setup",), ring),
    Attack("System V memory", "system_v_memory", system_v, ("shmget",)),
    Attack("daemon", "daemon_process", left_processes(1), NEW_PROCESS),

    Attack("kernel's keyring", "keep_key", told(), ("add_key",), keyrings),
    Attack("message queue", "open_queue", told("/twinlock-attack"), ("mq_open",)),
    Attack("System V semaphores", "make_semaphores", told(), ("semget",)),
    Attack("watching a folder", "watch_folder", watched_folder, ("inotify_init1",)),
    Attack("faults of its memory", "handle_faults", told(), ("userfaultfd",)),
    Attack("another's descriptor", "take_descriptor", anothers_descriptor, ("pidfd_open",)),
    *(() if twinlock_test.SANITIZER else (Attack("dumpable", "be_dumpable", told(), ("prctl",)),)),  # a sanitizer makes itself dumpable
    Attack("another personality", "change_personality", told(), ("personality",)),
    Attack("escapes by its own pipe", "write_own_pipe", escaped, (), elsewhere),
)


# ---- attacks after which the run may end: each in a separate run ----

class Lone(Attack):
    """An attack that has a run for itself.

    `at`: another place than usual. `may_end`: the confined run may end with 70 and a message.
    `believed`: the attacker may report success, for example after it has closed its own
    descriptors. `own_values`: the attack may change the values that its FMU computes, but not the
    format of the results.
    """

    def __init__(self, label, function, stage, calls=(), only=None, at=None, may_end=False, believed=False, own_values=False):
        super().__init__(label, function, stage, calls, only)
        self.at, self.may_end, self.believed, self.own_values = at, may_end, believed, own_values


def killed_parent(ground):
    return ("parent", int(signal.SIGKILL)), lambda: ground.code in (-signal.SIGKILL, 128 + signal.SIGKILL)


def killed_victim(ground):
    victim = ground.victim()
    return (victim.pid, int(signal.SIGKILL)), lambda: comm(victim.pid) == ""


def traced_parent(_):
    return ("parent",), None


def taken(mebibytes):
    """An attack that takes memory. The kernel measures it."""
    return lambda ground: ((mebibytes,), lambda: ground.mebibytes >= mebibytes)


def enough_memory(mebibytes):
    text = Path("/proc/meminfo").read_text(encoding="utf-8")
    return int(re.search(r"MemAvailable: +(\d+) kB", text)[1]) >> 10 > 2 * mebibytes


def filled(mebibytes, *folder):
    def stage(ground):
        def reached():
            files = [path for path in (*ground.temporary.rglob("*"), *ground.home.rglob("*")) if path.name.startswith("attack.")]
            return sum(path.stat().st_blocks for path in files) * 512 >= mebibytes << 20
        return (mebibytes, *folder), reached
    return stage


def many_files(count, *folder):
    def stage(ground):
        tried = 20 * count if ground.confined else count  # enough time for the parent to notice
        return (tried, *folder), lambda: len(list((ground.home if folder else ground.temporary).iterdir())) >= count
    return stage


def printed(count):
    return lambda ground: ((count,), lambda: sum((ground.folder / name).stat().st_size for name in ("out", "log")) >= count)


LIMIT_MEBIBYTES = 192  # memory limit of the FMUs' process in these tests; on any machine less than
BOMB_MEBIBYTES = 384
DISK_MEBIBYTES = 640  # more than FMUs may write
FILES = 20000
PRINTED = 30000000  # bytes; the log relay forwards more at once

LONE = (
    Lone("kill of its parent", "send_kill", killed_parent, ("kill",), may_end=True),
    Lone("tgkill of its parent", "send_tgkill", killed_parent, ("tgkill",), may_end=True),
    Lone("kill", "send_kill", killed_victim, ("kill",), may_end=True),
    Lone("tgkill", "send_tgkill", signalled, ("tgkill",), may_end=True),
    Lone("tkill", "send_tkill", signalled, ("tkill",), may_end=True),
    Lone("sigqueue", "send_sigqueue", signalled, ("rt_sigqueueinfo",), may_end=True),
    Lone("sigqueue of a thread", "send_tgsigqueue", signalled, ("rt_tgsigqueueinfo",), may_end=True),
    Lone("ptrace", "trace", written_memory(b"tack"), ("ptrace",), may_end=True),
    Lone("ptrace of its parent", "trace", traced_parent, ("ptrace",), may_end=True),
    Lone("execve", "replace_itself", new_file, ("execve",)),
    Lone("int 0x80", "call_32_bits", new_file, (), programs_of_32_bits, may_end=True),
    Lone("x32", "call_x32", new_file, (), never, may_end=True),
    Lone("uretprobe", "call_uretprobe", told(), (), never, may_end=True),
    Lone("fork bomb", "processes", left_processes(50), NEW_PROCESS),
    Lone("many threads", "threads", told(1000), may_end=True, believed=True),
    Lone("many timers", "timers", told(20000), may_end=True),
    Lone("many descriptors", "many_descriptors", told(900), may_end=True, believed=True),
)
BOMBS = (
    Lone("shared memory", "shared_memory", taken(BOMB_MEBIBYTES), may_end=True),
    Lone("heap", "heap_memory", taken(BOMB_MEBIBYTES), may_end=True),
    Lone("stack", "stack_memory", taken(BOMB_MEBIBYTES), may_end=True),
    Lone("file in memory", "file_memory", told(BOMB_MEBIBYTES), may_end=True),
    Lone("page tables", "page_tables", told(BOMB_MEBIBYTES), may_end=True),
    Lone("bytes in removed files", "fill_removed", told_or_seen("removed|MB|FMUs", DISK_MEBIBYTES), believed=True, may_end=True),
    Lone("bytes in its folder", "fill_disk", filled(DISK_MEBIBYTES, "."), may_end=True),
    Lone("reserved bytes in TMPDIR", "reserve_disk", filled(DISK_MEBIBYTES), (), elsewhere, may_end=True),
    Lone("reserved bytes in its folder", "reserve_disk", filled(DISK_MEBIBYTES, "."), may_end=True),
    Lone("files in its folder", "many_files", many_files(FILES, "."), may_end=True),
)
# The output of FMUs comes through a pipe. It neither replaces nor blocks the program's own output.
PRINTS = (
    Lone("flood", "flood_output", printed(PRINTED), believed=True),
    Lone("no newline", "output_without_newline", printed(PRINTED // 10), believed=True),
)


# ---- attacks on the files that the run writes or has open ----

def result(name):
    """A result file, after half of the steps.

    The recorder reports a damaged database as an error, creates a new one and continues with the
    data it has.
    """
    def stage(ground):
        path = ground.home / name
        reported = f"error|recorder|{name}"
        return (path, f"{path}.away"), lambda: has_line(ground.log, reported) or ground.rows() != untouched(ground.user, ground.verb)
    return stage


@functools.cache
def untouched(user, verb):
    """The results of a run without attacks."""
    with Ground(user, verb=verb).run() as ground:
        expect(ground.code == 0, f"{ground}: ended with {ground.code}\n{ground.said()}")
        return ground.rows()


HALF_WAY = "fmi2DoStep:50"
ON_RESULTS = {
    "truncate": ("truncate_file", ()),
    "O_TRUNC, read-only": ("open_truncating", ()), "chmod": ("chmod_file", ("chmod", "fchmodat")), "fchmod": ("fchmod_file", ()),
    "setxattr": ("setxattr_file", ("setxattr",)), "rename": ("rename_file", ()), "rename over": ("rename_over", ()),
    "unlink": ("unlink_file", ()),
    "write": ("write_file", ()),
}
ON_DATABASE = tuple(label for label in ON_RESULTS if label != "write")  # SQLite overwrites these bytes


def on_result(name, at, *labels):
    return tuple(Lone(f"{label} of {name}", ON_RESULTS[label][0], result(name), ON_RESULTS[label][1],
                      attributes if label == "setxattr" else None, at=at) for label in labels)


RESULTS = {
    "replay": (*on_result("run.db", HALF_WAY, *ON_DATABASE), *on_result("rows.csv", "fmi2FreeInstance", "write", "truncate", "unlink")),
    "plant": on_result("rows.csv", "fmi2FreeInstance", "write", "truncate", "unlink", "chmod"),
}


# Attacks on shared memory, pipes and descriptors of the FMUs' own process. They may harm that
# process only.
def inside(label, function, stage):
    return Lone(label, function, stage, at=HALF_WAY, may_end=True, believed=True, own_values=True)


OWN_PIPE = Lone("reads its own pipe", "read_own_pipe", told(), ("socket",), elsewhere, at=HALF_WAY)
INSIDE = (
    inside("writes into all descriptors", "write_descriptors", told_or_seen("FMU|killed|memory")),
    inside("closes all descriptors but the log", "close_descriptors", told(3)),
    inside("closes all descriptors", "close_descriptors", told(0)),
    *(inside(f"scribbles over shared memory, seed {seed}", "scribble_over_shared", told(seed)) for seed in range(1, 6)),
    *(inside(f"{pattern} over shared memory", "fill_shared", told(pattern)) for pattern in ("escapes", "NaN")),
    inside("moves the futex waiters of shared memory", "move_sleepers", told()),
    OWN_PIPE,
)


# ---- attacks on the terminal of the program ----

def shown(*terminal):
    def stage(ground):
        word = secrets.token_hex(8)
        return (word, *(path(ground) for path in terminal)), lambda: f"\033]0;{word}".encode() in ground.screen
    return stage


def typed(*terminal):
    def stage(ground):
        word = secrets.token_hex(8)
        return (word, *(path(ground) for path in terminal)), lambda: word.encode() in ground.typed
    return stage


def by_path(ground):
    return os.ttyname(ground.terminal()[1])


def by_name(_):
    return "/dev/tty"


ON_TERMINAL = (
    Attack("escapes by printing", "print_escapes", shown(), (), elsewhere),
    Attack("escapes by the FMI logger", "log_escapes", shown(), (), never),
    Attack("escapes by its own pipe", "write_own_pipe", shown(), (), elsewhere),
    Attack("escapes by /dev/tty", "print_to_terminal", shown(by_name), (), elsewhere),
    Attack("escapes by the terminal's path", "print_to_terminal", shown(by_path)),
    Attack("typing by /dev/tty", "type_text", typed(by_name), (), elsewhere),
    Attack("typing by the terminal's path", "type_text", typed(by_path), (), as_root),
    Attack("typing by a descriptor", "type_by_descriptor", typed(), (), elsewhere),
)
ERASE_LINE = b"\033[K"  # sent by the program itself, besides newlines
# ESC, BEL, backspace and the other control characters that a terminal obeys; C1 as UTF-8 and as
# bytes.
OBEYED = re.compile(rb"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f]|\xc2[\x80-\x9f]")
