/* Two libraries that test_own_copies copies: table counts its calls, and model calls table.
 *
 * Owner: each copy of table has its own count. Thread: one.
 */
#ifndef TL_TESTS_UNIT_FIRMWARE_FMU_TABLE_H
#define TL_TESTS_UNIT_FIRMWARE_FMU_TABLE_H

/* In table: returns the number of its calls, this one included. */
int table_count(void);

/* In model: calls table_count() and returns its result. */
int model_count(void);

#endif
