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

/* ---- Random numbers for noise: with the same seed the same numbers on every machine.
 *
 * Purpose: measurement noise and message times of an emulated plant. C's rand() is not used,
 *          because its numbers depend on the C library.
 * Method:  SplitMix64 for uniform bits, Marsaglia's polar method for the normal distribution.
 * Thread:  one thread per generator.
 */

/* Generator. Its state is the seed at first; any value is valid. */
typedef struct tl_random {
    uint64_t state;
} tl_random;

/* Returns a uniform number in [0, 1). */
double tl_random_uniform(tl_random *noise);

/* Returns a normally distributed number with mean 0 and standard deviation 1. */
double tl_random_normal(tl_random *noise);

/* ---- Emulated plant: rows of values over time, read from a recording or simulated by FMUs.
 *
 * Purpose: supplies the rows that `twinlock plant` serves. With FMUs, the configuration's
 *          co-simulation runs without corrections. Each row has the columns of `emulate`, with
 *          noise added.
 * Time:    the first row has time 0. Rows from a recording keep the recorded intervals. With FMUs,
 *          rows come at random message times, or every T_S if `emulate` defines none. A row has the
 *          values of the newest step at or before its time.
 * Thread:  one thread.
 */

typedef struct tl_emulation tl_emulation;

typedef struct tl_emulation_row {
    tl_time time;                  /* ns since the first row */
    double values[TL_MAX_SIGNALS]; /* by column, in the signal's unit */
    bool present[TL_MAX_SIGNALS];  /* by column; false: the recording's cell is empty or no number */
} tl_emulation_row;

/* Opens the rows of a CSV recording, with one column per signal of `config`, which must outlive the
 * emulation. Errors: those of tl_csv_open(); TL_TRY_AGAIN if memory is out. */
tl_status tl_emulation_open_recording(const char *path, const tl_config *config, tl_emulation **emulation,
                                      tl_error *error);

/* Opens the rows that a built twin simulates in place of the plant. In `model`, the caller sets
 * config (with `emulate`), account and child, which must outlive the emulation. `driving`: path of
 * the recording that supplies the inputs. `seed`: of the random noise and message times. Errors:
 * those of tl_recording_open() and tl_twin_feed_open(); TL_TRY_AGAIN if memory is out. */
tl_status tl_emulation_open_model(const tl_twin_feed_settings *model, const char *driving, uint64_t seed,
                                  tl_emulation **emulation, tl_error *error);

/* Return the number and the names of the columns of a row. The names are valid as long as the
 * configuration is. */
size_t tl_emulation_column_count(const tl_emulation *emulation);
const char *tl_emulation_column(const tl_emulation *emulation, size_t column);

/* Reads or simulates the next row. Sets *end to true if there is no further row. Errors: those of
 * the recording or of the FMUs. */
tl_status tl_emulation_next(tl_emulation *emulation, tl_emulation_row *row, bool *end, tl_error *error);

/* Closes the emulation and its recording. NULL is allowed. */
void tl_emulation_close(tl_emulation *emulation);

#endif
