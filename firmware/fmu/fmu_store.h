/* Loads FMU files: unpacks them, reads the description, checks and opens the binary.
 *
 * Purpose: provides what a plan needs of an FMU: its tl_model, its function table, and the URI of
 *          its resources.
 * Owner:   the store owns everything until tl_fmu_unload(), which also removes the unpacked folder.
 *          Only the opened binary and its heap remain until the process ends. Each load has its own
 *          folder, and its own libraries with their own variables (own_copies.h). So an FMU that
 *          can be instantiated only once can be loaded twice.
 * Limits:  see fmu_archive.h (size, number and paths of entries), model_description.h (size of the
 *          XML) and fmu_logger.h (messages).
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

enum { TL_FMU_MODULE = 128 }; /* bytes of a module's name with its terminating 0 */

/* Must not be moved while it is loaded, because the FMU has a pointer to the guard. */
typedef struct tl_fmu {
    const char *path; /* copy of the path passed to tl_fmu_load() */
    tl_model model;
    tl_fmu_guard guard;    /* contains the function table, and the callbacks for fmi2Instantiate */
    bool has_state;        /* private: rollback by the FMU's own states is allowed */
    const char *resources; /* file:/// URI; the folder is created if the FMU has none */
    char module
        [TL_FMU_MODULE];      /* name of the Python module that a PythonFMU FMU imports, cut to fit; "": no PythonFMU */
    tl_arena arena;           /* private: memory of the model and of texts */
    tl_private_folder folder; /* private: the folder with the unpacked FMU */
} tl_fmu;

/* Loads the FMU file at `path`. `opened`: descriptor of the file if it is already open; the caller
 * closes it. -1: the function opens the file. `rollback`: the requested rollback method.
 * TL_ROLLBACK_AUTO selects the first possible one of own states, memory and replay.
 * Errors:  TL_BAD_DATA if the file is invalid; TL_TRY_AGAIN if disk, memory or descriptors are
 *          missing. On failure no folder is left and *fmu is zeroed. */
tl_status tl_fmu_load(const char *path, int opened, tl_rollback rollback, tl_fmu *fmu, tl_error *error);

/* Opens the kernel interface that rollback needs (fmu_pages.h). Call it in a process that will load
 * FMUs, before the process drops its privileges. */
void tl_fmu_prepare(void);

/* Returns the used bytes of the heaps of all FMUs (fmu_heap.h), also of unloaded ones. */
size_t tl_fmu_used(void);

/* Sets the number of steps after the start up to which replay can roll back. Default:
 * TL_REPLAY_STEPS. Call it before the FMU is instantiated. */
void tl_fmu_set_replay_steps(tl_fmu *fmu, uint32_t steps);

/* FMUs in Python share one interpreter, so their memory is rolled back together. The first function
 * returns true if the FMU is in Python, the second one if it can be rolled back by memory. The
 * third one selects rollback by the memory that they share (true), or by own states or replay
 * (false). Call it before the FMU is instantiated, with the same value for all FMUs in Python. */
bool tl_fmu_is_in_python(const tl_fmu *fmu);
bool tl_fmu_can_share_memory(const tl_fmu *fmu);
void tl_fmu_share_memory(tl_fmu *fmu, bool is_shared);

/* Returns the rollback method in use, never TL_ROLLBACK_AUTO. It differs from the first choice if
 * the rollback proof has found the first choice wrong, or another method faster. */
tl_rollback tl_fmu_rollback(const tl_fmu *fmu);

/* Returns true if each restore of an own state also sets the last inputs again, because the states
 * do not contain them (last_inputs.h). */
bool tl_fmu_inputs_are_repeated(const tl_fmu *fmu);

/* If the FMU's own states are exact, but memory is used because it is faster, returns the measured
 * durations of both methods. Else returns NULL. */
const tl_fmi2_times *tl_fmu_measured_times(const tl_fmu *fmu);

/* Frees the FMU and removes its folder. Call it after all instances were freed. A zeroed tl_fmu is
 * allowed. */
void tl_fmu_unload(tl_fmu *fmu);

#endif
