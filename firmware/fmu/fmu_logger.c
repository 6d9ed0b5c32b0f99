/* Messages of FMUs, see fmu_logger.h. */
#include "firmware/fmu/fmu_logger.h"

#include <errno.h>
#include <printf.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "firmware/base/text.h"
#include "firmware/process/fmu_call.h"
#include "firmware/rollback/fmu_libc.h"

/* ---- fmu message ---- */

/* MOST: limit of a width or a precision. FLAGS: characters of flags in a conversion, '%' included.
 */
enum { WORD = 8, MESSAGE = 1024, CONVERSION = 32, MOST = 999, FLAGS = 7 };

/* ---- texts ---- */

/* rt_sigprocmask reads the signal mask from this address before it rejects its first argument. So
 * this tests memory without a fault, a file or a signal handler. */
static bool is_readable(uintptr_t address) {
    return syscall(SYS_rt_sigprocmask, -1, address / WORD * WORD, NULL, WORD) != 0 && errno != EFAULT;
}

/* Copies up to `most` readable characters up to the end of the text and returns their number.
 * AddressSanitizer must ignore it, because the pointer of the FMU may be invalid. */
__attribute__((no_sanitize("address"))) static size_t fetch(const char *untrusted, size_t most, char *text) {
    uintptr_t address = (uintptr_t)untrusted;
    size_t length = 0;
    while (length < most && ((length > 0 && (address + length) % WORD != 0) || is_readable(address + length)) &&
           untrusted[length] != '\0') {
        text[length] = untrusted[length];
        length++;
    }
    return length;
}

void tl_fmu_message_copy(const char *untrusted, char *text, size_t size) {
    int saved = errno;
    if (untrusted != NULL && !is_readable((uintptr_t)untrusted)) {
        (void)snprintf(text, size, "(unreadable)");
    } else {
        text[untrusted == NULL ? 0 : fetch(untrusted, size - 1, text)] = '\0';
    }
    errno = saved;
}

/* ---- formats ---- */

/* A function pointer, because the compiler cannot check a format of an FMU; it was checked here. */
static int (*const print)(char *, size_t, const char *, ...) = snprintf;

/* Appends a width or a precision: digits, or a star with its argument. Limits its size. Returns the
 * position after it. */
static const char *take_number(const char *c, va_list *arguments, char text[CONVERSION]) {
    bool is_star = *c == '*';
    long value = is_star ? va_arg(*arguments, int) : strtol(c, NULL, 10);
    value = value > MOST ? MOST : value < -MOST ? -MOST : value;
    (void)snprintf(text + strlen(text), CONVERSION - strlen(text), "%ld", value);
    return c + (is_star ? 1 : strspn(c, "0123456789"));
}

/* Reads the conversion at this '%' and replaces stars by numbers. Returns its length in the format;
 * 0: printf does not know it. */
static size_t read_conversion(const char *format, va_list *arguments, char text[CONVERSION]) {
    size_t flags = strspn(format + 1, "-+ #0'");
    const char *c = format + 1 + flags;
    (void)snprintf(text, CONVERSION, "%.*s", flags < FLAGS ? (int)flags + 1 : FLAGS, format);
    if (*c == '*' || (*c >= '1' && *c <= '9')) {
        c = take_number(c, arguments, text);
    }
    if (*c == '.') {
        char *precision = text + strlen(text);
        (void)snprintf(precision, CONVERSION - strlen(text), ".");
        c = take_number(c + 1, arguments, text);
        precision[0] = precision[1] == '-' ? '\0' : '.'; /* a negative precision counts as missing */
    }
    size_t size = strspn(c, "hlqLjzt");
    if (size > 2 || c[size] == '\0' || strchr("diouxXcsSCpaAeEfFgGm%", c[size]) == NULL) {
        return 0;
    }
    (void)snprintf(text + strlen(text), CONVERSION - strlen(text), "%.*s", (int)size + 1, c);
    bool has_type = strchr("m%", c[size]) != NULL || parse_printf_format(text, 0, NULL) != 0;
    return has_type ? (size_t)(c - format) + size + 1 : 0;
}

