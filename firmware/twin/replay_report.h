/* The report that `replay --report` writes.
 *
 * Purpose: tells html_report.h what a replay knows: its configuration, the twin's facts and ledger, the summary.
 * Thread:  one thread.
 */
#ifndef TL_FIRMWARE_TWIN_REPLAY_REPORT_H
#define TL_FIRMWARE_TWIN_REPLAY_REPORT_H

#include "firmware/config/config.h"
#include "firmware/report/summary.h"
#include "firmware/twin/journal.h"
#include "master/twin/account.h"

typedef struct tl_replay_report tl_replay_report;

/* Begins the file (new_file.h), so that a place that cannot be written is known before the run. Configuration and account
 * must outlive the report; `recording` is copied. */
tl_status tl_replay_report_open(const tl_config *config, const tl_account *account, const char *path,
                                const char *recording, tl_replay_report **report, tl_error *error);

void tl_replay_report_add(tl_replay_report *report, const tl_record *record);

/* From now on, what the journal is told is an event of the report. The report must outlive what is told. */
void tl_replay_report_listen(tl_replay_report *report, tl_journal *journal);

/* Writes the page, with the account as it stands now, and gives it its name. `ended`: why, in words. */
tl_status tl_replay_report_keep(tl_replay_report *report, const tl_summary *summary, const char *ended,
                                tl_error *error);

/* Ends it; what was not kept is gone. NULL is allowed. */
void tl_replay_report_close(tl_replay_report *report);

#endif
