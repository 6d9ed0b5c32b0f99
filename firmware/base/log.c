/* Log lines on stderr. Each line is built in one buffer and written with one call, so that lines of
 * several threads do not mix: a pipe accepts up to PIPE_BUF bytes atomically, and a terminal or a
 * socket handles one write at a time. */
#include "firmware/base/log.h"

#include <errno.h>
#include <limits.h>
#include <poll.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "firmware/base/os.h"
#include "firmware/base/text.h"

/* Returns to the start of the row and erases it. */
#define WIPE "\r\x1b[K"

enum { LINE = sizeof WIPE + TL_LOG_TEXT + TL_LOG_PREFIX + 1 }; /* with the newline */

typedef enum style { STYLE_UNKNOWN, STYLE_PLAIN, STYLE_COLOUR, STYLE_JOURNAL } style;

static int top_level = TL_LOG_NOTICE;
static int known_style = STYLE_UNKNOWN;

/* If there may be a status line, each line erases it first. There is no lock: erasing an empty row
 * costs little, and a thread that logs during a step must not wait. */
static bool has_status;

void tl_log_set_level(tl_log_level level) {
    __atomic_store_n(&top_level, (int)level, __ATOMIC_RELAXED);
}

/* JOURNAL_STREAM is "device:inode" of the socket. It is compared, because it is inherited even if
 * stderr was redirected. */
static bool is_journal(void) {
    const char *stream = getenv("JOURNAL_STREAM");
    struct stat status;
    char own[64];
    if (stream == NULL || fstat(STDERR_FILENO, &status) != 0) {
        return false;
    }
    (void)snprintf(own, sizeof own, "%llu:%llu", (unsigned long long)status.st_dev, (unsigned long long)status.st_ino);
    return strcmp(stream, own) == 0;
}

static style current_style(void) {
    int found = __atomic_load_n(&known_style, __ATOMIC_RELAXED);
    if (found == STYLE_UNKNOWN) {
        found = is_journal() ? STYLE_JOURNAL : tl_show_style_of(stderr).colour ? STYLE_COLOUR : STYLE_PLAIN;
        __atomic_store_n(&known_style, found, __ATOMIC_RELAXED);
    }
    return (style)found;
}

void tl_log_use_levels(void) {
    __atomic_store_n(&known_style, (int)STYLE_JOURNAL, __ATOMIC_RELAXED);
}

/* Accepts only levels that we use; more severe ones would be broadcast to all logged-in users. */
int tl_log_level_of(const char *line, const char **text) {
    bool has_level = line[0] == '<' && line[1] >= '0' + TL_LOG_ERROR && line[1] <= '0' + TL_LOG_DEBUG && line[2] == '>';
    *text = has_level ? line + 3 : line;
    return has_level ? line[1] - '0' : TL_LOG_FOREIGN;
}

/* Moves a cut to the start of a UTF-8 character, so that none is split. */
static size_t whole_characters(const char *text, size_t length) {
    while (length > 0 && ((unsigned char)text[length] & 0xC0U) == 0x80U) {
        length--;
    }
    return length;
}

/* Replaces ASCII control characters by spaces, and other characters that cannot be displayed by
 * "?". */
static void make_printable(char *text) {
    char *end = text;
    while (*text != '\0') {
        bool is_control = false;
        size_t length = tl_show_character(text, &is_control);
        if (is_control) {
            *end++ = (unsigned char)*text < 0x80U ? ' ' : '?';
        } else {
            memmove(end, text, length);
            end += length;
        }
        text += length;
    }
    *end = '\0';
}

/* Formats into text[TL_LOG_TEXT]: one line without a newline. */
static void format_text(char *text, const char *format, va_list arguments) TL_PRINTF(2, 0);

static void format_text(char *text, const char *format, va_list arguments) {
    static const char more[] = "…";
    int length = vsnprintf(text, TL_LOG_TEXT, format, arguments);
    if (length < 0) {
        (void)snprintf(text, TL_LOG_TEXT, "(the message cannot be formatted: %.100s)", format);
    }
    if (length >= TL_LOG_TEXT) {
        memcpy(text + whole_characters(text, TL_LOG_TEXT - sizeof more), more, sizeof more);
    }
    size_t end = strlen(text);
    while (end > 0 && (unsigned char)text[end - 1] <= ' ') {
        text[--end] = '\0';
    }
    make_printable(text);
}

