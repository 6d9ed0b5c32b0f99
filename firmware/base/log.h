/* Log: one line per message on stderr, in journald's style.
 *
 * Purpose: writes "<4>text" if stderr goes to the journal (JOURNAL_STREAM names it), else
 *          "twinlock: warning: text" (coloured on a terminal, unless NO_COLOR is set). Lines of
 *          several threads do not mix. ASCII control characters become spaces; other characters
 *          that cannot be displayed (text.h) become "?".
 * Limits:  a line has at most TL_LOG_TEXT bytes; a longer one is truncated and ends in "…".
 *          tl_log_limited() drops messages above `per_second` per limiter, and those that stderr
 *          cannot accept at once. It logs their number with the limiter's next message in a later
 *          second, or when the limiter ends.
 * Status:  a status line on a terminal is redrawn in the same row. Each other line erases it first,
 *          in the same write. A line of another thread at the time of the first status line may
 *          follow it in the same row, once.
 * Thread:  functions that write may block on stderr, so the real-time cycle must not call them.
 *          tl_log_limited() takes no lock and does not wait for stderr, so an FMU may call it
 *          during a step.
 */
#ifndef TL_FIRMWARE_BASE_LOG_H
#define TL_FIRMWARE_BASE_LOG_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/status.h"

enum { TL_LOG_TEXT = 1024, TL_LOG_PREFIX = 64, TL_LOG_PLAIN = 16 * 1024 };

typedef enum tl_log_level {
    TL_LOG_ERROR = 3,
    TL_LOG_WARNING = 4,
    TL_LOG_NOTICE = 5,
    TL_LOG_INFO = 6,
    TL_LOG_DEBUG = 7
} tl_log_level;

enum { TL_LOG_FOREIGN = -1 };

/* Drops messages above this level. Default: TL_LOG_NOTICE. */
void tl_log_set_level(tl_log_level level);

/* From now on each line starts with its level as for a journal, so that another process can relay
 * it (relay.h). */
void tl_log_use_levels(void);

void tl_log(tl_log_level level, const char *format, ...) TL_PRINTF(2, 3);

/* Logs a line without a prefix. It must have no control characters (relay.h); at most TL_LOG_PLAIN
 * bytes, else it is truncated. */
void tl_log_plain(const char *line);

/* Logs a line of another process, with the same conditions as tl_log_plain(). `level`: a
 * tl_log_level, or TL_LOG_FOREIGN to mark it as an FMU's. Waits at most `patience` ms for each part
 * of the line (-1: no limit). Returns false if stderr did not accept all of it in time; the rest is
 * dropped. */
bool tl_log_foreign(int level, const char *line, int patience);

/* Returns whether an error was logged, by this process or by another one that it logs for. Any
 * thread. */
bool tl_log_has_error(void);

/* Parses a line of a process that uses levels: returns its level and sets *text to the rest. For
 * another line returns TL_LOG_FOREIGN and sets *text to the whole line. */
int tl_log_level_of(const char *line, const char **text);

/* Sets the status line if stderr is a terminal. It is truncated to the terminal's columns and
 * TL_LOG_TEXT bytes. NULL removes it. */
void tl_log_status(const char *line);

/* Writes the prefix of this level, at most TL_LOG_PREFIX bytes, for code that cannot call tl_log()
 * later, such as signal handlers. */
void tl_log_prefix(tl_log_level level, char *prefix, size_t size);

/* Initialise it with TL_LOG_LIMITER(). Fields are private. */
typedef struct tl_log_limiter {
    uint32_t per_second;
    uint32_t second;
    uint32_t in_second;
    uint32_t dropped;
} tl_log_limiter;

/* Initialiser of a limiter: this many messages per second. */
#define TL_LOG_LIMITER(messages)                                                                                       \
    { .per_second = (messages) }

/* Several threads may use the same limiter. */
void tl_log_limited(tl_log_limiter *limiter, tl_log_level level, const char *format, ...) TL_PRINTF(3, 4);

/* Logs how many messages were dropped, unless that was already logged. */
void tl_log_limiter_end(tl_log_limiter *limiter);

#endif
