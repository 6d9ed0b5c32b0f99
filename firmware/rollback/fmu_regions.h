/* Regions: the writable memory of an FMU's own libraries.
 *
 * Purpose: the regions contain the global and static variables of the FMU's libraries: its binary,
 *          the libraries in its folder, and others that no other FMU uses. They include
 *          thread-local variables of the thread that calls the FMU. Memory that only the loader
 *          writes is left out.
 * Shared:  a library that the program or several FMUs use is not part of any FMU's regions. The
 *          same holds for libgcc_s. But if tl_fmu_regions_find() has found libstdc++ for an FMU, it
 *          stays with this FMU.
 * Python:  all FMUs in Python use one interpreter and its extension modules, so they have one list
 *          of regions.
 * Thread:  the thread that calls the FMUs.
 */
#ifndef TL_FIRMWARE_ROLLBACK_FMU_REGIONS_H
#define TL_FIRMWARE_ROLLBACK_FMU_REGIONS_H

#include <stdbool.h>
#include <stddef.h>

#include "master/base/status.h"

enum { TL_FMU_REGIONS = 512 }; /* maximum number of regions of one FMU */

typedef struct tl_fmu_region {
    unsigned char *begin;
    size_t size;    /* bytes */
    bool has_pages; /* no other data lies in its pages; false for thread-local variables */
} tl_fmu_region;

typedef struct tl_fmu_regions {
    size_t count;
    size_t bytes;                        /* sum of all sizes */
    tl_fmu_region place[TL_FMU_REGIONS]; /* the first `count` are used */
} tl_fmu_regions;

/* Returns a number that grows with each library that this process opens or closes, and with each
 * library that becomes shared. If it has grown, the regions may have changed. */
unsigned long long tl_fmu_regions_changed(void);

/* Returns the number of objects that are loaded now: the program and its libraries. */
size_t tl_fmu_regions_loaded(void);

/* Excludes the program and its libraries that are loaded now from all regions. Exceptions are
 * libcrypto, libssl and libsqlite3, because only FMUs use them in a process with FMUs. */
void tl_fmu_regions_exclude(void);

/* Assigns libraries to an FMU: the library `opened` with all that it needs, and all libraries that
 * were loaded after the first `from`. A library that already belongs to another FMU belongs to none
 * from then on, except libstdc++ (see above). `folder`: the same pointer as in
 * tl_fmu_regions_find(), because pointers are compared. `opened`: the result of dlopen(); NULL:
 * none. `from`: an earlier result of tl_fmu_regions_loaded(). */
void tl_fmu_regions_claim(const char *folder, void *opened, size_t from);

/* Removes the assignments of closed libraries, because their addresses may be used again. */
void tl_fmu_regions_forget_closed(void);

/* Finds the regions of an FMU: those of all loaded libraries below `folder`, an absolute path
 * without links, and of the libraries assigned to the FMU. `folder` NULL: those of FMUs in Python,
 * and of libraries that are not assigned. The order is that in which the libraries were loaded.
 * Creates the thread-local variables of this thread if they do not exist yet. Errors: TL_FMU_FAILED
 * if there are more than TL_FMU_REGIONS. */
tl_status tl_fmu_regions_find(const char *folder, tl_fmu_regions *places, tl_error *error);

#endif
