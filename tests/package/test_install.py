#!/usr/bin/env python3
"""The package on a bare Debian of this machine's release: apt finds its dependencies, the installed
programs and units work, and upgrade, removal and purge leave the right files.

`test_install.py` makes a Debian in a folder with mmdebstrap. The last hook of mmdebstrap runs
`test_install.py --inside ROOT`, before mmdebstrap deletes the folder.
"""
import contextlib
import json
import os
import re
import subprocess
import sys
import time
from pathlib import Path

import debian
import twinlock_test
from booted import Booted
from debian import output_of
from live_test import wait_until
from service_faults import check_bad_databases
from twinlock_test import Skip, at_most, expect, expect_line, has_line, scratch

SCORE = 2.5  # limit of `systemd-analyze security`: 0 is fully confined, 10 is unconfined
EXAMPLES = "/usr/share/doc/twinlock/examples"
SERVE_SCORE = 2.0
AGAIN = "/srv/again.deb"  # a copy of the package in a folder that stays visible after booting
ROOT = Path(sys.argv[2]) if sys.argv[1:2] == ["--inside"] else None


# ---- The Debian ----
def make_and_enter():
    """Makes the Debian and runs the tests in it. Skips if the archive cannot be reached."""
    debian.need("mmdebstrap")
    package = debian.make()
    copied = scratch() / "twinlock.deb"  # its path is the same inside
    copied.write_bytes(package.read_bytes())
    serve = copied.parent / "twinlock-serve.deb"
    serve.write_bytes(debian.make(name="twinlock-serve").read_bytes())
    # cleanup/apt would empty the lists of this machine
    command = ["mmdebstrap", "--quiet", "--variant=apt", "--format=null", "--skip=cleanup/apt",
               f"--include={copied}", f"--include={serve}", "--include=curl",
               f"--setup-hook=mkdir -p \"$1{copied.parent}\" \"$1/srv\" && cp '{copied}' '{serve}' \"$1{copied.parent}\"",
               f"--customize-hook=cp '{copied}' \"$1{AGAIN}\"",
               f"--customize-hook='{sys.executable}' '{__file__}' --inside \"$1\"", debian.release(), "-", "-"]
    done = subprocess.run(command, input=debian.archive(debian.release()), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False,
                          encoding="utf-8", errors="replace")
    print(done.stdout, end="")
    if done.returncode != 0 and "apt-get update" in done.stdout and "test_" not in done.stdout:
        raise Skip("Debian's archive cannot be reached")
    expect(done.returncode == 0, f"mmdebstrap ended with {done.returncode}; see above")


