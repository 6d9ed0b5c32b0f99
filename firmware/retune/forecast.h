/* The forecast of a candidate: what its twin will take of the box, in words, and whether that can be.
 *
 * Thread:  pure, but for tl_forecast_memory_left().
 */
#ifndef TL_FIRMWARE_RETUNE_FORECAST_H
#define TL_FIRMWARE_RETUNE_FORECAST_H

#include <stdint.h>

#include "firmware/retune/trial_answer.h"

enum { TL_FORECAST_TEXT = 192 };

typedef enum tl_forecast_result {
    TL_FORECAST_POSSIBLE,
    TL_FORECAST_TOO_SLOW, /* no box that is like this one could run it */
    TL_FORECAST_NO_MEMORY /* beside the twin that runs */
} tl_forecast_result;

/* `left`: bytes of memory; 0: not known. `why`: what cannot be. */
tl_forecast_result tl_forecast_of(const tl_trial_answer *answer, uint64_t left, char why[TL_FORECAST_TEXT]);

/* "a step takes 0.15 ms of 10 ms, and with all of its search 2.3 ms; the budget ends that after 8 ms" */
void tl_forecast_write_time(const tl_trial_answer *answer, char text[TL_FORECAST_TEXT]);

/* "its twin takes 31 MiB of memory; 1900 MiB are left" */
void tl_forecast_write_memory(const tl_trial_answer *answer, uint64_t left, char text[TL_FORECAST_TEXT]);

/* Bytes that the machine has to give, by /proc/meminfo; 0: it does not say. */
uint64_t tl_forecast_memory_left(void);

#endif
