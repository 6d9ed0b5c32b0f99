/* Log lines on stderr. A line is put together in one buffer and written at once, so that lines of several threads do
 * not mix: a write of up to PIPE_BUF bytes is whole on a pipe, and a terminal or a socket takes one write at a time. */
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

/* To the beginning of the line, and what stands there is gone. */
#define WIPE "\r\x1b[K"

enum { LINE = sizeof WIPE + TL_LOG_TEXT + TL_LOG_PREFIX + 1 }; /* with the newline */

typedef enum style { STYLE_UNKNOWN, STYLE_PLAIN, STYLE_COLOUR, STYLE_JOURNAL } style;

static int top_level = TL_LOG_NOTICE;
static int known_style = STYLE_UNKNOWN;

/* A status line may stand on the terminal, so each line begins by wiping it. No lock says whether it does: to wipe an empty line is cheap, and
 * who logs from within a step may not wait. */
static bool has_status;

void tl_log_set_level(tl_log_level level) {
    __atomic_store_n(&top_level, (int)level, __ATOMIC_RELAXED);
}

/* JOURNAL_STREAM is "device:inode" of the socket; it is inherited also where stderr was redirected since. */
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

/* Nothing of ours has a level that shakes up all who are logged in. */
int tl_log_level_of(const char *line, const char **text) {
    bool has_level = line[0] == '<' && line[1] >= '0' + TL_LOG_ERROR && line[1] <= '0' + TL_LOG_DEBUG && line[2] == '>';
    *text = has_level ? line + 3 : line;
    return has_level ? line[1] - '0' : TL_LOG_FOREIGN;
}

/* Cuts before the first byte of a UTF-8 character that would not be whole. */
static size_t whole_characters(const char *text, size_t length) {
    while (length > 0 && ((unsigned char)text[length] & 0xC0U) == 0x80U) {
        length--;
    }
    return length;
}

/* Control characters of ASCII become spaces, what else cannot be shown becomes "?". */
static void make_harmless(char *text) {
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

/* Formats into text[TL_LOG_TEXT]; one line, without a newline. */
static void format_text(char *text, const char *format, va_list arguments) TL_PRINTF(2, 0);

static void format_text(char *text, const char *format, va_list arguments) {
    static const char more[] = "…";
    int length = vsnprintf(text, TL_LOG_TEXT, format, arguments);
    if (length < 0) {
        (void)snprintf(text, TL_LOG_TEXT, "(a message that cannot be formatted: %.100s)", format);
    }
    if (length >= TL_LOG_TEXT) {
        memcpy(text + whole_characters(text, TL_LOG_TEXT - sizeof more), more, sizeof more);
    }
    size_t end = strlen(text);
    while (end > 0 && (unsigned char)text[end - 1] <= ' ') {
        text[--end] = '\0';
    }
    make_harmless(text);
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

static const char *wipe(void) {
    return __atomic_load_n(&has_status, __ATOMIC_SEQ_CST) ? WIPE : "";
}

/* What a pipe takes at once is written at once, if it takes anything: then no write waits. */
static bool write_patiently(const char *bytes, size_t size, int patience) {
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

/* false where `wait` is not wanted and stderr takes nothing now. */
static bool write_line(tl_log_level level, const char *text, bool wait) {
    char prefix[TL_LOG_PREFIX];
    char line[LINE];
    tl_log_prefix(level, prefix, sizeof prefix);
    int length = snprintf(line, sizeof line, "%s%s%s\n", wipe(), prefix, text);
    return length > 0 &&
           (wait ? tl_file_bytes_write(STDERR_FILENO, line, (size_t)length) : write_patiently(line, (size_t)length, 0));
}

static bool error_said;

static void note(int level) {
    if (level == (int)TL_LOG_ERROR) {
        __atomic_store_n(&error_said, true, __ATOMIC_RELAXED);
    }
}

bool tl_log_has_said_error(void) {
    return __atomic_load_n(&error_said, __ATOMIC_RELAXED);
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
    note((int)level);
    errno = saved;
}

static bool write_foreign(const char *prefix, const char *line, int patience) {
    int saved = errno;
    char whole[sizeof WIPE + TL_LOG_PREFIX + TL_LOG_PLAIN + 1];
    int length = snprintf(whole, sizeof whole, "%s%s%.*s\n", wipe(), prefix, (int)TL_LOG_PLAIN, line);
    bool done = write_patiently(whole, length > 0 ? (size_t)length : 0, patience);
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
    if (level == TL_LOG_FOREIGN) { /* in a journal a line without a level of its own could begin with one */
        (void)snprintf(prefix, sizeof prefix, "%s", current_style() == STYLE_JOURNAL ? "<6>fmu: " : "fmu: ");
    } else {
        tl_log_prefix((tl_log_level)level, prefix, sizeof prefix);
    }
    bool done = write_foreign(prefix, line, patience);
    if (done) {
        note(level);
    }
    return done;
}

/* ---- The status line ---- */

/* Bytes that the terminal has columns for: a line that wraps cannot be redrawn. Two columns are left for the ^C that the terminal itself
 * writes behind it. */
static size_t fitting(const char *line) {
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

/* Said before it is drawn, so that no line of another thread takes it for absent afterwards. */
static void draw(const char *line) {
    char text[TL_LOG_TEXT];
    char drawn[sizeof WIPE + TL_LOG_TEXT];
    int length = snprintf(text, sizeof text, "%s", line);
    if (length >= TL_LOG_TEXT) {
        text[whole_characters(text, TL_LOG_TEXT - 2)] = '\0';
    }
    make_harmless(text);
    __atomic_store_n(&has_status, true, __ATOMIC_SEQ_CST);
    length = snprintf(drawn, sizeof drawn, WIPE "%.*s", (int)fitting(text), text);
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
        draw(line);
    }
    errno = saved;
}

/* ---- Limits ---- */

static void say_dropped(tl_log_limiter *limiter, bool wait) {
    uint32_t dropped = __atomic_exchange_n(&limiter->dropped, 0, __ATOMIC_RELAXED);
    if (dropped > 0) {
        char text[128];
        (void)snprintf(text, sizeof text, "%u messages of the same source were dropped (limit: %u per second)",
                       (unsigned)dropped, (unsigned)limiter->per_second);
        if (!write_line(TL_LOG_WARNING, text, wait)) {
            (void)__atomic_add_fetch(&limiter->dropped, dropped, __ATOMIC_RELAXED);
        }
    }
}

/* true where the limiter has room. A few messages more may pass where two threads enter a new second together. */
static bool may_pass(tl_log_limiter *limiter) {
    struct timespec now = {0};
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    uint32_t second = (uint32_t)now.tv_sec;
    uint32_t last = __atomic_load_n(&limiter->second, __ATOMIC_RELAXED);
    if (last != second &&
        __atomic_compare_exchange_n(&limiter->second, &last, second, false, __ATOMIC_RELAXED, __ATOMIC_RELAXED)) {
        __atomic_store_n(&limiter->in_second, 0, __ATOMIC_RELAXED);
        say_dropped(limiter, false);
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
    say_dropped(limiter, true);
    errno = saved;
}
