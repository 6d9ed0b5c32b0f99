/* Messages of FMUs: their format, and their way to the log: see fmu_logger.h. */
#include "firmware/fmu/fmu_logger.h"

#include <errno.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "firmware/process/fmu_call.h"
#include "firmware/rollback/fmu_heap.h"

/* ---- fmu message ---- */

enum { WORD = 8, MESSAGE = 1024, CONVERSION = 32 };

static const char *const UNREADABLE = "(unreadable)";

/* ---- texts ---- */

/* The kernel reads a signal mask from there before it finds that it does not know what to do with it: a look at memory that
 * cannot fault, without a file and without a handler. */
static bool is_readable(uintptr_t address) {
    return syscall(SYS_rt_sigprocmask, -1, address / WORD * WORD, NULL, WORD) != 0 && errno != EFAULT;
}

/* Copies as many characters as can be read, at most `most`, up to its end; how many. AddressSanitizer must not judge what no
 * code of ours has made: such a pointer may lead anywhere. */
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

/* The length of what was copied. */
static size_t copy(const char *untrusted, size_t most, char *text, size_t size) {
    size_t length = 0;
    most = size - 1 < most ? size - 1 : most;
    if (untrusted != NULL && !is_readable((uintptr_t)untrusted)) {
        length = strlen(UNREADABLE) < most ? strlen(UNREADABLE) : most;
        memcpy(text, UNREADABLE, length);
    } else if (untrusted != NULL) {
        length = fetch(untrusted, most, text);
    }
    text[length] = '\0';
    return length;
}

void tl_fmu_message_copy(const char *untrusted, char *text, size_t size) {
    int saved = errno;
    (void)copy(untrusted, SIZE_MAX, text, size);
    errno = saved;
}

/* ---- formats ---- */

/* One conversion of a format: "%-8.3lf". */
typedef struct conversion {
    char text[CONVERSION]; /* as printf takes it, without stars */
    size_t length;         /* of it in the format */
    long precision;        /* -1: none */
    char size[3];          /* "", "hh", "h", "l", "ll", "q", "L", "j", "z", "t" */
    char kind;             /* 'd'; '\0': none that we know */
} conversion;

/* The format is the FMU's and was checked above, by us and not by a compiler. */
static int (*const print_one)(char *, size_t, const char *, va_list) = vsnprintf;

/* Digits of a width or a precision, or a star with its argument; absurd ones are cut. Appends to the text. */
static const char *take_number(const char *c, va_list *arguments, conversion *found, long *number) {
    long value = 0;
    if (*c == '*') {
        value = va_arg(*arguments, int);
        c++;
    }
    for (; *c >= '0' && *c <= '9'; c++) {
        value = value > MESSAGE ? value : value * 10 + (*c - '0');
    }
    value = value > MESSAGE - 1 ? MESSAGE - 1 : value < 1 - MESSAGE ? 1 - MESSAGE : value;
    size_t used = strlen(found->text);
    (void)snprintf(found->text + used, sizeof found->text - used, "%ld", value);
    *number = value;
    return c;
}

static const char *take_flags(const char *c, conversion *found) {
    size_t used = 1;
    for (; *c != '\0' && strchr("-+ #0'", *c) != NULL; c++) {
        if (strchr(found->text, *c) == NULL) {
            found->text[used++] = *c;
        }
    }
    return c;
}

static const char *take_size(const char *c, conversion *found) {
    static const char *const sizes[] = {"hh", "h", "ll", "l", "q", "L", "j", "z", "t"};
    for (size_t i = 0; i < sizeof sizes / sizeof sizes[0]; i++) {
        size_t length = strlen(sizes[i]);
        if (strncmp(c, sizes[i], length) == 0) {
            (void)snprintf(found->size, sizeof found->size, "%s", sizes[i]);
            return c + length;
        }
    }
    return c;
}

