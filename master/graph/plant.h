/* The plant as a component: outputs only, from samples.
 *
 * Purpose: keeps the newest samples by tick and delivers them step by step, as the thesis's CSV FMU
 *          does (section 5.4.2). The plant is one of the K components; its steps are executions.
 * Bad:     a value whose quality is not good is replaced by the last good value of the signal, or
 *          by `initial` before the first good one. The quality is kept. A value that is not finite,
 *          or too large for an integer signal, is also bad.
 * Later:   if the sample of a tick has not arrived, the newest sample is used in its place (modes
 *          `hold` and `ahead`).
 * Shift:   the plant at the instant t_i is the sample of tick i + shift. This compensates the delay
 *          of inputs. If i + shift is below 0, it is the sample of tick 0.
 * Saving:  if executions are saved, a step of the plant is *known*, and is no execution, if it
 *          delivers the sample of the same tick as before. If the sample of a tick is missing, the
 *          step delivers the newest one. When the missing sample has arrived, the step is not known
 *          any more. Within a tick, the samples are the same for every candidate.
 * Thread:  the twin's.
 */
#ifndef TL_MASTER_GRAPH_PLANT_H
#define TL_MASTER_GRAPH_PLANT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "fmi2TypesPlatform.h"
#include "master/base/archive.h"
#include "master/base/arena.h"
#include "master/base/signal.h"

/* Where one signal is delivered: the output port of its type. Unused pointers are NULL. */
typedef struct tl_plant_output {
    tl_type type;
    fmi2Real *real;
    fmi2Integer *integer;
    fmi2Boolean *boolean;
} tl_plant_output;

typedef struct tl_plant {
    size_t signal_count;
    tl_plant_output *outputs;    /* signal_count */
    size_t delivered_signals;    /* signals before this index may be delivered; the others are only matched */
    double held[TL_MAX_SIGNALS]; /* last good value of each signal */
    tl_sample *window;           /* ring by tick */
    size_t window_mask;          /* size of the ring, a power of two, minus 1 */
    int64_t newest;              /* tick of the newest sample; −1: none */
    int64_t shift;               /* ticks; see Shift above */
    int64_t known;               /* saving: macro steps before this one are known */
    int64_t *delivered;          /* ring by macro step: tick of the delivered sample; NULL: no saving */
    size_t delivered_size;       /* entries of this ring */
    uint64_t executions;
} tl_plant;

/* Allocates a ring of at least `window_size` samples. `shift` in ticks. Returns false if memory is
 * out. */
bool tl_plant_init(tl_plant *plant, tl_arena *arena, size_t signal_count, size_t window_size, int64_t shift);

/* Sets the value of a signal before its first good one; default 0. */
void tl_plant_set_initial(tl_plant *plant, size_t signal, double value);

/* Enables saving: known steps do not count as executions. `horizon` is T_P. Returns false if memory
 * is out. */
bool tl_plant_save_executions(tl_plant *plant, tl_arena *arena, size_t horizon);

/* Adds the sample of the next tick. Its stamps are not stored. */
void tl_plant_push(tl_plant *plant, const tl_sample *sample);

/* Returns the sample of a tick, with bad values replaced: the newest sample for later ticks, that
 * of tick 0 for negative ones. A tick older than the window is not allowed. There must be a sample.
 * Valid until the next tl_plant_push(). */
const tl_sample *tl_plant_sample(const tl_plant *plant, int64_t tick);

/* Saves or loads all data that comes from samples. */
void tl_plant_archive(tl_plant *plant, tl_archive *archive);

/* Determines which signals are delivered. Call it when the pointers in `outputs` are set. */
void tl_plant_placed(tl_plant *plant);

/* Tick of the sample that is delivered for t_i if `newest` is the newest tick. */
int64_t tl_plant_shown(const tl_plant *plant, int64_t i, int64_t newest);

/* Delivers the sample of `tick` to the outputs. */
void tl_plant_deliver(tl_plant *plant, int64_t tick);

/* Delivers these values, one per signal, all of them good. */
void tl_plant_deliver_values(const tl_plant *plant, const double *values);

/* Marks macro step `step` and later ones as not known (see Saving). */
void tl_plant_forget(tl_plant *plant, int64_t step);

/* Executes macro step i = `step`: delivers the sample for its end, t_(i+1). Counts as an execution
 * if the step was not known. `step`: the step to be committed next, or one of the T_P − 1 after
 * it. */
void tl_plant_step(tl_plant *plant, int64_t step);

#endif
