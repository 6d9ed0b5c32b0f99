/* Private data of a twin.
 *
 * Purpose: shared by twin.c (tick by tick), twin_build.c (from a plan) and twin_checkpoint.c (from
 *          and to bytes).
 */
#ifndef TL_MASTER_TWIN_TWIN_PARTS_H
#define TL_MASTER_TWIN_TWIN_PARTS_H

#include "master/base/arena.h"
#include "master/event/event_horizon.h"
#include "master/graph/exchange.h"
#include "master/graph/graph.h"
#include "master/measure/delay_meter.h"
#include "master/sync/free_twin.h"
#include "master/sync/proof.h"
#include "master/sync/synchroniser.h"
#include "master/sync/verifier.h"
#include "master/twin/reading_meter.h"
#include "master/twin/twin.h"

struct tl_twin {
    tl_arena arena;
    tl_graph graph;
    tl_exchange exchange;
    bool cannot_return; /* the rollback proof has failed */
    tl_synchroniser synchroniser;
    tl_event_horizon *event; /* in place of the synchroniser's steps; NULL: no event horizon */
    tl_objective_term terms[TL_MAX_MATCH];
    const tl_port *match_ports[TL_MAX_MATCH];
    const tl_port *adjust_ports[TL_MAX_ADJUST];
    uint32_t *capacity; /* nodes of each component's cache; NULL: sequences are not saved */
    uint64_t *worst;    /* nodes that each can need at once */
    const tl_port *outputs[TL_MAX_SIGNALS];
    tl_metrics metrics[TL_MAX_MATCH];
    tl_metrics readings[TL_MAX_MATCH];       /* at the plant's readings */
    tl_metrics due[TL_MAX_MATCH];            /* the part of it that no record holds yet */
    tl_reading_meter *readers[TL_MAX_MATCH]; /* NULL: there are no values between steps, or no readings */
    size_t reading_signals[TL_MAX_MATCH];    /* signals with these readings */
    tl_time look_back;                       /* of matched signals */
    tl_pairing measurements;
    tl_plan_measure measure;
    tl_delay_meter *meters[TL_MAX_MATCH]; /* if Δo is measured */
    tl_twin_delay delay;
    tl_time step;
    tl_experiment experiment; /* in use */
    uint32_t lead;            /* step i is computed at tick i + lead */
    uint32_t age;             /* ticks by which a look-up may be older than the instant it is for */
    int64_t first;            /* the step that the FMUs are initialised for */
    int64_t begin;            /* tick of the initialisation */
    uint64_t state_bytes;     /* bound of saved states; 0: no bound */
    size_t (*heap)(void);     /* as in the plan */
    tl_time (*now)(void *clock);
    tl_tuning built;  /* as it was built: its fixed parts */
    tl_tuning tuning; /* in use */
    tl_proof proof;
    uint64_t bad_at_start; /* as in a record: outputs that were not finite after the initialisation */
    bool resets;           /* the FMUs are reset before the next step */
    const char *runs_free; /* the component because of which the twin runs free since the last step; NULL: none */
    tl_verifier verifier;
    tl_free_twin free_twin;
    tl_twin_finding finding; /* the newest; no component: none */
    uint32_t marks;          /* flags of the next step's record */
    uint32_t lasting;        /* flags of all records */
    tl_status ended;         /* not TL_OK: a step has failed, and no other may follow */
    bool has_pending;        /* mode ahead: a computed step whose measurement has not come yet */
    tl_record pending;
};

/* Initialises the FMUs at t_first with the sample of tick `shown` and proves their rollback. The
 * caches are not started yet. */
tl_status tl_twin_start(tl_twin *twin, int64_t shown, tl_error *error);

/* True if an instance of this component's FMU has returned fmi2Fatal: that is valid for all of its
 * instances. */
bool tl_twin_is_lost(const tl_twin *twin, const tl_component *component);

#endif
