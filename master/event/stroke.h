/* One stroke of the plant, run again with another u: the candidates of an event horizon.
 *
 * Purpose: brings the co-simulation from the state at the stroke's start over the stroke, a macro step at a time and over as
 *          many cycles as that takes, judges what it did in the window, and keeps the state in which the best candidate was
 *          when it met the present.
 * States:  tl_stroke_try(), _try_live(), _follow() and _return() lead the FMUs away from the live twin, tl_stroke_leave() leads
 *          them back.
 * Thread:  the twin's. Memory: the arena, at start-up; states are the FMUs' own.
 */
#ifndef TL_MASTER_EVENT_STROKE_H
#define TL_MASTER_EVENT_STROKE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/arena.h"
#include "master/base/status.h"
#include "master/event/event_search.h"
#include "master/graph/snapshot.h"
#include "master/sync/lock.h"

/* What tells that the event is there: a matched Boolean output, and the plant signal it is matched with. */
typedef struct tl_stroke_event {
    size_t match; /* the output, among those with a weight */
    size_t signal;
    int32_t shift; /* the plant of t_j is in the sample of tick j + this (Δo) */
    bool falls;    /* it is there while they are false */
} tl_stroke_event;

typedef struct tl_stroke {
    tl_lock *lock;
    tl_stroke_event event;
    int64_t now;         /* tick that the live twin has reached */
    int64_t begin;       /* of the stroke's start, */
    int64_t met;         /* of the plant's event, */
    int64_t first;       /* of the window's first sample, */
    int64_t last;        /* and of its last one */
    double *live_course; /* y of the matched outputs as committed, by tick in a ring */
    size_t course_size;
    double *y;
    tl_snapshot states[5];
    tl_snapshot *start;
    tl_snapshot *live;
    tl_snapshot *walker; /* the candidate, when it is left for a cycle */
    tl_snapshot *mark;   /* the candidate at the present, or at the window's end */
    tl_snapshot *best;
    int64_t mark_at;
    int64_t best_at;
    double best_u;    /* NaN: none is kept of this stroke */
    bool away;        /* the FMUs are not those of the live twin; `live` is */
    bool walking;     /* there is a candidate */
    bool loaded;      /* and the FMUs are at it */
    bool unkept;      /* nothing of it need be kept: it goes on from the live twin, or is the winner */
    bool supposed;    /* it has used a sample that is only stood for */
    double u;         /* of the candidate */
    int64_t at;       /* tick it has reached */
    double sum;       /* J so far */
    uint32_t here;    /* samples of the window at which the simulated event is there, */
    uint32_t missing; /* at which it is not, */
    int64_t arrival;  /* tick of the first sample of the window at which it is; INT64_MAX: none */
    int32_t late;     /* samples at which only the plant's is there, less those at which only it is */
} tl_stroke;

typedef struct tl_stroke_settings {
    tl_lock *lock; /* complete; it must outlive the stroke */
    tl_stroke_event event;
    size_t
        samples; /* how many of the plant are kept, and so many outputs of the live twin: a search may begin late, after
                       missed ticks */
} tl_stroke_settings;

/* False when memory is out. */
bool tl_stroke_init(tl_stroke *stroke, tl_arena *arena, const tl_stroke_settings *settings);
void tl_stroke_forget(tl_stroke *stroke, size_t component);

/* The live twin has reached tick: notes its outputs. */
void tl_stroke_note(tl_stroke *stroke, int64_t tick);

/* The live twin is at the start of a stroke. */
tl_status tl_stroke_begin(tl_stroke *stroke, int64_t tick, tl_error *error);

/* A search begins: nothing is kept. False: there is no good sample of the end signal in the window. */
bool tl_stroke_begin_search(tl_stroke *stroke);

/* A candidate: from the start of the stroke; or the live twin, whose u is that of the whole stroke. */
tl_status tl_stroke_try(tl_stroke *stroke, double u, tl_error *error);
tl_status tl_stroke_try_live(tl_stroke *stroke, double u, tl_error *error);

/* The winner, to be led on to the present: from where it was kept, if it was, or from the start of the stroke. */
tl_status tl_stroke_follow(tl_stroke *stroke, double u, tl_error *error);

/* To where the candidate was left, where it was. One macro step of it. Then, for this cycle: the FMUs are those of the live
 * twin again. */
tl_status tl_stroke_return(tl_stroke *stroke, tl_error *error);
tl_status tl_stroke_walk(tl_stroke *stroke, tl_error *error);
tl_status tl_stroke_leave(tl_stroke *stroke, tl_error *error);

/* The candidate has been judged: over the window. J without penalties, and when its event came. */
double tl_stroke_value(const tl_stroke *stroke);
tl_event_side tl_stroke_side(const tl_stroke *stroke);

/* It is the best so far: what was marked of it is kept. */
void tl_stroke_keep(tl_stroke *stroke);

/* There is no candidate any more; or it is the twin from now on. */
void tl_stroke_drop(tl_stroke *stroke);
void tl_stroke_adopt(tl_stroke *stroke);

#endif
