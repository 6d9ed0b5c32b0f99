/* Loads FMU files: unpacks them, reads the description, checks and opens the binary.
 *
 * Purpose: yields a tl_model, a function table and a resources URI: all that a plan needs of an
 *          FMU.
 * Owner:   the store owns everything until tl_fmu_unload(), which also removes the unpacked folder.
 *          Only the opened binary remains until the process ends. Each load has its own folder, and
 *          its own libraries with their own variables (own_copies.h). So an FMU that can be
 *          instantiated only once can be loaded twice.
 * Limits:  see fmu_archive.h (size, count, path of entries), model_description.h (size of the XML)
 *          and fmu_logger.h (messages).
 * Errors:  see tl_fmu_load().
 * Thread:  the thread that calls the FMUs (fmu_guard.h).
 */
#ifndef TL_FIRMWARE_FMU_FMU_STORE_H
#define TL_FIRMWARE_FMU_FMU_STORE_H

#include <stdbool.h>

#include "firmware/fmu/fmu_guard.h"
#include "firmware/process/private_folder.h"
#include "master/base/arena.h"
#include "master/base/status.h"
#include "master/fmi/model.h"
#include "master/fmi/rollback.h"

enum { TL_FMU_MODULE = 128 };

/* Must not be moved while it is loaded, because the FMU has a pointer to the guard. */
typedef struct tl_fmu {
    const char *path; /* as passed to tl_fmu_load() */
    tl_model model;
    tl_fmu_guard guard;    /* its function table, and the callbacks for fmi2Instantiate */
    bool has_state;        /* private: rollback by its own states is allowed */
    const char *resources; /* file:/// URI; the folder is created if the FMU has none */
    char module
        [TL_FMU_MODULE];      /* name of the Python module that a PythonFMU FMU imports, cut to fit; "": no PythonFMU */
    tl_arena arena;           /* private: memory of the model and of texts */
    tl_private_folder folder; /* private: the folder with the unpacked FMU */
} tl_fmu;

/* `opened`: descriptor of the file if it is already open, which the caller keeps; -1: the file is
 * opened here. `rollback`: the wanted method. TL_ROLLBACK_AUTO takes the first possible one of
 * state, memory and replay.
 * Errors: TL_BAD_DATA if the file is invalid; TL_TRY_AGAIN if disk or memory is missing. On failure
 *         nothing is left behind and *fmu is zeroed. */
tl_status tl_fmu_load(const char *path, int opened, tl_rollback rollback, tl_fmu *fmu, tl_error *error);

/* Opens the kernel interfaces that rollback needs. Call it before a process that will load FMUs
 * drops its privileges. */
void tl_fmu_prepare(void);

/* Bytes that FMUs have used in their own heaps. */
size_t tl_fmu_used(void);

/* Sets how many steps after its start replay can roll back; default: TL_REPLAY_STEPS. Call it
 * before the FMU is instantiated. */
void tl_fmu_set_replay_steps(tl_fmu *fmu, uint32_t steps);

/* Returns the rollback method in use, never TL_ROLLBACK_AUTO. It may differ from the first choice
 * if the FMU's own states were found wrong. */
tl_rollback tl_fmu_rollback(const tl_fmu *fmu);

/* Returns true if the FMU is rolled back by its own states and its last inputs are set again,
 * because its states do not contain them. */
bool tl_fmu_inputs_are_repeated(const tl_fmu *fmu);

/* Returns the durations of both methods if memory is used because it is faster than the FMU's own
 * states, which are exact too. Else returns NULL. */
const tl_fmi2_times *tl_fmu_choice(const tl_fmu *fmu);

/* Call it after all instances were freed. A zeroed tl_fmu is allowed. */
void tl_fmu_unload(tl_fmu *fmu);

#endif
