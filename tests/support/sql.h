/* Questions to a database, asked as anybody with SQLite would: past all code of ours.
 *
 * Errors: a statement that fails ends the test with SQLite's text.
 * Thread: each call has a connection of its own.
 */
#ifndef TL_TESTS_SUPPORT_SQL_H
#define TL_TESTS_SUPPORT_SQL_H

#include <stddef.h>
#include <stdint.h>

/* The first column of the first row; 0 or "" where there is no row or it is NULL. */
int64_t tl_sql_integer(const char *path, const char *sql);
double tl_sql_number(const char *path, const char *sql);

/* The same as text, valid until the next call in this program. */
const char *tl_sql_text(const char *path, const char *sql);

/* Any statements. */
void tl_sql_execute(const char *path, const char *sql);

#endif
