#!/usr/bin/env python3
"""The commands of master/README.md build, install and use the master, whose only dependency is
NLopt."""
import os
import re
import subprocess

from twinlock_test import BUILD, SOURCE, at_most, expect, main, scratch

HOME = scratch()
README = (SOURCE / "master/README.md").read_text("utf-8")
HEADER = (SOURCE / "master/plan/plan.h").read_text("utf-8") + (SOURCE / "master/sync/record.h").read_text("utf-8")
# Members that are no settings.
OF_RUN = {"budget.started", "budget.context", "budget.unrecorded", "budget.repeated", "budget.without_nominal", "budget.executions"}


def run(*command, **options):
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False, encoding="utf-8", **options)
    expect(done.returncode == 0, f"{command} ended with {done.returncode}\n{done.stdout}")
    return done.stdout


def installed(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def build_flags():
    environment = {**os.environ, "PKG_CONFIG_PATH": str(HOME / "twinlock/lib/pkgconfig")}
    return run("pkg-config", "--cflags", "--libs", "twinlock-master", env=environment).split()


def test_the_example_finds_the_true_torque():
    commands = re.findall(r"^```sh\n(.*?)^```", README, re.M | re.S)
    said = run("bash", "-euo", "pipefail", "-c", "".join(commands), cwd=SOURCE, env={**os.environ, "HOME": str(HOME)})
    print(said[said.index("  t [s]"):], end="")
    rows = [tuple(map(float, row)) for row in re.findall(r"^ +(\d+\.\d\d) +(\d\.\d{5}) +(-?\d\.\d{5})$", said, re.M)]
    truth = [(t, 0.0 if t <= 2 else 0.12 - 1e-4 * (100 * t - 1)) for t in range(1, 11)]
    for (t, true, estimated), (wanted_t, wanted) in zip(rows, truth, strict=True):
        expect(t == wanted_t and abs(true - wanted) < 1e-5 and abs(estimated - wanted) < 2e-4, f"{t} s: {true} {estimated}")
    at_most(float(re.search(r"of 1000 steps: (\S+) N\.m", said)[1]), 2e-4, "largest error of 1000 steps, N.m")


def test_it_needs_libc_libm_and_nlopt():
    needed = set(re.findall(r"\(NEEDED\).*\[(.*?)\]", run("readelf", "--dynamic", "--wide", HOME / "lock")))
    expect(needed <= {"libnlopt.so.0", "libm.so.6", "libc.so.6"} and "libnlopt.so.0" in needed, f"{needed}")
    nlopt = re.search(r"libnlopt\S+ => (\S+)", run("ldd", HOME / "lock"))[1]
    files = [set(re.findall(r"^\s+(lib[^ ]+)", run("ldd", path), re.M)) for path in (HOME / "lock", nlopt)]
    expect(files[0] - files[1] <= {"libnlopt.so.0"}, f"{files[0]} and not of NLopt")


def test_what_is_installed():
    alone = installed(HOME / "twinlock")
    print("    " + " ".join(alone))
    headers = {name for name in alone if name.endswith(".h")}
    expect({f"include/twinlock/{name}" for name in ("fmi2FunctionTypes.h", "fmi2TypesPlatform.h", "master/twin/twin.h")} <= headers, f"{headers}")
    expect(set(alone) - headers == {"lib/libtwinlock-master.a", "lib/pkgconfig/twinlock-master.pc"}, f"{alone}")
    whole, component = scratch(), scratch()
    run("cmake", "--install", BUILD, "--component", "master", "--prefix", component)
    expect(installed(component) == alone, f"a usual build installs {installed(component)}")
    run("cmake", "--install", BUILD, "--prefix", whole)
    expect(not set(installed(whole)) & set(alone), "the master is installed with the appliance")


def settings():
    """(setting, default as a C expression) of the table; None if the setting is required."""
    for names, value in re.findall(r"^\| (`[a-z].*?) \| (?:`(.+?)`|required) \|", README[README.index("## Settings"):README.index("## Modules")], re.M):
        yield from ((name, value or None) for name in re.findall(r"`(.*?)`", names))


def test_the_table_has_every_setting():
    told = {".".join(name.split(".")[:2]) for name, _ in settings()}
    for kind, struct in {"plan": "tl_plan", "adjust": "tl_plan_adjust", "match": "tl_plan_match", "budget": "tl_budget"}.items():
        body = re.search(rf"^typedef struct {struct} {{(.*?)^}} {struct};", HEADER, re.M | re.S)[1]
        members = re.findall(r"(\w+)(?:\)\([^)]*\))?;", re.sub(r"/\*.*?\*/", "", body, flags=re.S))
        missing = {f"{kind}.{name}" for name in members if name != "where" and not name.endswith("_count")} - told - OF_RUN
        expect(members and not missing, f"master/README.md has no {missing}")


def test_the_table_has_the_defaults():
    checks = [f'if (!({name} == ({value}))) {{ puts("{name}"); wrong = 1; }}' for name, value in settings() if value]
    code = ["#include <math.h>", "#include <stdio.h>", '#include "master/twin/twin.h"', "int main(void) {", "int wrong = 0;",
            "const tl_time step = 1000; tl_plan plan = tl_plan_defaults(step); tl_budget budget = tl_budget_defaults(step);",
            'tl_plan_adjust adjust = tl_plan_adjust_defaults("m.u", 1); tl_plan_match match = tl_plan_match_defaults("m.y", "plant.y", 1);',
            *checks, "return wrong; }"]
    (HOME / "defaults.c").write_text("\n".join(code), "utf-8")
    run("cc", "-std=c99", "defaults.c", *build_flags(), "-o", "defaults", cwd=HOME)
    print(f"    {len(checks)} defaults")
    run(HOME / "defaults")


if __name__ == "__main__":
    main()
