/* The log: one line per message on stderr, in journald's style.
 *
 * Purpose: "<4>text" where stderr goes to the journal (JOURNAL_STREAM names it), else "twinlock: warning: text"
 *          (coloured on a terminal, unless NO_COLOR is set). Whole lines only, also from many threads; control
 *          characters become spaces, others that cannot be shown (text.h) "?".
 * Limits:  a line holds TL_LOG_TEXT bytes, what exceeds is cut and marked "…". tl_log_limited() drops what exceeds
 *          `per_second` per limiter, and what stderr cannot take at once; it says how many with the limiter's next
 *          message in a later second, or when the limiter ends.
 * Status:  a line on a terminal that is drawn anew in its place; every other line wipes it first, in the same write. One that another thread
 *          is just about to write when the first status is drawn may stand behind it, once.
 * Thread:  what writes may block on stderr: any thread but the cycle's. tl_log_limited() takes no lock and does not
 *          wait for a reader of stderr, so an FMU may come here from within a step.
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

/* Messages above this level are dropped. Default TL_LOG_NOTICE. */
void tl_log_set_level(tl_log_level level);

/* From now on every line begins with its level, as for a journal: for a process whose log another one reads (relay.h). */
void tl_log_use_levels(void);

void tl_log(tl_log_level level, const char *format, ...) TL_PRINTF(2, 3);

/* A foreign line as it is, of at most TL_LOG_PLAIN bytes and without control characters (relay.h); what exceeds is cut. */
void tl_log_plain(const char *line);

/* A line that another process asks to log, as tl_log_plain() demands it: of a tl_log_level, or TL_LOG_FOREIGN: marked as an FMU's. Waits at most
 * `patience` ms for each part that stderr is to take. False: it takes nothing; the line, or its rest, is left out. */
bool tl_log_foreign(int level, const char *line, int patience);

/* Whether an error was logged, of this process or of another one for which it logs. Any thread. */
bool tl_log_has_said_error(void);

/* Of a line of a process that uses levels: its level, and *text is what follows. Any other is TL_LOG_FOREIGN, and all of it is the text. */
int tl_log_level_of(const char *line, const char **text);

/* If stderr is a terminal: `line` is the status line from now on, as far as the terminal has columns and TL_LOG_TEXT bytes reach. NULL: there is
 * none any more. */
void tl_log_status(const char *line);

/* What a line of this level begins with, of at most TL_LOG_PREFIX bytes: for who cannot call tl_log() when it has something to say. */
void tl_log_prefix(tl_log_level level, char *prefix, size_t size);

/* Begins as TL_LOG_LIMITER(). Fields are private. */
typedef struct tl_log_limiter {
    uint32_t per_second;
    uint32_t second;
    uint32_t in_second;
    uint32_t dropped;
} tl_log_limiter;

/* What a limiter of so many messages a second is initialised with. */
#define TL_LOG_LIMITER(messages)                                                                                       \
    { .per_second = (messages) }

/* May be called from several threads with the same limiter. */
void tl_log_limited(tl_log_limiter *limiter, tl_log_level level, const char *format, ...) TL_PRINTF(3, 4);

/* Says how many were dropped, where that was not yet said. */
void tl_log_limiter_end(tl_log_limiter *limiter);

#endif
