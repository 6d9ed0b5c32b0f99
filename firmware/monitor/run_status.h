/* Run status: status block of a twin, live or shadow, used by probation and comparison.
 *
 * Counts are those of one twin; they start at 0 with each twin. The twin publishes all fields
 * except the last four.
 * Memory: one struct in shared memory, without pointers. Trust: the twin's process may write any
 *         values.
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

/* A matched or compared output. */
typedef struct tl_run_output {
    char name[TL_RUN_OUTPUT_NAME]; /* "motor.omega", truncated */
    char unit[TL_RUN_OUTPUT_UNIT]; /* "": none */
    uint64_t pairs;                /* number of pairs of y and ŷ */
    double sum_of_squares;         /* of y − ŷ over all pairs, in the square of `unit` */
    double tolerance;              /* present value, in `unit`; 0: the output is compared, but not matched */
    double y, measured;            /* newest, in `unit`; NaN: not finite; `measured`: not good */
} tl_run_output;

/* The correction Δu of an adjusted variable. */
typedef struct tl_run_correction {
    char name[TL_RUN_OUTPUT_NAME]; /* "motor.M_w", truncated */
    uint64_t count;                /* committed steps with a u */
    double sum;                    /* of Δu over them, in the variable's unit */
} tl_run_correction;

typedef enum tl_run_phase {
    TL_RUN_BEGINS,   /* FMUs are being loaded, or the steps of an earlier run are repeated */
    TL_RUN_RECORDED, /* a shadow simulates recorded samples */
    TL_RUN_LIVE      /* steps at the plant's ticks */
} tl_run_phase;

/* Small enough for tl_latest. */
typedef struct tl_run_status {
    uint32_t phase;       /* a tl_run_phase */
    uint32_t outputs;     /* number of valid entries of `output` */
    uint32_t corrections; /* likewise of `correction` */
    int64_t tick;         /* newest tick; with recorded samples: number of ticks done */
    int64_t last;         /* with recorded samples: number of ticks that are known so far */
    uint64_t ticks;       /* steps + skipped */
    uint64_t steps;
    uint64_t skipped;
    uint64_t gaps; /* a gap is one or more skipped ticks in a row */
    uint64_t deadline_misses;
    uint64_t evaluations;
    uint64_t executions;
    uint64_t timed_out; /* steps whose search was ended by the time limit */
    tl_time used;       /* sum of the computing times of all steps, ns */
    tl_time late;       /* sum of the delays with which ticks began, ns */
    tl_lock_tally lock; /* state "free" until the first window has ended */
    tl_lock_tally
        lock_before;        /* the same with the tolerances of the version that a probation may restore; else zeroed */
    uint32_t plant_is_shut; /* 1: io has not opened its sources yet; no bool, because the value is untrusted */
    tl_run_correction correction[TL_MAX_ADJUST];
    tl_run_output output[TL_MAX_MATCH];
    /* set by the reader: */
    bool twin_alive;
    uint64_t twin_failures;       /* number of unexpected ends of the twin's process */
    char failure[TL_RUN_FAILURE]; /* cause of the last one; "": not known */
    uint64_t pairs;               /* sum over all outputs; of a twin without outputs: its steps */
} tl_run_status;

#endif