void tl_log_prefix(tl_log_level level, char *prefix, size_t size) {
    static const char *const names[] = {[TL_LOG_ERROR] = "error",
                                        [TL_LOG_WARNING] = "warning",
                                        [TL_LOG_NOTICE] = "notice",
                                        [TL_LOG_INFO] = "info",
                                        [TL_LOG_DEBUG] = "debug"};
    style now = current_style();
    const char *colour = level <= TL_LOG_ERROR ? "1;31" : level == TL_LOG_WARNING ? "1;33" : "1";
    if (now == STYLE_JOURNAL) {
        (void)snprintf(prefix, size, "<%d>", (int)level);
    } else if (now == STYLE_COLOUR) {
        (void)snprintf(prefix, size, "twinlock: \x1b[%sm%s:\x1b[0m ", colour, names[level]);
    } else {
        (void)snprintf(prefix, size, "twinlock: %s: ", names[level]);
    }
}

static const char *wipe_code(void) {
    return __atomic_load_n(&has_status, __ATOMIC_SEQ_CST) ? WIPE : "";
}

/* Writes in parts of PIPE_BUF bytes: a pipe that is ready for writing accepts such a part
 * completely, so no write blocks. */
static bool write_in_parts(const char *bytes, size_t size, int patience) {
    for (size_t written = 0; written < size;) {
        struct pollfd ready = {.fd = STDERR_FILENO, .events = POLLOUT};
        size_t part = size - written < PIPE_BUF ? size - written : PIPE_BUF;
        int found = poll(&ready, 1, patience);
        if (found < 0 && errno == EINTR && patience < 0) {
            continue;
        }
        if (found != 1 || (ready.revents & POLLOUT) == 0 ||
            !tl_file_bytes_write(STDERR_FILENO, bytes + written, part)) {
            return false;
        }
        written += part;
    }
    return true;
}

/* Returns false if not all was written: without `wait`, also if stderr cannot accept it now. */
static bool write_line(tl_log_level level, const char *text, bool wait) {
    char prefix[TL_LOG_PREFIX];
    char line[LINE];
    tl_log_prefix(level, prefix, sizeof prefix);
    int length = snprintf(line, sizeof line, "%s%s%s\n", wipe_code(), prefix, text);
    return length > 0 &&
           (wait ? tl_file_bytes_write(STDERR_FILENO, line, (size_t)length) : write_in_parts(line, (size_t)length, 0));
}

static bool error_logged;
static bool errors_are_kept;
static char *kept[TL_LOG_KEPT];
static size_t kept_count; /* may exceed TL_LOG_KEPT */

static void note(int level, const char *text) {
    if (level != (int)TL_LOG_ERROR) {
        return;
    }
    __atomic_store_n(&error_logged, true, __ATOMIC_RELAXED);
    if (__atomic_load_n(&errors_are_kept, __ATOMIC_RELAXED)) {
        const size_t number = __atomic_fetch_add(&kept_count, 1, __ATOMIC_RELAXED);
        if (number < TL_LOG_KEPT) {
            kept[number] = strdup(text);
        }
    }
}

void tl_log_keep_errors(void) {
    __atomic_store_n(&errors_are_kept, true, __ATOMIC_RELAXED);
}

const char *tl_log_kept_error(size_t number) {
    return number < TL_LOG_KEPT ? kept[number] : NULL;
}

bool tl_log_has_error(void) {
    return __atomic_load_n(&error_logged, __ATOMIC_RELAXED);
}

static bool is_wanted(int level) {
    return level <= __atomic_load_n(&top_level, __ATOMIC_RELAXED);
}

void tl_log(tl_log_level level, const char *format, ...) {
    if (!is_wanted((int)level)) {
        return;
    }
    int saved = errno;
    char text[TL_LOG_TEXT];
    va_list arguments;
    va_start(arguments, format);
    format_text(text, format, arguments);
    va_end(arguments);
    (void)write_line(level, text, true);
    note((int)level, text);
    errno = saved;
}

static bool write_foreign(const char *prefix, const char *line, int patience) {
    int saved = errno;
    char whole[sizeof WIPE + TL_LOG_PREFIX + TL_LOG_PLAIN + 1];
    int length = snprintf(whole, sizeof whole, "%s%s%.*s\n", wipe_code(), prefix, (int)TL_LOG_PLAIN, line);
    bool done = write_in_parts(whole, length > 0 ? (size_t)length : 0, patience);
    errno = saved;
    return done;
}

void tl_log_plain(const char *line) {
    (void)write_foreign("", line, -1);
}

