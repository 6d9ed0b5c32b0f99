/* Decimal numbers of CSV cells. Private to the CSV reader and driver.
 *
 * Purpose: gives the same bits as strtod() with about a quarter of its instructions, for what
 *          recordings have: up to 18 digits and a power of ten from -22 to 22. strtod() converts
 *          all other texts.
 * Thread:  any, in a locale with a decimal point (firmware/base/os.h).
 */
#ifndef TL_BOARD_CSV_CSV_NUMBER_H
#define TL_BOARD_CSV_CSV_NUMBER_H

#include <stdbool.h>

/* Converts a text that is a finite decimal number and nothing else: an optional sign, digits with
 * an optional point, an optional exponent. Returns false and sets *number to 0 for any other text,
 * also for "inf", "0x10", "" and " 1". */
bool tl_csv_number_read(const char *text, double *number);

#endif
