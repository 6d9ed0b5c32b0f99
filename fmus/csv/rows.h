/* The rows of a CSV file or FIFO, as they come.
 *
 * Purpose: reads what is there without waiting, keeps it, and finds cells in it by row number.
 * Format:  comma separated, LF or CRLF, in UTF-8 with or without a byte order mark; the first line names the columns;
 *          a cell may be quoted, but a quoted one has no quotes and no line ends in it. A line counts once its line end
 *          is there; blank ones are passed over. Times rise from row to row. Numbers have a decimal point whatever the
 *          locale.
 * Owner:   from rows_open() to csv_rows_close(). Thread: one at a time.
 * Errors:  false, with a sentence in `why` that names the file, the line, what was found and what was expected.
 */
#ifndef TL_FMUS_CSV_ROWS_H
#define TL_FMUS_CSV_ROWS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct csv_rows csv_rows;

/* A text that an error is told in. */
typedef struct csv_rows_error {
    char *why;
    size_t size; /* bytes, with the terminating NUL */
} csv_rows_error;

/* Without a file yet. NULL when memory is out. */
csv_rows *csv_rows_new(void);
void csv_rows_close(csv_rows *all);

/* Makes `file` the one that is read; where it is that already, nothing. */
bool csv_rows_choose(csv_rows *all, const char *file, const char *time_column, const csv_rows_error *error);

/* Takes in what has come and is whole. `instant` is remembered for each new row, see csv_rows_since(). */
bool csv_rows_read(csv_rows *all, double instant, const csv_rows_error *error);

/* Rows are numbered from 0 at the file's first one; csv_rows_end() is the number of the next one to come. */
int64_t csv_rows_end(const csv_rows *all);

/* True where that row is there: read, and not forgotten. */
bool csv_rows_has(const csv_rows *all, int64_t number);

/* Of a row that is there: its time, s, and the `instant` at which it was read. */
double csv_rows_time(const csv_rows *all, int64_t number);
double csv_rows_since(const csv_rows *all, int64_t number);

/* The cell's number into *value; an empty cell leaves it as it is. The row must be there. */
bool csv_rows_number(const csv_rows *all, int64_t number, const char *column, double *value,
                     const csv_rows_error *error);

/* True where the columns are known and `column` is one of them. */
bool csv_rows_has_header(const csv_rows *all);
bool csv_rows_check_column(const csv_rows *all, const char *column, const csv_rows_error *error);

/* Rows before that number are not needed any more: those of a FIFO are dropped now and then; a file's are kept. */
void csv_rows_forget(csv_rows *all, int64_t number);

#endif
