/* Pasts out of a database: the box's memory.
 *
 * Purpose: finds the newest run that can be gone on with (past.h), if it had the same configuration and FMUs, and from where: its
 *          newest checkpoint first, then older ones, at last its inputs without any. After a reboot UTC says how long ago it was. If there is
 *          none, what is told says why the twin begins anew.
 * Twin:    none: what must be known of it is given, so that a process without FMUs can look.
 * Trust:   none in the database (history.h).
 * Owner:   settings are copied, what they point to is not.
 * Thread:  one at a time.
 */
#ifndef TL_FIRMWARE_TWIN_PAST_HISTORY_H
#define TL_FIRMWARE_TWIN_PAST_HISTORY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/config/config.h"
#include "firmware/twin/past.h"

typedef struct tl_past_history tl_past_history;

typedef struct tl_past_history_settings {
    const tl_config *config; /* whose second look-ups are signals */
    const char *path;        /* of the database */
    int64_t before;          /* runs with a smaller number are looked at: that of the new run; INT64_MAX: all */
    const char *fmus;        /* which FMUs these are (tl_twin_recorder_identify()), */
    const char *boot;        /* and which boot (tl_identity_boot()) */
    size_t components;       /* of the twin, the plant included */
    tl_past_tell *tell;
    void *context; /* of tell */
} tl_past_history_settings;

/* Opens the database. NULL: it cannot be read, which was told and keeps no twin from running; or `record.resume_s` is 0. */
tl_past_history *tl_past_history_open(const tl_past_history_settings *settings);

/* NULL is allowed. */
void tl_past_history_close(tl_past_history *history);

/* The newest past, then ever older ones; *size is that of its image. False: there is none (any more), and if that is worth saying it
 * was told. NULL is allowed. */
bool tl_past_history_next(tl_past_history *history, size_t *size);

/* If the newest run is not gone on with (another configuration, for example): when its last tick was, on the clock of now. 0: not known. NULL is allowed. */
tl_time tl_past_history_ended(const tl_past_history *history);

/* The image of the past that was found last. */
void tl_past_history_write(const tl_past_history *history, void *image);

/* ---- Recorded samples of the run that is under way, for a twin that begins beside it: a shadow has minutes behind it before it is compared.
 *
 * Run:     the newest one of this boot that is being written; of ticks before it begins, those of the run that it goes on with, which has the same t_start.
 */

/* From where the newest are given, if nobody says from which tick on. */
#define TL_PAST_SAMPLES_BEFORE (60 * TL_SECOND)

/* Into `image`, which has `room` bytes: samples from tick `from` on, up to a hole, for tl_past_read_samples(); below 0: from a minute before the newest on. `boot` is
 * tl_identity_boot(). *size is 0 if there are none. Errors: those of history.h. */
tl_status tl_past_samples_find(const char *path, const char *boot, int64_t from, void *image, size_t room, size_t *size,
                               tl_error *error);

#endif
