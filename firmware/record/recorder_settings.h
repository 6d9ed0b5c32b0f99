/* What a recorder is made with: the file, the run's facts, and how patient it is.
 *
 * Purpose: shared by the recorder and the SQL below it.
 * Owner:   all texts and arrays are the caller's, and copied where they are kept.
 * Thread:  plain data.
 */
#ifndef TL_FIRMWARE_RECORD_RECORDER_SETTINGS_H
#define TL_FIRMWARE_RECORD_RECORDER_SETTINGS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/process/heartbeat.h"
#include "firmware/record/run_types.h"
#include "master/base/simtime.h"
#include "master/plan/plan.h"

typedef struct tl_recorder_settings {
    const char *path;
    int64_t max_bytes;         /* 0: no bound; else at least 1,000,000 */
    tl_time commit;            /* ns between commits, > 0, default 0.5 s */
    const char *verb;          /* "run", "hold", "replay" */
    const char *name;          /* of the configuration */
    const char *configuration; /* its text */
    const char *fmus;          /* SHA-256 over those of the FMUs, */
    const char *boot;          /* of the system, */
    const char *format;        /* and of the bytes of checkpoints; each may be NULL */
    tl_time step;              /* T_S */
    uint32_t prediction;
    uint32_t lead; /* step i is computed at tick i + lead */
    tl_measurements measurements;
    const tl_recorder_signal *plant, *match, *adjust;
    size_t plant_count, match_count, adjust_count;
    const char *const *components; /* names, in the order of the ledger */
    size_t component_count;
    tl_heartbeats *beats; /* whom the recorder's thread tells that it is alive; NULL: nobody */
    bool wait_when_full;  /* replay: put waits instead of losing, but not once the disk has refused for `patience` */
    tl_time patience;     /* ns, with a disk that refuses: of close, and of a put that waits; 0: 2 s */
} tl_recorder_settings;

#endif
