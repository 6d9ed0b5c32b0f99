/* Regions: the writable memory of an FMU's own libraries.
 *
 * Purpose: global and static variables of the FMU's binary, of the libraries in its folder, and of
 *          other libraries that no other FMU uses. Includes their thread-local variables of the
 *          thread that calls the FMU. Memory that only the loader writes is left out.
 * Shared:  a library that the program or several FMUs use is no part of any FMU's regions. The same
 *          holds for libgcc_s. libstdc++ stays with an FMU if another one opens it after
 *          tl_fmu_regions_find().
 * Python:  all FMUs in Python use one interpreter and its extension modules, so they have one list
 *          of regions.
 * Thread:  the thread that calls the FMUs.
 */
#ifndef TL_FIRMWARE_ROLLBACK_FMU_REGIONS_H
#define TL_FIRMWARE_ROLLBACK_FMU_REGIONS_H

#include <stdbool.h>
#include <stddef.h>

#include "master/base/status.h"

enum { TL_FMU_REGIONS = 512 };

typedef struct tl_fmu_region {
    unsigned char *begin;
    size_t size;
    bool has_pages; /* no other data lies in its pages; false for thread-local variables */
} tl_fmu_region;

typedef struct tl_fmu_regions {
    size_t count;
    size_t bytes; /* sum of all sizes */
    tl_fmu_region place[TL_FMU_REGIONS];
} tl_fmu_regions;

/* A number that grows with each library that this process opens or closes, and with each that
 * becomes shared.
 * If it has grown, the regions may have changed. */
unsigned long long tl_fmu_regions_changed(void);

/* Number of libraries that are loaded now. */
size_t tl_fmu_regions_loaded(void);

/* Excludes the libraries that are loaded now from all regions: they are the program's. */
void tl_fmu_regions_exclude(void);

/* Assigns libraries to an FMU: the open library `opened` with all that it needs, and all libraries
 * except the first `from`, in the order in which they were loaded. If another FMU has one of them,
 * it belongs to neither from then on. `folder`: as in tl_fmu_regions_find(), the same address.
 * `opened`: as dlopen() has returned it; NULL: none. */
void tl_fmu_regions_claim(const char *folder, void *opened, size_t from);

/* Forgets the users of closed libraries, because their addresses may be used again. */
void tl_fmu_regions_forget_closed(void);

/* Finds the regions of an FMU: of all loaded libraries in `folder`, an absolute path without links,
 * and in its subfolders, and of the libraries assigned to it. NULL: those of FMUs in Python, and of
 * libraries without an FMU. They are in the order in which the libraries were loaded. Creates the
 * thread-local variables of this thread if they do not exist yet. Errors: TL_FMU_FAILED if there
 * are more than TL_FMU_REGIONS. */
tl_status tl_fmu_regions_find(const char *folder, tl_fmu_regions *places, tl_error *error);

#endif
