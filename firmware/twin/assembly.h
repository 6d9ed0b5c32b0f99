/* An assembly: a configuration, its FMUs, and the twin built from them.
 *
 * Purpose: what every verb that simulates starts from, put together and taken apart in one place.
 * Owner:   the assembly owns all of it until tl_assembly_free().
 * Thread:  one thread, that of the FMUs (fmu_thread.h), from load or build to free; read may come before, in another one.
 */
#ifndef TL_FIRMWARE_TWIN_ASSEMBLY_H
#define TL_FIRMWARE_TWIN_ASSEMBLY_H

#include "firmware/base/os.h"
#include "firmware/config/config.h"
#include "firmware/fmu/fmu_store.h"
#include "master/base/arena.h"
#include "master/twin/twin.h"

/* What a component needs of the disk: found, and its FMU opened, before the process gives up the right to. */
typedef struct tl_assembly_file {
    bool is_there;
    const char *path;               /* as it was found, or where it was looked for first */
    int descriptor;                 /* -1: none */
    char other[TL_OTHER_CASE_TEXT]; /* if it was not found: what is there instead */
    char **libraries;               /* absolute, or a bare name; an element: NULL if its path is too long */
} tl_assembly_file;

typedef struct tl_assembly {
    tl_config config;
    tl_problems problems;
    tl_fmu *fmus; /* one of each component; those of one file that run in Python share one */
    size_t fmu_count;
    tl_plan plan;
    tl_plan_component *components; /* of the plan */
    tl_plan_signal *signals;
    tl_plan_match *match;
    tl_plan_output *outputs; /* what `emulate` reads */
    tl_twin *twin;
    bool
        trusts_states; /* set by its user before it is built: what is exact by its own states is led back by these, though a copy may be faster */
    tl_tuning tuning;  /* as configured */
    tl_arena arena;    /* for what follows, and all arrays above */
    tl_assembly_file *files; /* of each component; NULL: not opened yet */
} tl_assembly;

/* Of an assembly with a configuration, which may be opened already: loads the FMUs and builds the twin. On failure every problem was said on the log and the
 * status is that of the first; the assembly must be freed all the same. */
tl_status tl_assembly_build(tl_assembly *assembly);

enum { TL_ASSEMBLY_NAME = 64 };

/* The same of what may well be wrong: nothing is said on the log. The error is the first problem, and `component` whose it is; "": no component's. */
tl_status tl_assembly_build_quietly(tl_assembly *assembly, char component[TL_ASSEMBLY_NAME], tl_error *error);

/* Writes the component's name with which a sentence begins, before a colon, as those about a call that has failed do, if there is one. */
void tl_assembly_find_component(const tl_assembly *assembly, const char *sentence, char component[TL_ASSEMBLY_NAME]);

/* Copies a sentence without the component's name at its beginning and without the advice behind a semicolon. */
void tl_assembly_quote(const char *sentence, const char *name, char *text, size_t size);

/* For a process that gives up its rights between the two: finds the FMUs and the libraries, and opens the FMUs. What cannot be is told by the
 * building. Errors: TL_TRY_AGAIN. */
tl_status tl_assembly_open(tl_assembly *assembly, tl_error *error);

/* tl_twin_retune(), and the configuration has these values from now on, for whoever else looks at them (tl_config_retune()). */
tl_status tl_assembly_retune(tl_assembly *assembly, const tl_tuning *tuning, tl_error *error);

/* The twin anew, as it was configured, of an assembly that has had one. Problems are said on the log. */
tl_status tl_assembly_rebuild(tl_assembly *assembly);

/* A zeroed assembly is allowed. */
void tl_assembly_free(tl_assembly *assembly);

/* ---- The places that the FMUs of a configuration may read besides what every program is made of.
 *
 * Purpose: a confined process reads no file that nobody has named. Named are: by the configuration the libraries, what a component `reads`, and
 *          texts in `set` that are the names of files; by the environment the folders in which loader, Python and locales look: absolute ones that are
 *          neither a home nor hold one; of an installation of Python what it loads.
 * Thread:  one thread.
 */

enum { TL_TWIN_PLACES = 256 }; /* further ones are left out */

/* A variable: the home of who has started all this, since HOME is another folder in a process with FMUs. */
#define TL_TWIN_PLACES_HOME "TWINLOCK_HOME"

/* Absolute paths of what exists. A zeroed one is empty. */
typedef struct tl_twin_places {
    char *path[TL_TWIN_PLACES];
    size_t count;
} tl_twin_places;

/* While everything can be looked at still; of an assembly whose libraries were looked for (tl_assembly_open()). */
void tl_twin_places_find(const tl_assembly *assembly, tl_twin_places *places);

void tl_twin_places_free(tl_twin_places *places);

#endif
