/* Loads FMU files: unpacks, reads the description, checks and opens the binary.
 *
 * Purpose: from a path to a tl_model, a function table and a resources URI; what a plan needs of an FMU.
 * Owner:   the store owns all of it but the opened binary, which stays until the process ends, until tl_fmu_unload(), which also removes the unpacked folder. Each load has a
 *          folder, and libraries with variables, of its own (own_copies.h): an FMU that can be instantiated only once can be loaded
 *          twice.
 * Limits:  see fmu_archive.h (size, count, path of entries) and model_description.h (size of the XML); for its messages fmu_logger.h.
 * Thread:  that of the FMUs (fmu_guard.h).
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

/* Must stay where it is while it is loaded: the FMU knows the guard. */
typedef struct tl_fmu {
    const char *path; /* as given */
    tl_model model;
    tl_fmu_guard guard;         /* its functions, and the callbacks to instantiate it with */
    bool has_state;             /* private: it may be rolled back by its own states */
    const char *resources;      /* file:/// URI; the folder exists also where the FMU has none */
    char module[TL_FMU_MODULE]; /* the Python module that an FMU of PythonFMU imports, cut; "": none */
    tl_arena arena;             /* private: of the model and texts */
    tl_private_folder folder;   /* private: what it is unpacked to */
} tl_fmu;

/* `opened`: the file, if it was opened before; the descriptor stays the caller's. -1: it is opened here. `rollback`: how it shall be rolled back; without a way the FMU has no functions for it. Errors: TL_BAD_DATA for anything wrong in the file, TL_TRY_AGAIN where disk or memory is missing.
 * On failure nothing is left behind and *fmu is zeroed. */
tl_status tl_fmu_load(const char *path, int opened, tl_rollback rollback, tl_fmu *fmu, tl_error *error);

/* Before a process gives up its rights, if it is to load FMUs: what their rollback needs of the kernel is opened. */
void tl_fmu_prepare(void);

/* Bytes that FMUs have allocated from heaps of their own. */
size_t tl_fmu_used(void);

/* Before it is instantiated: by replay it can be led back from so many steps after its beginning. Else TL_REPLAY_STEPS. */
void tl_fmu_set_replay_steps(tl_fmu *fmu, uint32_t steps);

/* How it is rolled back now, never TL_ROLLBACK_AUTO: one whose own states turned out to be wrong is so by another way since. */
tl_rollback tl_fmu_rollback(const tl_fmu *fmu);

/* Whether that is by its own state, and it is given again what it had been given: its states do not hold that. */
bool tl_fmu_is_given_again(const tl_fmu *fmu);

/* If that is by its memory since it was found to be faster than by its own states, which would do: how long both take. Else NULL. */
const tl_fmi2_times *tl_fmu_choice(const tl_fmu *fmu);

/* No instance of it may exist any more. A zeroed tl_fmu is allowed. */
void tl_fmu_unload(tl_fmu *fmu);

#endif
