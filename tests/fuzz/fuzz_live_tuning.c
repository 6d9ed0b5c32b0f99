/* Fuzzes a tuning block of a hostile writer, as a twin and a recorder read it.
 *
 * Input:  a byte that selects which fields are corrected, so that the input passes the first
 *         checks; the head; then the text. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/identity.h"
#include "firmware/twin/live_tuning.h"
#include "tests/fuzz/harness.h"
#include "tests/fuzz/input.h"

enum { RIGHT_NUMBER = 1, RIGHT_TEXT = 2, RIGHT_WORDS = 4 };

static tl_live_tuning block;
static tl_live_tuning_head head;
static char text[TL_CONFIG_MAX_BYTES + 1];

static void put_right(unsigned what, size_t size) {
    if ((what & RIGHT_NUMBER) != 0) {
        block.head.number = 2;
    }
    if ((what & RIGHT_TEXT) != 0) {
        block.head.size = (uint32_t)size;
        tl_sha256(block.text, size, block.head.hash);
    }
    if ((what & RIGHT_WORDS) != 0) {
        block.head.who[0] = block.head.origin[0] = block.head.why[0] = '\0';
    }
}

/* Expects the ranges on which a twin relies. */
static void check_numbers(const tl_tuning *tuning) {
    tl_fuzz_hold(tuning->matches <= TL_MAX_MATCH && tuning->adjusts <= TL_MAX_ADJUST);
    tl_fuzz_hold(tuning->evaluations >= 1 && tuning->evaluations <= TL_TUNING_EVALUATIONS && tuning->time >= 0);
    tl_fuzz_hold(tuning->margin >= 0.0 && tuning->margin < 1.0 && tuning->noise_floor >= 0.0);
    for (uint32_t i = 0; i < tuning->matches; i++) {
        const tl_tuning_match *match = &tuning->match[i];
        tl_fuzz_hold(isfinite(match->tolerance) && isfinite(match->weight) && match->weight >= 0.0);
        tl_fuzz_hold(!(match->weight > 0.0) || match->tolerance > 0.0);
    }
    for (uint32_t v = 0; v < tuning->adjusts; v++) {
        const tl_tuning_adjust *adjust = &tuning->adjust[v];
        tl_fuzz_hold(isfinite(adjust->nominal) && adjust->lower < adjust->upper && adjust->has_nominal <= 1);
        tl_fuzz_hold(isfinite(adjust->deviation_penalty) && isfinite(adjust->rate_penalty) &&
                     isfinite(adjust->approved));
    }
}

static void check_head(void) {
    tl_fuzz_hold(head.number != 0 && head.number % 2 == 0 && head.size <= TL_CONFIG_MAX_BYTES);
    tl_fuzz_hold(tl_identity_is_sound(head.hash) && head.hash[0] != '\0');
    tl_fuzz_hold(memchr(head.who, '\0', sizeof head.who) != NULL && memchr(head.why, '\0', sizeof head.why) != NULL &&
                 memchr(head.origin, '\0', sizeof head.origin) != NULL);
    check_numbers(&head.tuning);
}

/* Checks the tuning for a twin that was built with one matched output and one adjusted variable. */
static void check_fit(void) {
    tl_tuning built = {.matches = 1, .adjusts = 1, .evaluations = 60};
    tl_error error;
    built.match[0] = (tl_tuning_match){.tolerance = 1.0, .weight = 1.0};
    built.adjust[0] = (tl_tuning_adjust){.lower = -HUGE_VAL, .upper = HUGE_VAL};
    if (tl_tuning_fits(&head.tuning, &built, &error) == TL_OK) {
        tl_fuzz_hold(head.tuning.matches == 1 && head.tuning.evaluations <= 60 && head.tuning.match[0].weight > 0.0);
    } else {
        tl_fuzz_hold(error.text[0] != '\0');
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    tl_error error;
    if (size == 0) {
        return 0;
    }
    unsigned what = data[0];
    size_t of_head = size - 1 < sizeof block.head ? size - 1 : sizeof block.head;
    size_t of_text = size - 1 - of_head < sizeof block.text - 1 ? size - 1 - of_head : sizeof block.text - 1;
    memset(&block.head, 0, sizeof block.head);
    memcpy(&block.head, data + 1, of_head);
    memcpy(block.text, data + 1 + of_head, of_text);
    block.text[of_text] = '\0';
    put_right(what, of_text);
    if (tl_live_tuning_read(&block, &head, &error) == TL_OK) {
        check_head();
        check_fit();
    }
    if (tl_live_tuning_read_text(&block, &head, text, &error) == TL_OK) {
        char digest[TL_SHA256_TEXT];
        tl_fuzz_hold(strlen(text) == head.size);
        tl_sha256(text, head.size, digest);
        tl_fuzz_hold(strcmp(digest, head.hash) == 0);
        check_head();
    }
    return 0;
}
