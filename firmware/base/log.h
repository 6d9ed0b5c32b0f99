/* Log: one line per message on stderr, in journald's style.
 *
 * Purpose: writes "<4>text" if stderr goes to the journal (JOURNAL_STREAM names it), else
 *          "twinlock: warning: text" (coloured on a terminal, unless NO_COLOR is set). Lines of
 *          several threads do not mix. ASCII control characters become spaces; other characters
 *          that cannot be displayed (text.h) become "?".
 * Limits:  a text has at most TL_LOG_TEXT − 1 bytes; a longer one is truncated and ends in "…".
 *          tl_log_limited() drops messages beyond `per_second` of a limiter, and those that stderr
 *          cannot accept at once. The number of dropped messages is logged before the limiter's
 *          next message in a later second, or by tl_log_limiter_end().
 * Status:  on a terminal, a status line is redrawn in the same row. Every log line first erases the
 *          status line, in the same write. Exception: if another thread logs while the first status
 *          line is drawn, the log line may follow in the same row, once.
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

/* Most errors that are kept, see tl_log_keep_errors(). */
enum { TL_LOG_KEPT = 256 };

/* Bytes: of a message with its NUL, of a prefix with its NUL, of a plain or relayed line. */
enum { TL_LOG_TEXT = 1024, TL_LOG_PREFIX = 64, TL_LOG_PLAIN = 16 * 1024 };

/* Levels with the numbers of syslog. */
typedef enum tl_log_level {
    TL_LOG_ERROR = 3,
    TL_LOG_WARNING = 4,
    TL_LOG_NOTICE = 5,
    TL_LOG_INFO = 6,
    TL_LOG_DEBUG = 7
} tl_log_level;

/* Instead of a level, for a line without one, for example of an FMU. Such a line is always logged.
 */
enum { TL_LOG_FOREIGN = -1 };

/* From now on drops messages with a higher number than `level`. Default: TL_LOG_NOTICE. */
void tl_log_set_level(tl_log_level level);

/* From now on each line starts with its level, as for the journal: "<4>text". So another process
 * can forward the line with this level (relay.h, tl_log_level_of()). */
void tl_log_use_levels(void);

/* Logs a message; `format` as for printf(). May wait for stderr. Does not change errno. */
void tl_log(tl_log_level level, const char *format, ...) TL_PRINTF(2, 3);

/* Logs a line without a prefix, whatever tl_log_set_level() has set. The line must have no control
 * characters: clean it first (tl_clean_text()). The line is truncated to TL_LOG_PLAIN bytes. */
void tl_log_plain(const char *line);

/* Logs a line of another process, clean as for tl_log_plain(). `level`: a tl_log_level, or
 * TL_LOG_FOREIGN for a line of an FMU, which gets the prefix "fmu: ". Waits at most `patience` ms
 * for each PIPE_BUF bytes of the line; -1: no limit. Returns false if stderr did not accept the
 * whole line in time; then the rest is dropped. */
bool tl_log_foreign(int level, const char *line, int patience);

/* Returns true if tl_log() or tl_log_foreign() has logged an error in this process. Errors by
 * tl_log_limited() do not count. Any thread. */
bool tl_log_has_error(void);

/* From now on also keeps the texts of the first TL_LOG_KEPT errors that tl_log_has_error() counts.
 */
void tl_log_keep_errors(void);

/* Returns a kept text by its number, from 0; NULL after the last one. Call it while no other thread
 * logs. The text is valid until the process ends. */
const char *tl_log_kept_error(size_t number);

/* Parses a line of a process that has called tl_log_use_levels(). Returns its level and sets *text
 * to the rest of the line. If the line has no level of ours, returns TL_LOG_FOREIGN and sets *text
 * to the whole line. */
int tl_log_level_of(const char *line, const char **text);

/* Sets the status line if stderr is a terminal; NULL removes it. The line is truncated to the
 * terminal's columns and TL_LOG_TEXT bytes. */
void tl_log_status(const char *line);

/* Writes the prefix of this level to `prefix`, which has `size` bytes; TL_LOG_PREFIX is enough. For
 * code that will write a line without tl_log(), such as a signal handler. */
void tl_log_prefix(tl_log_level level, char *prefix, size_t size);

/* Limits the messages of one source per second. Initialise it with TL_LOG_LIMITER(). Fields are
 * private. */
typedef struct tl_log_limiter {
    uint32_t per_second; /* maximum number of messages in one second */
    uint32_t second;     /* the present second */
    uint32_t in_second;  /* messages in it, dropped ones included */
    uint32_t dropped;    /* dropped messages whose number was not logged yet */
} tl_log_limiter;

/* Initialiser of a limiter: this many messages per second. */
#define TL_LOG_LIMITER(messages)                                                                                       \
    { .per_second = (messages) }

/* Logs a message within the limiter's rate, or drops it. Never waits. Several threads may use the
 * same limiter. */
void tl_log_limited(tl_log_limiter *limiter, tl_log_level level, const char *format, ...) TL_PRINTF(3, 4);

/* Logs the number of dropped messages that was not logged yet. May wait for stderr. */
void tl_log_limiter_end(tl_log_limiter *limiter);

#endif