# ---- Inside ----
def inside(*args, user="root"):
    """Standard output of a command in the Debian, which must succeed."""
    return output_of("chroot", f"--userspec={user}:{user}", ROOT, *args,
                     env={"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "LC_ALL": "C.UTF-8", "DEBIAN_FRONTEND": "noninteractive"})


def place(path):
    return ROOT / path.lstrip("/")


def of_ours():
    """All paths with "twinlock" in their names, except in file systems of the kernel, /tmp and
    /run."""
    found = inside("find", "/", "-xdev", "(", "-path", "/proc", "-o", "-path", "/sys", "-o", "-path", "/tmp", "-o", "-path", "/run", "-o",
                   "-path", "/var/lib/dpkg", ")", "-prune", "-o", "-name", "*twinlock*", "-print")
    return sorted(found.splitlines())


def need_proc():
    """The program finds its installed files through /proc, which some containers forbid to mount.
    """
    if not place("/proc/self/exe").exists():
        raise Skip("/proc cannot be mounted in the Debian here: that takes CAP_SYS_ADMIN")


def test_the_program_runs():
    expect(inside("twinlock", "--help").startswith("usage: twinlock VERB"), "another help")


def test_the_examples_are_good():
    """The installed examples find their FMUs, recordings and schema."""
    need_proc()
    for folder in sorted(path for path in place(EXAMPLES).iterdir() if path.is_dir() and list(path.glob("*.json"))):
        if folder.name == "schema":
            continue
        names = [path.name for path in sorted(folder.glob("*.json")) if "emulate" not in path.read_text("utf-8")]
        for name in names[:2] + names[-1:]:
            inside("twinlock", "check", f"{EXAMPLES}/{folder.name}/{name}")
    expect_line(inside("twinlock", "replay", f"{EXAMPLES}/motor/lock.json"), "in lock|100.0 %")


def test_a_user_of_its_own():
    _, _, uid, _, _, home, shell = inside("getent", "passwd", "twinlock").strip().split(":")
    expect(int(uid) < 1000 and home == "/var/lib/twinlock" and shell == "/usr/sbin/nologin", f"{uid} {home} {shell}")
    expect(set(inside("id", "-nG", "twinlock").split()) == {"twinlock", "dialout"}, inside("id", "twinlock"))


def test_nothing_is_enabled():
    found = inside("find", "/etc/systemd", "-name", "*twinlock*")
    expect(found == "", found)
    expect(list(place("/etc/twinlock").iterdir()) == [], "a configuration of ours")


def exposure_of(unit):
    """Verifies a unit by systemd-analyze, and returns its exposure level."""
    inside("systemd-analyze", "verify", "--man=no", unit)
    said = inside("systemd-analyze", "security", "--offline=true", "--no-pager", unit)
    return float(re.search(r"Overall exposure level.*: ([0-9.]+)", said)[1])


def test_the_unit():
    at_most(exposure_of("twinlock@motor.service"), SCORE, "exposure")


def test_the_unit_with_the_drop_ins_of_the_examples():
    folder = place("/etc/systemd/system/twinlock@dropped.service.d")
    folder.mkdir(parents=True)
    for drop_in in place(f"{EXAMPLES}/systemd").glob("*.conf"):
        (folder / drop_in.name).write_bytes(drop_in.read_bytes())
    expect(len(list(folder.iterdir())) == 2, "other drop-ins")
    at_most(exposure_of("twinlock@dropped.service"), SCORE, "exposure")
    inside("rm", "-r", "/etc/systemd/system/twinlock@dropped.service.d")


def test_the_units_of_the_server_and_the_inbox():
    at_most(exposure_of("twinlock-serve.service"), SERVE_SCORE, "exposure")
    at_most(exposure_of("twinlock-inbox@motor.service"), SERVE_SCORE, "exposure")
    inside("systemd-analyze", "verify", "--man=no", "twinlock-inbox@motor.path")
    groups = set(inside("id", "-nG", "twinlock-serve").split())
    expect(groups == {"twinlock-serve", "twinlock-control"}, f"{groups}")


def test_tokens_are_the_administrator_s():
    secret = inside("twinlock", "token", "add", "anna", "--role", "retune").strip()
    expect(len(secret) == 64 and "anna" in inside("twinlock", "token", "list"), secret)
    place_ = "/etc/twinlock-serve"
    expect(inside("stat", "-c", "%a %U %G", place_, f"{place_}/tokens").splitlines() ==
           ["750 root twinlock-serve", "640 root twinlock-serve"], inside("stat", place_, f"{place_}/tokens"))
    expect(secret not in inside("cat", f"{place_}/tokens", user="root"), "the file has the token itself")
    expect("sha256//" in inside("twinlock", "serve", "--fingerprint", "--state", "/tmp"), "no fingerprint")
    inside("rm", "/tmp/server.pem")


def command_of_the_unit(name):
    """The command of the unit for a configuration."""
    unit = place("/usr/lib/systemd/system/twinlock@.service").read_text(encoding="utf-8")
    command = re.search(r"^ExecStart=(.*)$", unit, re.M)[1]
    return command.replace("%i", name).replace("%S", "/var/lib")


def test_it_runs_as_its_user():
    """Runs the command of the unit with its configuration and folders, and a plant beside it."""
    need_proc()
    live = json.loads(place(f"{EXAMPLES}/motor/live.json").read_text(encoding="utf-8"))
    del live["duration_s"]
    place("/etc/twinlock/motor.json").write_text(json.dumps(live), encoding="utf-8")
    inside("install", "-d", "-o", "twinlock", "-g", "twinlock", "-m", "750", "/var/lib/twinlock", "/var/lib/twinlock/motor")
    script = (f"twinlock plant {EXAMPLES}/motor/live.json >/dev/null 2>&1 & plant=$!; "
              f"{command_of_the_unit('motor')} --duration 1; code=$?; kill $plant; exit $code")
    said = inside("sh", "-c", script, user="twinlock")
    expect_line(said, "motor.omega|error|rad/s")
    expect("motor bench" in inside("twinlock", "show", "/var/lib/twinlock/motor.db"), "no run in the database")


def test_enabled_by_the_administrator():
    inside("systemctl", "enable", "twinlock@motor")
    expect(place("/etc/systemd/system/multi-user.target.wants/twinlock@motor.service").is_symlink(), "not enabled")


# ---- Under systemd ----
def twins_of(machine, unit):
    """Process ids, inside the machine, of a unit's processes that run FMUs."""
    group = machine.property(unit, "ControlGroup")
    pids = machine.run_well("cat", f"/sys/fs/cgroup{group}/cgroup.procs").split()
    titles = {pid: machine.run_well("sh", "-c", f"cat /proc/{pid}/cmdline || true") for pid in pids}
    return [pid for pid, title in titles.items() if title.startswith("twinlock: twin")]


def check_confinement(machine, unit):
    """By the kernel, the process with the FMUs has no privileges and cannot gain any."""
    pid = twins_of(machine, unit)[0]
    status = dict(re.findall(r"^(\w+):\t(.*)$", machine.run_well("cat", f"/proc/{pid}/status"), re.M))
    sets = {name: int(value, 16) for name, value in status.items() if name.startswith("Cap")}
    expect(len(sets) == 5 and not any(sets.values()), f"capabilities: {sets}")
    expect(status["NoNewPrivs"] == "1" and status["Seccomp"] == "2", f"{status}")
    expect(status["Uid"].split()[0] == inside("id", "-u", "twinlock").strip(), status["Uid"])
    temporary = machine.run_well("findmnt", "--task", str(pid), "--noheadings", "--output", "FSTYPE,OPTIONS", "/tmp")
    expect(temporary.startswith("tmpfs") and "size=" in temporary, f"/tmp of the FMUs: {temporary}")
    bounds = machine.run_well("systemctl", "show", unit, "--property=MemoryMax,TasksMax")
    expect("infinity" not in bounds, bounds)
    limits = machine.run_well("cat", f"/proc/{pid}/limits")
    realtime = re.search(r"Max realtime priority +(\d+)", limits)[1]
    if subprocess.run(["prlimit", "--rtprio=99", "true"], stderr=subprocess.DEVNULL, check=False).returncode == 0:
        expect(realtime == "99" and "SCHED_FIFO" in threads(machine, pid), f"{limits}{threads(machine, pid)}")
        expect(int(status["VmLck"].split()[0]) > 0, f"VmLck is {status['VmLck']}")
    else:
        print("    this machine's root may not raise limits: SCHED_FIFO and locked memory are not checked")


def threads(machine, pid):
    return machine.run_well("sh", "-c", f"for thread in /proc/{pid}/task/*; do chrt -p ${{thread##*/}}; done")


def start_motor(machine):
    """Starts the service. Returns the ids of its main process and of the twin."""
    machine.run_well("systemctl", "start", "twinlock@motor")
    wait_until(lambda: len(twins_of(machine, "twinlock@motor")) == 1, "the twin", machine.log)
    return machine.property("twinlock@motor", "MainPID"), twins_of(machine, "twinlock@motor")[0]


def check_a_kill(machine):
    """The supervisor starts another twin; systemd restarts nothing."""
    main_, child = start_motor(machine)
    machine.run_well("sh", "-c", f"kill -KILL {child}")
    wait_until(lambda: twins_of(machine, "twinlock@motor") not in ([], [child]), "a new twin", machine.log)
    expect(machine.property("twinlock@motor", "MainPID") == main_, "another supervisor")
    expect(machine.property("twinlock@motor", "NRestarts") == "0", "systemd has restarted it")


def check_a_bite(machine):
    """A stopped supervisor sends no keepalive, so systemd restarts the service. The test shortens
    WatchdogSec=."""
    folder = place("/etc/systemd/system/twinlock@motor.service.d")
    folder.mkdir()
    (folder / "short.conf").write_text("[Service]\nWatchdogSec=5\nRestartSec=0\nTimeoutAbortSec=1\n", encoding="utf-8")
    machine.run_well("systemctl", "daemon-reload")
    machine.run_well("systemctl", "restart", "twinlock@motor")
    main_ = machine.property("twinlock@motor", "MainPID")
    time.sleep(7)
    expect(machine.property("twinlock@motor", "MainPID") == main_, f"restarted without a cause\n{machine.journal('twinlock@motor')}")
    machine.run_well("sh", "-c", f"kill -STOP {main_}")
    wait_until(lambda: machine.property("twinlock@motor", "NRestarts") != "0", "a new supervisor", machine.log)
    inside("rm", "-r", "/etc/systemd/system/twinlock@motor.service.d")
    machine.run_well("systemctl", "daemon-reload")


def check_what_is_wrong_for_ever(machine):
    """Systemd starts it once, and not again."""
    place("/etc/twinlock/bad.json").write_text("{}\n", encoding="utf-8")
    expect(machine.call("start", "twinlock@bad").returncode != 0, "a bad configuration runs")
    wait_until(lambda: machine.property("twinlock@bad", "ActiveState") == "failed", "its failure", machine.log)
    expect(machine.property("twinlock@bad", "ExecMainStatus") == "65", machine.journal("twinlock@bad"))
    expect(machine.property("twinlock@bad", "NRestarts") == "0", "restarted")
    machine.run_well("systemctl", "reset-failed", "twinlock@bad")
    inside("rm", "/etc/twinlock/bad.json")


def check_a_change_by_a_folder(machine):
    """As by SFTP: a member of the group puts files into the folder that the first start made, and
    reads the results there."""
    folder, service = "/var/lib/twinlock-inbox/motor", "twinlock-inbox@motor.service"

    def put(name, change):
        document = json.loads(place("/etc/twinlock/motor.json").read_text(encoding="utf-8"))
        change(document)
        place("/tmp/new.json").write_text(json.dumps(document), encoding="utf-8")
        machine.run_well("runuser", "-u", "carl", "--", "sh", "-c", f"cp /tmp/new.json {folder}/x.part && mv {folder}/x.part {folder}/{name}")

    def wait_for(name, parts):
        command = "runuser", "-u", "carl", "--", "cat", f"{folder}/{name}.result.txt"
        wait_until(lambda: has_line(machine.run(*command).stdout, parts), parts, lambda: machine.run(*command).stdout + machine.journal(service), every=0.5)

    inside("useradd", "--groups", "twinlock-inbox", "carl")
    machine.run_well("systemctl", "enable", "--now", "twinlock-inbox@motor.path")
    wait_until(lambda: place(folder).exists() and machine.property(service, "ActiveState") == "inactive", "its folder", machine.log)
    put("motor.json", lambda document: document["synchronise"]["match"]["motor.omega"].update(tolerance=1.5))
    wait_for("motor.json", "probation")
    machine.run_well("twinlock", "reload", "motor.json", "--confirm")
    wait_for("motor.json", "version 2|kept")
    expect_line(machine.run_well("twinlock", "reload", "motor.json", "--versions"), "motor.json|carl")
    put("free.json", lambda document: document["components"]["motor"].update(unconfined=True))
    wait_for("free.json", "forbidden")
    wait_until(lambda: machine.property(service, "ActiveState") == "inactive", "its end", machine.log)
    expect(machine.property(service, "Result") == "success", machine.journal(service))
    machine.run_well("systemctl", "disable", "--now", "twinlock-inbox@motor.path")
    inside("userdel", "carl")
    inside("rm", "-r", "/var/lib/twinlock-inbox", "/tmp/new.json")


def check_packages(machine):
    """An upgrade restarts the running service and starts no other one. Removal stops it."""
    before, _ = start_motor(machine)
    machine.run_well("dpkg", "--install", AGAIN)
    wait_until(lambda: machine.property("twinlock@motor", "ActiveState") == "active", "the twin", machine.log)
    expect(machine.property("twinlock@motor", "MainPID") != before, "the old program still runs")
    units = machine.run_well("systemctl", "list-units", "--plain", "--no-legend", "twinlock@*").splitlines()
    expect(len(units) == 1, f"{units}")
    machine.run_well("systemctl", "stop", "twinlock@motor")
    machine.run_well("dpkg", "--install", AGAIN)
    expect(machine.property("twinlock@motor", "ActiveState") == "inactive", "started by an upgrade")
    start_motor(machine)
    machine.run_well("dpkg", "--remove", "twinlock")
    machine.call("stop", "plant")  # it may have ended already, with its recording
    left = machine.run("sh", "-c", "grep -ls '^twinlock$' /proc/[0-9]*/comm").stdout
    expect(left == "", f"still running after removal: {left}")
    inside("dpkg", "--install", AGAIN)


@contextlib.contextmanager
def services_allowed():
    """During mmdebstrap, policy-rc.d forbids to start services. A booted Debian has no such file.
    """
    policy, aside = place("/usr/sbin/policy-rc.d"), place("/usr/sbin/policy-rc.d-aside")
    there = policy.exists()
    if there:
        policy.rename(aside)
    try:
        yield
    finally:
        if there:
            aside.rename(policy)


def check_a_change_by_the_network(machine):
    """curl sends a change to the server, and the server to the twin. Their users share only the
    folder of control sockets."""
    machine.run_well("systemd-run", "--unit=plant", "twinlock", "plant", f"{EXAMPLES}/motor/plant.json", "--for",
                     f"{EXAMPLES}/motor/live.json")
    start_motor(machine)
    pin = re.search(r"sha256//\S+", machine.run_well("twinlock", "serve", "--fingerprint"))[0]
    secret = re.search(r"[0-9a-f]{64}", machine.run_well("twinlock", "token", "add", "ben", "--role", "retune"))[0]
    place("/tmp/ben").write_text(f"Authorization: Bearer {secret}\n", encoding="ascii")
    document = json.loads(place("/etc/twinlock/motor.json").read_text(encoding="utf-8"))
    document["synchronise"]["match"]["motor.omega"]["tolerance"] = 1.5
    place("/tmp/new.json").write_text(json.dumps(document), encoding="utf-8")
    words = ["curl", "-sS", "-k", "--pinnedpubkey", pin, "-H", "@/tmp/ben"]
    motor = "https://127.0.0.1:8443/api/v1/plants/motor"
    said = machine.run_well(*words, "-H", "If-Match: *", "-T", "/tmp/new.json", f"{motor}/configuration?why=wider")
    expect('"kind":"in place"' in said and '"result":"done"' in said.splitlines()[-1], said)
    expect('"who":"ben"' in machine.run_well(*words, f"{motor}/versions"), "no version by ben")
    wait_until(lambda: "token=ben role=retune" in machine.journal("twinlock-serve"), "the audit of the change", machine.log)
    machine.run_well("systemctl", "stop", "twinlock@motor", "plant")
    inside("rm", "-r", "/var/lib/twinlock/motor/versions", "/tmp/ben", "/tmp/new.json")


def test_the_server_under_systemd():
    """It starts confined by its unit and by itself, accepts a change, and ends without an error."""
    unit = "twinlock-serve"
    with services_allowed(), Booted(ROOT) as machine:
        machine.run_well("systemctl", "start", unit)
        check_a_change_by_the_network(machine)
        pid = machine.property(unit, "MainPID")
        status = dict(re.findall(r"^(\w+):\t(.*)$", machine.run_well("cat", f"/proc/{pid}/status"), re.M))
        expect(status["Seccomp"] == "2" and status["NoNewPrivs"] == "1", f"{status}")
        expect(not any(int(value, 16) for name, value in status.items() if name.startswith("Cap")), f"{status}")
        expect(status["Uid"].split()[0] == inside("id", "-u", unit).strip(), status["Uid"])
        expect("sha256//" in machine.journal(unit), machine.journal(unit))
        machine.run_well("systemctl", "stop", unit)
        expect(machine.property(unit, "Result") == "success", machine.journal(unit))
    expect(inside("stat", "-c", "%a %U", "/var/lib/twinlock-serve/server.pem") == "600 twinlock-serve\n", "another owner")


def test_removal_and_purge_of_the_server():
    inside("dpkg", "--remove", "twinlock-serve")
    expect(place("/var/lib/twinlock-serve/server.pem").exists() and place("/etc/twinlock-serve/tokens").exists(), "removal deleted the key or the tokens")
    inside("dpkg", "--purge", "twinlock-serve")
    left = [path for path in of_ours() if "serve" in path]
    expect(not left, f"{left}")


def test_under_systemd():
    """The unit as installed, in a booted Debian."""
    with services_allowed(), Booted(ROOT) as machine:
        machine.run_well("systemd-run", "--unit=plant", "twinlock", "plant", f"{EXAMPLES}/motor/plant.json", "--for",
                         f"{EXAMPLES}/motor/live.json")
        start_motor(machine)
        said = wait_until(lambda: machine.property("twinlock@motor", "StatusText"), "its status text", machine.log)
        print(f"    {said}")
        check_confinement(machine, "twinlock@motor")
        check_a_change_by_a_folder(machine)
        check_a_kill(machine)
        check_a_bite(machine)
        machine.run_well("systemctl", "stop", "twinlock@motor")
        expect(machine.property("twinlock@motor", "Result") == "success", machine.journal("twinlock@motor"))
        expect("SIGTERM" in machine.run_well("twinlock", "show", "/var/lib/twinlock/motor.db"), "not ended orderly")
        check_bad_databases(machine, place(EXAMPLES))
        check_what_is_wrong_for_ever(machine)
        check_packages(machine)


# ---- Upgrade, removal, purge ----
def test_an_upgrade_keeps_everything():
    need_proc()
    before = place("/var/lib/twinlock/motor.db").read_bytes()
    inside("dpkg", "--install", AGAIN)
    expect(place("/var/lib/twinlock/motor.db").read_bytes() == before, "another database")
    expect(place("/etc/twinlock/motor.json").exists(), "the configuration is gone")
    expect(place("/etc/systemd/system/multi-user.target.wants/twinlock@motor.service").is_symlink(), "disabled")


def test_removal_keeps_files_of_the_user():
    need_proc()
    inside("dpkg", "--remove", "twinlock")
    found = of_ours()
    expect(found == ["/etc/systemd/system/multi-user.target.wants/twinlock@motor.service", "/etc/twinlock",
                     "/var/lib/twinlock"], f"{found}")
    expect(place("/var/lib/twinlock/motor.db").exists(), "the database is gone")


def test_a_purge_takes_the_databases_too():
    need_proc()
    inside("dpkg", "--purge", "twinlock")
    found = of_ours()
    expect(found == ["/etc/twinlock"], f"{found}")
    expect(place("/etc/twinlock/motor.json").exists(), "the administrator's configuration is gone")
    expect(inside("getent", "passwd", "twinlock"), "the user is gone")


if ROOT is None:
    try:
        make_and_enter()
    except Skip as skip:
        print(f"skipped: {skip.why}")
        raise
else:
    sys.argv[1:] = []
    twinlock_test.main()
