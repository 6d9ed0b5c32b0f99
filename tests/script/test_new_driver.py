#!/usr/bin/env python3
"""A new driver needs a folder in board/, a configuration file and a line in the table of drivers.

The test adds such a driver to a copy of the tree, builds it without the tests, and checks, runs and
reloads a configuration that uses it. docs/contributing.md has the same steps.
"""
import shutil
import subprocess

import twinlock_test
from retuned import Retuned, tolerance
from supervised import end_orderly, wait_for_run
from tree import OMEGA
from twinlock_test import BAD_DATA, FORBIDDEN, PLAIN_LIVE, SOURCE, edited_config, expect, expect_line, main, run, scratch

FILES = {
    "board/steady/steady.h": """
#ifndef TL_BOARD_STEADY_STEADY_H
#define TL_BOARD_STEADY_STEADY_H

#include "board/io/plant_access.h"
#include "board/io/plant_io.h"

extern const tl_plant_io_driver tl_steady_driver;
extern const tl_plant_access tl_steady_access;

tl_status tl_steady_open(const double *values, size_t count, tl_plant_io **io, tl_error *error);

#endif
""",
    "board/steady/steady.c": """
#include "board/steady/steady.h"

#include <stdlib.h>
#include <string.h>

#include "board/io/monotonic.h"

struct tl_plant_io {
    size_t count;
    double values[TL_MAX_SIGNALS];
};

static tl_status steady_poll(tl_plant_io *io, const tl_plant_io_sink *sink, bool *finished, tl_error *error) {
    (void)finished;
    (void)error;
    for (size_t i = 0; i < io->count; i++) {
        const tl_reading reading = {.value = io->values[i], .stamp = tl_monotonic_now(), .quality = TL_GOOD};
        sink->post(sink->context, i, &reading);
    }
    return TL_OK;
}

static void steady_interrupt(tl_plant_io *io) {
    (void)io;
}

static void steady_close(tl_plant_io *io) {
    free(io);
}

const tl_plant_access tl_steady_access = {.tcp = false};

const tl_plant_io_driver tl_steady_driver = {
    .name = "steady", .poll = steady_poll, .interrupt = steady_interrupt, .close = steady_close};

tl_status tl_steady_open(const double *values, size_t count, tl_plant_io **io, tl_error *error) {
    tl_plant_io *made = calloc(1, sizeof *made);
    if (made == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "out of memory");
    }
    made->count = count;
    memcpy(made->values, values, count * sizeof *values);
    *io = made;
    return TL_OK;
}
""",
    "firmware/config/config_steady.c": """
#include <math.h>

#include "board/steady/steady.h"
#include "firmware/config/config_change.h"
#include "firmware/config/config_reader.h"
#include "firmware/config/drivers.h"

typedef struct settings {
    double gain;
} settings;

static void read_source(tl_config_object *object, tl_config_source *source) {
    static const tl_config_number rule = {.minimum = 0, .maximum = 10, .example = "1"};
    settings *own = source->settings;
    own->gain = 1;
    (void)tl_config_get_number(object, "gain", &rule, &own->gain);
}

static void read_signal(tl_config_object *object, const cJSON *named, tl_config_signal *signal) {
    static const tl_config_number any = {
        .need = TL_CONFIG_REQUIRED, .minimum = -HUGE_VAL, .maximum = HUGE_VAL, .example = "1"};
    (void)named;
    (void)tl_config_get_number(object, "value", &any, signal->channel);
}

static tl_status open_steady(const tl_config_source *source, const char *path, const void *channels, size_t count,
                             tl_plant_io **io, tl_error *error) {
    const settings *own = source->settings;
    const double *given = channels;
    double values[TL_MAX_SIGNALS];
    (void)path;
    for (size_t i = 0; i < count; i++) {
        values[i] = own->gain * given[i];
    }
    return tl_steady_open(values, count, io, error);
}

static const tl_change_rule RULES[] = {
    {"sources.*.steady", TL_RULE_COMMISSION, NULL},
    {"sources.*.steady.gain", TL_RULE_COMMISSION, NULL},
    {"sources.*.steady.period_s", TL_RULE_RETUNE, NULL},
    {"plant.*.steady", TL_RULE_COMMISSION, NULL},
    {"plant.*.steady.source", TL_RULE_COMMISSION, NULL},
    {"plant.*.steady.value", TL_RULE_COMMISSION, NULL},
    {NULL, TL_RULE_COMMISSION, NULL},
};

const tl_driver tl_driver_steady = {
    .name = "steady",
    .signal_key = "steady",
    .source_example = "{\\"gain\\": 1}",
    .signal_example = "{\\"source\\": \\"bench\\", \\"value\\": 1}",
    .settings_bytes = sizeof(settings),
    .channel_bytes = sizeof(double),
    .read_source = read_source,
    .read_signal = read_signal,
    .rules = RULES,
    .not_played = "that are steady",
    .io = &tl_steady_driver,
    .access = &tl_steady_access,
    .open = open_steady,
};
""",
}
TABLE = "firmware/config/drivers.c"
ROW = ("tl_driver_gpio, NULL", "tl_driver_gpio, &tl_driver_steady, NULL")
DECLARED = ("tl_driver_gpio;", "tl_driver_gpio, tl_driver_steady;")


