/* Ages of the plant's values at the first tick that uses them.
 *
 * Purpose: shows how fresh the values are: p50 and p99 of the time from a reading to its tick.
 * Counted: good readings of devices that the cycle uses unchanged and at once, each reading once.
 *          Not counted are values that are interpolated (key `between`), filtered (`condition`) or
 *          delayed, because they are older by intention. The configuration (config.h) adds a signal
 *          NAME@reading with the unchanged readings of NAME. These are counted instead.
 * Bins:    16 in each doubling of the age, from 16 µs to 69 s, so a percentile is at most 1/16 too
 *          large; bins of 1 µs below. Older values count as 69 s.
 * Trust:   tl_ages_percentile() neither overflows nor reads outside, whatever the structure
 *          contains.
 * Thread:  plain data; one thread at a time.
 */
#ifndef TL_FIRMWARE_REPORT_AGES_H
#define TL_FIRMWARE_REPORT_AGES_H

#include <stdint.h>

#include "firmware/config/config.h"

/* In units of 1.024 µs: 16 bins of one unit, then 16 bins for each doubling from 2⁴ to 2²⁶. */
enum { TL_AGE_BINS = 16 * (26 - 4 + 1) };

/* Histogram. The caller zeroes it at first. */
typedef struct tl_ages {
    uint64_t values;                /* number of counted readings */
    uint64_t bins[TL_AGE_BINS];     /* number of readings, by age */
    tl_time newest[TL_MAX_SIGNALS]; /* stamp of the newest counted reading, by signal */
} tl_ages;

/* Counts the new values of a sample. */
void tl_ages_add_sample(tl_ages *ages, const tl_config *config, const tl_sample *sample);

/* Returns the age in ns that `percent` (0 … 100) of the values do not exceed; 0 without values. */
tl_time tl_ages_percentile(const tl_ages *ages, unsigned percent);

enum { TL_AGES_TEXT = 96 };

/* Writes p50 and p99 for people. */
void tl_ages_write(const tl_ages *ages, char text[TL_AGES_TEXT]);

#endif
