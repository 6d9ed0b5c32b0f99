#!/usr/bin/env python3
"""script/bootstrap on a machine without some packages: what it installs and prints, how it waits
for another apt, and its advice to a user without root.

It runs in a copy with the real apt-get, whose packages, lists and locks are in a folder of the
test. dpkg is replaced by a program that installs nothing.
"""
import fcntl
import http.server
import os
import re
import shutil
import ssl
import subprocess
import threading
import time
from contextlib import contextmanager

from twinlock_test import SOURCE, Skip, at_most, expect, main, scratch

DEPS = SOURCE / ".deps"
ONLY_TESTS = {"git", "shellcheck", "locales", "python3-venv", "libpython3.11"}
ONLY_ALL = {"clang", "clang-format", "clang-tidy", "chromium", "cppcheck", "mmdebstrap", "man-db", "valgrind"}  # script/test --all
PROGRAMS = {
    # Reports that all packages are installed, except those that TL_MISSING names.
    "dpkg-query": """#!/bin/sh
shift 3
for name in "$@"; do
    case " $TL_MISSING " in *" $name "* | " all ") ;; *) echo "$name installed" ;; esac
done
""",
    "sudo": '#!/bin/sh\n[ "$1" != -n ] || shift\nexec "$@"\n',  # if the tests do not run as root
    "dpkg": f'#!/bin/sh\n[ "$1" != --print-architecture ] || exec {shutil.which("dpkg")} "$@"\n',  # installs nothing
}
NO_ROOT = {
    "id": '#!/bin/sh\n[ "$1" = -u ] && echo 1000 || exec /usr/bin/id "$@"\n',
    "sudo": "#!/bin/sh\nexit 1\n",
}


class Machine:
    """A copy of script/bootstrap and its files, with an apt whose state the test controls."""

    def __init__(self, missing="git", parts=("fmi2", "unity", "venv"), programs=None):
        self.root = scratch()
        self.deps = self.root / ".deps"
        self.deps.mkdir()
        (self.root / "script").mkdir()
        for name in ("bootstrap", "requirements.txt"):
            shutil.copy2(SOURCE / "script" / name, self.root / "script" / name)
        shutil.copytree(SOURCE / "script" / "shared", self.root / "script" / "shared")
        for name in parts:
            (self.deps / name).symlink_to(DEPS / name)
        self.state = scratch()
        (self.state / "lists").mkdir()
        self.environment = {**os.environ, "TL_MISSING": missing, "APT_CONFIG": str(self.apt_config()),
                            "PATH": f"{self.programs({**PROGRAMS, **(programs or {})})}:{os.environ['PATH']}"}

    @staticmethod
    def programs(texts):
        folder = scratch()
        for name, text in texts.items():
            (folder / name).write_text(text, encoding="utf-8")
            (folder / name).chmod(0o755)
        return folder

    def apt_config(self):
        """Writes an apt configuration with one archive, which has one package."""
        (self.state / "status").touch()
        (self.state / "sources.list").write_text(f"deb [trusted=yes] copy:{archive()} ./\n", encoding="utf-8")
        path = self.state / "apt.conf"
        path.write_text(f'Dir::State "{self.state}"; Dir::State::status "{self.state}/status"; Dir::Cache "{scratch()}";'
                        f'Dir::Etc::SourceList "{self.state}/sources.list"; Dir::Etc::SourceParts "/dev/null";'
                        f'Dir::Bin::dpkg "{self.programs(PROGRAMS)}/dpkg"; APT::Sandbox::User "";', encoding="utf-8")
        return path

    def start(self, *arguments):
        return subprocess.Popen([self.root / "script" / "bootstrap", *arguments], stdin=subprocess.DEVNULL, env=self.environment,
                                stdout=subprocess.PIPE, stderr=subprocess.PIPE, encoding="utf-8")

    def run(self, *arguments):
        """(exit code, stdout, stderr)"""
        process = self.start(*arguments)
        out, err = process.communicate(timeout=200)
        return process.returncode, out, err


