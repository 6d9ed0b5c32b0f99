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

#include "firmware/base/identity.h"
#include "firmware/base/os.h"
#include "firmware/config/config.h"
#include "firmware/live/restarts.h"
#include "firmware/monitor/run_status.h"
#include "firmware/plant/plant_input.h"
#include "firmware/process/block.h"
#include "firmware/process/heartbeat.h"
#include "firmware/report/summary.h"
#include "firmware/store/record_queue.h"
#include "firmware/store/recorder_state.h"
#include "firmware/twin/handover.h"
#include "firmware/twin/live_tuning.h"
#include "firmware/twin/resume.h"

/* ---- What crosses between the processes of a run: which shared memory there is, who writes it, what lies in it, which descriptor it has where.
 *
 * Purpose: all processes must mean the same. Sizes follow from the configuration, which each has read from the same text.
 * Trust:   every block has one writer. Whoever reads it believes nothing of it that its writer could have made up: io is in the hands of
 *          whoever sits on the plant's network, the recorder in those of who wrote the database, the twin in those of its FMUs.
 */

/* Blocks of shared memory, by the number of their descriptor, which is the same in every process of the run that has the block (live_blocks.h). Descriptor 0
 * is nothing, 1 and 2 are what is logged. Every process with FMUs has its job and its start socket where twin_role.h says. */
enum {
    TL_LIVE_KNOCKER = 3,          /* no block: the control socket, of the activator */
    TL_LIVE_JOB = 4,              /* tl_live_job */
    TL_LIVE_MAIL = 5,             /* what io reads of the plant (sample_buffer.h) */
    TL_LIVE_IO_BEATS = 6,         /* tl_heartbeats */
    TL_LIVE_RECORDER_PULSE = 8,   /* tl_live_recorder_pulse */
    TL_LIVE_CONFIG_MANAGER_PULSE, /* tl_live_config_manager_pulse */
    TL_LIVE_IO_EVENTS,            /* outboxes */
    TL_LIVE_SUPERVISOR_EVENTS,
    TL_LIVE_CONFIG_MANAGER_EVENTS,
    TL_HANDOVER,       /* tl_handover, which the supervisor writes */
    TL_LIVE_CANDIDATE, /* tl_live_candidate */
    /* Of place 0; the next number is of place 1. */
    TL_LIVE_TWIN_PULSE,                                  /* tl_live_twin_pulse */
    TL_LIVE_TUNING = TL_LIVE_TWIN_PULSE + TL_TWIN_SLOTS, /* tl_live_tuning */
    TL_LIVE_PAST = TL_LIVE_TUNING + TL_TWIN_SLOTS,       /* what a new twin goes on from (resume.h) */
    TL_LIVE_QUEUE = TL_LIVE_PAST + TL_TWIN_SLOTS,        /* the twin's */
    TL_LIVE_BLOCKS = TL_LIVE_QUEUE + TL_TWIN_SLOTS
};

/* Which outbox is which, for the recorder. */
enum {
    TL_LIVE_QUEUE_TWIN, /* in place 0; the next one is of place 1 */
    TL_LIVE_QUEUE_IO = TL_TWIN_SLOTS,
    TL_LIVE_QUEUE_SUPERVISOR,
    TL_LIVE_QUEUE_ACTIVATOR,
    TL_LIVE_QUEUES
};

/* Bytes that a checkpoint may have, and the past that a cold start goes on from. Their memory is there only as far as it is used. */
#define TL_LIVE_CHECKPOINT_BYTES ((size_t)32 * 1024 * 1024)
#define TL_LIVE_PAST_BYTES TL_RESUME_MOST

/* The end of a run, as the twin tells it: for the summary. */
typedef struct tl_live_end {
    uint32_t is_there; /* 1: all of this is */
    tl_summary summary;
    tl_account account;
} tl_live_end;

/* A number that a process counts up, and what it belongs to: which twin, which try. In one word, so that it is read whole. */
typedef uint64_t tl_live_wish;

static inline tl_live_wish tl_live_wish_of(uint32_t twin, uint32_t number) {
    return (uint64_t)twin << 32 | number;
}

