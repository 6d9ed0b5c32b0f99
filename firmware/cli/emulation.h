/* Emulated plant: rows of values from a recording, or from a simulation with added noise.
 *
 * Thread:  one thread.
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
 * Purpose: measurement noise and message times of an emulated plant. C's rand() is not used because
 *          it differs between libraries.
 * Method:  SplitMix64 for uniform bits, Marsaglia's polar method for the normal distribution.
 * Thread:  one thread per generator.
 */

/* State of a generator. Any value is a valid seed. */
typedef struct tl_noise {
    uint64_t state;
} tl_noise;

/* Returns a uniform number in [0, 1). */
double tl_noise_uniform(tl_noise *noise);

/* Returns a normally distributed number with mean 0 and standard deviation 1. */
double tl_noise_normal(tl_noise *noise);

/* ---- Emulated plant: rows of values over time, read from a recording or simulated by FMUs.
 *
 * Purpose: the rows that `twinlock plant` serves. With FMUs, the configuration's co-simulation runs
 *          free. Its `emulate` columns are read at random message times, with seeded noise added.
 * Time:    rows start at time 0. A row holds the plant's values at its time: those of the newest
 *          step at or before it.
 * Thread:  one thread.
 */

typedef struct tl_emulation tl_emulation;

typedef struct tl_emulation_row {
    tl_time time;
    double values[TL_MAX_SIGNALS];
    bool present[TL_MAX_SIGNALS];
} tl_emulation_row;

/* Opens the rows of a CSV recording, with one column per signal of `config`. Errors: those of
 * tl_csv_open(), or TL_TRY_AGAIN if memory is out. */
tl_status tl_emulation_open_recording(const char *path, const tl_config *config, tl_emulation **emulation,
                                      tl_error *error);

/* Opens the rows that a built twin simulates as the plant. `model` has the configuration (with
 * `emulate`), the account and the process of the twin. `driving`: path of the recording that
 * supplies the inputs. `seed`: of the noise. */
tl_status tl_emulation_open_model(const tl_twin_feed_settings *model, const char *driving, uint64_t seed,
                                  tl_emulation **emulation, tl_error *error);

/* Number and names of the columns of a row. The names are valid as long as the configuration is. */
size_t tl_emulation_column_count(const tl_emulation *emulation);
const char *tl_emulation_column(const tl_emulation *emulation, size_t column);

/* Reads or simulates the next row. *end is true if there is none. Errors: those of the recording or
 * of the FMUs. */
tl_status tl_emulation_next(tl_emulation *emulation, tl_emulation_row *row, bool *end, tl_error *error);

/* Closes the emulation and its recording. NULL is allowed. */
void tl_emulation_close(tl_emulation *emulation);

#endif
