/* Which pages of memory were written since somebody looked.
 *
 * Purpose: of an FMU's megabytes a step changes a few pages, and only those need to be copied. The kernel knows which, if it is Linux 6.7 or newer: it takes
 *          note of the first write to a page, and tells and forgets in one go (PAGEMAP_SCAN, userfaultfd's asynchronous write protection). Nobody waits for
 *          anybody, and a system call may write there as well.
 * Rights:  two descriptors, which must be opened before a process gives up its rights; after that these are used by ioctl() only.
 * Without: tl_fmu_written_serves() is false on an older kernel, in an emulator, or if it is not allowed. Then whoever asks compares.
 * Thread:  one at a time.
 */
#ifndef TL_FIRMWARE_ROLLBACK_FMU_WRITTEN_H
#define TL_FIRMWARE_ROLLBACK_FMU_WRITTEN_H

#include <stdbool.h>
#include <stddef.h>

enum { TL_FMU_PAGE = 4096 };

/* Opens what is needed, and tries it; once in a process. */
void tl_fmu_written_begin(void);

/* Whether there is a kernel that tells; begins if nobody has. */
bool tl_fmu_written_serves(void);

/* From now on this range is taken note of: whole pages of private memory, for good. False: it cannot be. */
bool tl_fmu_written_watch(const unsigned char *begin, size_t size);

/* So many pages from this one on were written. */
typedef void tl_fmu_written_take(void *context, size_t first, size_t count);

/* Tells of all pages of a range that is watched, or of a part of it, which were written since they were forgotten last, in order; with `forget`
 * they are not written any more. False: it could not be told of all. */
bool tl_fmu_written_find(const unsigned char *begin, size_t size, bool forget, tl_fmu_written_take *take,
                         void *context);

#endif
