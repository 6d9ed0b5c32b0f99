/* Versions of large memory: versions share pages that are equal.
 *
 * Thread:  one at a time.
 */
#ifndef TL_FIRMWARE_ROLLBACK_FMU_PAGES_H
#define TL_FIRMWARE_ROLLBACK_FMU_PAGES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/rollback/fmu_regions.h"
#include "master/base/status.h"

/* ---- Detection of written pages.
 *
 * Purpose: a step changes only a few pages of a large FMU, and only these need to be copied. Linux
 *          6.7 or newer records the first write to each page, and reports and resets this record in
 *          one call (PAGEMAP_SCAN, asynchronous write protection of userfaultfd). The writing
 *          thread does not wait for another thread, and writes by system calls are recorded too.
 * Rights:  needs two descriptors. Call tl_fmu_written_begin() before the process drops its
 *          privileges; later only ioctl() uses them.
 * Without: tl_fmu_written_serves() returns false on an older kernel, in an emulator, with pages of
 *          another size than 4096 bytes, or if the call is not allowed. Then all pages are
 *          compared.
 * Thread:  one at a time.
 */

enum { TL_FMU_PAGE = 4096 }; /* bytes of a page */

/* Opens and tests the kernel interface; further calls do nothing. */
void tl_fmu_written_begin(void);

/* Calls tl_fmu_written_begin(). Returns true if the kernel reports written pages. */
bool tl_fmu_written_serves(void);

/* ---- Versions of large memory: pages that are equal in several versions are stored once.
 *
 * Purpose: stores the states of a large FMU (fmu_memory.h). The cost of a save depends on the pages
 *          written since the last save, and that of a restore on the pages that differ. It does not
 *          depend on the total size: megabytes of tables are equal in all states.
 * Changes: the kernel reports written pages. If it cannot, all pages are compared with the last
 *          version; this takes longer, but needs no more memory.
 * Ranges:  consist of whole pages and have a fixed size. Of the last range, each version may use a
 *          different part, from its beginning.
 * Order:   versions can be saved, restored and freed in any order; none depends on another.
 * Memory:  tl_fmu_pages_reserve() reserves it for later versions. If a later version differs in
 *          more pages than expected, the memory grows by pieces of about 256 KiB. Each save also
 *          reserves for later ones, at most 64 MiB. All is freed with the last version.
 * Thread:  one at a time.
 */

typedef struct tl_fmu_pages tl_fmu_pages;

/* One version. Zeroed: empty. Fields are private. */
typedef struct tl_fmu_version {
    size_t pages;   /* pages of all ranges, up to the used end of the last one */
    size_t leaves;  /* number of groups, each of 32 pages */
    size_t room;    /* allocated elements of `leaf` */
    uint32_t *leaf; /* index of each group in the storage; a group contains the indices of its pages */
} tl_fmu_version;

/* Creates the storage for `count` ranges, at most TL_FMU_REGIONS + 1. Their addresses and sizes
 * must be multiples of TL_FMU_PAGE. The storage exists until the process ends. Returns NULL if
 * memory is out (TL_TRY_AGAIN in `error`). */
tl_fmu_pages *tl_fmu_pages_open(const tl_fmu_region *ranges, size_t count, tl_error *error);

/* Saves the present contents of the ranges in `version` and replaces its old contents. `used`:
 * bytes of the last range that are saved. `was_written`: false only if nothing was written to the
 * ranges since the last save or restore; then the search for written pages may be skipped. Errors:
 * TL_TRY_AGAIN if memory is out; then `version` is unchanged. */
tl_status tl_fmu_pages_save(tl_fmu_pages *self, size_t used, bool was_written, tl_fmu_version *version,
                            tl_error *error);

/* Restores a version. Does not change the last range after the pages of the version's used part.
 * `was_written`: as for a save. */
void tl_fmu_pages_restore(tl_fmu_pages *self, const tl_fmu_version *version, bool was_written);

/* Returns true if the ranges have the contents of the version; `used`: as for a save. */
bool tl_fmu_pages_are_same(const tl_fmu_pages *self, const tl_fmu_version *version, size_t used);

/* Frees a version and zeroes it. An empty version is allowed. */
void tl_fmu_pages_forget(tl_fmu_pages *self, tl_fmu_version *version);

/* Call it after other code has overwritten the ranges, for example by a plain copy. The next save
 * then compares all pages. */
void tl_fmu_pages_invalidate(tl_fmu_pages *self);

/* Returns the estimated bytes of one more version, from the largest number of pages that differed
 * between two versions. Before the fourth such difference, the pages copied by restores count too.
 * Default without any difference: 64 pages, or all if there are fewer. */
size_t tl_fmu_pages_size(const tl_fmu_pages *self);

/* Restarts the size estimate. */
void tl_fmu_pages_remeasure(tl_fmu_pages *self);

/* While `passes` is true, saves and restores do not change the size estimate. Default: false. */
void tl_fmu_pages_freeze_estimate(tl_fmu_pages *self, bool passes);

/* The first function reserves memory for `versions` more versions that each differ in the estimated
 * number of pages. The second one allocates the list `leaf` of one new version. Call them after one
 * version was saved. Both return false if memory is out. */
bool tl_fmu_pages_reserve(tl_fmu_pages *self, size_t versions);
bool tl_fmu_pages_reserve_version(const tl_fmu_pages *self, tl_fmu_version *version);

#endif
