/* A replay of a recording, and its report.
 *
 * Thread:  one.
 */
#ifndef TL_FIRMWARE_TWIN_REPLAY_H
#define TL_FIRMWARE_TWIN_REPLAY_H

#include <stdbool.h>
#include <stdio.h>

#include "firmware/base/os.h"
#include "firmware/base/text.h"
#include "firmware/config/config.h"
#include "firmware/plant/recording.h"
#include "firmware/report/html_report.h"
#include "firmware/report/show.h"
#include "firmware/report/summary.h"
#include "firmware/store/recorder.h"
#include "firmware/twin/journal.h"
#include "firmware/twin/twin_child.h"
#include "firmware/twin/watch.h"
#include "master/twin/account.h"

/* ---- The report that `replay --report` writes.
 *
 * Purpose: tells html_report.h what a replay knows: its configuration, the twin's facts and ledger, the summary.
 * Thread:  one thread.
 */

/* Fields are private but for `page`. A zeroed one is none. */
typedef struct tl_replay_report {
    tl_html_report *page; /* NULL: there is none */
    const tl_account *account;
    tl_new_file file;
    char begun[TL_UTC_TEXT];
    tl_recorder_signal match[TL_MAX_MATCH];
    tl_recorder_signal adjust[TL_MAX_ADJUST];
    double tolerance[TL_MAX_MATCH];
} tl_replay_report;

/* Begins the file (os.h), so that a place that cannot be written is known before the run. The report is zeroed. Configuration, account and
 * the name of the recording must outlive it, and it what the journal is told, of which each event is one of the report. */
tl_status tl_replay_report_open(tl_replay_report *report, const tl_config *config, const tl_account *account,
                                const char *path, const char *recording, tl_journal *journal, tl_error *error);

/* Writes the page, with the account as it stands now, and gives it its name. `ended`: why, in words. */
tl_status tl_replay_report_keep(tl_replay_report *report, const tl_summary *summary, const char *ended,
                                tl_error *error);

/* Ends it; what was not kept is gone. */
void tl_replay_report_close(tl_replay_report *report);

/* ---- A replay: a recording through the twin, as fast as it can or in real time.
 *
 * Purpose: the loop of `twinlock replay`. Budgets in time are ignored, so that it is repeatable to the bit.
 * Thread:  the caller's.
 */

typedef struct tl_replay {
    tl_config *config;         /* has the recording's tunings as they come into force */
    const tl_account *account; /* of the built twin */
    tl_recording *recording;
    tl_twin_feed *feed;    /* of this recording; with TL_TELLS_COUNTS if there is a recorder */
    tl_recorder *recorder; /* NULL: none */
    tl_watch *watch;       /* tells events as a live run's does */
    tl_lock_monitor *judge;
    FILE *trajectory;     /* NULL: none */
    tl_html_report *page; /* NULL: none */
    bool realtime;
} tl_replay;

/* Whether the replay of a run that went on with another one can begin as that did.
 * Errors: TL_BAD_DATA if the FMUs, or this program, are not those of the run. */
tl_status tl_replay_check(const tl_config *config, const tl_recording_beginning *beginning, tl_error *error);

/* Runs to the end, to the configured duration, or until interrupted (TL_INTERRUPTED; the summary holds what was done). */
tl_status tl_replay_run(const tl_replay *replay, tl_summary *summary, tl_error *error);

#endif
