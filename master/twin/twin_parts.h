/* What a twin is made of.
 *
 * Purpose: private to twin.c (the life of a twin, tick by tick), twin_build.c (from a plan) and twin_checkpoint.c (from and to bytes).
 */
#ifndef TL_MASTER_TWIN_TWIN_PARTS_H
#define TL_MASTER_TWIN_TWIN_PARTS_H

#include "master/base/arena.h"
#include "master/event/event_horizon.h"
#include "master/graph/exchange.h"
#include "master/graph/graph.h"
#include "master/measure/delay_meter.h"
#include "master/sync/free_twin.h"
#include "master/sync/lock.h"
#include "master/sync/proof.h"
#include "master/sync/verifier.h"
#include "master/twin/reading_meter.h"
#include "master/twin/twin.h"

struct tl_twin {
    tl_arena arena;
    tl_graph graph;
    tl_exchange exchange;
    bool cannot_return; /* the proof of the rollback has failed */
    tl_lock lock;
    tl_event_horizon *event; /* in place of the lock's own steps; NULL: no event horizon */
    tl_objective_term terms[TL_MAX_MATCH];
    const tl_port *match_ports[TL_MAX_MATCH];
    const tl_port *adjust_ports[TL_MAX_ADJUST];
    uint32_t *capacity; /* nodes of each component's cache; NULL: sequences are not saved */
    uint64_t *worst;    /* and how many it can need at once */
    const tl_port *outputs[TL_MAX_SIGNALS];
    tl_metrics metrics[TL_MAX_MATCH];
    tl_metrics readings[TL_MAX_MATCH]; /* the same at readings, */
    tl_metrics due[TL_MAX_MATCH];      /* and what of it no record has yet */
    tl_reading_meter
        *readers[TL_MAX_MATCH]; /* for which these look; NULL: there is no line between steps, or nothing shows them */
    size_t reading_signals[TL_MAX_MATCH]; /* where they do */
    tl_time look_back;                    /* of what is matched */
    tl_measurements measurements;
    tl_plan_measure measure;
    tl_delay_meter *meters[TL_MAX_MATCH]; /* where Δo is measured */
    tl_twin_delay delay;
    tl_time step;
    uint32_t lead;        /* step i is computed at tick i + lead */
    uint32_t age;         /* ticks by which what is looked up may be older than the instant it is for */
    int64_t first;        /* step: that which the FMUs are initialised for */
    int64_t begin;        /* tick at which they are */
    uint64_t state_bytes; /* that saved states may take; 0: there is no bound */
    size_t (*heap)(void); /* as in the plan, */
    tl_time (*now)(void *clock);
    tl_tuning built;  /* with which the twin was built: what of it cannot change, */
    tl_tuning tuning; /* and which is in force */
    tl_proof proof;
    bool resets; /* the FMUs begin anew before the next step */
    const char *
        runs_free; /* the component that keeps it from being synchronised since the step last computed; NULL: none does */
    tl_verifier verifier;
    tl_free_twin free_twin;
    tl_twin_finding finding; /* the newest; no component: none */
    uint32_t marks;          /* flags of the next step's record, */
    uint32_t lasting;        /* and of all */
    tl_status ended;         /* not TL_OK: a step has failed, nothing may follow */
    bool has_pending;        /* mode ahead: computed, its measurement not there yet */
    tl_record pending;
};

/* The FMUs stand initialised at t_first, with the sample of tick `shown`, and their rollback is tested; not known to the caches yet. */
tl_status tl_twin_start(tl_twin *twin, int64_t shown, tl_error *error);

/* fmi2Fatal is for all instances of an FMU: none of them may be called any more. */
bool tl_twin_is_lost(const tl_twin *twin, const tl_component *component);

#endif