static int put_one(const char *conversion, va_list *arguments, char *text, size_t size) {
    char value[MESSAGE];
    const char *untrusted;
    int type = PA_INT;
    if (parse_printf_format(conversion, 1, &type) == 0) { /* %m or %% */
        return print(text, size, conversion);
    }
    bool is_wide = (type & PA_FLAG_LONG_LONG) != 0; /* also a long double; glibc does not set it for %qd and %Ld */
    is_wide = is_wide || ((type & ~PA_FLAG_MASK) == PA_INT && strpbrk(conversion, "qL") != NULL);
    switch (type & ~PA_FLAG_MASK) {
    case PA_STRING: /* also "%ls" */
    case PA_WSTRING:
        untrusted = va_arg(*arguments, const char *);
        if (strpbrk(conversion, "lqLjztS") != NULL) {
            return print(text, size, "?");
        }
        tl_fmu_message_copy(untrusted, value, sizeof value);
        return print(text, size, conversion, untrusted != NULL ? value : "(null)");
    case PA_POINTER:
        return print(text, size, conversion, va_arg(*arguments, void *));
    case PA_DOUBLE:
        if (is_wide) {
            return print(text, size, conversion, va_arg(*arguments, long double));
        }
        return print(text, size, conversion, va_arg(*arguments, double));
    default:
        break;
    }
    if (is_wide) {
        return print(text, size, conversion, va_arg(*arguments, long long));
    }
    if ((type & PA_FLAG_LONG) != 0) {
        return print(text, size, conversion, va_arg(*arguments, long));
    }
    return print(text, size, conversion, va_arg(*arguments, int));
}

void tl_fmu_message_format(const char *untrusted, va_list *arguments, char *text, size_t size) {
    char format[MESSAGE];
    char conversion[CONVERSION];
    int saved = errno;
    size_t used = 0;
    size_t length = 0;
    tl_fmu_message_copy(untrusted, format, sizeof format);
    text[0] = '\0';
    for (const char *c = format; *c != '\0' && used < size - 1; c += length) {
        bool is_plain = *c != '%';
        length = is_plain ? strcspn(c, "%") : read_conversion(c, arguments, conversion);
        if (length == 0) { /* no conversion: the remaining text is plain */
            length = strlen(c);
            is_plain = true;
        }
        errno = saved; /* for %m */
        int printed = is_plain ? print(text + used, size - used, "%.*s", (int)length, c)
                               : put_one(conversion, arguments, text + used, size - used);
        if (printed < 0) { /* a wide character that the locale cannot show */
            printed = print(text + used, size - used, "?");
        }
        used += (size_t)printed;
        used = used < size ? used : size - 1;
        text[used] = '\0';
    }
    errno = saved;
}

/* ---- fmu logger ---- */

enum { LOGGERS = TL_FMU_CALL_FMUS, WORD_TEXT = 80 };

/* The open loggers, so that an environment is checked before it is used. `unknown_limiter`
 * limits messages without a known logger. They are static because the callback has no other
 * context. */
static tl_fmu_logger *open_loggers[LOGGERS];
static tl_log_limiter unknown_limiter = TL_LOG_LIMITER(TL_FMU_MESSAGES_PER_SECOND);

void tl_fmu_logger_open(tl_fmu_logger *logger, const char *name, const char *generator) {
    *logger = (tl_fmu_logger){
        .plain = strncmp(generator, "PythonFMU", strlen("PythonFMU")) == 0,
        .limiter = TL_LOG_LIMITER(TL_FMU_MESSAGES_PER_SECOND),
    };
    (void)snprintf(logger->name, sizeof logger->name, "%s", name);
    for (size_t i = 0; i < LOGGERS; i++) {
        if (open_loggers[i] == NULL) {
            __atomic_store_n(&open_loggers[i], logger, __ATOMIC_RELEASE);
            return;
        }
    }
}

