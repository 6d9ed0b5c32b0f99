/* Simulated members of the supervisor: real processes that hang, crash, exit or loop as planned.
 *
 * Plans:   each letter of a member's plan is the behaviour of one process:
 *            k  killed by a signal           h  ready, then silent
 *            s  silent before it is ready    d  killed by SIGTERM before it is ready
 *            0  ready, ends with 0           7  ready, ends with 70
 *            8  ends with 70, never ready    6  ends with 65, never ready
 *            w  ready, beats until SIGTERM   a  beats until SIGTERM, never ready
 *            -  cannot be started            l  announces its end, then crashes
 *            t  sends SIGTERM to itself, as another process might
 *            o  sends SIGKILL to itself, as another process might
 *            i  as w, but ignores SIGTERM in the 0.5 s before it is ready
 *            e  as w, but becomes ready after 0.5 s, in which SIGTERM kills it
 *          and inside an FMU, without an announced end:
 *            c  crashes    f  hangs    x  ends with 0    y  ends with 65, never ready
 *            n  overwrites its FMU's name and crashes
 *            r  a thread of twinlock hangs, but FMUs are still called
 *            b  ignores SIGTERM
 * Use:     tl_stage_open() in main(), tl_stage_set() and tl_stage_clear() around each test.
 *          tl_stage_cast() adds members other than the twin before they are supervised.
 * Owner:   a program has one stage. All processes of a test share its memory.
 * Errors:  an unexpected error fails the test.
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

/* One member. Twin and shadow are two parts that a handover exchanges. */
typedef struct tl_stage_part {
    const char *plan; /* NULL: there is no such member */
    int starts;
    int order;         /* number of its last end, over all members */
    int ends_reported; /* ends that the supervisor reported */
    pid_t pid;         /* of its last process */
    tl_heartbeats beats;
} tl_stage_part;

typedef struct tl_stage {
    tl_supervisor_settings settings;               /* a test sets further members first */
    void (*play_on)(bool ends, tl_orders *orders); /* orders of the test; NULL: none */
    tl_scratch scratch;                            /* folder of the restart account */
    tl_stage_part parts[TL_MEMBERS];
    bool swapped; /* twin and shadow are exchanged */
    tl_time at;   /* for the test's orders */
    int ends;
    int starts; /* this and the following: of the twin */
    bool hold[TL_STAGE_STARTS];
    bool again[TL_STAGE_STARTS];
    unsigned failures[TL_STAGE_STARTS];
    char reason[TL_STAGE_STARTS][TL_RESTARTS_REASON];
    unsigned processes[TL_STAGE_STARTS]; /* children of the supervisor, running or zombie */
    pid_t last;
    int ends_reported;               /* ends that the supervisor reported */
    char better[TL_RESTARTS_REASON]; /* replaces the supervisor's reason; "": not */
    bool was_killed_by_others;       /* as reported for any end of the twin */
    uint64_t blames;                 /* returned to the supervisor then */
    uint64_t unreadable[TL_STAGE_STARTS];
    char event[256];             /* last event for the database */
    tl_time damaged[TL_MEMBERS]; /* reported damage of each member's queue */
} tl_stage;

/* Creates the program's stage with a folder `parent`/`name`_XXXXXX. Ends the program if it
 * fails. */
tl_stage *tl_stage_open(const char *parent, const char *name);

/* Last call of main(): returns `failures`, the result of UNITY_END(). */
int tl_stage_close(int failures);

/* Set-up and clean-up of a test. */
void tl_stage_set(void);
void tl_stage_clear(void);

/* Resets the stage except settings and restart account. */
void tl_stage_empty(void);

void tl_stage_cast(tl_member which, const char *plan);

/* Supervises until the end. The exit code is `code`, and the twin was started once per letter. */
void tl_stage_expect_code(const char *plan, int code);

/* Returns the exit code of a supervisor that gets the signal `after_ms` after the first start.
 * It gets the signal again after `again_ms`, unless that is 0. */
int tl_stage_signal(const char *plan, int number, long after_ms, long again_ms);
int tl_stage_signal_once(const char *plan, int number, long after_ms);

/* The same; the twin must be started exactly once. */
int tl_stage_end(const char *plan, int number, long after_ms);

/* Since the last call of these functions: one line of the log has all parts (message.h); the
 * last event for the database has them, too; there is neither a log line nor an event. */
void tl_stage_expect_said(const char *parts);
void tl_stage_expect_report(const char *parts);
void tl_stage_expect_silence(void);

/* State of a part, which is another member after a handover. */
bool tl_stage_is_ready(tl_member part);
bool tl_stage_has_died(tl_member part);

/* Returns the number of children of a process, running or zombie. */
unsigned tl_stage_processes_of(pid_t parent);

void tl_stage_pause_ms(long ms);

#endif
