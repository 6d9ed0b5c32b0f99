/* Times of CSV rows: numbers in s, ms, µs or ns, and dates.
 *
 * Purpose: people export recordings with Unix times or dates. The first row determines the form;
 *          all other rows must have the same.
 * Thread:  one per clock. Never allocates.
 */
#ifndef TL_BOARD_CSV_CSV_TIME_H
#define TL_BOARD_CSV_CSV_TIME_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/simtime.h"

typedef enum tl_csv_time_form {
    TL_CSV_TIME_UNKNOWN, /* no row yet */
    TL_CSV_TIME_NUMBER,
    TL_CSV_TIME_DATE,     /* with its distance from UTC */
    TL_CSV_TIME_ZONELESS, /* a date that names no zone: taken as UTC */
} tl_csv_time_form;

/* How the times of a file are written. Initialise it with zeros. */
typedef struct tl_csv_clock {
    tl_csv_time_form form;
    int64_t per_second; /* of numbers: 1, 1000, 1000000 or 1000000000 */
    bool is_guessed;    /* not seconds, and there was no row of units */
} tl_csv_clock;

/* Reads a time; the first one sets *clock. Numbers are seconds, except if the first one is a Unix
 * time of the years 2015 to 2039 in ms, µs or ns. (Such a number may also count from a start: the
 * caller checks the distances.) Dates are ISO 8601 (2026-11-30T06:44:34.5+01:00) or 30.11.2026
 * 06:44:34; a space may stand for the T, a comma for the point; seconds and zone may be missing:
 * UTC. *time is in ns since the zero of the numbers, or since 1970. Returns false if the text is no
 * time, has another form than the first one, or is beyond ±4.6e9 s: the distance of two such times
 * fits tl_time. */
bool tl_csv_time_read(tl_csv_clock *clock, const char *text, tl_time *time);

/* True if the text is the unit of a time column, as in a second header row: s, sec, seconds, ms,
 * us, µs or ns, perhaps in brackets. Sets *clock; allowed before the first time. */
bool tl_csv_time_read_unit(tl_csv_clock *clock, const char *text);

#endif
