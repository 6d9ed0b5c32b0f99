/* Of the libraries that test_own_copies makes copies of: one that counts, and one that asks it.
 *
 * Owner: the count is the library's, so of each copy of it. Thread: one.
 */
#ifndef TL_TESTS_UNIT_FIRMWARE_FMU_TABLE_H
#define TL_TESTS_UNIT_FIRMWARE_FMU_TABLE_H

/* How often it was called. */
int table_count(void);

/* The same, by way of the library that needs it. */
int model_count(void);

#endif
