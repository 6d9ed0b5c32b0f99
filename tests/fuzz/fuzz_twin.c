/* Fuzzes results and accounts of a hostile FMU process, in which it can change each byte; and the
 * use of those that are accepted.
 *
 * Input:  what a result contains besides its record; then ticks: changes of a valid result (their
 *         number, then a place and a value for each); at the end, changes of the account. So the
 *         tested data are nearly valid. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cjson/cJSON.h>

#include "firmware/report/show.h"
#include "firmware/report/summary.h"
#include "firmware/twin/twin_recorder.h"
#include "firmware/twin/twin_step.h"
#include "tests/fuzz/harness.h"
#include "tests/fuzz/input.h"

enum { MOST_TICKS = 64, MOST_CHANGES = 16 };

static const char configuration[] =
    "{\"twinlock\": 1, \"name\": \"fuzz\", \"step_s\": 0.01,"
    " \"components\": {\"drive\": {\"fmu\": \"drive.fmu\"}, \"motor\": {\"fmu\": \"motor.fmu\"}},"
    " \"plant\": {\"omega\": {\"unit\": \"rad/s\"}, \"current\": {\"unit\": \"A\"}},"
    " \"connect\": [[\"plant.omega\", \"drive.y\"]],"
    " \"synchronise\": {\"adjust\": {\"motor.d\": {\"nominal\": 0.0031, \"step\": 0.12}},"
    " \"match\": {\"motor.omega\": {\"to\": \"plant.omega\", \"tolerance\": 1.0},"
    "             \"motor.i\": {\"to\": \"plant.current\", \"tolerance\": 0.5}},"
    " \"horizon\": {\"prediction\": 1}, \"algorithm\": \"secant\", \"budget\": {\"evaluations\": 60}}}";

static tl_summary summary;
static tl_account account;
static int64_t least; /* lowest valid step of the next record */

/* ---- the enemy ---- */

static void change(unsigned char *bytes, size_t size) {
    if (bytes == NULL || size == 0) {
        return;
    }
    for (unsigned changes = tl_fuzz_take() % MOST_CHANGES; changes > 0; changes--) {
        size_t place = (tl_fuzz_take() << 8 | tl_fuzz_take()) % size;
        bytes[place] = (unsigned char)tl_fuzz_take();
    }
}

static void make_honest(int64_t tick, tl_twin_result *honest) {
    memset(honest, 0, sizeof *honest);
    honest->tick = tick;
    honest->ready = 1;
    honest->record.step = tick;
    honest->record.outcome = TL_OPTIMISED;
}

static void make_honest_account(const tl_config *config) {
    account = (tl_account){.components = (uint32_t)config->component_count + 1,
                           .matches = (uint32_t)config->match_count,
                           .adjusts = (uint32_t)config->adjust_count,
                           .prediction = 1,
                           .lead = 1,
                           .complete = 1,
                           .algorithm = "secant"};
    for (size_t i = 0; i < account.components; i++) {
        (void)snprintf(account.component[i].name, sizeof account.component[i].name, "part%zu", i);
    }
}

/* ---- what is done with it ---- */

static void use(const tl_config *config, const tl_record *record, FILE *table) {
    tl_fuzz_hold(record->step >= least && tl_outcome_name(record->outcome) != NULL &&
                 tl_stop_name(record->stop) != NULL);
    least = record->step + 1;
    tl_summary_add(&summary, config, record);
    tl_trajectory_add(table, config, record);
}

static void take_result(const tl_config *config, tl_twin_attached attached, int64_t tick, FILE *table) {
    static tl_twin_result honest;
    size_t size = tl_twin_result_size(config, attached);
    tl_twin_result *result = malloc(size); /* without spare bytes, so that a sanitizer detects an access outside */
    if (result == NULL) {
        return;
    }
    make_honest(tick, &honest);
    memcpy(result, &honest, size);
    change((unsigned char *)result, size);
    if (tl_twin_result_is_sound(result, config, tick, least) && result->ready != 0) {
        use(config, &result->record, table);
    }
    free(result);
}

/* Validates a changed account, as twin_child.c does. */
static bool take_account(const tl_config *config) {
    make_honest_account(config);
    change((unsigned char *)&account, sizeof account);
    return account.components == config->component_count + 1 && account.matches == config->match_count &&
           account.adjusts == config->adjust_count && tl_account_is_sound(&account);
}

/* Expects that the JSON summary is valid, and that summary and table have no control characters
 * except newline and tab. */
static void print(const tl_config *config) {
    char *text = NULL;
    size_t size = 0;
    tl_error error;
    tl_recorder_signal match[TL_MAX_MATCH];
    tl_recorder_signal adjust[TL_MAX_ADJUST];
    FILE *file = open_memstream(&text, &size);
    tl_fuzz_hold(file != NULL);
    tl_fuzz_hold(tl_summary_print_json(&summary, config, &account, NULL, file, &error) == TL_OK && fflush(file) == 0);
    cJSON *document = cJSON_Parse(text);
    tl_fuzz_hold(document != NULL);
    cJSON_Delete(document);
    tl_summary_print_table(&summary, config, &account, NULL, true, file);
    (void)fclose(file);
    for (size_t i = 0; i < size; i++) {
        tl_fuzz_hold(((unsigned char)text[i] >= ' ' && text[i] != '\x7f') || text[i] == '\n' || text[i] == '\t');
    }
    free(text);
    tl_twin_recorder_signals(config, &account, match, adjust);
    (void)tl_account_executions(&account);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static const tl_twin_attached attachments[] = {TL_ATTACHED_NONE, TL_ATTACHED_COUNTS};
    const tl_config *config = tl_fuzz_config(configuration);
    tl_error error;
    FILE *table = NULL;
    char *lines = NULL;
    size_t length = 0;
    tl_fuzz_begin(data, size);
    FILE *output = open_memstream(&lines, &length);
    tl_fuzz_hold(output != NULL && tl_trajectory_open("-", output, config, &table, &error) == TL_OK);
    summary = (tl_summary){0};
    least = 0;
    tl_twin_attached attached = attachments[tl_fuzz_take() % 2];
    for (int64_t tick = tl_fuzz_take() % MOST_TICKS; tick > 0 && !tl_fuzz_is_over(); tick--) {
        take_result(config, attached, MOST_TICKS - tick, table);
    }
    if (take_account(config)) {
        print(config);
    }
    (void)fclose(output);
    free(lines);
    return 0;
}
