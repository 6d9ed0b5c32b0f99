/* What an FMU has that a fork does not copy, looked for by the FMU's own process.
 *
 * Purpose: as rollback/fmu_traces.h, for a process whose Landlock lets it read nothing of itself in /proc once it was forked: so descriptors are asked for by their
 *          numbers, and threads by the links of a folder, which anybody may see. Shared mappings are seen by the first process only, which may read.
 * Cost:    threads a µs or two; all of it some hundred.
 * Thread:  the only one of the FMU's process.
 */
#ifndef TL_FIRMWARE_FORKED_FORKED_TRACES_H
#define TL_FIRMWARE_FORKED_FORKED_TRACES_H

#include <stdbool.h>
#include <stdint.h>

enum { TL_FORKED_DESCRIPTORS = 1024, TL_FORKED_TRACE_TEXT = 160 };

typedef struct tl_forked_traces {
    unsigned shared; /* mappings that other processes share, and that may be written; 0 also if nobody may look */
    bool has_children;
    uint64_t descriptors[TL_FORKED_DESCRIPTORS / 64];
} tl_forked_traces;

bool tl_forked_has_threads(void);

void tl_forked_traces_look(tl_forked_traces *traces);

/* True: something is there that was not; `text` names it, as in "an open file or socket, /tmp/log". */
bool tl_forked_traces_differ(const tl_forked_traces *before, const tl_forked_traces *after,
                             char text[TL_FORKED_TRACE_TEXT]);

#endif
