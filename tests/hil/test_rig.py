#!/usr/bin/env python3
"""The emulated box with its real kernel and drivers (tests/hil/rig.json): runs the tests of
tests/hil/box.

It also tests the watchdog of the box, and how script/rig reports a box that crashed or hangs.
"""
import contextlib
import functools
import os
import shutil
import signal
import subprocess
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import box
import hostile_fmu
import twinlock_test
from supervised import store_saved_states
from twinlock_test import HUNG_S, PLAIN_BOX, PLAIN_CAN, BUILD, SOURCE, Failure, Skip, expect, expect_line, has_line

BOX_TESTS = "tests/hil/box"
PREPARE = SOURCE / "tests" / "hil" / "rig" / "prepare"
LOST = box.description()["reach"]["lost"]
UNAVAILABLE = 69  # exit code of rig/prepare


def rig(*arguments, timeout=HUNG_S):
    done = subprocess.run([SOURCE / "script" / "rig", *arguments], capture_output=True, encoding="utf-8",
                          timeout=timeout, check=False)
    return done.returncode, done.stdout, done.stderr


@functools.cache
def preparation():
    """The reason why this machine cannot make the rig; "" if the rig is ready."""
    done = subprocess.run([PREPARE], capture_output=True, encoding="utf-8", check=False)
    return done.stderr.strip() if done.returncode != 0 else ""


def need_rig():
    if preparation():
        expect(os.environ.get("CI") != "true", f"{preparation()}\n(CI=true does not allow to skip it)")
        raise Skip(preparation())


# Tests of BOX_TESTS for the first of two boxes, in this order; the second one runs all others. test_can_faults leaves a clock that was
# set, on which test_live_gpio fails.
FIRST_BOX = ("test_attack.py", "test_kills.py", "test_live_gpio.py", "test_motor_scenario.py", "test_supervised_faults.py", "test_watchdog.py")
FLOODS = "test_can_floods.py"  # see tests/hil/test_can_floods.py


def failures(output):
    """The lines of tests that failed, and the 12 lines after each."""
    lines = output.splitlines()
    shown = {i + after for i, line in enumerate(lines) if line.startswith("FAILED") for after in range(13)}
    return "".join(f"{line}\n" for i, line in enumerate(lines) if i in shown)


def test_on_the_box():
    """Runs tests/hil/box without the floods, on two boxes in parallel, because many tests wait. Each
    box boots once."""
    need_rig()
    results = BUILD / "rig"
    results.mkdir(exist_ok=True)
    figures = twinlock_test.run_well(["replay", twinlock_test.config_path("motor/lock.json"), "--json"])
    (results / "lock.json").write_text(figures, encoding="utf-8")
    shutil.copy(hostile_fmu.make("attack"), results / "attack.fmu")
    store_saved_states(PLAIN_BOX, results / "gpio_states.json")
    store_saved_states(PLAIN_CAN, results / "can_states.json")
    tests = sorted(path.name for path in (SOURCE / BOX_TESTS).glob("test_*.py") if path.name != FLOODS)
    expect(set(FIRST_BOX) < set(tests), f"{FIRST_BOX} are not all in {BOX_TESTS}")
    boxes = [[f"{BOX_TESTS}/{name}" for name in tests if (name in FIRST_BOX) is first] for first in (True, False)]
    with ThreadPoolExecutor() as pool:
        ended = list(pool.map(lambda chosen: box.run([f"{BOX_TESTS}/run", *chosen], timeout=840), boxes))
    for done in ended:
        print("".join(f"  {line}\n" for line in done.stdout.splitlines()), end="")
    for done in ended:
        expect(done.returncode == 0, f"the tests on the box ended with {done.returncode}\n{failures(done.stdout)}{done.stderr}")


def test_watchdog_bites():
    need_rig()
    done = box.run(["python3", f"{BOX_TESTS}/test_watchdog.py", "bite"], timeout=HUNG_S)
    expect("watchdog opened" in done.stdout, f"no open watchdog\n{done.stdout}{done.stderr}")
    expect(done.returncode == LOST, f"the box must be reset, not end with {done.returncode}\n{done.stderr}")
    expect_line(done.stderr, "watchdog|softdog|reset")