/* At a '%'. */
static conversion read_conversion(const char *format, va_list *arguments) {
    conversion found = {.text = "%", .precision = -1};
    const char *c = take_flags(format + 1, &found);
    long width = 0;
    if (*c == '*' || (*c >= '1' && *c <= '9')) {
        c = take_number(c, arguments, &found, &width);
    }
    if (*c == '.') {
        found.text[strlen(found.text)] = '.'; /* the rest of it is zeros */
        c = take_number(c + 1, arguments, &found, &found.precision);
    }
    c = take_size(c, &found);
    found.kind = *c != '\0' && strchr("diouxXcsSCpaAeEfFgGm%", *c) != NULL ? *c : '\0';
    found.length = (size_t)(c - format) + (found.kind == '\0' ? 0 : 1);
    (void)snprintf(found.text + strlen(found.text), sizeof found.text - strlen(found.text), "%s%c", found.size,
                   found.kind);
    return found;
}

/* Passes over the argument that was printed from a copy of the arguments. */
static void skip(const conversion *found, va_list *arguments) {
    const char *size = found->size;
    if (strchr("aAeEfFgG", found->kind) != NULL) {
        long double value = size[0] == 'L' ? va_arg(*arguments, long double) : (long double)va_arg(*arguments, double);
        (void)value;
    } else if (found->kind == 'p') {
        (void)va_arg(*arguments, void *);
    } else if (found->kind != 'm' && found->kind != '%') {
        bool is_wide = strcmp(size, "ll") == 0 || size[0] == 'q' || size[0] == 'j';
        bool is_long = size[0] == 'l' || size[0] == 'z' || size[0] == 't';
        long long value = is_wide   ? va_arg(*arguments, long long)
                          : is_long ? va_arg(*arguments, long)
                                    : va_arg(*arguments, int);
        (void)value;
    }
}

static int put_value(const conversion *found, va_list *arguments, char *text, size_t size) {
    va_list copied;
    va_copy(copied, *arguments);
    int length = print_one(text, size, found->text, copied);
    va_end(copied);
    skip(found, arguments);
    return length;
}

/* A text in its field. */
static int put_text(const conversion *found, va_list *arguments, char *text, size_t size) {
    char value[MESSAGE];
    const char *untrusted = va_arg(*arguments, const char *);
    size_t most = found->precision >= 0 ? (size_t)found->precision : SIZE_MAX;
    if (untrusted == NULL) {
        return snprintf(text, size, "(null)");
    }
    (void)copy(untrusted, most, value, sizeof value);
    long width = strtol(found->text + 1 + strspn(found->text + 1, "+ #0'"), NULL, 10);
    return snprintf(text, size, "%*s", (int)width, value);
}

static int put_one(const conversion *found, va_list *arguments, char *text, size_t size) {
    bool is_wide = found->size[0] == 'l' && (found->kind == 's' || found->kind == 'c');
    if (is_wide || strchr("SC", found->kind) != NULL) {
        (void)va_arg(*arguments, void *);
        return snprintf(text, size, "?");
    }
    return found->kind == 's' ? put_text(found, arguments, text, size) : put_value(found, arguments, text, size);
}

/* Where a text grows. */
typedef struct sink {
    char *text;
    size_t size;
    size_t used; /* may pass the size: what is beyond is cut */
} sink;

static char *end_of(const sink *to) {
    return to->text + (to->used < to->size ? to->used : to->size - 1);
}

static size_t room_in(const sink *to) {
    return to->used < to->size ? to->size - to->used : 1;
}

static void append(sink *to, const char *from, size_t length) {
    int printed = snprintf(end_of(to), room_in(to), "%.*s", (int)length, from);
    to->used += printed < 0 ? 0 : (size_t)printed;
}

/* From a '%' on; what follows it. */
static const char *append_conversion(sink *to, const char *format, va_list *arguments) {
    conversion found = read_conversion(format, arguments);
    if (found.kind == '\0') {
        size_t rest = strlen(format);
        append(to, format, rest);
        return format + rest;
    }
    int printed = put_one(&found, arguments, end_of(to), room_in(to));
    to->used += printed < 0 ? 0 : (size_t)printed;
    return format + found.length;
}

