/* Shared memory and jobs of the processes of a live run.
 *
 * Purpose: the supervisor creates the shared memory blocks and the job of each process. Each
 *          process maps its blocks and reads its job.
 * Memory:  the supervisor allocates all blocks; a block outlives each process that writes it.
 * Errors:  each function states its own.
 * Thread:  each part states its own.
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
#include "firmware/process/role.h"
#include "firmware/report/summary.h"
#include "firmware/store/record_queue.h"
#include "firmware/store/recorder_state.h"
#include "firmware/twin/handover.h"
#include "firmware/twin/live_tuning.h"
#include "firmware/twin/resume.h"

/* ---- Blocks: which shared memory exists, which process writes it, its content, its descriptor.
 *
 * Purpose: all processes use the same definitions. Each process computes the sizes from the
 *          configuration, which all of them have read from the same text.
 * Trust:   every block has one writer. A reader validates all content that a faulty or hostile
 *          writer could forge: io is exposed to the plant's network, the recorder to the database
 *          file, and the twin to its FMUs.
 */

/* Descriptor numbers of the blocks. A block has the same number in each process that has it.
 * Descriptor 0 is /dev/null; 1 and 2 are the log. For processes with FMUs, twin_role.h gives the
 * numbers of job and start socket. */
enum {
    TL_LIVE_CLIENT = 3,            /* not a block: control socket of the config manager */
    TL_LIVE_JOB = 4,               /* tl_live_job */
    TL_LIVE_SAMPLES = 5,           /* sample memory: all sample buffers (sample_buffer.h), written by io */
    TL_LIVE_IO_BEATS = 6,          /* tl_heartbeats */
    TL_LIVE_RECORDER_STATUS = 8,   /* tl_live_recorder_status */
    TL_LIVE_CONFIG_MANAGER_STATUS, /* tl_live_config_manager_status */
    TL_LIVE_IO_EVENTS,             /* record queues */
    TL_LIVE_SUPERVISOR_EVENTS,
    TL_LIVE_CONFIG_MANAGER_EVENTS,
    TL_HANDOVER,       /* tl_handover, written by the supervisor */
    TL_LIVE_CANDIDATE, /* tl_live_candidate */
    /* Each name is the number for twin slot 0. The next number is that for slot 1. */
    TL_LIVE_TWIN_STATUS,                                  /* tl_live_twin_status */
    TL_LIVE_TUNING = TL_LIVE_TWIN_STATUS + TL_TWIN_SLOTS, /* tl_live_tuning */
    TL_LIVE_RESUME = TL_LIVE_TUNING + TL_TWIN_SLOTS,      /* resume block of a new twin (resume.h) */
    TL_LIVE_QUEUE = TL_LIVE_RESUME + TL_TWIN_SLOTS,       /* record queue of the twin */
    TL_LIVE_BLOCKS = TL_LIVE_QUEUE + TL_TWIN_SLOTS
};

/* Indices of the record queues, for the recorder. */
enum {
    TL_LIVE_QUEUE_TWIN, /* for twin slot 0; the next index is that for slot 1 */
    TL_LIVE_QUEUE_IO = TL_TWIN_SLOTS,
    TL_LIVE_QUEUE_SUPERVISOR,
    TL_LIVE_QUEUE_CONFIG_MANAGER,
    TL_LIVE_QUEUES
};

/* Largest size in bytes of a checkpoint, and of the content of a resume block (resume.h). Pages
 * take memory only when they are used. */
#define TL_LIVE_CHECKPOINT_BYTES ((size_t)32 * 1024 * 1024)
#define TL_LIVE_RESUME_BYTES TL_RESUME_MOST

/* Results of a run, written by the twin at its end, for the summary. */
typedef struct tl_live_end {
    uint32_t is_there; /* 1: all fields are valid */
    tl_summary summary;
    tl_account account;
} tl_live_end;

/* Request number: the number of the twin process in the upper 32 bits, a counter in the lower. One
 * integer, so that a reader gets both at once. */
