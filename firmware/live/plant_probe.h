/* Plant probe: reads all signals for some seconds, without a twin, a recorder or a watchdog.
 *
 * Purpose: `twinlock probe` shows what a device answers before there is a twin. The readings come
 *          from the same confined process as those of a run (io_role.c), and have the same limits.
 *          No FMU is loaded, and nothing is written to the plant.
 * Trust:   the sample memory and the events come from a process that is exposed to the plant's
 *          network: their readers validate them.
 * Signals: SIGINT, SIGTERM and SIGHUP end a probe early, with what it has found so far. Call
 *          tl_interrupt_install() before.
 * Thread:  the main thread, because it starts a process (role.h).
 */
#ifndef TL_FIRMWARE_LIVE_PLANT_PROBE_H
#define TL_FIRMWARE_LIVE_PLANT_PROBE_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/config/config.h"
#include "firmware/store/record_queue.h"
#include "master/base/signal.h"
#include "master/base/status.h"

typedef struct tl_plant_probe_settings {
    const tl_config *config; /* tl_config_use_lookups() was called */
    const char *text; /* configuration of the process: that of `config`, or with other keys of drivers but period_s */
    tl_time duration; /* ns of reading, > 0 */
    bool is_brief;    /* ends as soon as each signal has a reading or a problem */
    int (*run_role)(const char *role, void *context); /* runs a role in a fork if exec is not possible (role.h) */

    /* Converts a good reading of a signal before its limits are applied; NULL: it stays. */
    void (*convert)(void *context, size_t signal, tl_reading *reading);
    /* Returns false if the message of a signal's source is not about this signal; NULL: all are. */
    bool (*concerns)(void *context, size_t signal, const char *message);
    void *context; /* of both functions */
} tl_plant_probe_settings;

typedef struct tl_plant_probe_signal {
    tl_reading last;           /* newest reading, with its quality as in a run; TL_NO_LINK: none, or none now */
    tl_time age;               /* of the newest reading at the end, ns */
    uint64_t readings;         /* new readings with a value, also out of range */
    uint64_t rejected;         /* new readings out of range or not a number */
    bool has_changed;          /* not all of `readings` have the same value */
    char cause[TL_EVENT_TEXT]; /* first problem that concerns it since its source reported none; "": none */
    char later[TL_EVENT_TEXT]; /* the newest such problem, if it is another one; else "" */
} tl_plant_probe_signal;

typedef struct tl_plant_probe {
    tl_time lasted;                                /* ns from the opening of the sources to the end */
    tl_plant_probe_signal signals[TL_MAX_SIGNALS]; /* by index in config->signals, up to own_count */
} tl_plant_probe;

/* Reads the plant. Errors: TL_BAD_DATA if a signal has no live source; TL_PLANT_DOWN if the process
 * has ended, because a source can never work (its log says why), or by a signal; TL_TRY_AGAIN. An
 * interrupted probe is no error. */
tl_status tl_plant_probe_run(const tl_plant_probe_settings *settings, tl_plant_probe *probe, tl_error *error);

#endif
