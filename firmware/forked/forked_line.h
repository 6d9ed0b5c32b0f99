/* The twin's end of the processes of one FMU: asks the one that goes on, saves by having it forked, restores by forking a snapshot.
 *
 * Purpose: a *snapshot* is a process that waits. To save is to let the process of the FMU fork one; to restore is to let a snapshot fork one that goes on,
 *          and to end the one that went on before. Who ends is reaped by the keeper (forked_pool.h): nobody waits for that.
 * Failure: a process that has ended is told with how, and in which function the FMU was. If it was the one that goes on, there is nobody
 *          to ask any more until a snapshot is restored.
 * Memory:  all of it is there when the processes are begun.
 * Thread:  that of the FMUs.
 */
#ifndef TL_FIRMWARE_FORKED_FORKED_LINE_H
#define TL_FIRMWARE_FORKED_FORKED_LINE_H

#include "firmware/forked/forked_block.h"
#include "master/base/status.h"

enum { TL_FORKED_NAME = 64 };

/* What the twin thinks of a slot. */
typedef enum tl_forked_use { TL_FORKED_FREE, TL_FORKED_USED, TL_FORKED_ENDING } tl_forked_use;

typedef struct tl_forked_snapshot {
    uint32_t slot;
    bool used;
} tl_forked_snapshot;

/* What a handle of an instance is in the twin. */
typedef struct tl_forked_instance {
    struct tl_forked_line *line;
    uint32_t number;
    bool used;
} tl_forked_instance;

/* Fields are private. */
typedef struct tl_forked_line {
    tl_forked_block *block;
    pid_t keeper;
    int alive;       /* a descriptor that is closed when this process ends; then the keeper ends all */
    bool is_refused; /* the FMU cannot be forked; it was said */
    uint32_t slot_count;
    uint32_t current; /* the slot that goes on */
    uint32_t next;    /* where a free slot is looked for first */
    uint32_t number;  /* of the last request */
    uint32_t snapshot_count;
    tl_forked_use *uses;           /* of slots */
    tl_forked_snapshot *snapshots; /* handles */
    uint32_t most;                 /* snapshots that its user may have: some more are kept for what is asked beside */
    tl_forked_instance instances[TL_FORKED_INSTANCES];
    char name[TL_FORKED_NAME];   /* of the FMU, for what is said */
    char failure[TL_ERROR_TEXT]; /* the first that was said, behind its name: "has a thread, …"; "": nothing was */
    uint32_t
        touched; /* pages that the FMU's process has begun to use for itself between the last save and what was before it, a save or a restore */
} tl_forked_line;

/* For who begins the processes: the first of them is in slot 0. Errors: TL_TRY_AGAIN. */
tl_status tl_forked_line_open(uint32_t snapshots, tl_forked_line *line, tl_error *error);

/* All of its processes end, and are gone when this returns. */
void tl_forked_line_close(tl_forked_line *line);

/* The request that is in line->block->message but for its number: waits for the answer, which is there then. TL_FMU_FATAL: the process has ended
 * instead; it was said on the log. */
tl_status tl_forked_line_ask(tl_forked_line *line, uint32_t function);

/* What the FMU is now, in *snapshot, which is used again unless it is NULL. TL_FMU_FAILED: there are no more, or no process could be made; it was said, and
 * *snapshot is as it was. TL_FMU_FATAL as above. */
tl_status tl_forked_line_save(tl_forked_line *line, tl_forked_snapshot **snapshot);

/* Back to it. The same errors; then the FMU is where it was. TL_FMU_FATAL: the snapshot has ended. */
tl_status tl_forked_line_restore(tl_forked_line *line, const tl_forked_snapshot *snapshot);

/* It is not wanted any more. */
void tl_forked_line_forget(tl_forked_line *line, tl_forked_snapshot *snapshot);

#endif
