/* What a tree is made of.
 *
 * Purpose: private to tree.c (its run, and what is looked at in it) and tree_start.c (what each process is given at its start).
 * Thread:  the supervisor's, but for tl_tree_put_event().
 */
#ifndef TL_FIRMWARE_LIVE_TREE_PARTS_H
#define TL_FIRMWARE_LIVE_TREE_PARTS_H

#include <stdio.h>

#include "firmware/live/live_activator.h"
#include "firmware/live/live_change.h"
#include "firmware/live/live_job.h"
#include "firmware/live/live_place.h"
#include "firmware/live/live_wire.h"
#include "firmware/live/saved_states.h"
#include "firmware/live/supervisor.h"
#include "firmware/live/tree.h"
#include "firmware/live/voice.h"

/* All shared memory of the run. It outlives each process that writes it. */
typedef struct tl_tree_memory {
    tl_block mail; /* in which io posts what it reads of the plant (plant_mail.h) */
    tl_block io_pulse;
    tl_block recorder_pulse;
    tl_block supervisor; /* an outbox of ours */
    tl_block stage;
    tl_block candidate; /* of the activator */
} tl_tree_memory;

typedef struct tl_tree {
    const tl_tree_settings *settings;
    tl_config config; /* as the processes have it, with what the command line changes */
    tl_live_job job;  /* what does not change from start to start */
    tl_tree_memory memory;
    tl_live_place places[TL_LIVE_PLACES];
    tl_live_change change;
    uint32_t twins_place; /* the place of the supervisor's twin; that of the run is on the stage */
    tl_live_activator activator;
    tl_saved_states states; /* of the FMUs with which the run begins, */
    bool told_states;       /* and that they are of no use */
    bool again;             /* the run is to begin anew */
    int stopped;            /* by this signal; 0: by none */
    tl_outbox outbox;       /* of the supervisor */
    tl_voice *voice;
    int32_t urgent; /* the thread of the run's twin that has the priority; 0: none */
    FILE *output;
    tl_time began;
} tl_tree;

static inline tl_live_stage *tl_tree_stage(const tl_tree *self) {
    return self->memory.stage.bytes;
}

/* That of the run. */
static inline tl_live_place *tl_tree_place_of_run(tl_tree *self) {
    return &self->places[tl_tree_stage(self)->place];
}

/* The place in which the supervisor's twin is, or its shadow. */
static inline tl_live_place *tl_tree_place_of(tl_tree *self, tl_member which) {
    return &self->places[which == TL_MEMBER_TWIN ? self->twins_place : 1 - self->twins_place];
}

static inline tl_live_recorder_pulse *tl_tree_recorder_pulse(const tl_tree *self) {
    return self->memory.recorder_pulse.bytes;
}

static inline bool tl_tree_records(const tl_tree *self) {
    return self->job.database[0] != '\0';
}

/* ---- tree_start.c ---- */

/* As tl_supervisor_settings.begin, and tl_live_activator_host.begin; the context is the tree. */
pid_t tl_tree_begin(void *context, tl_member which, const tl_start *start, tl_error *error);
pid_t tl_tree_begin_activator(void *context);

/* What main() does for a title; the context is the tree. */
int tl_tree_be(const char *title, void *context);

/* ---- tree.c ---- */

/* For the database; on the log it is already. Any thread. */
void tl_tree_put_event(tl_tree *self, tl_severity severity, const char *source, const char *text);

#endif
