/* The plant as a component: outputs only, from samples.
 *
 * Purpose: keeps the newest samples by tick and delivers them step by step, as the thesis's CSV FMU
 *          does (5.4.2). It counts in K and in the executions.
 * Bad:     a value whose quality is not good is replaced by the last good one of the signal
 *          (`initial` before the first); the quality is kept. A good value that is not finite, or
 *          too large for an integer signal, is not good.
 * Later:   the newest sample stands in for a tick whose sample has not arrived (modes `hold` and
 *          `ahead`).
 * Shift:   the plant at the instant t_i is the sample of tick i + shift, which compensates a delay
 *          of inputs. Before tick 0 it is that of tick 0.
 * Saving:  if executions are saved, the plant's key is the number of the delivered sample, so that
 *          a stand-in is never taken for the real sample. Its sequence has no branches: within a
 *          tick it is the same for every candidate.
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
    double held[TL_MAX_SIGNALS]; /* last good value */
    tl_sample *window;           /* ring by tick */
    size_t window_mask;          /* size of the ring, a power of two, minus 1 */
    int64_t newest;              /* tick; −1: none */
    int64_t shift;               /* ticks */
    int64_t known;               /* saving: the samples delivered in macro steps before this one are known */
    int64_t *delivered;          /* these samples, by step, in a ring; NULL: every step is an execution */
    size_t delivered_size;
    uint64_t executions;
} tl_plant;

/* Allocates a ring of at least `window_size` samples. `shift` in ticks. Returns false if memory is
 * out. */
bool tl_plant_init(tl_plant *plant, tl_arena *arena, size_t signal_count, size_t window_size, int64_t shift);

/* Sets the value of a signal before its first good one; default 0. */
void tl_plant_set_initial(tl_plant *plant, size_t signal, double value);

/* Enables saving: known steps are not executed again. `horizon` is T_P. */
bool tl_plant_save_executions(tl_plant *plant, tl_arena *arena, size_t horizon);

/* Adds the sample of the next tick, without its stamps. */
void tl_plant_push(tl_plant *plant, const tl_sample *sample);

/* The sample of a tick, with bad values replaced. After the newest tick it is the newest, before
 * tick 0 that of tick 0. Ticks older than the window are not allowed. There must be a sample. */
const tl_sample *tl_plant_sample(const tl_plant *plant, int64_t tick);

/* Archives all data from samples. */
void tl_plant_archive(tl_plant *plant, tl_archive *archive);

/* Determines which signals are delivered, once the outputs are placed. */
void tl_plant_placed(tl_plant *plant);

/* The tick of the sample that is the plant at t_i if `newest` is the newest. */
int64_t tl_plant_shown(const tl_plant *plant, int64_t i, int64_t newest);

/* Delivers the sample of `tick` to the outputs. */
void tl_plant_deliver(tl_plant *plant, int64_t tick);

/* Drops what is known of macro step `step` and later ones. */
void tl_plant_forget(tl_plant *plant, int64_t step);

/* Executes macro step `step`: delivers the plant at its end, t_(step+1). Counts as an execution if
 * it was not known. Steps start at the committed one, at most T_P of them. */
void tl_plant_step(tl_plant *plant, int64_t step);

#endif
