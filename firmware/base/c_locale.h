/* The C locale for a thread of ours, whatever the process has.
 *
 * Purpose: an FMU, or a library that it loads, may call setlocale(): with a decimal comma every strtod() and printf() of the
 *          process would read and write other numbers from then on. A thread that has called this keeps a locale of its
 *          own: numbers with a point, English messages. Characters are UTF-8 where the system has C.UTF-8, for the scripts of
 *          FMUs that are written in Python. What an FMU computes in such a thread is the same too.
 * Use:     first thing in main() and in each thread of ours; again after every time that an FMU could have called uselocale().
 *          Costs no more than storing a pointer. The locale lives as long as the process.
 * Thread:  any; says nothing about other threads.
 */
#ifndef TL_FIRMWARE_BASE_C_LOCALE_H
#define TL_FIRMWARE_BASE_C_LOCALE_H

void tl_locale_use(void);

#endif