def archive():
    """An archive in a folder: a package git of 200 kB of random bytes, and its list."""
    folder, content = scratch(), scratch()
    (content / "DEBIAN").mkdir()
    (content / "DEBIAN/control").write_text("Package: git\nVersion: 1\nArchitecture: all\nMaintainer: none <none@invalid>\n"
                                            "Installed-Size: 3000\nDescription: a test\n", encoding="utf-8")
    (content / "noise").write_bytes(os.urandom(200000))
    subprocess.run(["dpkg-deb", "--build", "--root-owner-group", content, folder / "git.deb"], check=True, stdout=subprocess.DEVNULL)
    listed = subprocess.run(["dpkg-scanpackages", "."], cwd=folder, check=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    (folder / "Packages").write_bytes(listed.stdout)
    return folder


def expect_failure(found, *words):
    code, _, err = found
    for word in ("bootstrap: error: ", "bootstrap: what to do: ", *words):
        expect(code == 1 and word in err, f"ended with {code}, without \"{word}\":\n{err}")


def asked_for(text, program):
    """The packages that a command line after `--no-install-recommends` names."""
    lines = re.findall(rf"{program} .*--no-install-recommends (.*)$", text, re.M)
    expect(len(lines) == 1, f"{len(lines)} commands to install something:\n{text}")
    return set(lines[0].split())


# ---- output before the installation ----

def test_download_size():
    machine = Machine()
    code, out, err = machine.run()
    expect(code == 0 and not err, f"{code}: {err}")
    expect(re.search(r"^bootstrap: installing 1 Debian package, 20\d kB to fetch, \d+ kB on disk: git *$", out, re.M), out)
    log = (machine.deps / "bootstrap.log").read_text(encoding="utf-8")
    expect("0 upgraded, 1 newly installed" in log, f"apt was not asked:\n{log}")


def test_an_unknown_package():
    expect_failure(Machine("git shellcheck").run(), "Unable to locate package shellcheck", "apt-get install failed", "apt's words above")


# ---- another apt ----

@contextmanager
def held(path):
    """Holds the lock of a file, like apt and dpkg."""
    with open(path, "w", encoding="utf-8") as file:
        fcntl.lockf(file, fcntl.LOCK_EX)
        yield


def expect_patience(name):
    """It prints the process that holds the lock, and continues when the lock is free."""
    machine = Machine()
    path = machine.state / name
    with held(path):
        process = machine.start()
        said = ""
        while "waiting" not in said:
            said = process.stdout.readline()
            expect(said, f"it has not waited: {process.stderr.read() if not said else ''}")
        expect(re.match(rf"bootstrap: waiting for apt, \d+ of at most 900 s: process {os.getpid()} \(.+\) holds {path}$", said), said)
        second = process.stdout.readline()
        expect(second.startswith("bootstrap: waiting for apt, "), f"not said again: {second}")
    begun = time.monotonic()
    out, err = process.communicate(timeout=60)
    expect(process.returncode == 0 and "bootstrap: done" in out, f"{process.returncode}: {out}{err}")
    at_most(time.monotonic() - begun, 30, "s from then on")


def test_another_one_has_the_lists():
    expect_patience("lists/lock")


def test_another_one_installs():
    expect_patience("lock-frontend")


def test_patience_ends():
    machine = Machine()
    with held(machine.state / "lock-frontend"):
        expect_failure(machine.run("--wait", "0"), f"process {os.getpid()} ", "lock-frontend", "let it end, then run script/bootstrap")
    expect(machine.run("--wait", "x")[0] == 2 and machine.run("--wait")[0] == 2, "an invalid time is accepted")


# ---- packages ----

def test_what_building_needs():
    machine = Machine("all", programs=NO_ROOT)
    less = asked_for(machine.run("--build")[2], "apt-get update && apt-get install")
    more = asked_for(machine.run()[2], "apt-get update && apt-get install")
    most = asked_for(machine.run("--all")[2], "apt-get update && apt-get install")
    expect(less < more < most, f"{sorted(less)}, {sorted(more)}, {sorted(most)}")
    expect(ONLY_TESTS <= more - less, f"{sorted(less & ONLY_TESTS)} to build, {sorted(ONLY_TESTS - more)} missing")
    expect(ONLY_ALL <= most - more, f"{sorted(more & ONLY_ALL)} without --all, {sorted(ONLY_ALL - most)} missing")
    expect(machine.run("--all", "--build")[0] == 2, "--all and --build together")
    expect({"gcc", "cmake", "ninja-build", "libnlopt-dev", "libjs-dygraphs", "dpkg-dev"} <= less, f"{sorted(less)}")


def test_without_root():
    for options in ([], ["--cross"], ["--all"], ["--all", "--cross"], ["--build"], ["--build", "--cross"]):
        found = Machine("gcc", programs=NO_ROOT).run(*options)
        again = " ".join(["script/bootstrap", *options])
        expect_failure(found, "this needs root", "as root run\n  apt-get update && ", f"then, as yourself,\n  {again}\n")
        packages = asked_for(found[2], "apt-get update && apt-get install")
        expect(("gcc-aarch64-linux-gnu" in packages) == ("--cross" in options), f"{options}: {sorted(packages)}")
        expect(("qemu-user-static" in packages) == ("--cross" in options and "--build" not in options), f"{options}: {sorted(packages)}")
        expect(("chromium" in packages) == ("--all" in options), f"{options}: {sorted(packages)}")


def test_what_dbc2json_needs():
    """dbc2json needs three packages and cantools, and uses an environment of its own."""
    packages = asked_for(Machine("all", parts=(), programs=NO_ROOT).run("--dbc")[2], "apt-get update && apt-get install")
    expect(packages == {"python3", "python3-venv", "ca-certificates"}, f"{sorted(packages)}")
    machine, text = Machine("", parts=()), 'VERSION ""\nBS_:\nBU_:\nBO_ 5 Engine: 8 Vector__XXX\n SG_ Speed : 0|16@1+ (1,0) [0|9] "" Vector__XXX\n'
    for name in ("dbc2json", "dbc2json.py"):
        shutil.copy2(SOURCE / "script" / name, machine.root / "script" / name)
    (machine.root / "small.dbc").write_text(text, encoding="utf-8")
    done = subprocess.run([machine.root / "script/dbc2json", machine.root / "small.dbc"], capture_output=True, encoding="utf-8",
                          env=machine.environment, timeout=200, check=False)
    if "could not be installed" in done.stderr:
        raise Skip("no packages of Python's can be fetched")
    expect(done.returncode == 0 and "Speed" in done.stdout, f"{done.returncode}: {done.stdout}{done.stderr}")
    made = sorted(path.name for path in machine.deps.iterdir() if not path.name.startswith("."))
    expect(made == ["bootstrap.log", "dbc"], f"{made}")


def test_headers_without_an_environment():
    machine = Machine("", parts=())
    code, _, err = machine.run("--build")
    if "could not be fetched" in err:
        raise Skip("no packages of Python's can be fetched")
    expect(code == 0, f"{code}: {err}")
    made = sorted(path.name for path in machine.deps.iterdir() if not path.name.startswith("."))
    expect(made == ["bootstrap.log", "fmi2"], f"{made}")
    expect({path.name for path in (machine.deps / "fmi2").iterdir()} == {path.name for path in (DEPS / "fmi2").iterdir()}, "other files")


def test_no_headers():
    machine = Machine("", parts=())
    machine.environment["PIP_NO_INDEX"] = "1"
    machine.environment.pop("PIP_FIND_LINKS", None)
    expect_failure(machine.run("--build"), "fmpy could not be fetched", "then run script/bootstrap --build")


@contextmanager
def untrusted_server():
    """Address of an HTTPS server with a self-signed certificate, like that of a proxy that inspects
    TLS."""
    folder = scratch()
    subprocess.run(["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-keyout", folder / "key", "-out", folder / "crt",
                    "-subj", "/CN=127.0.0.1"], check=True, stderr=subprocess.DEVNULL)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(folder / "crt", folder / "key")
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), http.server.BaseHTTPRequestHandler)
    server.socket = context.wrap_socket(server.socket, server_side=True)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"https://127.0.0.1:{server.server_address[1]}"
    server.shutdown()


def test_a_proxy_that_signs_itself():
    machine = Machine("", parts=())
    for name in ("PIP_FIND_LINKS", "PIP_CERT", "REQUESTS_CA_BUNDLE"):
        machine.environment.pop(name, None)
    with untrusted_server() as address:
        machine.environment |= {"PIP_INDEX_URL": address, "no_proxy": "127.0.0.1", "PIP_CONFIG_FILE": os.devnull}
        expect_failure(machine.run("--build"), "fmpy could not be fetched: the certificate", "run update-ca-certificates",
                       "then run script/bootstrap --build")


main()