def test_panic():
    need_rig()
    code, out, err = rig("--", "sh", "-c", "echo out; echo err >&2; echo c >/proc/sysrq-trigger")
    expect((code, out) == (125, "out\n"), f"found {code}, {out!r}\n{err}")
    first, second = err.splitlines()[:2]
    expect(first == "err" and has_line(second, "rig: error|kernel|sysrq triggered crash"), err)
    expect(err.count("\n  | ") > 10, f"the console is not shown\n{err}")


def test_a_box_that_hangs_is_ended():
    need_rig()
    code, _, err = rig("--timeout", "2", "--", "sleep", "1000")
    expect(code == 124, f"found {code}\n{err}")
    expect_line(err, "rig: error|2 s")


def test_wrong_usage():
    for arguments, code, parts in (
            (["--kernel", "pdp11", "--", "true"], 2, "--kernel|'pdp11'"),
            (["--build", "/nowhere", "--", "true"], 2, "--build /nowhere|script/build"),
            (["--disk", "/nowhere", "--", "true"], 2, "--disk /nowhere|mke2fs -t ext4"),
            (["--timeout", "soon", "--", "true"], 2, "--timeout|soon|120"),
            (["--timeout", "0", "--", "true"], 2, "--timeout|0|120"),
            ([], 2, "COMMAND")):
        found, _, err = rig(*arguments)
        expect(found == code and has_line(err, parts), f"script/rig {' '.join(arguments)}: found {found}, {err}")


def emulator_of(process):
    """The process id of the QEMU that script/rig started."""
    deadline = time.monotonic() + 30
    while time.monotonic() < deadline:
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text(encoding="ascii").split()
        for child in children:
            with contextlib.suppress(FileNotFoundError, ProcessLookupError):  # the process has ended meanwhile
                if Path(f"/proc/{child}/comm").read_text(encoding="ascii").startswith("qemu"):
                    return child
        time.sleep(0.05)
    raise Failure("script/rig has not started QEMU within 30 s")


def test_signals_leave_nothing_behind():
    need_rig()
    for number, code in ((signal.SIGTERM, 143), (signal.SIGKILL, -9)):
        process = subprocess.Popen([SOURCE / "script" / "rig", "--", "sleep", "1000"], stderr=subprocess.DEVNULL,
                                   env={**os.environ, "TMPDIR": str(twinlock_test.scratch())})
        try:
            emulator = Path("/proc") / emulator_of(process)
            process.send_signal(number)
            expect(process.wait(HUNG_S) == code, f"ended with {process.returncode}, not with {code}")
        finally:
            process.kill()
        deadline = time.monotonic() + 5
        while emulator.exists() and time.monotonic() < deadline:
            time.sleep(0.05)
        expect(not emulator.exists(), f"QEMU lives on after {number.name}")


def prepare_elsewhere(environment):
    """(exit code, standard error) of rig/prepare in an empty folder."""
    copied = twinlock_test.scratch() / "tests" / "hil" / "rig"
    copied.mkdir(parents=True)
    for name in ("prepare", "kernel.py"):
        (copied / name).write_bytes((PREPARE.parent / name).read_bytes())
    done = subprocess.run(["/bin/bash", copied / "prepare"], env=environment, capture_output=True, encoding="utf-8",
                          check=False)
    return done.returncode, done.stderr


def test_missing_tools():
    """A machine without Debian's package tools."""
    tools = twinlock_test.scratch()
    for name in ("bash", "dirname", "mkdir", "flock", "cat", "sha256sum"):
        (tools / name).symlink_to(Path("/usr/bin") / name)
    code, err = prepare_elsewhere({"PATH": tools})
    expect(code == UNAVAILABLE, f"found {code}\n{err}")
    expect_line(err, "rig: error|apt-get")
    expect_line(err, "script/bootstrap")


def test_missing_packages():
    """A machine whose apt has no source of packages."""
    setting = twinlock_test.scratch() / "apt.conf"
    setting.write_text('Dir::Etc::SourceList "/dev/null"; Dir::Etc::SourceParts "/dev/null";\n', encoding="ascii")
    code, err = prepare_elsewhere({**os.environ, "APT_CONFIG": str(setting)})
    expect(code == UNAVAILABLE, f"found {code}\n{err}")
    expect_line(err, "rig: error|qemu-system-x86|busybox-static")
    expect_line(err, "apt|Debian 12")


twinlock_test.main()
