/* Queries a database with SQLite alone, without code of the product.
 *
 * Errors: a statement that fails ends the test with SQLite's message.
 * Thread: any; each call opens its own connection.
 */
#ifndef TL_TESTS_SUPPORT_SQL_H
#define TL_TESTS_SUPPORT_SQL_H

#include <stddef.h>
#include <stdint.h>

/* Return the first column of the first row; 0 or "" if there is no row or the value is NULL. */
int64_t tl_sql_integer(const char *path, const char *sql);
double tl_sql_number(const char *path, const char *sql);

/* The text is valid until the next call. */
const char *tl_sql_text(const char *path, const char *sql);

/* Counts the events of this source whose text has all parts, see message.h. */
int64_t tl_sql_count_events(const char *path, const char *source, const char *parts);

/* Executes one or more statements. */
void tl_sql_execute(const char *path, const char *sql);

#endif