/* Why a twin has no FMUs: safe hold, or the run's first twin may not begin yet. */
enum { TL_LIVE_HOLDS = 1, TL_LIVE_WAITS = 2 };

/* The pulse of the twin. Heartbeats come first in every pulse. */
typedef struct tl_live_twin_pulse {
    tl_heartbeats beats;
    uint32_t number;             /* which twin of this place it is, from 1 on, */
    uint32_t first;              /* which was the first of its configuration, */
    uint32_t holds;              /* and whether it holds: 0, TL_LIVE_HOLDS or TL_LIVE_WAITS; all by the supervisor */
    tl_latest figures;           /* tl_run_status; nothing while it holds */
    int32_t realtime;            /* number of the thread that wants the configured priority; 0: none does */
    uint32_t begun;              /* 1: it needs no past any more */
    uint64_t fmus;               /* the files of its FMUs, as a number; kept for a successor. 0: there was none */
    char digest[TL_SHA256_TEXT]; /* of what is in them; there before it wishes for a past */
    uint32_t loads;       /* 1: a checkpoint was loaded, and too few steps prove it harmless; kept for a successor */
    uint64_t unreadable;  /* by the supervisor: `fmus` whose saved state has ended the process that loaded it */
    tl_live_wish resume;  /* which past it wants: the first, the next older one, …; of a shadow: which samples, */
    int64_t past_from;    /* from this tick on; written before `resume` */
    tl_time start;        /* t_start of its run (CLOCK_MONOTONIC), */
    int64_t started;      /* and UTC, ms; before it is ready. 0: not known yet */
    uint32_t handed_over; /* number of the newest flip in which it has done its part */
    tl_live_tuning_answer tuned; /* what it made of the newest tuning that it was told; kept for who waits for that */
    tl_live_end end;
} tl_live_twin_pulse;

/* What is to be told about a past. */
typedef struct tl_live_past_word {
    int32_t severity; /* tl_severity */
    char text[TL_RESUME_TEXT];
} tl_live_past_word;

enum { TL_LIVE_PAST_WORDS = 8 };

/* What came of a wish for a past. All else is there before the wish is. */
typedef struct tl_live_past_answer {
    tl_live_wish wish;
    uint64_t size;                               /* bytes in the block; 0: there is none (any more) */
    tl_time ended;                               /* tl_resume_history_ended() */
    tl_live_past_word words[TL_LIVE_PAST_WORDS]; /* to the first without a text */
} tl_live_past_answer;

/* The pulse of the recorder. */
typedef struct tl_live_recorder_pulse {
    tl_heartbeats beats;
    tl_time damaged[TL_LIVE_QUEUES]; /* tl_recorder_writer_damage() of each */
    uint32_t drained; /* the newest flip before which all is written of the twin whose run it has ended */
    tl_recorder_writer_state state;
    tl_live_past_answer answer[TL_TWIN_SLOTS]; /* of the twin in each place */
} tl_live_recorder_pulse;

/* The pulse of the activator. */
typedef struct tl_live_config_manager_pulse {
    tl_heartbeats beats;
    uint32_t restart; /* 1: the run is to end, and another one to begin */
    tl_live_order order;
    uint32_t handovers; /* the activator's own: number of the newest flip when it ordered one */
} tl_live_config_manager_pulse;

/* Events only. */
static inline tl_record_queue_settings tl_live_event_queue(void) {
    return (tl_record_queue_settings){.ring_bytes = 0};
}

static inline tl_record_queue_settings tl_live_queue_of_shape(const tl_recorder_shape *shape, tl_time step) {
    return (tl_record_queue_settings){.shape = *shape,
                                      .ring_bytes = tl_record_queue_ring_bytes(shape, step),
                                      .checkpoint_bytes = TL_LIVE_CHECKPOINT_BYTES};
}

