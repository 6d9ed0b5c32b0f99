/* Follow: see follow.h. */
#include "firmware/live/follow.h"

#include <errno.h>
#include <limits.h>
#include <math.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "firmware/base/json.h"
#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/base/text.h"

static const tl_time INTERVAL = TL_SECOND;

/* ---- a line ---- */

/* Returns the mean since the line before, NaN if nothing was counted since then. Counts restart if
 * another twin has taken over. */
static double mean_of(double sum, double sum_before, uint64_t count, uint64_t count_before) {
    return count > count_before ? (sum - sum_before) / (double)(count - count_before) : (double)NAN;
}

static void add_times(tl_json_writer *json, const tl_run_status *now, const tl_run_status *before) {
    tl_json_add_number(json, "late_s",
                       mean_of(tl_seconds(now->late), tl_seconds(before->late), now->steps, before->steps));
    tl_json_add_number(json, "used_s",
                       mean_of(tl_seconds(now->used), tl_seconds(before->used), now->steps, before->steps));
}

static void add_corrections(tl_json_writer *json, const tl_run_status *now, const tl_run_status *before) {
    tl_json_open_object(json, "corrections");
    for (size_t i = 0; i < now->corrections; i++) {
        const tl_run_correction *one = &now->correction[i];
        const tl_run_correction *old = &before->correction[i];
        bool is_same = strcmp(one->name, old->name) == 0; /* else another twin has taken over */
        tl_json_add_number(json, one->name,
                           is_same ? mean_of(one->sum, old->sum, one->count, old->count) : (double)NAN);
    }
    tl_json_close(json);
}

static void add_outputs(tl_json_writer *json, const tl_run_status *now) {
    tl_json_open_object(json, "match");
    for (size_t i = 0; i < now->outputs; i++) {
        tl_json_open_object(json, now->output[i].name);
        tl_json_add_number(json, "simulated", now->output[i].y);
        tl_json_add_number(json, "measured", now->output[i].measured);
        tl_json_add_text(json, "unit", now->output[i].unit);
        tl_json_close(json);
    }
    tl_json_close(json);
}

static void add_recorder(tl_json_writer *json, const tl_live_recorder_status *recorder) {
    if (recorder == NULL) {
        return;
    }
    const tl_recorder_mark *mark = tl_recorder_state_mark(&recorder->state);
    tl_json_add_count(json, "lost", __atomic_load_n(&mark->totals.lost, __ATOMIC_RELAXED));
    tl_json_add_count(json, "open_findings", __atomic_load_n(&recorder->open_findings, __ATOMIC_RELAXED));
}

static void compose_line(tl_follow *follow) {
    char utc[TL_UTC_TEXT];
    tl_json_writer json;
    tl_control_state state = {.version = 0};
    tl_activation_view *view = &follow->views[follow->lines % 2];
    const tl_run_status *now = &view->figures;
    const tl_run_status *before = &follow->views[(follow->lines + 1) % 2].figures;
    const tl_activation_host functions = tl_live_host_functions(&follow->host);
    functions.read_view(functions.context, view);
    tl_activation_view_write(view, &state);
    tl_utc_text(tl_utc_now(), utc);
    tl_json_writer_begin(&json);
    tl_json_add_text(&json, "time", utc);
    tl_control_add_figures(&json, &state);
    tl_json_add_truth(&json, "is_in_lock",
                      now->twin_alive && (now->lock.state == TL_LOCK_LOCKED || now->lock.state == TL_LOCK_CORRECTED));
    tl_json_add_number(&json, "tick", (double)now->tick);
    tl_json_add_count(&json, "evaluations", now->evaluations);
    tl_json_add_count(&json, "executions", now->executions);
    tl_json_add_count(&json, "time_limited", now->timed_out);
    add_times(&json, now, before);
    add_recorder(&json, follow->host.recorder);
    add_corrections(&json, now, before);
    add_outputs(&json, now);
    tl_json_add_count(&json, "dropped_lines", follow->dropped);
    follow->lines++;
    follow->written = 0;
    follow->length = tl_json_writer_line(&json, follow->line, sizeof follow->line - 1);
    tl_json_writer_free(&json);
    if (follow->length > 0) {
        follow->line[follow->length++] = '\n';
    }
}

/* ---- output ---- */

/* The open file may be shared with other programs, so O_NONBLOCK is not set. A pipe with room takes
 * PIPE_BUF bytes without waiting. */
static ssize_t write_part(int output, const char *from, size_t size) {
    struct pollfd room = {.fd = output, .events = POLLOUT};
    if (poll(&room, 1, 0) != 1) {
        return 0;
    }
    size = size < PIPE_BUF ? size : PIPE_BUF;
    ssize_t done = send(output, from, size, MSG_DONTWAIT | MSG_NOSIGNAL);
    return done < 0 && errno == ENOTSOCK ? write(output, from, size) : done;
}

static void write_line(tl_follow *follow) {
    ssize_t done = 1;
    while (done > 0 && follow->written < follow->length) {
        done = write_part(follow->output, follow->line + follow->written, follow->length - follow->written);
        follow->written += done > 0 ? (size_t)done : 0;
    }
    if (done < 0 && (errno == EPIPE || errno == ECONNRESET)) {
        tl_log(TL_LOG_NOTICE, "--follow: the reader is gone: no more lines are written, the run continues");
        follow->output = -1;
    }
}

void tl_follow_poll(tl_follow *follow) {
    tl_time now = tl_clock_now(NULL);
    if (follow->output < 0) {
        return;
    }
    write_line(follow);
    if (now < follow->due || follow->output < 0) {
        return;
    }
    follow->due = now - follow->due < INTERVAL ? follow->due + INTERVAL : now + INTERVAL;
    if (follow->written < follow->length) {
        follow->dropped++;
        return;
    }
    compose_line(follow);
    write_line(follow);
}
