/* Read-back test: see read_back.h. */
#include "firmware/twin/read_back.h"

#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include "master/twin/twin_read_back.h"

typedef enum read_stage { STAGE_SKIPPED, STAGE_WANTED, STAGE_BEGUN, STAGE_DONE } read_stage;

/* Result of one component in the block. */
typedef struct read_answer {
    uint32_t stage;
    tl_read_back_component found; /* valid when done */
} read_answer;

/* At the beginning of the block; the saved states follow. */
typedef struct read_block {
    uint64_t size; /* bytes of the saved states */
    read_answer of[TL_RECORDER_COMPONENTS];
} read_block;

static const size_t ROOM = TL_READ_BACK_BYTES - sizeof(read_block);

static unsigned char *bytes_of(read_block *block) {
    return (unsigned char *)block + sizeof *block;
}

/* ---- reader process ---- */

/* `is_here`: the control test, in the process that saved the states. */
static void evaluate_result(const tl_read_back *read, const char *name, bool is_here, tl_read_back_component *found) {
    char text[TL_ERROR_TEXT];
    *found = (tl_read_back_component){.finding = is_here ? TL_READ_BACK_UNKNOWN : TL_READ_BACK_IS_EXACT};
    if (read->outcome == TL_READ_BACK_DIFFERS) {
        found->finding = is_here ? TL_READ_BACK_NOT_REPEATABLE : TL_READ_BACK_IS_OTHER;
        (void)snprintf(found->text, sizeof found->text, "%.127s is %.9g in step %u after it, but %.9g %s",
                       read->variable, read->first, read->after, read->again,
                       is_here ? "if the step is repeated after a rollback" : "in the other process");
    } else if (read->outcome == TL_READ_BACK_REFUSED) {
        found->finding = is_here ? TL_READ_BACK_NOT_REPEATABLE : TL_READ_BACK_IS_REFUSED;
        tl_assembly_quote(read->error.text, name, text, sizeof text);
        (void)snprintf(found->text, sizeof found->text, "%s%.400s",
                       is_here ? "after a rollback it fails in a step that had succeeded: " : "", text);
    }
}

/* Publishes progress at once, because this process may end during the next call. */
static void set_stage(read_answer *kept, read_stage reached) {
    __atomic_store_n(&kept->stage, (uint32_t)reached, __ATOMIC_RELEASE);
}

tl_status tl_read_back_run_reader(const tl_assembly *assembly, void *block, tl_error *error) {
    read_block *own = block;
    tl_status status = tl_twin_prepare_reader(assembly->twin, error);
    if (status != TL_OK) {
        return status;
    }
    for (size_t i = 0; i < assembly->config.component_count; i++) {
        tl_read_back read;
        if (own->of[i].stage != STAGE_WANTED || own->size > ROOM) {
            continue;
        }
        set_stage(&own->of[i], STAGE_BEGUN);
        tl_twin_read_state(assembly->twin, bytes_of(own), (size_t)own->size, i, &read);
        evaluate_result(&read, assembly->config.components[i].name, false, &own->of[i].found);
        set_stage(&own->of[i], STAGE_DONE);
    }
    return TL_OK;
}

/* ---- process that saved ---- */

/* Evaluates one component after the reader process has ended. Returns true if it is done. */
static bool evaluate_answer(read_answer *answer, const tl_error *end, tl_read_back_component *found) {
    const read_stage reached = (read_stage)answer->stage;
    if (reached == STAGE_DONE) {
        *found = answer->found; /* untrusted: the FMU of that process may have overwritten it */
        found->text[sizeof found->text - 1] = '\0';
        if (found->finding != TL_READ_BACK_IS_EXACT && found->finding != TL_READ_BACK_IS_OTHER) {
            found->finding = TL_READ_BACK_IS_REFUSED;
        }
    } else {
        found->finding = reached == STAGE_BEGUN ? TL_READ_BACK_ENDS : TL_READ_BACK_UNKNOWN;
        (void)snprintf(found->text, sizeof found->text, "%s", end->text);
    }
    if (reached != STAGE_WANTED) {
        answer->stage = STAGE_SKIPPED;
    }
    return reached != STAGE_WANTED;
}

/* Starts as many processes as needed: each one completes at least one component, or is the last. */
static void run_readers(const tl_read_back_host *host, tl_read_back_report *report) {
    read_block *block = host->block;
    bool continues = true;
    while (continues) {
        tl_error end = {.text = "the test ended before this component"};
        bool remains = false;
        continues = false;
        (void)host->start_reader(host->context, &end);
        for (size_t i = 0; i < report->count; i++) {
            if (block->of[i].stage != STAGE_SKIPPED) {
                bool settled = evaluate_answer(&block->of[i], &end, &report->of[i]);
                continues = continues || settled;
                remains = remains || !settled;
            }
        }
        continues = continues && remains;
    }
}

/* Saves all components and sets the findings that need no other process. Returns false if there is
 * nothing to load. */
static bool save_states(const tl_assembly *assembly, read_block *block, tl_read_back_report *report) {
    tl_read_back here[TL_RECORDER_COMPONENTS];
    tl_error error = {.text = "its saved state is too large for this test"};
    size_t size = 0;
    tl_status status = tl_twin_write_states(assembly->twin, bytes_of(block), ROOM, &size, here, &error);
    bool is_saved = status == TL_OK && size != 0 && size <= ROOM;
    block->size = size;
    for (size_t i = 0; i < report->count; i++) {
        tl_read_back_component *found = &report->of[i];
        if (is_saved) {
            evaluate_result(&here[i], assembly->config.components[i].name, true, found);
        } else {
            tl_assembly_quote(error.text, "", found->text, sizeof found->text);
        }
        block->of[i].stage = is_saved && here[i].outcome == TL_READ_BACK_EXACT ? STAGE_WANTED : STAGE_SKIPPED;
    }
    return is_saved;
}

void tl_read_back_run(const tl_assembly *assembly, const tl_read_back_host *host, tl_read_back_report *report) {
    *report = (tl_read_back_report){.count = assembly->config.component_count};
    if (host == NULL || !tl_twin_can_save(assembly->twin)) {
        return;
    }
    report->is_tried = true;
    if (save_states(assembly, host->block, report)) {
        run_readers(host, report);
    }
    report->is_exact = true;
    for (size_t i = 0; i < report->count; i++) {
        report->is_exact = report->is_exact && report->of[i].finding == TL_READ_BACK_IS_EXACT;
    }
}

bool tl_read_back_prevents_resume(tl_saved_state_outcome finding) {
    return finding == TL_READ_BACK_ENDS || finding == TL_READ_BACK_IS_REFUSED || finding == TL_READ_BACK_IS_OTHER;
}

const char *tl_read_back_text(tl_saved_state_outcome finding) {
    switch (finding) {
    case TL_READ_BACK_ENDS:
        return "ends the process that loads it";
    case TL_READ_BACK_IS_REFUSED:
        return "cannot be loaded by another process";
    case TL_READ_BACK_IS_OTHER:
        return "gives other results in another process";
    case TL_READ_BACK_NOT_REPEATABLE:
    case TL_READ_BACK_IS_EXACT:
    case TL_READ_BACK_UNKNOWN:
        break;
    }
    return "could not be tested in another process";
}
