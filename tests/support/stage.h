/* A stage: the supervisor's members, played by real processes that hang, die, end and loop.
 *
 * Plans:   what each process of a member does is one letter of its plan:
 *            k  killed by a signal      h  becomes ready, then silent      s  silent before it is ready
 *            0  ready, ends with 0      7  ready, ends with 70             8  ends with 70 before it is ready
 *            6  ends with 65, never ready   w  ready, beats until SIGTERM   a  beats until SIGTERM, never ready
 *            -  cannot be started                       d  dies of SIGTERM before it is ready
 *            l  has done all, and crashes then              t  told to end by somebody else
 *            i  as w, and ignores SIGTERM in the half second before it is ready
 *            e  as w, and needs half a second to become ready, in which it dies of SIGTERM
 *          and in an FMU, which nobody announces:
 *            c  crashes    f  hangs    x  ends with 0    y  ends with 65 before it is ready    n  crashes, and has spoilt its name
 *            r  a thread of ours hangs, while FMUs are called as ever      b  called while it is told to end, deaf
 * Use:     tl_stage_open() in main(), tl_stage_set() and tl_stage_clear() around each test. Members other than the twin are cast before they are supervised.
 * Owner:   there is one stage in a program; its memory is shared by all processes of a test.
 * Errors:  what does not go well fails the test.
 * Thread:  one. stderr is captured (stderr_capture.h) from tl_stage_set() to tl_stage_clear().
 */
#ifndef TL_TESTS_SUPPORT_STAGE_H
#define TL_TESTS_SUPPORT_STAGE_H

#include <stdbool.h>
#include <sys/types.h>

#include "firmware/live/supervisor.h"
#include "firmware/process/heartbeat.h"
#include "tests/support/scratch.h"

enum { TL_STAGE_STARTS = 32 };

/* Of one member; of twin and shadow, one of two that change places. */
typedef struct tl_stage_part {
    const char *plan; /* NULL: there is no such member */
    int starts;
    int order; /* of its last end, among all */
    int told;  /* ends of which the supervisor told */
    pid_t pid; /* of the last one */
    tl_heartbeats beats;
} tl_stage_part;

typedef struct tl_stage {
    tl_supervisor_settings settings;               /* to be set before: what is not of the play */
    void (*play_on)(bool ends, tl_orders *orders); /* to be set before: what is ordered; NULL: nothing */
    tl_scratch scratch;                            /* a folder for the account */
    tl_stage_part parts[TL_MEMBERS];
    bool swapped; /* twin and shadow */
    tl_time at;   /* when a play has come so far */
    int ends;
    int starts; /* this and what follows is of the twin */
    bool hold[TL_STAGE_STARTS];
    bool again[TL_STAGE_STARTS];
    unsigned failures[TL_STAGE_STARTS];
    char reason[TL_STAGE_STARTS][TL_RESTARTS_REASON];
    unsigned processes[TL_STAGE_STARTS]; /* of the supervisor, that are there, dead or alive */
    pid_t last;
    int told;                        /* ends of which the supervisor told */
    char better[TL_RESTARTS_REASON]; /* the reason that it is told instead */
    bool was_killed_by_others;       /* as it told of any end of the twin */
    uint64_t blames;                 /* what it is told then */
    uint64_t unreadable[TL_STAGE_STARTS];
    char event[256];             /* the last one for the database */
    tl_time damaged[TL_MEMBERS]; /* what is said of each */
} tl_stage;

/* The program's stage, with a folder `parent`/`name`_XXXXXX; ends the program if there is no room. */
tl_stage *tl_stage_open(const char *parent, const char *name);

/* The last of main(): returns `failures`, what UNITY_END() said. */
int tl_stage_close(int failures);

/* Around each test. */
void tl_stage_set(void);
void tl_stage_clear(void);

/* Nothing has been played, and nothing is ordered; settings and the account stay. */
void tl_stage_empty(void);

void tl_stage_cast(tl_member which, const char *plan);

/* Supervises until all is over: with this exit code, after as many starts of the twin as its plan has letters. */
void tl_stage_expect_code(const char *plan, int code);

/* The exit code of a supervisor that gets the signal `after_ms` after the first start, and once more `again_ms` later; 0: it does not. */
int tl_stage_signal(const char *plan, int number, long after_ms, long again_ms);
int tl_stage_signal_once(const char *plan, int number, long after_ms);

/* The same, of a twin that was started once. */
int tl_stage_end(const char *plan, int number, long after_ms);

/* Said on the log since this was asked before; told, as an event for the database as well; nothing of either. */
void tl_stage_expect_said(const char *words);
void tl_stage_expect_told(const char *words);
void tl_stage_expect_silence(void);

/* Of a part that is played, which is another member's after a swap. */
bool tl_stage_is_ready(tl_member part);
bool tl_stage_has_died(tl_member part);

/* Children of a process, dead or alive. */
unsigned tl_stage_processes_of(pid_t parent);

void tl_stage_pause_ms(long ms);

#endif
