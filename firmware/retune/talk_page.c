/* What a run says, for people: see talk_page.h. */
#include "firmware/retune/talk_page.h"

#include "firmware/base/log.h"
#include "firmware/retune/control_words.h"

static void print_state(const tl_control_state *state, FILE *output) {
    (void)fprintf(output, "%s: %s\n", state->plant, state->lock[0] == '\0' ? "no twin runs" : state->lock);
    (void)fprintf(output, "  configuration %.12s, version %llu\n", state->hash, (unsigned long long)state->version);
    if (state->step == TL_CONTROL_PROBATION) {
        (void)fprintf(output, "  on probation, %u s are left\n", state->left_s);
    } else if (state->step != TL_CONTROL_IDLE) {
        (void)fprintf(output, "  a change is under way: %s\n", tl_control_step_name((tl_control_step)state->step));
    }
    (void)fprintf(output, "  %llu ticks of %g s: %llu steps, %llu made up, %llu deadlines missed, %.1f %% in lock\n",
                  (unsigned long long)state->ticks, state->step_s, (unsigned long long)state->steps,
                  (unsigned long long)state->skipped, (unsigned long long)state->deadline_misses, state->in_lock);
    if (state->line[0] != '\0') {
        (void)fprintf(output, "  %s\n", state->line);
    }
}

static void print_version(const tl_control_version *version, FILE *output) {
    char number[24] = "-"; /* of what never was a version */
    if (version->version != 0) {
        (void)snprintf(number, sizeof number, "%llu", (unsigned long long)version->version);
    }
    (void)fprintf(output, "%c%4s  %.12s  %s  by %s, %s%s%s", version->is_active != 0 ? '*' : ' ', number, version->hash,
                  version->at, version->who, version->origin, version->kind[0] == '\0' ? "" : ", ", version->kind);
    (void)fprintf(output, "\n       %s%s%s\n", version->result, version->why[0] == '\0' ? "" : "; ", version->why);
}

static void print_change(const tl_control_reply *reply, FILE *output) {
    const tl_control_change *change = &reply->as.change;
    (void)fprintf(output, "            %s: %s → %s (%s%s)\n", change->path,
                  change->before[0] == '\0' ? "nothing" : change->before,
                  change->after[0] == '\0' ? "nothing" : change->after, change->kind,
                  tl_control_right_note(change->right));
    if (reply->more > 0) {
        (void)fprintf(output, "            and %u more\n", reply->more);
    }
}

static void print_problem(const tl_talk_page *page, const tl_control_reply *reply) {
    const tl_control_problem *problem = &reply->as.problem;
    const char *separator = problem->path[0] == '\0' ? "" : ": ";
    char line[32] = "";
    if (problem->line != 0) {
        (void)snprintf(line, sizeof line, "line %u: ", problem->line);
    }
    tl_log(TL_LOG_ERROR, "%s: %s%s%s%s", page->subject, line, problem->path, separator, problem->text);
    if (reply->more > 0) {
        tl_log(TL_LOG_ERROR, "%s: and %u more", page->subject, reply->more);
    }
}

static void print_end(const tl_control_end *end, FILE *output) {
    tl_control_result result = (tl_control_result)end->result;
    if (result != TL_CONTROL_DONE && result != TL_CONTROL_SAME) {
        tl_log(TL_LOG_ERROR, "%s: %s", tl_control_result_name(result), end->text);
    } else if (end->text[0] != '\0') {
        (void)fprintf(output, "%s\n", end->text);
    }
}

void tl_talk_page_print(const tl_talk_page *page, const tl_control_reply *reply) {
    FILE *output = page->output;
    switch ((tl_control_kind)reply->kind) {
    case TL_CONTROL_STATE:
        print_state(&reply->as.state, output);
        break;
    case TL_CONTROL_VERSION:
        print_version(&reply->as.version, output);
        break;
    case TL_CONTROL_CHANGE:
        print_change(reply, output);
        break;
    case TL_CONTROL_PROBLEM:
        print_problem(page, reply);
        break;
    case TL_CONTROL_STEP:
        (void)fprintf(output, "%-10s  %s\n", tl_control_step_name((tl_control_step)reply->as.progress.step),
                      reply->as.progress.text);
        break;
    case TL_CONTROL_END:
        print_end(&reply->as.end, output);
        break;
    case TL_CONTROL_CONFIGURATION:
    case TL_CONTROL_KINDS:
        break;
    }
    (void)fflush(output);
}
