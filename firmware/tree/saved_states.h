/* Whether what the FMUs of a run save is of use to another process: found out before the run begins, and remembered.
 *
 * Purpose: a checkpoint that ends who loads it costs a start, and one that is loaded and goes on otherwise is noticed by nobody. So two processes of the FMUs
 *          try it (read_back.h), of which nothing is heard on the log: what is wrong with the FMUs otherwise the run will say.
 * Memory:  FOLDER/states.json, by the contents of the FMU files, how they are rolled back, the step and the version of this program. So it costs two starts of
 *          the FMUs once. Who has no folder would pay that at each start, and does not try.
 * Trust:   what is said comes from a process with FMUs, and harms nobody but its own run: it is cleaned, and bounded.
 * Thread:  the main thread, before there are others.
 */
#ifndef TL_FIRMWARE_TREE_SAVED_STATES_H
#define TL_FIRMWARE_TREE_SAVED_STATES_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/config/config.h"
#include "firmware/twin/twin_role.h"

enum { TL_SAVED_STATES_TEXT = 400 };

typedef struct tl_saved_states_settings {
    const tl_config *config; /* as it was read */
    const char *folder;      /* NULL: there is none */
    bool unconfined;
    uint64_t memory_limit;           /* bytes that the process of the FMUs may take; 0: tl_confine_fair_memory() */
    const tl_twin_role_tasks *tasks; /* of a twin's process */
} tl_saved_states_settings;

typedef struct tl_saved_states {
    uint64_t
        files; /* these FMU files' (tl_identity_number_of_open_files()) are of no use; 0: nothing is known against them */
    char why[TL_SAVED_STATES_TEXT]; /* then: a sentence, which begins with a component */
} tl_saved_states;

/* Waits for the processes, each of whose calls of FMUs may take a minute. */
void tl_saved_states_try(const tl_saved_states_settings *settings, tl_saved_states *found);

#endif
