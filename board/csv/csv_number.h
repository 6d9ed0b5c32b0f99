/* Decimal numbers of CSV cells. Private to the CSV reader and driver.
 *
 * Purpose: gives the same double as strtod() with about a quarter of its instructions. This holds
 *          for digits·10^power with power from -22 to 22 and digits up to 2^53; with a negative
 *          power for up to 18 digits. strtod() converts all other texts.
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
