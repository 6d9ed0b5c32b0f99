/* Following: see push_follow.h. */
#include "firmware/push/push_follow.h"

#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "firmware/base/clock.h"
#include "firmware/base/log.h"
#include "firmware/control/control_words.h"

static const tl_time COMING_BACK = 60 * TL_SECOND;

bool tl_push_follow_is_due(const tl_push_lines *lines) {
    bool is_open = strcmp(lines->step, "activate") == 0 || strcmp(lines->step, "probation") == 0;
    bool is_done = strcmp(lines->result, "done") == 0;
    bool has_hung_up = strcmp(lines->result, "failed") == 0 && lines->hash[0] == '\0';
    return is_open && (is_done || has_hung_up);
}

/* ---- one question ---- */

/* Lines of which nothing is printed. */
static void note(void *context, long status, const char *bytes, size_t size) {
    tl_push_lines *lines = context;
    if (status == 200) {
        tl_push_lines_take(lines, bytes, size);
    }
}

/* False: nobody answers as it should. */
static bool inquire(tl_push_link *link, const char *path, uint64_t version, tl_push_lines *lines) {
    tl_error error;
    tl_push_lines_begin(lines, NULL, false, NULL);
    lines->wanted = version;
    tl_push_request request = {.method = "GET", .path = path, .take = note, .context = lines};
    return tl_push_link_ask(link, &request, &error) == TL_PUSH_OK && request.status == 200 && !lines->is_broken;
}

/* ---- the end ---- */

/* "kept: in lock for …" of the version with that text. */
static void tell_result(tl_push_link *link, tl_push_lines *lines, tl_push_lines *asked, const char *hash,
                        const tl_push_state *now) {
    bool is_ours = strcmp(now->hash, hash) == 0;
    (void)inquire(link, "/versions", is_ours ? now->version : lines->version, asked);
    tl_push_lines_say(lines, is_ours ? "kept" : "returned", 0, asked->version_result);
    tl_push_lines_end(lines, is_ours ? "done" : "undone", now, asked->version_result);
}

static int follow(tl_push_link *link, tl_push_lines *lines, tl_push_lines *asked, const char *hash) {
    const struct timespec pause = {.tv_sec = 1};
    tl_time heard = tl_clock_now(NULL);
    bool is_told = false;
    tl_push_lines_say(lines, lines->step, 0, "the run is waited for, for 60 s at most");
    while (tl_clock_now(NULL) - heard < COMING_BACK) {
        (void)nanosleep(&pause, NULL);
        if (!inquire(link, "", 0, asked) || asked->state.hash[0] == '\0') {
            continue;
        }
        const tl_push_state now = asked->state;
        bool is_idle = strcmp(now.step, "idle") == 0;
        bool is_ours = strcmp(now.hash, hash) == 0;
        heard = tl_clock_now(NULL);
        if (!is_ours || is_idle) {
            tell_result(link, lines, asked, hash, &now);
            return tl_control_exit_code(is_ours ? TL_CONTROL_DONE : TL_CONTROL_UNDONE);
        }
        if (!is_told && now.runs && strcmp(now.step, "probation") == 0) {
            is_told = true;
            tl_push_lines_say(lines, "probation", now.left_s, "the run is there again");
        }
    }
    tl_log(TL_LOG_ERROR,
           "the run has not come back for 60 s: its log on the box says why; --versions shows what came of the change");
    return tl_exit_code(TL_PLANT_DOWN);
}

int tl_push_follow(tl_push_link *link, tl_push_lines *lines, const char *hash) {
    tl_push_lines *asked = calloc(1, sizeof *asked);
    if (asked == NULL) {
        tl_log(TL_LOG_ERROR, "out of memory");
        return tl_exit_code(TL_TRY_AGAIN);
    }
    int code = follow(link, lines, asked, hash);
    free(asked);
    return code;
}
