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

/* Loads the FMU file at `path`. `opened`: descriptor of the file if it is already open; the caller
 * closes it. -1: the function opens the file. `rollback`: the requested method. TL_ROLLBACK_AUTO
 * selects the first possible method of state, memory and replay.
 * Errors: TL_BAD_DATA if the file is invalid; TL_TRY_AGAIN if disk or memory is missing. On failure
 *         nothing is left behind and *fmu is zeroed. */
tl_status tl_fmu_load(const char *path, int opened, tl_rollback rollback, tl_fmu *fmu, tl_error *error);

/* Opens the kernel interfaces that rollback needs. Call it before a process that will load FMUs
 * drops its privileges. */
void tl_fmu_prepare(void);

/* Returns the bytes that all FMUs together have used in their own heaps (fmu_heap.h). */
size_t tl_fmu_used(void);

/* Sets the number of steps after the start up to which replay can roll back. Default:
 * TL_REPLAY_STEPS. Call it before the FMU is instantiated. */
void tl_fmu_set_replay_steps(tl_fmu *fmu, uint32_t steps);

/* FMUs in Python have one interpreter, so several of them can only be rolled back together.
 * is_in_python(): the FMU is one of them. can_share_memory(): it can be rolled back by their
 * shared memory. share_memory(): it is rolled back by this memory, or (false) by its own states or
 * replay. Call it before the FMU is instantiated, with the same value for all FMUs in Python. */
bool tl_fmu_is_in_python(const tl_fmu *fmu);
bool tl_fmu_can_share_memory(const tl_fmu *fmu);
void tl_fmu_share_memory(tl_fmu *fmu, bool is_shared);

/* Returns the rollback method in use, never TL_ROLLBACK_AUTO. It may differ from the first choice
 * if the FMU's own states were found wrong. */
tl_rollback tl_fmu_rollback(const tl_fmu *fmu);

/* Returns true if the FMU's own states do not contain its inputs. Each restore of a state then also
 * sets the last inputs again. */
bool tl_fmu_inputs_are_repeated(const tl_fmu *fmu);

/* Returns the measured durations of both methods if the FMU's own states are exact, but memory is
 * used because it is faster. Else returns NULL. */
const tl_fmi2_times *tl_fmu_measured_times(const tl_fmu *fmu);

/* Frees the FMU and removes its folder. Call it after all instances were freed. A zeroed tl_fmu is
 * allowed. */
void tl_fmu_unload(tl_fmu *fmu);

#endif
