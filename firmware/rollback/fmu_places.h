/* Where an FMU keeps what it does not allocate: the writable memory of its own libraries.
 *
 * Purpose: globals and static variables of the FMU's binary and of the libraries that it brings in its folder, and their variables that each thread has for
 *          itself, of the thread that calls the FMU. What the loader alone writes is left out.
 * Thread:  that of the FMUs.
 */
#ifndef TL_FIRMWARE_ROLLBACK_FMU_PLACES_H
#define TL_FIRMWARE_ROLLBACK_FMU_PLACES_H

#include <stdbool.h>
#include <stddef.h>

#include "master/base/status.h"

enum { TL_FMU_PLACES = 64 };

typedef struct tl_fmu_place {
    unsigned char *begin;
    size_t size;
    bool has_pages; /* of its own: nothing else lies in them; not so for a thread's variables */
} tl_fmu_place;

typedef struct tl_fmu_places {
    size_t count;
    size_t bytes; /* of all */
    tl_fmu_place place[TL_FMU_PLACES];
} tl_fmu_places;

/* Libraries that this process has opened so far: if there are more, places may have come. */
unsigned long long tl_fmu_places_opened(void);

/* Of all libraries that are loaded now from `folder`, an absolute path without links in it, or from folders below it. Thread-local variables of this
 * thread exist from then on. Errors: TL_FMU_FAILED: there are more than TL_FMU_PLACES. */
tl_status tl_fmu_places_find(const char *folder, tl_fmu_places *places, tl_error *error);

#endif
