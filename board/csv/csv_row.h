/* What is read of a CSV stream: which columns, and one row of them.
 *
 * Purpose: what the reader, the driver and the table below both speak of.
 * Units:   times in ns, as the time column counts them; values as in the cells.
 * Owner:   a row is placed by its owner; texts of the settings belong to the caller.
 */
#ifndef TL_BOARD_CSV_CSV_ROW_H
#define TL_BOARD_CSV_CSV_ROW_H

#include <stdbool.h>
#include <stddef.h>

#include "master/base/signal.h"
#include "master/base/simtime.h"

typedef struct tl_csv_settings {
    const char *path;
    const char *time_column;
    const char *const *columns; /* one per channel, in channel order */
    size_t column_count;
} tl_csv_settings;

/* One row. A cell that is empty leaves present false; one that is no finite number has quality
 * TL_NOT_A_NUMBER and value 0. */
typedef struct tl_csv_row {
    tl_time time; /* as in the time column */
    bool present[TL_MAX_SIGNALS];
    double values[TL_MAX_SIGNALS];
    tl_quality quality[TL_MAX_SIGNALS];
} tl_csv_row;

#endif
