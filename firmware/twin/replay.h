/* Replay of a recording, and its report. One thread.
 *
 * Owner:   the caller owns all that the structs point to.
 */
#ifndef TL_FIRMWARE_TWIN_REPLAY_H
#define TL_FIRMWARE_TWIN_REPLAY_H

#include <stdbool.h>
#include <stdio.h>

#include "firmware/base/os.h"
#include "firmware/base/text.h"
#include "firmware/config/config.h"
#include "firmware/monitor/change_detector.h"
#include "firmware/plant/recording.h"
#include "firmware/report/html_report.h"
#include "firmware/report/journal.h"
#include "firmware/report/show.h"
#include "firmware/report/summary.h"
#include "firmware/report/watch.h"
#include "firmware/store/recorder.h"
#include "firmware/twin/twin_child.h"
#include "master/twin/account.h"

/* ---- The report that `replay --report` writes.
 *
 * Purpose: creates an HTML page (html_report.h) from configuration, twin's account and summary.
 */

/* Fields are private except `page`. Zeroed: no report. */
typedef struct tl_replay_report {
    tl_html_report *page; /* NULL: there is none */
    const tl_account *account;
    tl_new_file file;
    char begun[TL_UTC_TEXT];
    tl_recorder_signal match[TL_MAX_MATCH];
    tl_recorder_signal adjust[TL_MAX_ADJUST];
    double tolerance[TL_MAX_MATCH];
} tl_replay_report;

/* Creates the file `path` under a temporary name (os.h), so that a path that cannot be written
 * fails before the run. The report must be zeroed. Each event of the journal becomes an event of
 * the report. `recording`: name of the recording. Configuration, account and that name must outlive
 * the report. After the report is closed, the journal must receive no event. */
tl_status tl_replay_report_open(tl_replay_report *report, const tl_config *config, const tl_account *account,
                                const char *path, const char *recording, tl_journal *journal, tl_error *error);

/* Writes the page with the present account, and gives the file its final name. `changes`: findings
 * of the change detector. `ended`: why the run ended, in words. */
tl_status tl_replay_report_keep(tl_replay_report *report, const tl_summary *summary, const tl_run_changes *changes,
                                const char *ended, tl_error *error);

/* Closes the report. A file that was not kept is deleted. */
void tl_replay_report_close(tl_replay_report *report);

/* ---- Replay: feeds a recording to the twin, as fast as possible or in real time.
 *
 * Purpose: the loop of `twinlock replay`. Time budgets are ignored, so that each replay gives the
 *          same results, to the bit.
 */

typedef struct tl_replay {
    tl_config *config;         /* each recorded tuning is stored here at its tick */
    const tl_account *account; /* of the built twin */
    tl_recording *recording;
    tl_twin_feed *feed;    /* of this recording; must have TL_ATTACHED_COUNTS (twin_step.h) if `recorder` is not NULL */
    tl_recorder *recorder; /* NULL: none */
    tl_watch *watch;       /* reports events as in a live run */
    tl_lock_monitor *lock_monitor;
    tl_change_detector *detector; /* NULL: none */
    FILE *trajectory;             /* receives a row per step (tl_trajectory_add()); NULL: none */
    tl_html_report *page;         /* NULL: none */
    bool realtime;                /* each tick waits for its instant; the feed must then be paced */
} tl_replay;

/* Checks whether the replay of a resumed run can start from the same state as the run. Errors:
 * TL_BAD_DATA if the run had other FMUs, or a checkpoint of another program version or machine. */
tl_status tl_replay_check(const tl_config *config, const tl_recording_beginning *beginning, tl_error *error);

/* Runs to the end of the recording or of the configured duration. Fills the summary in any case.
 * Errors: TL_INTERRUPTED; TL_BAD_DATA: too short for a step; those of tl_twin_feed_next(). */
tl_status tl_replay_run(const tl_replay *replay, tl_summary *summary, tl_error *error);

#endif
