/* What a recorder is made with: the file, the run's facts, and how patient it is.
 *
 * Purpose: shared by the recorder, the writer and the SQL below it.
 * Owner:   all texts and arrays are the caller's, and outlive the recorder.
 * Thread:  plain data.
 */
#ifndef TL_FIRMWARE_STORE_RECORDER_SETTINGS_H
#define TL_FIRMWARE_STORE_RECORDER_SETTINGS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/config/config.h"
#include "firmware/store/database_file.h"
#include "firmware/store/run_types.h"
#include "master/base/simtime.h"
#include "master/plan/plan.h"
#include "master/twin/account.h"

typedef struct tl_recorder_settings {
    const char *path;
    tl_database_insistence insistence; /* at the opening; once it is open, whatever happens is coped with */
    int64_t max_bytes;                 /* 0: no bound; else at least 1,000,000 */
    tl_time commit;                    /* ns between commits, > 0, default 0.5 s */
    const char *verb;                  /* "run", "hold", "replay" */
    const char *name;                  /* of the configuration */
    const char *configuration;         /* its text, */
    const tl_recorder_known *known;    /* and others: they may change between two writes */
    size_t known_count;
    const char *fmus;   /* SHA-256 over those of the FMUs, */
    const char *boot;   /* of the system, */
    const char *format; /* and of the bytes of checkpoints; each may be NULL */
    tl_time step;       /* T_S */
    tl_measurements measurements;
    const tl_recorder_signal *plant, *match, *adjust;
    size_t plant_count, match_count, adjust_count;
    size_t component_count;    /* in the ledger */
    const tl_account *account; /* of a twin whose run begins when the recorder is opened: needed only then */
    bool wait_when_full; /* replay: put waits instead of losing, but not once the disk has refused for `patience` */
    tl_time patience;    /* ns, with a disk that refuses: of close, and of a put that waits; 0: 2 s */
} tl_recorder_settings;

/* Names as the recorder makes them of a configuration. */
enum { TL_RECORDER_NAME = 80 }; /* "plant." and at most 63 characters */
typedef struct tl_recorder_names {
    char plant_texts[TL_MAX_SIGNALS][TL_RECORDER_NAME];
    tl_recorder_signal plant[TL_MAX_SIGNALS];
    tl_recorder_signal match[TL_MAX_MATCH]; /* without units and types, which the FMUs tell */
    tl_recorder_signal adjust[TL_MAX_ADJUST];
} tl_recorder_names;

/* Sets all that a configuration says: bound, interval, name, text, step, measurements, signals. Lives as long as both. */
void tl_recorder_settings_of(const tl_config *config, tl_recorder_names *names, tl_recorder_settings *settings);

#endif
