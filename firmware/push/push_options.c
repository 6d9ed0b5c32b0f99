/* Options: see push_options.h. */
#include "firmware/push/push_options.h"

#include <stddef.h>

enum { LONGEST_SHADOW = 3600 };

#define COUNT(array) (sizeof(array) / sizeof(array)[0])

/* As they are given: what is to be done is still a switch each. */
typedef struct words {
    tl_push_options options;
    bool state;
    bool versions;
    bool get;
    bool confirm;
    bool back;
    bool cancel;
} words;

#define SETS(member) .offset = offsetof(words, member)

static const tl_program_option ROWS[] = {
    {"pin", "PIN", TL_PROGRAM_TEXT, SETS(options.pin),
     "what `twinlock serve --fingerprint` prints on the box: sha256//… or AB:CD:…; without it\nthis ends, and says what the box has shown"},
    {"token-file", "FILE", TL_PROGRAM_TEXT, SETS(options.token_file),
     "your token; default: the environment variable TWINLOCK_TOKEN"},
    {"base", "FILE", TL_PROGRAM_TEXT, SETS(options.base),
     "what CONFIG was made from: ends with 75 unless that is what is active"},
    {"why", "TEXT", TL_PROGRAM_TEXT, SETS(options.why), "a word for the book of changes"},
    {"no-activate", NULL, TL_PROGRAM_SWITCH, SETS(options.check),
     "validate it and try its FMUs on the box, and change nothing"},
    {"activate", NULL, TL_PROGRAM_SWITCH, SETS(options.activate),
     "activate it once all steps before that went well: as without this"},
    {"restart", NULL, TL_PROGRAM_SWITCH, SETS(options.restart),
     "allow what takes an end and a new start of the twin, with a gap"},
    {"until-confirmed", NULL, TL_PROGRAM_SWITCH, SETS(options.needs_confirm),
     "keep it only if somebody confirms it during its probation"},
    {"wait", NULL, TL_PROGRAM_SWITCH, SETS(options.wait), "until it is kept or returned from; else until it is active"},
    {"probation", "S", TL_PROGRAM_SECONDS, SETS(options.probation_s), "how long its probation is"},
    {"shadow", "S", TL_PROGRAM_SECONDS, SETS(options.shadow_s),
     "how long a new twin runs beside the old one over live samples, before the two are compared;\nat most 3600"},
    {"accept-worse", NULL, TL_PROGRAM_SWITCH, SETS(options.accept_worse),
     "let a new twin take over also if an output is more than twice as far off as the old one's, and\nout of its tolerance"},
    {"require-lock", "PERCENT", TL_PROGRAM_PERCENT, SETS(options.require_lock),
     "return from it unless the twin is in lock in so much of its probation"},
    {"state", NULL, TL_PROGRAM_SWITCH, SETS(state), "print how the plant is"},
    {"versions", NULL, TL_PROGRAM_SWITCH, SETS(versions),
     "list the configurations that the box has kept, and what it has refused last"},
    {"get", NULL, TL_PROGRAM_SWITCH, SETS(get), "print the active configuration, or that of --version"},
    {"confirm", NULL, TL_PROGRAM_SWITCH, SETS(confirm), "keep the one that is on probation"},
    {"cancel", NULL, TL_PROGRAM_SWITCH, SETS(cancel),
     "end the change that is under way, or return from the one that is on probation"},
    {"rollback", NULL, TL_PROGRAM_SWITCH, SETS(back), "bring back the one before the active one, or that of --version"},
    {"version", "N", TL_PROGRAM_COUNT, SETS(options.version), "which one, of --get and --rollback"},
    {"json", NULL, TL_PROGRAM_SWITCH, SETS(options.json), "print what the box says as it is, a JSON object a line"},
};

