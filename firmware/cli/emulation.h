/* A plant from a simulation: the twin's outputs with noise.
 *
 * Thread:  one.
 */
#ifndef TL_FIRMWARE_CLI_EMULATION_H
#define TL_FIRMWARE_CLI_EMULATION_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/config/config.h"
#include "firmware/twin/twin_child.h"
#include "master/base/status.h"

/* ---- Seeded noise: the same numbers on every machine.
 *
 * Purpose: measurement noise and message times of an emulated plant; C's rand() differs between libraries.
 * Method:  SplitMix64 for uniform bits, Marsaglia's polar method for the normal distribution.
 * Thread:  one generator belongs to one thread.
 */

/* Any value is a seed. */
typedef struct tl_noise {
    uint64_t state;
} tl_noise;

/* Uniform in [0, 1). */
double tl_noise_uniform(tl_noise *noise);

/* Normal with mean 0 and standard deviation 1. */
double tl_noise_normal(tl_noise *noise);

/* ---- An emulated plant: rows of values in time, played from a recording or made by FMUs as the true plant.
 *
 * Purpose: what `twinlock plant` serves. From FMUs: the configuration's co-simulation runs free, its `emulate` columns
 *          are read with seeded noise at random message times.
 * Time:    of rows starts at 0; a row tells the plant as it was at its time (the newest step at or before it).
 * Thread:  one thread.
 */

typedef struct tl_emulation tl_emulation;

typedef struct tl_emulation_row {
    tl_time time;
    double values[TL_MAX_SIGNALS];
    bool present[TL_MAX_SIGNALS];
} tl_emulation_row;

/* The rows of a CSV recording, one column per signal of `config`. */
tl_status tl_emulation_open_recording(const char *path, const tl_config *config, tl_emulation **emulation,
                                      tl_error *error);

/* The rows that a built twin makes as the plant. `model` has its configuration, with `emulate`, its account and its process; `driving` is the
 * recording of what drives it. */
tl_status tl_emulation_open_model(const tl_twin_feed_settings *model, const char *driving, uint64_t seed,
                                  tl_emulation **emulation, tl_error *error);

size_t tl_emulation_column_count(const tl_emulation *emulation);
const char *tl_emulation_column(const tl_emulation *emulation, size_t column);

tl_status tl_emulation_next(tl_emulation *emulation, tl_emulation_row *row, bool *end, tl_error *error);

/* NULL is allowed. */
void tl_emulation_close(tl_emulation *emulation);

#endif
