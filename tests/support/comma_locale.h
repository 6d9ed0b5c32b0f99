/* Sets a locale with a decimal comma in this process, as an FMU can do by setlocale().
 *
 * Purpose: generates the locale de_DE.UTF-8 from Debian's package `locales`, because a machine may
 *          lack it, and sets it. setlocale(LC_ALL, "C") reverts it.
 * Errors:  false: the package is missing (script/bootstrap), or /tmp cannot be used.
 * Thread:  call it while the process has only one thread.
 */
#ifndef TL_TESTS_SUPPORT_COMMA_LOCALE_H
#define TL_TESTS_SUPPORT_COMMA_LOCALE_H

#include <stdbool.h>

/* From now on, threads without a locale of their own print 1.5 as "1,5". */
bool tl_comma_locale_set(void);

#endif
