/* What crosses between the processes of a run: which shared memory there is, who writes it, what lies in it, which descriptor it has where.
 *
 * Purpose: private to the room: all processes must mean the same. Sizes follow from the configuration, which each has read from the same text.
 * Trust:   every block has one writer. Whoever reads it believes nothing of it that its writer could have made up: io is in the hands of
 *          whoever sits on the plant's network, the recorder in those of who wrote the database, the twin in those of its FMUs.
 */
#ifndef TL_FIRMWARE_LIVE_LIVE_WIRE_H
#define TL_FIRMWARE_LIVE_LIVE_WIRE_H

#include <stdint.h>

#include "firmware/base/identity.h"
#include "firmware/base/os.h"
#include "firmware/monitor/run_status.h"
#include "firmware/plant/mailbox.h"
#include "firmware/process/heartbeat.h"
#include "firmware/report/summary.h"
#include "firmware/store/outbox.h"
#include "firmware/store/recorder_state.h"
#include "firmware/twin/live_stage.h"
#include "firmware/twin/live_tuning.h"
#include "firmware/twin/past.h"
#include "master/base/status.h"
#include "master/twin/account.h"

/* Descriptors, beside 0 (nothing), 1 and 2 (what is logged). Every process with FMUs has its job and its start socket where twin_role.h says. */
enum {
    TL_LIVE_MAIL = 3,            /* io writes; the twin reads */
    TL_LIVE_TWIN_PULSE_READ = 3, /* of the recorder */
    TL_LIVE_JOB = 4,             /* live_job.h */
    TL_LIVE_RECORDER_PULSE = 5,  /* io and the twin read; */
    TL_LIVE_IO_PULSE_READ = 5,   /* of the recorder */
    TL_LIVE_OWN_PULSE = 6,       /* each writes its own */
    TL_LIVE_SUPERVISOR_READ = 7, /* of the recorder: the supervisor's outbox */
    TL_LIVE_TWIN_OUTBOX = 8,     /* the twin writes; the recorder reads */
    TL_LIVE_PAST = 9,            /* the recorder writes; the twin reads */
    TL_LIVE_KNOCKER = 3,         /* of the activator: the control socket */
    TL_LIVE_ACTIVATOR_TWIN = 9,  /* of the activator: the twin's pulse, to read */
    TL_LIVE_ACTIVATOR_READ = 11, /* of the recorder: the activator's pulse */
    TL_LIVE_TUNING =
        10, /* the activator writes; the twin and the recorder read: of its place, as all below that has places */
    TL_LIVE_STAGE = 12, /* the supervisor writes; all but io read */
    TL_LIVE_OTHER_PULSE =
        13, /* of the recorder and the activator: of the twin in the other place than that of their job, to read */
    TL_LIVE_OTHER_PAST = 14,   /* of the recorder, which writes it: for that twin */
    TL_LIVE_OTHER_TUNING = 14, /* of the activator, which writes it */
    TL_LIVE_CANDIDATE = 15,    /* of the activator, which writes it: tl_live_candidate */
    TL_LIVE_MAIL_READ = 15     /* of the recorder: the mail */
};

/* Which outbox is which, for the recorder. */
enum {
    TL_LIVE_OUTBOX_TWIN, /* in place 0 */
    TL_LIVE_OUTBOX_IO,
    TL_LIVE_OUTBOX_SUPERVISOR,
    TL_LIVE_OUTBOX_ACTIVATOR,
    TL_LIVE_OUTBOX_OTHER_TWIN, /* in place 1 */
    TL_LIVE_OUTBOXES
};

static inline size_t tl_live_outbox_of_place(uint32_t place) {
    return place == 0 ? TL_LIVE_OUTBOX_TWIN : TL_LIVE_OUTBOX_OTHER_TWIN;
}

/* Bytes that a checkpoint may have, and the past that a cold start goes on from. Their memory is there only as far as it is used. */
#define TL_LIVE_CHECKPOINT_BYTES ((size_t)32 * 1024 * 1024)
#define TL_LIVE_PAST_BYTES TL_PAST_MOST

