/* The file that a writer writes: opened, looked after, and given up for another one.
 *
 * Purpose: what is wrong with a file at first is coped with, or refused (insistence): see database_file.h. Later everything is coped with:
 *          a damaged file is put aside, one that may not be written any more is left for one beside it, one that was removed, moved away or
 *          overwritten is made anew. The run then begins again in the new file (tl_recorder_state_leave_run()).
 * Words:   each of it is said once, in the log and as an event of the writer's own (tl_recorder_state_say()).
 * Touches: the file and what lies beside it; of the writer's state its marks, if a run is left. No outbox.
 * Thread:  one at a time.
 */
#ifndef TL_FIRMWARE_STORE_RECORDER_FILE_H
#define TL_FIRMWARE_STORE_RECORDER_FILE_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/base/log.h"
#include "firmware/store/database_file.h"
#include "firmware/store/recorder_database.h"
#include "firmware/store/recorder_state.h"
#include "master/base/simtime.h"
#include "master/base/status.h"

enum { TL_RECORDER_FATE = 80 };

/* Placed by the caller, who reads it, and writes `goes_on` and `lost_said`. */
typedef struct tl_recorder_file {
    const tl_recorder_settings *record;
    tl_recorder_writer_state *state;
    tl_database_file file;
    tl_database_user user;
    tl_recorder_database *database; /* NULL: no file is open */
    bool goes_on;                   /* with a run that another writer began, and of which nothing was written since */
    bool is_kept;                   /* what that one wrote is still in its file, as far as we know */
    char fate[TL_RECORDER_FATE];    /* of the file before, as long as it is not said; "": nothing has happened to it */
    uint64_t lost_said;             /* of totals.lost, what was said */
    tl_time opened_at;              /* when that was tried the last time */
    tl_error failure;               /* the last one, with the file */
    char reason[192];               /* and without */
    tl_log_limiter limiter;
} tl_recorder_file;

/* None is open yet. Settings and state outlive it. */
void tl_recorder_file_begin(tl_recorder_file *file, const tl_recorder_settings *record,
                            tl_recorder_writer_state *state);
void tl_recorder_file_end(tl_recorder_file *file);

/* Where it is; if none is open, where one was asked for. */
const char *tl_recorder_file_path(const tl_recorder_file *file);

void tl_recorder_file_say(tl_recorder_file *file, tl_severity severity, const char *text);

/* Of a call that has failed: sets `failure` and `reason`. Before a roll-back, which has words of its own. */
void tl_recorder_file_keep_words(tl_recorder_file *file, int code);

/* That which the writer before us was writing, or the one that is asked for, or what there is instead: why is in *news, still to be told. Else
 * sets `failure`; *waits: trying again may help. */
tl_status tl_recorder_file_open(tl_recorder_file *file, tl_database_insistence insistence, tl_database_news *news,
                                bool *waits);

/* Says why it is another file than before; NULL: that there is none. */
void tl_recorder_file_tell(tl_recorder_file *file, const tl_database_news *news);

/* Whether it is time to try that again; it is noted as tried then. */
bool tl_recorder_file_is_due(tl_recorder_file *file);

/* From now on commits wait but shortly for other programs: entries are waiting meanwhile. */
void tl_recorder_file_hurry(tl_recorder_file *file);

/* How far the writer before us came, and whether what it wrote is here; else its run is left. `news`: of the opening. SQLite's result code. */
int tl_recorder_file_find_run(tl_recorder_file *file, const tl_database_news *news);

/* What others have done to it, which SQLite would go on to write. True: something was done about it, and perhaps none is open. */
bool tl_recorder_file_look_after(tl_recorder_file *file);

/* Something else can be done about a failure than to try again; true: at once. */
bool tl_recorder_file_mend(tl_recorder_file *file, int code);

void tl_recorder_file_close(tl_recorder_file *file);

#endif