void tl_fmu_message_format(const char *untrusted, va_list *arguments, char *text, size_t size) {
    char format[MESSAGE];
    sink to = {.text = text, .size = size};
    int saved = errno;
    (void)copy(untrusted, SIZE_MAX, format, sizeof format);
    errno = saved; /* %m is about it */
    text[0] = '\0';
    for (const char *c = format; *c != '\0' && to.used < size;) {
        size_t plain = strcspn(c, "%");
        append(&to, c, plain);
        c += plain;
        if (*c == '%') {
            c = append_conversion(&to, c, arguments);
        }
    }
    errno = saved;
}

/* ---- fmu logger ---- */

enum { LOGGERS = TL_FMU_CALL_FMUS, WORD_TEXT = 80 };

/* The loggers that are open, so that an environment can be known before it is used; and what is left for messages of
 * nobody. The callback has nothing else to go by. */
static tl_fmu_logger *known[LOGGERS];
static tl_log_limiter unknown = TL_LOG_LIMITER(TL_FMU_MESSAGES_PER_SECOND);

void tl_fmu_logger_open(tl_fmu_logger *logger, const char *name, const char *generator) {
    *logger = (tl_fmu_logger){
        .plain = strncmp(generator, "PythonFMU", strlen("PythonFMU")) == 0,
        .limiter = TL_LOG_LIMITER(TL_FMU_MESSAGES_PER_SECOND),
    };
    (void)snprintf(logger->name, sizeof logger->name, "%s", name);
    for (size_t i = 0; i < LOGGERS; i++) {
        if (known[i] == NULL) {
            __atomic_store_n(&known[i], logger, __ATOMIC_RELEASE);
            return;
        }
    }
}

void tl_fmu_logger_close(tl_fmu_logger *logger) {
    for (size_t i = 0; i < LOGGERS; i++) {
        if (known[i] == logger) {
            __atomic_store_n(&known[i], NULL, __ATOMIC_RELEASE);
        }
    }
    tl_log_limiter_end(&logger->limiter);
}

/* NULL where it is nobody that we know. */
static tl_fmu_logger *find(const void *environment) {
    tl_fmu_logger *found = NULL;
    for (size_t i = 0; i < LOGGERS && found == NULL && environment != NULL; i++) {
        tl_fmu_logger *logger = __atomic_load_n(&known[i], __ATOMIC_ACQUIRE);
        found = logger == environment ? logger : NULL;
    }
    return found;
}

void tl_fmu_logger_take(fmi2ComponentEnvironment environment, fmi2String instance, fmi2Status status,
                        fmi2String category, fmi2String message, ...) {
    tl_fmu_heap *heap = tl_fmu_allocation_enter(NULL); /* what a message takes here is not the FMU's */
    char text[TL_LOG_TEXT];
    char name[WORD_TEXT];
    char kind[WORD_TEXT];
    tl_fmu_call call;
    tl_fmu_logger *logger = find(environment);
    if (message == NULL) {
        (void)tl_fmu_allocation_enter(heap);
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
        text[end - 1] = '\0'; /* many end with a newline */
    }
    tl_fmu_message_copy(instance, name, sizeof name);
    tl_fmu_message_copy(category, kind, sizeof kind);
    /* Who is being called is the best guess for a message that does not say where it comes from. */
    tl_log_level level = status == fmi2OK || status == fmi2Pending    ? TL_LOG_DEBUG
                         : status == fmi2Error || status == fmi2Fatal ? TL_LOG_ERROR
                                                                      : TL_LOG_WARNING;
    const char *caller = tl_fmu_calls_look(tl_fmu_calls_here(), &call) ? call.fmu : "(unknown)";
    tl_log_limited(logger != NULL ? &logger->limiter : &unknown, level, "FMU %s%s%s: %s%s%s%s",
                   logger != NULL ? logger->name : caller, name[0] != '\0' ? ", instance " : "", name, text,
                   kind[0] != '\0' ? " [" : "", kind, kind[0] != '\0' ? "]" : "");
    (void)tl_fmu_allocation_enter(heap);
}

void tl_fmu_logger_say(tl_fmu_logger *logger, tl_log_level level, const char *text) {
    tl_fmu_call call = {.fmu = ""};
    (void)tl_fmu_calls_look(tl_fmu_calls_here(), &call);
    tl_log_limited(&logger->limiter, level, "FMU %s %s", call.fmu[0] != '\0' ? call.fmu : logger->name, text);
}