/* Behind the mailboxes in their block. */
typedef struct tl_live_mail_end {
    uint32_t opened; /* 1: io has opened all sources */
} tl_live_mail_end;

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
    uint32_t number;   /* which twin of this place it is, from 1 on, */
    uint32_t first;    /* which was the first of its configuration, */
    uint32_t holds;    /* and whether it holds: 0, TL_LIVE_HOLDS or TL_LIVE_WAITS; all by the supervisor */
    tl_latest figures; /* tl_run_status; nothing while it holds */
    int32_t
        realtime; /* the number of the thread that shall have the configured priority; 0: none shall have it any more */
    uint32_t begun;              /* 1: it needs no past any more */
    uint64_t fmus;               /* the files of its FMUs, as a number; kept for a successor. 0: there was none */
    char digest[TL_SHA256_TEXT]; /* of what is in them; there before it wishes for a past */
    uint32_t
        loads; /* 1: a checkpoint is being loaded, or was, and too few steps were made since to say that it does no harm; kept for a successor */
    uint64_t
        unreadable; /* `fmus` of which a saved state has ended the process that loaded it; by the supervisor. 0: none */
    tl_live_wish
        past; /* which past it wants: of this start, the first, the next one older, …; of a shadow: which samples, */
    int64_t past_from;           /* from this tick on; written before `past` */
    tl_time start;               /* t_start of its run (CLOCK_MONOTONIC), */
    int64_t started;             /* and UTC, ms; before it is ready. 0: not known yet */
    uint32_t flipped;            /* number of the newest flip in which it has done its part */
    tl_live_tuning_answer tuned; /* what it made of the newest tuning that it was told; kept for who waits for that */
    tl_live_end end;
} tl_live_twin_pulse;

/* What is to be told about a past. */
typedef struct tl_live_past_word {
    int32_t severity; /* tl_severity */
    char text[TL_PAST_TEXT];
} tl_live_past_word;

enum { TL_LIVE_PAST_WORDS = 8 };

/* What came of a wish for a past. All else is there before the wish is. */
typedef struct tl_live_past_answer {
    tl_live_wish wish;
    uint64_t size;                               /* bytes in the block; 0: there is none (any more) */
    tl_time ended;                               /* tl_past_history_ended() */
    tl_live_past_word words[TL_LIVE_PAST_WORDS]; /* to the first without a text */
} tl_live_past_answer;

/* The pulse of the recorder. */
typedef struct tl_live_recorder_pulse {
    tl_heartbeats beats;
    tl_time damaged[TL_LIVE_OUTBOXES]; /* tl_recorder_writer_damage() of each */
    uint32_t
        drained; /* number of the newest flip of which all is written that the twin had to say whose run has ended by it */
    tl_recorder_writer_state state;
    tl_live_past_answer answer[TL_LIVE_PLACES]; /* of the twin in each place */
} tl_live_recorder_pulse;

/* The pulse of io; its outbox, of events, follows. The supervisor's block is such an outbox only. */
typedef struct tl_live_io_pulse {
    tl_heartbeats beats;
} tl_live_io_pulse;

/* The pulse of the activator; its outbox, of events, follows. */
typedef struct tl_live_activator_pulse {
    tl_heartbeats beats;
    uint32_t restart; /* 1: the run is to end, and another one to begin */
    tl_live_order order;
    uint32_t flips; /* the activator's own: number of the newest flip when it ordered one */
} tl_live_activator_pulse;

static inline size_t tl_live_round(size_t size) {
    return (size + 63U) & ~(size_t)63U;
}

/* Events only. */
static inline tl_outbox_settings tl_live_event_outbox(void) {
    return (tl_outbox_settings){.ring_bytes = 0};
}

static inline tl_outbox_settings tl_live_outbox_of_shape(const tl_recorder_shape *shape, tl_time step) {
    return (tl_outbox_settings){
        .shape = *shape, .ring_bytes = tl_outbox_ring_bytes(shape, step), .checkpoint_bytes = TL_LIVE_CHECKPOINT_BYTES};
}

static inline tl_outbox_settings tl_live_twin_outbox(const tl_config *config) {
    const tl_recorder_shape shape = tl_recorder_shape_of(config);
    return tl_live_outbox_of_shape(&shape, config->step);
}

static inline size_t tl_live_mail_bytes(const tl_plant_mail_shape *shape) {
    return tl_live_round(tl_plant_mail_bytes(shape)) + sizeof(tl_live_mail_end);
}

static inline tl_live_mail_end *tl_live_mail_end_of(const tl_plant_mail_shape *shape, void *mail) {
    return (tl_live_mail_end *)(void *)((unsigned char *)mail + tl_live_round(tl_plant_mail_bytes(shape)));
}

static inline size_t tl_live_io_bytes(void) {
    const tl_outbox_settings outbox = tl_live_event_outbox();
    return tl_live_round(sizeof(tl_live_io_pulse)) + tl_outbox_bytes(&outbox);
}

static inline void *tl_live_io_outbox_of(void *pulse) {
    return (unsigned char *)pulse + tl_live_round(sizeof(tl_live_io_pulse));
}

static inline size_t tl_live_activator_bytes(void) {
    const tl_outbox_settings outbox = tl_live_event_outbox();
    return tl_live_round(sizeof(tl_live_activator_pulse)) + tl_outbox_bytes(&outbox);
}

static inline void *tl_live_activator_outbox_of(void *pulse) {
    return (unsigned char *)pulse + tl_live_round(sizeof(tl_live_activator_pulse));
}

#endif