bool tl_log_foreign(int level, const char *line, int patience) {
    char prefix[TL_LOG_PREFIX];
    if (!is_wanted(level)) {
        return true;
    }
    if (level == TL_LOG_FOREIGN) { /* in a journal, an untrusted line could start with a level of its own */
        (void)snprintf(prefix, sizeof prefix, "%s", current_style() == STYLE_JOURNAL ? "<6>fmu: " : "fmu: ");
    } else {
        tl_log_prefix((tl_log_level)level, prefix, sizeof prefix);
    }
    bool done = write_foreign(prefix, line, patience);
    if (done) {
        note(level, line);
    }
    return done;
}

/* ---- The status line ---- */

/* Returns the bytes that fit into the terminal's columns, because a wrapped line cannot be redrawn.
 * Leaves two columns for the ^C that the terminal echoes. */
static size_t fitting_bytes(const char *line) {
    struct winsize size = {0};
    size_t columns = ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 3 ? size.ws_col - 3U : 77U;
    size_t end = 0;
    for (size_t shown = 0; line[end] != '\0'; end++) {
        bool begins_character = ((unsigned char)line[end] & 0xC0U) != 0x80U;
        if (begins_character && shown++ == columns) {
            break;
        }
    }
    return end;
}

/* Sets has_status before the status line is drawn, so that later lines of other threads erase it.
 */
static void draw_status(const char *line) {
    char text[TL_LOG_TEXT];
    char drawn[sizeof WIPE + TL_LOG_TEXT];
    int length = snprintf(text, sizeof text, "%s", line);
    if (length >= TL_LOG_TEXT) {
        text[whole_characters(text, TL_LOG_TEXT - 2)] = '\0';
    }
    make_printable(text);
    __atomic_store_n(&has_status, true, __ATOMIC_SEQ_CST);
    length = snprintf(drawn, sizeof drawn, WIPE "%.*s", (int)fitting_bytes(text), text);
    (void)tl_file_bytes_write(STDERR_FILENO, drawn, (size_t)length);
}

void tl_log_status(const char *line) {
    int saved = errno;
    if (line == NULL) {
        if (__atomic_load_n(&has_status, __ATOMIC_SEQ_CST)) {
            (void)tl_file_bytes_write(STDERR_FILENO, WIPE, sizeof WIPE - 1);
        }
        __atomic_store_n(&has_status, false, __ATOMIC_SEQ_CST);
    } else if (isatty(STDERR_FILENO) == 1) {
        draw_status(line);
    }
    errno = saved;
}

/* ---- Limits ---- */

static void log_dropped(tl_log_limiter *limiter, bool wait) {
    uint32_t dropped = __atomic_exchange_n(&limiter->dropped, 0, __ATOMIC_RELAXED);
    if (dropped > 0) {
        char text[128];
        (void)snprintf(text, sizeof text, "%u messages dropped: their source logs more than %u per second",
                       (unsigned)dropped, (unsigned)limiter->per_second);
        if (!write_line(TL_LOG_WARNING, text, wait)) {
            (void)__atomic_add_fetch(&limiter->dropped, dropped, __ATOMIC_RELAXED);
        }
    }
}

/* Returns whether the limiter permits a message. A few more may pass if two threads enter a new
 * second at once. */
static bool may_pass(tl_log_limiter *limiter) {
    struct timespec now = {0};
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    uint32_t second = (uint32_t)now.tv_sec;
    uint32_t last = __atomic_load_n(&limiter->second, __ATOMIC_RELAXED);
    if (last != second &&
        __atomic_compare_exchange_n(&limiter->second, &last, second, false, __ATOMIC_RELAXED, __ATOMIC_RELAXED)) {
        __atomic_store_n(&limiter->in_second, 0, __ATOMIC_RELAXED);
        log_dropped(limiter, false);
    }
    return __atomic_fetch_add(&limiter->in_second, 1, __ATOMIC_RELAXED) < limiter->per_second;
}

void tl_log_limited(tl_log_limiter *limiter, tl_log_level level, const char *format, ...) {
    if (!is_wanted((int)level)) {
        return;
    }
    int saved = errno;
    bool passed = may_pass(limiter);
    if (passed) {
        char text[TL_LOG_TEXT];
        va_list arguments;
        va_start(arguments, format);
        format_text(text, format, arguments);
        va_end(arguments);
        passed = write_line(level, text, false);
    }
    if (!passed) {
        (void)__atomic_add_fetch(&limiter->dropped, 1, __ATOMIC_RELAXED);
    }
    errno = saved;
}

void tl_log_limiter_end(tl_log_limiter *limiter) {
    int saved = errno;
    log_dropped(limiter, true);
    errno = saved;
}
