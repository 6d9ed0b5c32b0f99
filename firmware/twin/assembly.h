/* Assembly: a configuration, its FMUs, and the twin built from them.
 *
 * Purpose: builds and frees all parts; every command that simulates uses it.
 * Owner:   the assembly owns all its parts until tl_assembly_free().
 * Thread:  the FMU thread (fmu_thread.h), from load or build to free. The configuration may be read
 *          earlier in another thread.
 * Errors:  a failed build logs its problems; the assembly must still be freed.
 */
#ifndef TL_FIRMWARE_TWIN_ASSEMBLY_H
#define TL_FIRMWARE_TWIN_ASSEMBLY_H

#include "firmware/base/os.h"
#include "firmware/config/config.h"
#include "firmware/fmu/fmu_store.h"
#include "firmware/plant/recording.h"
#include "master/base/arena.h"
#include "master/twin/twin.h"

/* Files that a component needs. They are found, and its FMU is opened, before the process drops its
 * access rights. */
typedef struct tl_assembly_file {
    bool is_there;                  /* the FMU was found */
    const char *path;               /* of the FMU; if it was not found: where it was searched first */
    int descriptor;                 /* of the FMU; -1: not open */
    char other[TL_OTHER_CASE_TEXT]; /* if not found: text that the error appends, on what exists instead; "": nothing */
    char **libraries;               /* absolute paths, or names for the loader; NULL elements: the path is too long */
} tl_assembly_file;

typedef struct tl_assembly {
    tl_config config;
    tl_problems problems;
    tl_fmu *fmus; /* one per component; components with the same Python FMU (its model is Python code) share one */
    size_t fmu_count;
    bool shares_memory; /* several Python FMUs are rolled back together, by one copy of their memory */
    tl_plan plan;
    tl_plan_component *components; /* the arrays to which `plan` points: */
    tl_plan_signal *signals;
    tl_plan_match *match;
    tl_plan_output *outputs; /* variables that `emulate` reads */
    tl_twin *twin;
    bool
        trusts_states; /* set before the build: use the FMU's own states if they are exact, even if a memory copy is faster */
    bool may_rerun;             /* set before the build: tl_twin_rerun() will be called (tl_plan) */
    tl_recording_time recorded; /* set before the build: times of the replayed recording; zeroed: unknown */
    tl_tuning tuning;           /* at the time of the build; tl_assembly_retune() does not change it */
    tl_arena arena;             /* for all arrays above and for `files` */
    tl_assembly_file *files;    /* one per component; NULL: not opened yet */
} tl_assembly;

/* Loads the FMUs and builds the twin. The configuration must be loaded; tl_assembly_open() may have
 * been called before. Logs every problem and returns the status of the first one. After a failure
 * the assembly must still be freed. */
tl_status tl_assembly_build(tl_assembly *assembly);

enum { TL_ASSEMBLY_NAME = 64 };

/* As tl_assembly_build(), but logs nothing, for a configuration that may be wrong. `error` is the
 * first problem; `component` is the name of its component, or "" if it belongs to none. */
tl_status tl_assembly_build_quietly(tl_assembly *assembly, char component[TL_ASSEMBLY_NAME], tl_error *error);

/* If `sentence` begins with a component's name and a colon (as messages about failed calls do),
 * copies that name to `component`. Otherwise leaves `component` unchanged. */
void tl_assembly_find_component(const tl_assembly *assembly, const char *sentence, char component[TL_ASSEMBLY_NAME]);

/* Returns the FMU of component number `component`. All FMUs must have been loaded. */
const tl_fmu *tl_assembly_fmu(const tl_assembly *assembly, size_t component);

/* Returns the number of macro steps from the start to the stop time of the FMUs, or in duration_s
 * if that is less. Call it after the build. */
int64_t tl_assembly_steps_to_stop(const tl_assembly *assembly);

/* Returns the newest message, with status fmi2Warning or worse, of the FMU of the named component.
 * Truncated; "": none. Call it after the build. The text is valid until the FMU's next call. */
const char *tl_assembly_last_message(const tl_assembly *assembly, const char *component);

/* Copies a sentence to `text` (`size` bytes), truncated. Leaves out the component's name (`name`)
 * at its beginning and the advice after a semicolon. */
void tl_assembly_quote(const char *sentence, const char *name, char *text, size_t size);

/* Finds the FMUs and libraries and opens the FMUs, for a process that drops its access rights
 * before the build. The build reports files that are missing. Errors: TL_TRY_AGAIN. */
tl_status tl_assembly_open(tl_assembly *assembly, tl_error *error);

/* Calls tl_twin_retune() and, if that succeeds, tl_config_retune(). Errors: of tl_twin_retune(). */
tl_status tl_assembly_retune(tl_assembly *assembly, const tl_tuning *tuning, tl_error *error);

/* Destroys the twin and builds it again with the tuning of the first build (`tuning`), without
 * later retunes. Call it only after a successful build. Logs problems. */
tl_status tl_assembly_rebuild(tl_assembly *assembly);

/* Frees everything. A zeroed assembly is allowed. */
void tl_assembly_free(tl_assembly *assembly);

/* ---- Paths that the FMUs of a configuration may read, in addition to the system paths that every
 * program needs.
 *
 * Purpose: a confined process can read only listed files. The list has three sources. First, the
 *          configuration: libraries, `reads` of a component, and texts in `set` that are file
 *          names. Second, the environment: folders that the dynamic loader, Python and the C
 *          library (locales) search. Of these, relative paths, the user's home, its parents, and
 *          top folders such as /opt are ignored. Third, the files that an installation of Python
 *          loads.
 * Owner:   the list owns its texts until tl_readable_paths_free().
 * Thread:  one thread.
 */

enum { TL_READABLE_PATHS_MOST = 256 }; /* further paths are ignored without a message */

/* Environment variable with the home of the user who started the program. HOME is another folder in
 * a process with FMUs. */
#define TL_READABLE_PATHS_HOME "TWINLOCK_HOME"

/* Absolute paths that exist. Zeroed: empty. */
typedef struct tl_readable_paths {
    char *path[TL_READABLE_PATHS_MOST];
    size_t count;
} tl_readable_paths;

/* Fills a zeroed list. Call it after tl_assembly_open(), before the process is confined. */
void tl_readable_paths_find(const tl_assembly *assembly, tl_readable_paths *paths);

void tl_readable_paths_free(tl_readable_paths *paths);

#endif
