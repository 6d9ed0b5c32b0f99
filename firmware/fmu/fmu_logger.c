/* The logger that FMUs are given: see fmu_logger.h. */
#include "firmware/fmu/fmu_logger.h"

#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

#include "firmware/fmu/fmu_message.h"
#include "firmware/process/fmu_call.h"
#include "firmware/rollback/fmu_allocation.h"

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

static tl_log_level level_of(fmi2Status status) {
    switch (status) {
    case fmi2OK:
    case fmi2Pending:
        return TL_LOG_DEBUG;
    case fmi2Warning:
    case fmi2Discard:
        return TL_LOG_WARNING;
    case fmi2Error:
    case fmi2Fatal:
        return TL_LOG_ERROR;
    }
    return TL_LOG_WARNING;
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
    const char *caller = tl_fmu_calls_look(tl_fmu_calls_here(), &call) ? call.fmu : "(unknown)";
    tl_log_limited(logger != NULL ? &logger->limiter : &unknown, level_of(status), "FMU %s%s%s: %s%s%s%s",
                   logger != NULL ? logger->name : caller, name[0] != '\0' ? ", instance " : "", name, text,
                   kind[0] != '\0' ? " [" : "", kind, kind[0] != '\0' ? "]" : "");
    (void)tl_fmu_allocation_enter(heap);
}

void tl_fmu_logger_say(tl_fmu_logger *logger, tl_log_level level, const char *who, const char *text) {
    tl_log_limited(&logger->limiter, level, "FMU %s %s", who[0] != '\0' ? who : logger->name, text);
}