def edit(path, old, new):
    text = path.read_text(encoding="utf-8")
    expect(text.count(old) == 1, f"{path.name}: \"{old.strip()}\" is there {text.count(old)} times")
    path.write_text(text.replace(old, new), encoding="utf-8")


def call(*args, cwd):
    done = subprocess.run(args, cwd=cwd, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, encoding="utf-8",
                          check=False)
    expect(done.returncode == 0, f"{' '.join(args)}: {done.returncode}\n{done.stdout[-4000:]}")


def build():
    """Builds a copy of the tree with the driver, and returns the path of its program."""
    root = scratch()
    for path in SOURCE.iterdir():
        if path.name in ("board", "firmware"):
            shutil.copytree(path, root / path.name)
        elif path.name not in (".git", ".deps", "build"):
            (root / path.name).symlink_to(path)
    (root / ".deps").mkdir()
    (root / ".deps" / "fmi2").symlink_to(SOURCE / ".deps" / "fmi2")
    for name, text in FILES.items():
        (root / name).parent.mkdir(exist_ok=True)
        (root / name).write_text(text.lstrip(), encoding="utf-8")
    edit(root / TABLE, *ROW)
    edit(root / TABLE, *DECLARED)
    call("cmake", "--preset", "host", "-DTL_TESTS=OFF", "-DTL_CHECKS=OFF", cwd=root)
    call("cmake", "--build", "build/host", "--target", "twinlock", cwd=root)
    return next((root / "build" / "host").rglob("bin/twinlock"))


def steady(**values):
    """The motor bench at a constant speed."""
    return edited_config(PLAIN_LIVE, {
        "duration_s": None, "record": {"commit_s": 0.1}, "sources": {"inverter": None, "bench": {"steady": {"period_s": 0.005}}},
        "plant": {name: {"modbus": None, "steady": {"source": "bench", "value": value}} for name, value in values.items()}})


def test_a_new_driver():
    twinlock_test.PROGRAM = str(build())
    config = steady(torque=0, omega=OMEGA)
    code, out, err = run(["check", config])
    expect(code == 0, f"check ends with {code}\n{out}{err}")
    code, _, err = run(["check", steady(torque=0, omega="fast")])
    expect(code == BAD_DATA, f"check ends with {code}\n{err}")
    expect_line(err, 'plant.omega.steady.value|"fast"')
    code, out, err = run(["plant", config, "--for", config])
    expect_line(err, "bench|signals|steady")
    with Retuned(None, config=config) as live:
        wait_for_run(live, live.database, 1)
        code, out, err = live.reload(live.edited(tolerance(0.5)), "--why", "too wide", "--wait", "--probation", "2")
        expect(code == 0, f"{code}\n{out}{err}{live.log()}")
        expect_line(out, "synchronise.match.motor.omega.tolerance|1 → 0.5|in place")
        louder = live.edited(lambda document: document["sources"]["bench"]["steady"].update(gain=2))
        code, out, err = live.reload(louder, "--restart", "--no-activate", "--right", "retune")
        expect(code == FORBIDDEN, f"{code}\n{out}{err}")
        expect_line(out + err, "sources.bench.steady.gain|→ 2|commission")
        end_orderly(live)


main()