static inline tl_record_queue_settings tl_live_twin_queue(const tl_config *config) {
    const tl_recorder_shape shape = tl_recorder_shape_of(config);
    return tl_live_queue_of_shape(&shape, config->step);
}

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
    char hash[TL_TWIN_SLOTS][TL_SHA256_TEXT]; /* of the activator: of the configuration in each place; "": none is */
    /* of the twin's start */
    uint32_t number;    /* of this start, from 1 on */
    bool is_shadow;     /* it is not the run's twin, until a flip makes it that, */
    tl_time start;      /* and t_start of the run beside which it runs (CLOCK_MONOTONIC), */
    int64_t started;    /* and UTC, ms */
    uint32_t handovers; /* the newest flip that was announced before; of the recorder: by which the run came here */
    tl_start how;       /* if it waits in safe hold `start` is when that began, and samples are recorded from then on */
} tl_live_job;

/* The job, then the path of the configuration, then its text; for a twin, the text of the run's configuration if it is a shadow, else "". To
 * free(). NULL: memory is out. */
unsigned char *tl_live_job_pack(const tl_live_job *job, const char *path, const char *text, size_t *size);

/* Reads what pack() made; path and text lie in `bytes`. Errors: TL_BAD_DATA. */
tl_status tl_live_job_unpack(const void *bytes, size_t size, tl_live_job *job, const char **path, const char **text,
                             tl_error *error);

/* Of all but the twin: takes the block with the job, and reads the configuration as all the others do. `block` must stay. Errors: TL_BAD_DATA, TL_TRY_AGAIN. */
tl_status tl_live_job_take(int descriptor, tl_block *block, tl_live_job *job, tl_config *config, tl_error *error);

/* A configuration that was read before, as this process has it. To be freed. Errors: TL_BAD_DATA, TL_TRY_AGAIN. */
tl_status tl_live_job_read(const tl_live_job *job, const char *path, const char *text, tl_config *config,
                           tl_error *error);

/* What changes the configuration by the command line; look-ups are in use then. */
void tl_live_job_apply(const tl_live_job *job, tl_config *config);

/* ---- Which process of a run has which blocks: asked by the supervisor, which gives them, and by the process, which takes them.
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
tl_status tl_live_input_open(const tl_config *config, const tl_block *sample_memory, tl_plant_input *input,
                             tl_error *error);

/* ---- What the processes of a run share of the machine's memory: how much, and what for. For who tells it before anything runs.
 *
 * Purpose: the sizes are those by which the tree makes the memory. A page takes memory once it is used: of checkpoints and the past that
 *          are those which a twin of this size fills.
 * Thread:  pure.
 */

/* Bytes. */
typedef struct tl_live_blocks {
    size_t sample_memory; /* the plant's newest readings */
    size_t queue;         /* what waits for the recorder, and what the processes say of themselves */
    size_t checkpoints;   /* saved twins, as many as there is room for at a time; 0: none are saved */
    size_t resume;        /* what a new twin goes on from; at most, and only until it has begun. 0: it never does */
    size_t shadow;        /* what another twin of this size has beside all that, while it runs as a shadow; at most */
} tl_live_blocks;

/* Of a twin that is saved in so many bytes; 0: it is not. `config` is one whose second look-ups are signals. */
void tl_live_blocks_of(const tl_config *config, size_t checkpoint, tl_live_blocks *blocks);

/* ---- Recorded samples for a shadow: the side of the recorder, which alone reads the database of a run.
 *
 * Purpose: the shadow says in its pulse from which tick on it wants samples; the recorder finds them, and puts them into the past block of its place
 *          (resume.h).
 * Trust:   none in the shadow: it gets what is recorded, and at most what the block has room for.
 * Thread:  the recorder's. What is pointed to must stay.
 */

typedef struct tl_live_samples {
    const tl_live_twin_pulse *pulse; /* of the twin in the other place, which it writes */
    tl_live_past_answer *answer;     /* of the recorder, to it */
    tl_block *resume;                /* for it; the recorder writes */
    const char *boot;                /* tl_identity_boot() */
    /* private, zeroed at first */
    tl_live_wish answered;
    bool is_filled;
} tl_live_samples;

/* Answers the newest wish with what is in the database at `path`, if there is one that was not answered; gives the memory back once nobody wants
 * any more. */
void tl_live_samples_look(tl_live_samples *self, const char *path);

#endif