static const tl_program PROGRAM = {
    .name = "twinlock push",
    .usage = "[CONFIG] URL [options]",
    .description =
        "Gives a configuration to a running plant on another box, and shows each step of the change; with\n"
        "--state, --versions, --get, --confirm, --cancel or --rollback asks it something else. URL is that of\n"
        "the plant, such as https://192.0.2.7:8443/motor; the port is 8443 if there is none.\n"
        "Exit codes: 0 done, 2 wrong usage or --restart is missing, 3 returned from, 65 bad configuration,\n"
        "69 nobody there, 75 try again or --base is not active, 77 not permitted.",
    .options = ROWS,
    .option_count = COUNT(ROWS),
    .least_words = 1,
    .most_words = 2,
};

/* What is given and would be ignored; NULL: nothing. */
static const char *useless_of(const words *given, bool is_no_configuration) {
    const tl_push_options *options = &given->options;
    bool is_candidate = options->base != NULL || options->check || options->activate || options->needs_confirm;
    bool is_way = options->restart || options->accept_worse || options->probation_s != 0 || options->shadow_s != 0 ||
                  options->require_lock > 0.0;
    if (is_no_configuration && is_candidate) {
        return "found --base, --activate, --no-activate or --until-confirmed, which are of use with a configuration only";
    }
    if (is_no_configuration && !given->back && is_way) {
        return "found --restart, --accept-worse, --probation, --shadow or --require-lock, which are of use with a configuration or --rollback only";
    }
    if ((given->state || given->versions || given->get) && (options->wait || options->why != NULL)) {
        return "found --wait or --why, and nothing is changed";
    }
    return NULL;
}

/* One of what excludes each other, and what belongs to it. */
static tl_program_outcome check(const words *given, size_t count) {
    int asked = (given->state ? 1 : 0) + (given->versions ? 1 : 0) + (given->get ? 1 : 0) + (given->confirm ? 1 : 0) +
                (given->back ? 1 : 0) + (given->cancel ? 1 : 0);
    if (asked > 1) {
        return tl_program_options_refuse(
            &PROGRAM, "expected at most one of --state, --versions, --get, --confirm, --cancel, --rollback");
    }
    if (asked == 1 && count == 2) {
        return tl_program_options_refuse(&PROGRAM, "found a configuration, and an option that takes none");
    }
    if (asked == 0 && count == 1) {
        return tl_program_options_refuse(
            &PROGRAM, "expected CONFIG and URL, or one of --state, --versions, --get, --confirm, --cancel, --rollback");
    }
    const char *useless = useless_of(given, asked == 1);
    if (useless != NULL) {
        return tl_program_options_refuse(&PROGRAM, useless);
    }
    if (given->options.check && given->options.activate) {
        return tl_program_options_refuse(&PROGRAM, "found --activate and --no-activate");
    }
    if (given->options.shadow_s > LONGEST_SHADOW) {
        return tl_program_options_refuse(&PROGRAM, "--shadow: expected whole seconds from 1 to 3600, for example 60");
    }
    if (given->options.version != 0 && !given->get && !given->back) {
        return tl_program_options_refuse(&PROGRAM, "--version needs --get or --rollback");
    }
    return TL_PROGRAM_READ;
}

static tl_push_action action_of(const words *given) {
    if (given->state) {
        return TL_PUSH_STATE;
    }
    if (given->versions) {
        return TL_PUSH_VERSIONS;
    }
    if (given->get) {
        return TL_PUSH_GET;
    }
    if (given->confirm) {
        return TL_PUSH_CONFIRM;
    }
    if (given->cancel) {
        return TL_PUSH_CANCEL;
    }
    return given->back ? TL_PUSH_RETURN : TL_PUSH_CONFIGURATION;
}

tl_program_outcome tl_push_options_read(int argc, char **argv, tl_push_options *options) {
    words given = {.state = false};
    char **rest = NULL;
    size_t count = 0;
    tl_program_outcome outcome = tl_program_options_read(&PROGRAM, argc, argv, &given, &rest, &count);
    outcome = outcome == TL_PROGRAM_READ ? check(&given, count) : outcome;
    if (outcome == TL_PROGRAM_READ) {
        *options = given.options;
        options->action = action_of(&given);
        options->config = count == 2 ? rest[0] : NULL;
        options->url = rest[count - 1];
    }
    return outcome;
}
