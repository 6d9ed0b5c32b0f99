/* A process whose numbers have a decimal comma, as an FMU can make of it by setlocale().
 *
 * Purpose: makes the locale de_DE.UTF-8 out of Debian's package `locales`, since a machine need not have it, and sets it.
 *          setlocale(LC_ALL, "C") puts things back.
 * Errors:  false; then the package is missing (script/bootstrap), or /tmp cannot be used.
 * Thread:  before there is another one.
 */
#ifndef TL_TESTS_SUPPORT_COMMA_LOCALE_H
#define TL_TESTS_SUPPORT_COMMA_LOCALE_H

#include <stdbool.h>

/* Threads without a locale of their own write 1,5 from now on. */
bool tl_comma_locale_set(void);

#endif