typedef uint64_t tl_live_request;

static inline tl_live_request tl_live_request_of(uint32_t twin, uint32_t number) {
    return (uint64_t)twin << 32 | number;
}

/* Why a twin process has no FMUs: safe hold (HOLDS), or the first twin of the run may not start yet
 * (WAITS). */
enum { TL_LIVE_HOLDS = 1, TL_LIVE_WAITS = 2 };

/* Status block of a twin. The twin writes all fields except those marked "by the supervisor". The
 * next process in the slot uses the fields marked "kept". Before each start the supervisor resets
 * `beats`, `realtime`, `begun`, `resume`, `start` and `end`. Heartbeats are the first field of
 * every status block. */
typedef struct tl_live_twin_status {
    tl_heartbeats beats;
    uint32_t number;             /* by the supervisor: number of the twin process in this slot, from 1; kept */
    uint32_t first;              /* by the supervisor: the first such number; number - first counts failures; kept */
    uint32_t holds;              /* by the supervisor: TL_LIVE_HOLDS, TL_LIVE_WAITS, or 0: the process has FMUs */
    tl_latest figures;           /* tl_run_status; empty in safe hold */
    int32_t realtime;            /* kernel's id of the thread that needs the configured real-time priority; 0: none */
    uint32_t begun;              /* 1: the twin does not need resume data any more */
    uint64_t fmus;               /* identity number of its FMU files (identity.h), not their count; 0: none; kept */
    char digest[TL_SHA256_TEXT]; /* SHA-256 of the content of the FMU files; set before a request; kept */
    uint32_t loads;              /* 1: it loads a checkpoint, or has not made enough steps since to trust it; kept */
    uint64_t unreadable;    /* by the supervisor: `fmus` of a process that ended while `loads` was 1; 0: none; kept */
    tl_live_request resume; /* newest request for resume data; of a shadow: for samples; 0: none */
    int64_t resumed_from;   /* shadow: first tick of the requested samples; written before `resume` */
    tl_time start;          /* t_start of its run (CLOCK_MONOTONIC), also for io; 0: not known yet */
    int64_t started;        /* the same in UTC, ms since 1970; both are set before the twin is ready */
    uint32_t handed_over;   /* newest handover that this twin has completed */
    tl_live_tuning_answer tuned; /* answer to the newest tuning; kept for the config manager */
    tl_live_end end;
} tl_live_twin_status;

/* A message about resume data, to be logged by the twin. */
typedef struct tl_live_resume_word {
    int32_t severity; /* tl_severity */
    char text[TL_RESUME_TEXT];
} tl_live_resume_word;

enum { TL_LIVE_RESUME_WORDS = 8 };

/* Answer to a request. All other fields are written before `live_request`. */
typedef struct tl_live_resume_answer {
    tl_live_request live_request;
    uint64_t size;                                   /* bytes in the resume block; 0: nothing found */
    tl_time ended;                                   /* result of tl_resume_history_ended() (resume.h), ns */
    tl_live_resume_word words[TL_LIVE_RESUME_WORDS]; /* valid up to the first one with an empty text */
} tl_live_resume_answer;

/* Status block of the recorder. */
typedef struct tl_live_recorder_status {
    tl_heartbeats beats;
    tl_time damaged[TL_LIVE_QUEUES]; /* tl_recorder_writer_damage() of each record queue */
    uint32_t drained;                /* newest handover for which the old record queue is recorded to its end */
    uint32_t open_findings;          /* of the change detector */
    uint32_t explanations;           /* number of explanations that have become due so far (live_detection.h) */
    uint32_t due_finding;            /* number of the finding that the newest of them explains */
    tl_recorder_writer_state state;
    tl_live_resume_answer answer[TL_TWIN_SLOTS]; /* to the twin in each slot */
} tl_live_recorder_status;

