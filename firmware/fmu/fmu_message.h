/* The text of a message that an FMU hands to the logger, made without trusting it.
 *
 * Purpose: an FMI 2.0 message is a printf format with arguments. FMUs of others give pointers that lead nowhere, a %s without an
 *          argument, a %n. None of that may end the process: a text is read only as far as its memory can be read.
 * Thread:  any; takes no lock and allocates nothing.
 * Source:  FMI 2.0.4, section 2.1.5.
 */
#ifndef TL_FIRMWARE_FMU_FMU_MESSAGE_H
#define TL_FIRMWARE_FMU_FMU_MESSAGE_H

#include <stdarg.h>
#include <stddef.h>

/* A text of the FMU's as text of ours, cut to what fits; "" if it is NULL, and a word that says so if it cannot be read. */
void tl_fmu_message_copy(const char *untrusted, char *text, size_t size);

/* The message with its arguments put in, cut to what fits. A conversion that printf does not know ends the formatting: the rest is copied
 * as it is. Wide characters show as "?". A message with a %n is taken for a text. */
void tl_fmu_message_format(const char *untrusted, va_list *arguments, char *text, size_t size);

#endif