void tl_fmu_logger_close(tl_fmu_logger *logger) {
    for (size_t i = 0; i < LOGGERS; i++) {
        if (open_loggers[i] == logger) {
            __atomic_store_n(&open_loggers[i], NULL, __ATOMIC_RELEASE);
        }
    }
    tl_log_limiter_end(&logger->limiter);
}

/* Returns NULL if no open logger has this address. */
static tl_fmu_logger *find_logger(const void *environment) {
    tl_fmu_logger *found = NULL;
    for (size_t i = 0; i < LOGGERS && found == NULL && environment != NULL; i++) {
        tl_fmu_logger *logger = __atomic_load_n(&open_loggers[i], __ATOMIC_ACQUIRE);
        found = logger == environment ? logger : NULL;
    }
    return found;
}

/* A message of another thread at the same time is not noted. */
static void note_last(tl_fmu_logger *logger, const char *text) {
    if (!__atomic_test_and_set(&logger->is_noting, __ATOMIC_ACQUIRE)) {
        (void)tl_clean_text(text, strlen(text), logger->last, sizeof logger->last);
        __atomic_clear(&logger->is_noting, __ATOMIC_RELEASE);
    }
}

void tl_fmu_logger_take(fmi2ComponentEnvironment environment, fmi2String instance, fmi2Status status,
                        fmi2String category, fmi2String message, ...) {
    tl_fmu_heap *heap = tl_fmu_libc_enter(NULL); /* allocations of this function do not belong to the FMU */
    char text[TL_LOG_TEXT];
    char name[WORD_TEXT];
    char kind[WORD_TEXT];
    tl_fmu_call call;
    tl_fmu_logger *logger = find_logger(environment);
    if (message == NULL) {
        (void)tl_fmu_libc_enter(heap);
        return;
    }
    if (logger != NULL && logger->plain) {
        tl_fmu_message_copy(message, text, sizeof text);
    } else {
        va_list arguments;
        va_start(arguments, message);
        tl_fmu_message_format(message, &arguments, text, sizeof text);
        va_end(arguments);
    }
    for (size_t end = strlen(text); end > 0 && (unsigned char)text[end - 1] <= ' '; end--) {
        text[end - 1] = '\0'; /* many messages end with a newline */
    }
    tl_fmu_message_copy(instance, name, sizeof name);
    tl_fmu_message_copy(category, kind, sizeof kind);
    /* If the message has no valid environment, the FMU in the present call is the most likely
     * sender. */
    tl_log_level level = status == fmi2OK || status == fmi2Pending    ? TL_LOG_DEBUG
                         : status == fmi2Error || status == fmi2Fatal ? TL_LOG_ERROR
                                                                      : TL_LOG_WARNING;
    if (logger != NULL && level <= TL_LOG_WARNING) {
        note_last(logger, text);
    }
    const char *caller = tl_fmu_calls_poll(tl_fmu_calls_in_use(), &call) ? call.fmu : "(unknown)";
    tl_log_limited(logger != NULL ? &logger->limiter : &unknown_limiter, level, "FMU %s%s%s: %s%s%s%s",
                   logger != NULL ? logger->name : caller, name[0] != '\0' ? ", instance " : "", name, text,
                   kind[0] != '\0' ? " [" : "", kind, kind[0] != '\0' ? "]" : "");
    (void)tl_fmu_libc_enter(heap);
}

void tl_fmu_logger_log(tl_fmu_logger *logger, tl_log_level level, const char *text) {
    tl_fmu_call call = {.fmu = ""};
    (void)tl_fmu_calls_poll(tl_fmu_calls_in_use(), &call);
    tl_log_limited(&logger->limiter, level, "FMU %s: %s", call.fmu[0] != '\0' ? call.fmu : logger->name, text);
}