/* Status block of the config manager. */
typedef struct tl_live_config_manager_status {
    tl_heartbeats beats;
    uint32_t restart; /* 1: end this run and start another one */
    tl_live_order order;
    uint32_t handovers; /* only for the config manager: number of handovers when it last ordered one */
} tl_live_config_manager_status;

/* Return the settings of a record queue: for events only; for a twin with this shape and this T_S
 * (ns); for a twin of this configuration. */
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

/* ---- Job: what the supervisor passes to a process at its start, besides shared memory.
 *
 * Purpose: only the supervisor reads the configuration file and the command line. A restarted
 *          process gets the same text, even if the file has changed.
 * Trust:   written by the supervisor, in memory that no process can change.
 * Thread:  plain data.
 */

/* The first fields are the same for all processes; the last ones belong to the start of one
 * process. Contains no pointers. */
typedef struct tl_live_job {
    bool unsupervised;       /* the run is not supervised */
    bool unconfined;         /* FMUs have all rights of the user */
    tl_time duration;        /* ns; duration of the command line; 0: as configured */
    char database[PATH_MAX]; /* "": nothing is recorded */
    char state[PATH_MAX];    /* config manager: folder of the versions; "": none */
    char allowed[PATH_MAX];  /* config manager: administrator's list of names */
    uint64_t memory_limit;   /* config manager: bytes for an FMU process; 0: default */
    uint32_t slot_index;     /* twin: its own slot; recorder: slot whose queue it reads; others: the live twin's */
    char hash[TL_TWIN_SLOTS][TL_SHA256_TEXT]; /* of the configuration in each slot; "": none */
    uint32_t finding;                         /* explainer: number of the finding */
    /* for the start of a twin: */
    uint32_t number;    /* of this process in its slot, from 1 */
    bool is_shadow;     /* the process starts as a shadow; a handover may make it the live twin */
    tl_time start;      /* shadow: t_start of the live twin's run (CLOCK_MONOTONIC) */
    int64_t started;    /* the same in UTC, ms since 1970 */
    uint32_t handovers; /* newest handover at the start; recorder: the handover that made the twin of its queue live */
    tl_start how;       /* if `how.waits` is true, `start` above is the time from which samples are recorded */
} tl_live_job;

/* Packs the job, the path of the configuration file, and `text`. For a shadow, `text` is the
 * configuration of the live twin; for another twin, ""; for other processes, the run's
 * configuration. The caller frees the result with free(). Returns NULL if memory is out. */
unsigned char *tl_live_job_pack(const tl_live_job *job, const char *path, const char *text, size_t *size);

/* Unpacks the result of tl_live_job_pack(). *path and *text point into `bytes`. Errors:
 * TL_BAD_DATA. */
tl_status tl_live_job_unpack(const void *bytes, size_t size, tl_live_job *job, const char **path, const char **text,
                             tl_error *error);

/* For all processes except the twin: maps the block with the job and reads the configuration.
 * `block` must outlive job and configuration. Errors: TL_BAD_DATA, TL_TRY_AGAIN. */
tl_status tl_live_job_take(int descriptor, tl_block *block, tl_live_job *job, tl_config *config, tl_error *error);

/* Reads a configuration that was valid before, and applies the job to it. The caller frees it.
 * Errors: TL_BAD_DATA, TL_TRY_AGAIN. */
tl_status tl_live_job_read(const tl_live_job *job, const char *path, const char *text, tl_config *config,
                           tl_error *error);

/* Applies the duration of the command line, and calls tl_config_use_lookups(). */
void tl_live_job_apply(const tl_live_job *job, tl_config *config);

/* ---- Access: which process has which blocks. The supervisor passes these blocks; the process maps
 * them.
 *
 * Trust:   the sample memory is written by io: its reader validates it. A block of an unexpected
 *          size is rejected.
 * Thread:  any.
 */

typedef enum tl_live_kind {
    TL_LIVE_IS_IO,
    TL_LIVE_IS_RECORDER,
    TL_LIVE_IS_CONFIG_MANAGER,
    TL_LIVE_IS_EXPLAINER, /* has no block */
    TL_LIVE_IS_TWIN
} tl_live_kind;

