/* Recordings: see recording.h. */
#include "firmware/plant/recording.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "board/csv/csv.h"
#include "firmware/plant/live_plant.h"
#include "firmware/plant/plant_input.h"
#include "firmware/plant/plant_mail.h"
#include "firmware/plant/recording_database.h"

struct tl_recording {
    int64_t ticks; /* in all */
    int64_t next;  /* tick */
    /* from a database */
    tl_recording_database *database;
    /* from CSV */
    tl_csv_reader *reader;
    tl_plant_input input;
    void *mail; /* memory of its mailboxes */
    tl_time step;
    tl_time start;  /* of the first row */
    tl_csv_row row; /* read, not yet posted */
    bool row_waits;
    size_t own;              /* signals that are no further look-ups */
    tl_recording_hear *hear; /* NULL: nobody does */
    void *listener;
};

/* ---- CSV ---- */

static tl_status open_reader(const char *path, const tl_config *config, tl_csv_reader **reader, tl_error *error) {
    const char *columns[TL_MAX_SIGNALS];
    for (size_t i = 0; i < config->signal_count; i++) {
        columns[i] = config->signals[i].column;
    }
    const tl_csv_settings settings = {
        .path = path,
        .time_column = config->recording_time_column,
        .columns = columns,
        .column_count = config->signal_count,
    };
    return tl_csv_open(&settings, reader, error);
}

/* A row is no further from the one before, and from the first one, than a replay can go. */
static tl_status check_gap(const char *path, tl_time step, tl_time first, tl_time before, tl_time now,
                           tl_error *error) {
    if ((now - before) / step > TL_RECORDING_GAP) {
        return tl_fail(error, TL_BAD_DATA,
                       "%s: between the rows at %.9f s and %.9f s there are %lld steps of %.9g s, at most %lld are "
                       "allowed: correct the time, or cut the recording there",
                       path, tl_seconds(before), tl_seconds(now), (long long)((now - before) / step), tl_seconds(step),
                       (long long)TL_RECORDING_GAP);
    }
    if ((now - first) / step >= TL_RECORDING_TICKS) {
        return tl_fail(error, TL_BAD_DATA,
                       "%s: from the first row to that at %.9f s there are more than %lld steps of %.9g s: cut the "
                       "recording, or replay it with a larger step_s",
                       path, tl_seconds(now), (long long)TL_RECORDING_TICKS, tl_seconds(step));
    }
    return TL_OK;
}

/* Reads the file once: every row is checked before the first is used, and its length is known. */
static tl_status survey(const char *path, const tl_config *config, tl_recording *recording, tl_error *error) {
    tl_csv_reader *reader = NULL;
    tl_status status = open_reader(path, config, &reader, error);
    tl_time last = 0;
    size_t rows = 0;
    bool end = false;
    while (status == TL_OK && !end) {
        status = tl_csv_next(reader, &recording->row, &end, error);
        if (status == TL_OK && !end) {
            recording->start = rows == 0 ? recording->row.time : recording->start;
            last = rows++ == 0 ? recording->start : last;
            status = check_gap(path, config->step, recording->start, last, recording->row.time, error);
            last = recording->row.time;
        }
    }
    tl_csv_close(reader);
    if (status == TL_OK && rows == 0) {
        return tl_fail(error, TL_BAD_DATA, "%s: there is a header, but no row", path);
    }
    recording->ticks = status == TL_OK ? (last - recording->start + TL_PLANT_ALIKE) / config->step + 1 : 0;
    return status;
}

static tl_status open_csv(const char *path, const tl_config *config, tl_recording *recording, tl_error *error) {
    tl_status status = survey(path, config, recording, error);
    if (status != TL_OK) {
        return status;
    }
    recording->step = config->step;
    for (size_t i = 0; i < config->signal_count; i++) {
        recording->own += config->signals[i].of == i ? 1 : 0;
    }
    tl_live_plant_set_limits(&recording->input, config);
    recording->mail = tl_plant_mail_make_least(config->signal_count, recording->input.mailboxes);
    if (recording->mail == NULL || !tl_plant_input_open(&recording->input)) {
        return tl_fail(error, TL_TRY_AGAIN, "%s: not enough memory", path);
    }
    return open_reader(path, config, &recording->reader, error);
}

