/* What the processes of a live run have from their supervisor: their job, and memory that they share.
 *
 * Thread:  as each part says.
 */
#ifndef TL_FIRMWARE_LIVE_LIVE_BLOCKS_H
#define TL_FIRMWARE_LIVE_LIVE_BLOCKS_H

#include <limits.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/base/os.h"
#include "firmware/config/config.h"
#include "firmware/live/live_wire.h"
#include "firmware/live/restarts.h"
#include "firmware/plant/plant_input.h"
#include "firmware/process/block.h"

/* ---- The job of a process of a run: what it is told at its start, besides the shared memory that it gets.
 *
 * Purpose: no process but the supervisor reads the configuration's file or the command line. A process that is begun again is told the same
 *          text, whatever the file says by then.
 * Trust:   the supervisor's word, in memory that nobody can change.
 * Thread:  plain data.
 */

/* The same for all of them, but what is said of a start. No pointers. */
typedef struct tl_live_job {
    bool alone;              /* nobody supervises the run */
    bool unconfined;         /* FMUs may do what the user can */
    tl_time duration;        /* that was asked for; 0: as configured */
    char database[PATH_MAX]; /* "": nothing is recorded */
    char state[PATH_MAX];    /* of the activator: where versions are kept; "": there is none */
    char allowed[PATH_MAX];  /* the same: the administrator's list of names */
    uint64_t memory_limit;   /* the same: bytes that a process of FMUs may take; 0: as usual */
    uint32_t place; /* of the twin; of the twin that the recorder reads; of the run's twin when the activator begins */
    char hash[TL_LIVE_PLACES][TL_SHA256_TEXT]; /* of the activator: of the configuration in each place; "": none is */
    /* of the twin's start */
    uint32_t number; /* of this start, from 1 on */
    bool is_shadow;  /* it is not the run's twin, until a flip makes it that, */
    tl_time start;   /* and t_start of the run beside which it runs (CLOCK_MONOTONIC), */
    int64_t started; /* and UTC, ms */
    uint32_t flips;  /* the newest flip that was announced before; of the recorder: by which the run came here */
    tl_start how;    /* if it waits in safe hold `start` is when that began, and samples are recorded from then on */
} tl_live_job;

/* For all but the twin: with path and text of the configuration behind it. Errors: TL_TRY_AGAIN. */
tl_status tl_live_job_make(const tl_live_job *job, const char *path, const char *text, tl_block *block,
                           tl_error *error);

/* Of a twin: what tl_twin_job.live holds. With the text of the run's configuration, for a shadow; else "". To free(); NULL: memory is out. */
unsigned char *tl_live_job_pack(const tl_live_job *job, const char *of_run, size_t *size);

/* There: the text lies in `bytes`. Errors: TL_BAD_DATA. */
tl_status tl_live_job_unpack(const unsigned char *bytes, size_t size, tl_live_job *job, const char **of_run,
                             tl_error *error);

/* There: takes it, and reads the configuration as all the others do. `block` must stay. Errors: TL_BAD_DATA, TL_TRY_AGAIN. */
tl_status tl_live_job_take(int descriptor, tl_block *block, tl_live_job *job, tl_config *config, tl_error *error);

/* A configuration that was read before, as this process has it. To be freed. Errors: TL_BAD_DATA, TL_TRY_AGAIN. */
tl_status tl_live_job_read(const tl_live_job *job, const char *path, const char *text, tl_config *config,
                           tl_error *error);

/* What changes the configuration by the command line; look-ups are in use then. */
void tl_live_job_apply(const tl_live_job *job, tl_config *config);

/* ---- Which process of a run has which blocks (live_wire.h): asked by the supervisor, which gives them, and by the process, which takes them.
 *
 * Trust:   the mail is io's: what is in it is judged by who looks it up. A block of another size than it should have is not taken.
 * Thread:  any.
 */

typedef enum tl_live_kind { TL_LIVE_IS_IO, TL_LIVE_IS_RECORDER, TL_LIVE_IS_ACTIVATOR, TL_LIVE_IS_TWIN } tl_live_kind;

/* Bits by the number of the block. */
typedef struct tl_live_access {
    uint32_t reads;
    uint32_t writes;
} tl_live_access;

/* Those of the job's place; of a run that records or not, as the job says. */
tl_live_access tl_live_access_of(tl_live_kind kind, const tl_live_job *job);

/* Bytes of each block; an outbox is that of a twin of this configuration, whose second look-ups are signals. */
void tl_live_block_sizes(const tl_config *config, size_t sizes[TL_LIVE_BLOCKS]);

/* Takes all blocks of this process. `blocks` is zeroed before; what the process does not have stays so. Errors: TL_BAD_DATA. */
tl_status tl_live_blocks_take(tl_live_kind kind, const tl_live_job *job, const tl_config *config,
                              tl_block blocks[TL_LIVE_BLOCKS], tl_error *error);

/* Samples of the plant by the mail that was taken. Errors: TL_TRY_AGAIN. */
tl_status tl_live_input_open(const tl_config *config, const tl_block *mail, tl_plant_input *input, tl_error *error);

/* ---- What the processes of a run share of the machine's memory: how much, and what for. For who tells it before anything runs.
 *
 * Purpose: the sizes are those by which the tree makes the memory (live_wire.h). A page takes memory once it is used: of checkpoints and the past that
 *          are those which a twin of this size fills.
 * Thread:  pure.
 */

/* Bytes. */
typedef struct tl_live_blocks {
    size_t mail;        /* the plant's newest readings */
    size_t outbox;      /* what waits for the recorder, and what the processes say of themselves */
    size_t checkpoints; /* saved twins, as many as there is room for at a time; 0: none are saved */
    size_t past;        /* what a new twin goes on from; at most, and only until it has begun. 0: it never does */
    size_t shadow;      /* what another twin of this size has beside all that, while it runs as a shadow; at most */
} tl_live_blocks;

/* Of a twin that is saved in so many bytes; 0: it is not. `config` is one whose second look-ups are signals. */
void tl_live_blocks_of(const tl_config *config, size_t checkpoint, tl_live_blocks *blocks);

/* ---- Recorded samples for a shadow: the side of the recorder, which alone reads the database of a run.
 *
 * Purpose: the shadow says in its pulse from which tick on it wants samples; the recorder finds them, and puts them into the past block of its place
 *          (past.h).
 * Trust:   none in the shadow: it gets what is recorded, and at most what the block has room for.
 * Thread:  the recorder's. What is pointed to must stay.
 */

typedef struct tl_live_samples {
    const tl_live_twin_pulse *pulse; /* of the twin in the other place, which it writes */
    tl_live_past_answer *answer;     /* of the recorder, to it */
    tl_block *past;                  /* for it; the recorder writes */
    const char *boot;                /* tl_identity_boot() */
    /* private, zeroed at first */
    tl_live_wish answered;
    bool is_filled;
} tl_live_samples;

/* Answers the newest wish with what is in the database at `path`, if there is one that was not answered; gives the memory back once nobody wants
 * any more. */
void tl_live_samples_look(tl_live_samples *self, const char *path);

#endif
