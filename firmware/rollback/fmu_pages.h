/* Versions of much memory, of which little differs: what is the same in several of them is kept once.
 *
 * Purpose: a state of a large FMU (fmu_memory.h). To save it costs what was written since the last time, to go back to one what differs, and not
 *          what there is: some megabytes of tables are of the same value in all states.
 * Found:   what was written, by the kernel (fmu_written.h); if it does not tell, by comparing all with the last version, which writes nothing and keeps as little.
 * Ranges:  whole pages; all but the last are fixed, the last may be used up to another place in each version.
 * Order:   any; versions are equals, none depends on another one.
 * Memory:  reserved for versions to come (tl_fmu_pages_reserve()); if they differ in more than versions did until then, it grows by pieces of 1 MiB. Given back with the last version.
 * Thread:  one at a time.
 */
#ifndef TL_FIRMWARE_ROLLBACK_FMU_PAGES_H
#define TL_FIRMWARE_ROLLBACK_FMU_PAGES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/rollback/fmu_places.h"
#include "master/base/status.h"

typedef struct tl_fmu_pages tl_fmu_pages;

/* Zeroed: none. Fields are private. */
typedef struct tl_fmu_version {
    size_t pages;   /* of all ranges, up to where the last one is used */
    size_t leaves;  /* groups of pages, */
    size_t room;    /* for which there is room */
    uint32_t *leaf; /* each a slot with the slots of its pages */
} tl_fmu_version;

/* Of these ranges, at most TL_FMU_PLACES + 1, whose beginnings and sizes are multiples of a page but for the size of the last. It is there until the process
 * ends. NULL: TL_TRY_AGAIN. */
tl_fmu_pages *tl_fmu_pages_open(const tl_fmu_place *ranges, size_t count, tl_error *error);

/* Whether the kernel tells what was written; else all is compared. */
bool tl_fmu_pages_are_told(const tl_fmu_pages *self);

/* What is there now, `used` bytes of the last range; in place of what the version was. Errors: TL_TRY_AGAIN: there is no memory; it is as it was. */
tl_status tl_fmu_pages_save(tl_fmu_pages *self, size_t used, tl_fmu_version *version, tl_error *error);

/* Back to it. What lies behind the version's part of the last range is not touched. */
void tl_fmu_pages_restore(tl_fmu_pages *self, const tl_fmu_version *version);

void tl_fmu_pages_forget(tl_fmu_pages *self, tl_fmu_version *version);

/* Somebody else has written everywhere, in another way than by these calls. */
void tl_fmu_pages_lose(tl_fmu_pages *self);

/* Bytes that one version more takes, by the most that was written between two of them; before some were, by what is supposed. */
size_t tl_fmu_pages_size(const tl_fmu_pages *self);

/* What was seen of versions says nothing of those to come. */
void tl_fmu_pages_measure_anew(tl_fmu_pages *self);

/* Nor does what is saved and restored while it passes. */
void tl_fmu_pages_pass(tl_fmu_pages *self, bool passes);

/* Memory for so many versions more, each of which differs in as many pages as were seen to, and for the list of one of them, which has none yet. After one was saved. False: there is none. */
bool tl_fmu_pages_reserve(tl_fmu_pages *self, size_t versions);
bool tl_fmu_pages_reserve_version(const tl_fmu_pages *self, tl_fmu_version *version);

#endif