static void post_row(tl_recording *recording) {
    for (size_t i = 0; i < recording->input.count; i++) {
        if (recording->row.present[i]) {
            const tl_reading reading = {
                .value = recording->row.values[i],
                .stamp = recording->row.time,
                .quality = recording->row.quality[i],
            };
            tl_plant_input_post(&recording->input, i, &reading);
            if (recording->hear != NULL && i < recording->own) {
                recording->hear(recording->listener, i, &reading);
            }
        }
    }
}

static tl_status next_from_csv(tl_recording *recording, tl_recording_tick *tick, tl_error *error) {
    tl_time instant = tl_time_of_step(recording->start, recording->step, recording->next);
    tl_time alike = recording->next > 0 ? TL_PLANT_ALIKE : 0; /* as in plant_input.c */
    for (;;) {
        if (!recording->row_waits) {
            bool end = false;
            tl_status status = tl_csv_next(recording->reader, &recording->row, &end, error);
            if (status != TL_OK) {
                return status;
            }
            if (end) {
                break;
            }
            recording->row_waits = true;
        }
        if (recording->row.time > instant + alike) {
            break;
        }
        post_row(recording);
        recording->row_waits = false;
    }
    tl_plant_input_take(&recording->input, recording->next, instant, &tick->sample);
    tick->made_up = false;
    tick->cut_short = false;
    tick->resets = false;
    tick->evaluations = 0;
    tick->without_nominal = false;
    tick->followed = false;
    return TL_OK;
}

/* ---- both ---- */

static bool is_database(const char *path) {
    static const char magic[16] = "SQLite format 3";
    char head[sizeof magic] = {0};
    FILE *file = fopen(path, "rb");
    if (file != NULL) {
        (void)!fread(head, 1, sizeof head, file);
        (void)fclose(file);
    }
    return memcmp(head, magic, sizeof magic) == 0;
}

tl_status tl_recording_open(const char *path, const tl_config *config, tl_recording **recording, tl_error *error) {
    tl_recording *opened = calloc(1, sizeof *opened);
    if (opened == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "%s: not enough memory", path);
    }
    struct stat about;
    if (stat(path, &about) == 0 && !S_ISREG(about.st_mode) && !S_ISDIR(about.st_mode)) {
        free(opened);
        return tl_fail(error, TL_BAD_DATA,
                       "%s: is no regular file, expected a recording (CSV or database); a FIFO is a live source for "
                       "`twinlock run`",
                       path);
    }
    if (config->recording_run != 0 && !is_database(path)) {
        free(opened);
        return tl_fail(error, TL_BAD_USAGE, "%s: is no database, and has no run %lld: remove --run", path,
                       (long long)config->recording_run);
    }
    tl_status status = is_database(path)
                           ? tl_recording_database_open(path, config, &opened->database, &opened->ticks, error)
                           : open_csv(path, config, opened, error);
    if (status != TL_OK) {
        tl_recording_close(opened);
        return status;
    }
    const tl_recording_beginning *beginning = tl_recording_get_beginning(opened);
    opened->next = beginning != NULL ? beginning->tick : 0;
    *recording = opened;
    return TL_OK;
}

tl_recording_tunings tl_recording_get_tunings(const tl_recording *recording) {
    return recording->database != NULL ? tl_recording_database_tunings(recording->database)
                                       : (tl_recording_tunings){.recorded = 0};
}

const tl_recording_beginning *tl_recording_get_beginning(const tl_recording *recording) {
    return recording->database != NULL ? tl_recording_database_beginning(recording->database) : NULL;
}

tl_status tl_recording_next(tl_recording *recording, tl_recording_tick *tick, bool *end, tl_error *error) {
    *end = recording->next >= recording->ticks;
    if (*end) {
        return TL_OK;
    }
    tl_status status = recording->database != NULL ? tl_recording_database_next(recording->database, tick, end, error)
                                                   : next_from_csv(recording, tick, error);
    recording->next++;
    return status;
}

void tl_recording_listen(tl_recording *recording, tl_recording_hear *hear, void *context) {
    if (recording->database != NULL) {
        tl_recording_database_listen(recording->database, hear, context);
    }
    recording->hear = hear;
    recording->listener = context;
}

int64_t tl_recording_ticks(const tl_recording *recording) {
    return recording->ticks;
}

void tl_recording_close(tl_recording *recording) {
    if (recording == NULL) {
        return;
    }
    tl_csv_close(recording->reader);
    tl_recording_database_close(recording->database);
    tl_plant_input_close(&recording->input);
    free(recording->mail);
    free(recording);
}
