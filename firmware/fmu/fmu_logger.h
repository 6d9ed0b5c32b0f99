/* Messages of FMUs: formatting, and forwarding to the log.
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

/* ---- Formats the message that an FMU passes to the logger, without trusting it.
 *
 * Purpose: an FMI 2.0 message is a printf format with arguments. Faulty FMUs pass invalid pointers,
 *          a %s without an argument, or a %n. None of these may crash the process: a text is read
 *          only as far as its memory is readable.
 * Trust:   format and arguments are untrusted.
 * Thread:  any; takes no lock and allocates no memory.
 * Source:  FMI 2.0.4, section 2.1.5.
 */

/* Copies a text of the FMU, cut to `size` bytes with the terminating 0. Yields "" if `untrusted` is
 * NULL, and "(unreadable)" if its memory cannot be read. */
void tl_fmu_message_copy(const char *untrusted, char *text, size_t size);

/* Formats the message `untrusted` with its arguments, cut to `size` bytes. Formatting ends at %n
 * and at any conversion that printf does not know; the remaining text is copied unchanged. A wide
 * string becomes "?". */
void tl_fmu_message_format(const char *untrusted, va_list *arguments, char *text, size_t size);

/* ---- The logger for FMUs: forwards their messages to the log, limited per second.
 *
 * Purpose: implements fmi2CallbackLogger of one loaded FMU. All arguments are untrusted: the
 *          environment, for which some FMUs pass NULL or an invalid pointer, the format, and the
 *          texts.
 * Limits:  at most TL_FMU_MESSAGES_PER_SECOND lines per second and FMU. Messages that belong to no
 *          known FMU share one further limit. At most 128 open loggers are known.
 * Owner:   the caller provides the memory of a logger and must not move it before
 *          tl_fmu_logger_close().
 * Thread:  open and close: the thread that calls the FMUs. The callback: any thread.
 */

/* The last two: bytes of a text with its terminating 0. */
enum { TL_FMU_MESSAGES_PER_SECOND = 20, TL_FMU_LOGGER_NAME = 80, TL_FMU_LOGGER_LAST = 200 };

/* Fields are private, except `last`. */
typedef struct tl_fmu_logger {
    char name[TL_FMU_LOGGER_NAME];
    bool plain; /* messages are texts, not formats */
    tl_log_limiter limiter;
    bool is_noting;                /* a thread writes `last` */
    char last[TL_FMU_LOGGER_LAST]; /* newest message with fmi2Warning or worse, cut to fit; "": none */
} tl_fmu_logger;

/* Opens and closes a logger. `name`: name of the model. `generator`: its generationTool; messages
 * of PythonFMU are plain texts, not formats. */
void tl_fmu_logger_open(tl_fmu_logger *logger, const char *name, const char *generator);
void tl_fmu_logger_close(tl_fmu_logger *logger);

/* The callback fmi2CallbackFunctions.logger. `environment` should be a tl_fmu_logger; any other
 * value counts as an unknown FMU. Levels: debug for fmi2OK and fmi2Pending, error for fmi2Error and
 * fmi2Fatal, else warning. */
void tl_fmu_logger_take(fmi2ComponentEnvironment environment, fmi2String instance, fmi2Status status,
                        fmi2String category, fmi2String message, ...) TL_PRINTF(5, 6);

/* Logs a line of twinlock itself about the FMU. The same limit per second applies, because a cause
 * may recur in every cycle. The line begins with the name of the instance that is called now, or
 * else with the name of the FMU. `text` follows the name: "changed …". */
void tl_fmu_logger_log(tl_fmu_logger *logger, tl_log_level level, const char *text);

#endif
