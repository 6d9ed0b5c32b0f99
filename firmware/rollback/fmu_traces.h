/* What an FMU leaves behind a call that no copy of its memory takes back.
 *
 * Purpose: a thread, a child, an open file or socket: the kernel keeps these, and they are as they are, whatever is restored. So an FMU that has any is not
 *          rolled back by its memory; which one it was is told. Memory that it maps itself is seen where it asks for it (fmu_heap.h).
 * Seen:    what is there after a call and was not before. A file that is opened and closed within one call leaves nothing, and may be
 *          written all the same.
 * Limits:  what other threads of the process do at the same time is taken for the FMU's.
 * Cost:    some hundred µs a look.
 * Thread:  any, one at a time.
 */
#ifndef TL_FIRMWARE_ROLLBACK_FMU_TRACES_H
#define TL_FIRMWARE_ROLLBACK_FMU_TRACES_H

#include <stdbool.h>
#include <stdint.h>

enum { TL_FMU_TRACES_DESCRIPTORS = 1024, TL_FMU_TRACE_TEXT = 160 };

typedef struct tl_fmu_traces {
    unsigned long threads;
    bool has_children;
    uint64_t descriptors[TL_FMU_TRACES_DESCRIPTORS / 64];
} tl_fmu_traces;

void tl_fmu_traces_look(tl_fmu_traces *traces);

/* True: something is there that was not; `text` names it, as in "a thread", "an open file, /tmp/log". */
bool tl_fmu_traces_differ(const tl_fmu_traces *before, const tl_fmu_traces *after, char text[TL_FMU_TRACE_TEXT]);

#endif
