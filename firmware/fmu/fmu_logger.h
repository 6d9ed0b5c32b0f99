/* The logger that FMUs are given: their messages in the log, limited per second.
 *
 * Purpose: fmi2CallbackLogger of one loaded FMU. Nothing that the FMU passes is trusted: not the environment, which some FMUs leave
 *          NULL or make up, not the format, not the texts (fmu_message.h).
 * Limits:  at most TL_FMU_MESSAGES_PER_SECOND lines of an FMU go into the log; those that no FMU can be told for have a limit
 *          together.
 * Owner:   the caller places a logger; it must stay where it is until tl_fmu_logger_close().
 * Thread:  open and close: the thread of the FMUs. The callback: any thread.
 */
#ifndef TL_FIRMWARE_FMU_FMU_LOGGER_H
#define TL_FIRMWARE_FMU_FMU_LOGGER_H

#include <stdbool.h>

#include "firmware/base/log.h"
#include "master/base/status.h"
#include "master/fmi/fmi2.h"

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

/* A line of ours about the FMU, by the same limit: it may be said in the cycle. `who`: an instance of it; "": the file. The
 * text goes on after the name: "changed …". */
void tl_fmu_logger_say(tl_fmu_logger *logger, tl_log_level level, const char *who, const char *text);

#endif
