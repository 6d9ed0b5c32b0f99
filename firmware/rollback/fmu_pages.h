/* Versions of large memory: pages, shared by all versions in which they are equal.
 *
 * Thread:  one at a time.
 */
#ifndef TL_FIRMWARE_ROLLBACK_FMU_PAGES_H
#define TL_FIRMWARE_ROLLBACK_FMU_PAGES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/status.h"

/* ---- Where an FMU keeps what it does not allocate: the writable memory of its own libraries.
 *
 * Purpose: globals and static variables of the FMU's binary and of the libraries that it brings in its folder, and their variables that each thread has for
 *          itself, of the thread that calls the FMU. What the loader alone writes is left out.
 * Thread:  that of the FMUs.
 */

enum { TL_FMU_REGIONS = 64 };

typedef struct tl_fmu_region {
    unsigned char *begin;
    size_t size;
    bool has_pages; /* of its own: nothing else lies in them; not so for a thread's variables */
} tl_fmu_region;

typedef struct tl_fmu_regions {
    size_t count;
    size_t bytes; /* of all */
    tl_fmu_region place[TL_FMU_REGIONS];
} tl_fmu_regions;

/* Libraries that this process has opened so far: if there are more, places may have come. */
unsigned long long tl_fmu_regions_opened(void);

/* Of all libraries that are loaded now from `folder`, an absolute path without links in it, or from folders below it. Thread-local variables of this
 * thread exist from then on. Errors: TL_FMU_FAILED: there are more than TL_FMU_REGIONS. */
tl_status tl_fmu_regions_find(const char *folder, tl_fmu_regions *places, tl_error *error);

/* ---- Which pages of memory were written since somebody looked.
 *
 * Purpose: of an FMU's megabytes a step changes a few pages, and only those need to be copied. The kernel knows which, if it is Linux 6.7 or newer: it takes
 *          note of the first write to a page, and tells and forgets in one go (PAGEMAP_SCAN, userfaultfd's asynchronous write protection). Nobody waits for
 *          anybody, and a system call may write there as well.
 * Rights:  two descriptors, which must be opened before a process gives up its rights; after that these are used by ioctl() only.
 * Without: tl_fmu_written_serves() is false on an older kernel, in an emulator, or if it is not allowed. Then whoever asks compares.
 * Thread:  one at a time.
 */

enum { TL_FMU_PAGE = 4096 };

/* Opens what is needed, and tries it; once in a process. */
void tl_fmu_written_begin(void);

/* Whether there is a kernel that tells; begins if nobody has. */
bool tl_fmu_written_serves(void);

/* ---- Versions of much memory, of which little differs: what is the same in several of them is kept once.
 *
 * Purpose: a state of a large FMU (fmu_memory.h). To save it costs what was written since the last time, to go back to one what differs, and not
 *          what there is: some megabytes of tables are of the same value in all states.
 * Found:   what was written, by the kernel (fmu_pages.h); if it does not tell, by comparing all with the last version, which writes nothing and keeps as little.
 * Ranges:  whole pages; all but the last are fixed, the last may be used up to another place in each version.
 * Order:   any; versions are equals, none depends on another one.
 * Memory:  reserved for versions to come (tl_fmu_pages_reserve()); if they differ in more than versions did until then, it grows by pieces of 1 MiB. Given back with the last version.
 * Thread:  one at a time.
 */

typedef struct tl_fmu_pages tl_fmu_pages;

/* Zeroed: none. Fields are private. */
typedef struct tl_fmu_version {
    size_t pages;   /* of all ranges, up to where the last one is used */
    size_t leaves;  /* groups of pages, */
    size_t room;    /* for which there is room */
    uint32_t *leaf; /* each a slot with the slots of its pages */
} tl_fmu_version;

/* Of these ranges, at most TL_FMU_REGIONS + 1, whose beginnings and sizes are multiples of a page but for the size of the last. It is there until the process
 * ends. NULL: TL_TRY_AGAIN. */
tl_fmu_pages *tl_fmu_pages_open(const tl_fmu_region *ranges, size_t count, tl_error *error);

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
void tl_fmu_pages_remeasure(tl_fmu_pages *self);

/* Nor does what is saved and restored while it passes. */
void tl_fmu_pages_pass(tl_fmu_pages *self, bool passes);

/* Memory for so many versions more, each of which differs in as many pages as were seen to, and for the list of one of them, which has none yet. After one was saved. False: there is none. */
bool tl_fmu_pages_reserve(tl_fmu_pages *self, size_t versions);
bool tl_fmu_pages_reserve_version(const tl_fmu_pages *self, tl_fmu_version *version);

#endif
