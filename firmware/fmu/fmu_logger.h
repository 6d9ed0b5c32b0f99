/* Messages of FMUs: their format, and their way to the log.
 *
 * Thread:  any.
 */
#ifndef TL_FIRMWARE_FMU_FMU_LOGGER_H
#define TL_FIRMWARE_FMU_FMU_LOGGER_H

#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>

#include "firmware/base/log.h"
#include "master/base/status.h"
#include "master/fmi/fmi2.h"

/* ---- The text of a message that an FMU hands to the logger, made without trusting it.
 *
 * Purpose: an FMI 2.0 message is a printf format with arguments. FMUs of others give pointers that lead nowhere, a %s without an
 *          argument, a %n. None of that may end the process: a text is read only as far as its memory can be read.
 * Thread:  any; takes no lock and allocates nothing.
 * Source:  FMI 2.0.4, section 2.1.5.
 */

/* A text of the FMU's as text of ours, cut to what fits; "" if it is NULL, and a word that says so if it cannot be read. */
void tl_fmu_message_copy(const char *untrusted, char *text, size_t size);

/* The message with its arguments put in, cut to what fits. A conversion that printf does not know, and %n, end the formatting: the rest is
 * copied as it is. A wide text shows as "?". */
void tl_fmu_message_format(const char *untrusted, va_list *arguments, char *text, size_t size);

/* ---- The logger that FMUs are given: their messages in the log, limited per second.
 *
 * Purpose: fmi2CallbackLogger of one loaded FMU. Nothing that the FMU passes is trusted: not the environment, which some FMUs leave
 *          NULL or make up, not the format, not the texts (fmu_logger.h).
 * Limits:  at most TL_FMU_MESSAGES_PER_SECOND lines of an FMU go into the log; those that no FMU can be told for have a limit
 *          together.
 * Owner:   the caller places a logger; it must stay where it is until tl_fmu_logger_close().
 * Thread:  open and close: the thread of the FMUs. The callback: any thread.
 */

enum { TL_FMU_MESSAGES_PER_SECOND = 20, TL_FMU_LOGGER_NAME = 80 };

/* Fields are private. */
typedef struct tl_fmu_logger {
    char name[TL_FMU_LOGGER_NAME];
    bool plain; /* messages are texts, not formats */
    tl_log_limiter limiter;
} tl_fmu_logger;

/* `name` is the model's; `generator` its generationTool, since PythonFMU's messages are no formats. */
void tl_fmu_logger_open(tl_fmu_logger *logger, const char *name, const char *generator);
void tl_fmu_logger_close(tl_fmu_logger *logger);

/* fmi2CallbackFunctions.logger; its environment is a tl_fmu_logger. */
void tl_fmu_logger_take(fmi2ComponentEnvironment environment, fmi2String instance, fmi2Status status,
                        fmi2String category, fmi2String message, ...) TL_PRINTF(5, 6);

/* A line of ours about the FMU, by the same limit: it may be said in the cycle. It begins with the instance that is called, or the file's name; the
 * text goes on after that: "changed …". */
void tl_fmu_logger_say(tl_fmu_logger *logger, tl_log_level level, const char *text);

#endif
