/* Rows of a CSV file or FIFO, read as they arrive.
 *
 * Purpose: reads the available data without waiting, stores it, and finds cells by row number.
 * Format:  comma separated, LF or CRLF, UTF-8 with or without a byte order mark. The first line
 *          names the columns. A cell may be quoted, but must not contain quotes or line ends. A
 *          line is used only after its line end has arrived; blank lines are skipped. Times
 *          increase from row to row. The decimal separator is a point in any locale.
 * Thread:  one thread at a time.
 * Errors:  functions return false and write a sentence to `why` with the file, the line, the value
 *          found and the value expected.
 */
#ifndef TL_FMUS_CSV_ROWS_H
#define TL_FMUS_CSV_ROWS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct csv_rows csv_rows;

/* Buffer for the text of an error. */
typedef struct csv_rows_error {
    char *why;
    size_t size; /* bytes, including the terminating NUL */
} csv_rows_error;

/* Allocates a reader without a file; csv_rows_close() frees it. Returns NULL if memory is out. */
csv_rows *csv_rows_new(void);

/* Closes the file and frees the reader. NULL is not allowed. */
void csv_rows_close(csv_rows *all);

/* Selects and opens the file to read. Does nothing if file and time column are already selected;
 * otherwise drops all stored rows. */
bool csv_rows_choose(csv_rows *all, const char *file, const char *time_column, const csv_rows_error *error);

/* Reads all complete lines that have arrived; from a FIFO at most 1 MiB per call. `instant`: the
 * caller's time, stored with each new row, see csv_rows_since(). */
bool csv_rows_read(csv_rows *all, double instant, const csv_rows_error *error);

/* Returns the number of the next row to be read. The first row of the file has the number 0. */
int64_t csv_rows_end(const csv_rows *all);

/* Returns true if the row has been read and is still stored. */
bool csv_rows_has(const csv_rows *all, int64_t number);

/* Return, of a stored row, its time in s, and the `instant` of the csv_rows_read() that read it. */
double csv_rows_time(const csv_rows *all, int64_t number);
double csv_rows_since(const csv_rows *all, int64_t number);

/* Parses a cell into *value; an empty cell leaves *value unchanged. The row must be stored. */
bool csv_rows_number(const csv_rows *all, int64_t number, const char *column, double *value,
                     const csv_rows_error *error);

/* The first function returns true once the header has been read. Only then call the second one: it
 * checks that `column` occurs exactly once. */
bool csv_rows_has_header(const csv_rows *all);
bool csv_rows_check_column(const csv_rows *all, const char *column, const csv_rows_error *error);

/* Declares that rows before `number` are no longer needed; `number` is at most csv_rows_end(). Rows
 * of a FIFO are dropped if that frees enough memory; rows of a file are kept. */
void csv_rows_forget(csv_rows *all, int64_t number);

#endif
