/* The status of a run, or of a second twin beside it: one struct in shared memory, for probation and for comparisons.
 *
 * Counts are those of one twin. They grow, and begin at 0 with another twin. The twin publishes all but the last five fields.
 * Thread: plain data.
 */
#ifndef TL_FIRMWARE_MONITOR_RUN_STATUS_H
#define TL_FIRMWARE_MONITOR_RUN_STATUS_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/monitor/lock_tally.h"
#include "master/base/signal.h"
#include "master/base/simtime.h"

enum { TL_RUN_OUTPUT_NAME = 40, TL_RUN_OUTPUT_UNIT = 16, TL_RUN_FAILURE = 128 };

/* One output that is compared with the plant. */
typedef struct tl_run_output {
    char name[TL_RUN_OUTPUT_NAME]; /* "motor.omega", cut */
    char unit[TL_RUN_OUTPUT_UNIT]; /* "": none */
    uint64_t pairs;
    double sum_of_squares; /* of y − ŷ, in that unit */
    double tolerance;      /* in that unit, as of now; 0: it is compared only */
} tl_run_output;

typedef enum tl_run_phase {
    TL_RUN_BEGINS,   /* FMUs are loaded, an earlier run is followed */
    TL_RUN_RECORDED, /* a second twin: over recorded samples */
    TL_RUN_LIVE      /* at the plant's ticks */
} tl_run_phase;

/* Fits tl_latest. */
typedef struct tl_run_status {
    uint32_t phase; /* tl_run_phase */
    uint32_t outputs;
    int64_t tick;   /* the newest; over recorded samples the number of ticks done, */
    int64_t last;   /* and of those known */
    uint64_t ticks; /* steps + skipped */
    uint64_t steps;
    uint64_t skipped;
    uint64_t gaps; /* times that ticks were skipped, however many at once */
    uint64_t deadline_misses;
    uint64_t evaluations;
    uint64_t executions;
    uint64_t timed_out;        /* steps whose search the time limit ended */
    tl_time used;              /* ns in all steps */
    tl_lock_tally lock;        /* free until it is judged */
    tl_lock_tally lock_before; /* by the tolerances of the version that a probation may return to; else zeroed */
    uint32_t
        plant_is_shut; /* 1: io has not opened its sources yet; no bool, since a process with FMUs may write anything */
    tl_run_output output[TL_MAX_MATCH];
    /* by the reader */
    bool twin_alive;
    uint64_t twin_failures;       /* ends that nobody asked for */
    char failure[TL_RUN_FAILURE]; /* why it ended the last time; "": not known */
    uint64_t pairs;               /* of all outputs; of a twin that matches nothing its steps */
} tl_run_status;

#endif
