/* The options of `twinlock push`.
 *
 * Thread: one thread, at the start of the process.
 */
#ifndef TL_FIRMWARE_PUSH_PUSH_OPTIONS_H
#define TL_FIRMWARE_PUSH_PUSH_OPTIONS_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/text/program_options.h"

/* What is to be done. */
typedef enum tl_push_action {
    TL_PUSH_CONFIGURATION,
    TL_PUSH_STATE,
    TL_PUSH_VERSIONS,
    TL_PUSH_GET,
    TL_PUSH_CONFIRM,
    TL_PUSH_CANCEL,
    TL_PUSH_RETURN
} tl_push_action;

/* Texts are those of the command line. */
typedef struct tl_push_options {
    tl_push_action action;
    const char *config; /* of CONFIGURATION */
    const char *url;
    const char *pin;
    const char *token_file; /* NULL: TWINLOCK_TOKEN has it */
    const char *base;       /* the file that must be active; NULL: whatever is */
    const char *why;
    bool check;
    bool activate;
    bool restart;
    bool accept_worse;
    bool needs_confirm;
    bool wait;
    bool json;
    uint32_t probation_s; /* 0: as usual */
    uint32_t shadow_s;    /* the same */
    double require_lock;  /* 0: as usual */
    uint64_t version;     /* of GET and RETURN; 0: the active one, the one before */
} tl_push_options;

tl_program_outcome tl_push_options_read(int argc, char **argv, tl_push_options *options);

#endif
