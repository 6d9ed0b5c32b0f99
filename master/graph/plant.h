/* The plant as a component: outputs only, fed by samples.
 *
 * Purpose: keeps the newest samples by tick and delivers them step by step, as the thesis's CSV FMU does (5.4.2). It
 *          counts in K and in the executions.
 * Held:    a value whose quality is not good is replaced by the signal's last good one (its `initial` before there
 *          was any); the quality stays with it.
 *          A value that calls itself good but is not finite, or too large for an integer signal, is not good.
 * Later:   a tick whose sample is not there yet is stood for by the newest one (modes `hold` and `ahead`).
 * Shift:   what the plant shows at the instant t_i is the sample of tick i + shift, so that a delay of inputs is made up for.
 *          What would be before tick 0 is that of tick 0.
 * Saving:  where executions are saved, the plant's key is the number of the sample it delivers, so that a value that was
 *          held for a tick is never taken for the real one. Its sequence has no branches: within a tick it is the same
 *          for every candidate.
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
    size_t delivered_signals;    /* those before this one may be delivered somewhere; the others are matched at most */
    double held[TL_MAX_SIGNALS]; /* last good value */
    tl_sample *window;           /* ring by tick */
    size_t window_mask;          /* its size, a power of two, less one */
    int64_t newest;              /* tick; −1: none */
    int64_t shift;               /* ticks */
    int64_t known;      /* saving: the sample delivered at the end of each macro step before this one is known … */
    int64_t *delivered; /* … to be this, by step, in a ring; NULL: every step is an execution */
    size_t delivered_size;
    uint64_t executions;
} tl_plant;

/* Takes the ring for at least `window_size` samples from the arena; false when memory is out. `shift` in ticks. */
bool tl_plant_init(tl_plant *plant, tl_arena *arena, size_t signal_count, size_t window_size, int64_t shift);

/* What a signal delivers before its first good value; 0 unless told. */
void tl_plant_hold(tl_plant *plant, size_t signal, double value);

/* From now on steps that are known are not executed again. `horizon` is T_P. */
bool tl_plant_save_executions(tl_plant *plant, tl_arena *arena, size_t horizon);

/* Adds the sample of the next tick; its stamps are not kept. */
void tl_plant_push(tl_plant *plant, const tl_sample *sample);

/* The sample of a tick, values held where bad. A tick after the newest gives the newest, one before 0 that of 0. Ticks older
 * than the window must not be asked for. At least one sample must have been pushed. */
const tl_sample *tl_plant_sample(const tl_plant *plant, int64_t tick);

/* All of it that came with samples. */
void tl_plant_archive(tl_plant *plant, tl_archive *archive);

/* Once the outputs are placed: finds out which signals are delivered at all. */
void tl_plant_placed(tl_plant *plant);

/* The tick of the sample that is shown at t_i where `newest` is the newest. */
int64_t tl_plant_shown(const tl_plant *plant, int64_t i, int64_t newest);

/* Delivers the sample of `tick` to the outputs. */
void tl_plant_deliver(tl_plant *plant, int64_t tick);

/* Of macro step i and those after it nothing is known any more. */
void tl_plant_forget(tl_plant *plant, int64_t step);

/* Macro step i: delivers what the plant shows at its end, t_(i+1). An execution, if it was not known. Steps are taken from the
 * committed one on, at most T_P. */
void tl_plant_step(tl_plant *plant, int64_t step);

#endif