/* Bit n stands for the block with descriptor n. */
typedef struct tl_live_access {
    uint32_t reads;
    uint32_t writes;
} tl_live_access;

/* Returns the blocks that a process of this kind reads and writes, for the slot of the job. Without
 * a database, the blocks of the recorder are left out. */
tl_live_access tl_live_access_of(tl_live_kind kind, const tl_live_job *job);

/* Sets the size of each block in bytes. A record queue has the size for a twin of this
 * configuration. Call tl_config_use_lookups() before. */
void tl_live_block_sizes(const tl_config *config, size_t sizes[TL_LIVE_BLOCKS]);

/* Maps all blocks of this process. The caller has zeroed `blocks`; blocks that the process does not
 * have stay zeroed. Errors: TL_BAD_DATA. */
tl_status tl_live_blocks_take(tl_live_kind kind, const tl_live_job *job, const tl_config *config,
                              tl_block blocks[TL_LIVE_BLOCKS], tl_error *error);

/* Duplicates the descriptors of the blocks that a process of this kind has, for tl_role_settings.
 * All others become -1. Close them with tl_live_blocks_close_passed(), which also closes what the
 * caller has added. */
void tl_live_blocks_pass(tl_live_kind kind, const tl_live_job *job, const tl_block blocks[TL_LIVE_BLOCKS],
                         int descriptors[TL_ROLE_DESCRIPTORS]);
void tl_live_blocks_close_passed(const int descriptors[TL_ROLE_DESCRIPTORS]);

/* Opens the plant input over the mapped sample memory. Errors: TL_TRY_AGAIN. */
tl_status tl_live_input_open(const tl_config *config, const tl_block *sample_memory, tl_plant_input *input,
                             tl_error *error);

/* ---- Memory need of a run, reported before anything runs.
 *
 * Purpose: uses the same sizes as the process tree. A page takes memory only when it is used. So
 *          for checkpoints and resume data, only pages that a twin of this size fills are counted.
 * Thread:  pure.
 */

/* Bytes. */
typedef struct tl_live_blocks {
    size_t sample_memory; /* newest readings of the plant */
    size_t queue;         /* record queue, events, and status blocks */
    size_t checkpoints;   /* all checkpoint slots; 0: no checkpoints */
    size_t resume;        /* resume data, freed when the twin has started; upper bound; 0: none */
    size_t shadow;        /* additionally, while a shadow of this size runs; an upper bound */
} tl_live_blocks;

/* Computes the memory need of a run whose twin has a checkpoint of `checkpoint` bytes (0: none).
 * Call tl_config_use_lookups() before. */
void tl_live_blocks_of(const tl_config *config, size_t checkpoint, tl_live_blocks *blocks);

/* ---- Recorded samples for a shadow: the recorder's side.
 *
 * Purpose: a shadow cannot open the database of the run. In its status block, the shadow requests
 *          the samples from a certain tick on. The recorder copies these samples to the resume
 *          block of the shadow's slot (resume.h).
 * Trust:   the shadow is untrusted. It gets only recorded samples, at most the size of the block.
 * Memory:  the caller owns the blocks; they must outlive the object.
 * Thread:  the recorder's.
 */

typedef struct tl_live_samples {
    const tl_live_twin_status *live_status; /* status block of the shadow, written by the shadow */
    tl_live_resume_answer *answer;          /* written by the recorder */
    tl_block *resume;                       /* of the shadow's slot, written by the recorder */
    const char *boot;                       /* result of tl_identity_boot(); must outlive the object */
    /* private; the caller zeroes them */
    tl_live_request answered;
    bool is_filled;
} tl_live_samples;

/* Answers the newest request from the database at `path`, unless it was answered before. Frees the
 * pages of the resume block when the shadow does not need them any more. */
void tl_live_samples_answer(tl_live_samples *self, const char *path);

#endif
