/* Tuning block: see live_tuning.h. */
#include "firmware/twin/live_tuning.h"

#include <assert.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>

#include "firmware/base/identity.h"
#include "firmware/base/text.h"
#include "master/base/text.h"

enum { PAGE = 4096 };

/* Offset of all fields after number and size, which share one 64-bit unit. */
enum { BEHIND = offsetof(tl_live_tuning_head, hash) };

/* ---- writer ---- */

uint32_t tl_live_tuning_write(tl_live_tuning *block, const tl_live_tuning_head *head, const char *text) {
    uint32_t writing = tl_live_tuning_number(block) | 1U;
    assert(head->size <= TL_CONFIG_MAX_BYTES && strlen(text) == head->size);
    __atomic_store_n(&block->head.number, writing, __ATOMIC_RELAXED);
    __atomic_store_n(&block->head.size, head->size, __ATOMIC_RELEASE);
    tl_words_store((char *)&block->head + BEHIND, (const char *)head + BEHIND, sizeof *head - BEHIND);
    tl_words_store(block->text, text, head->size + 1);
    __atomic_store_n(&block->head.number, writing + 1, __ATOMIC_RELEASE);
    return writing + 1;
}

void tl_live_tuning_skip(tl_live_tuning *block, uint32_t number) {
    uint32_t before = tl_live_tuning_number(block);
    if (before != 0 || number != 0) {
        __atomic_store_n(&block->head.number, (before > number ? before : number) | 1U, __ATOMIC_RELEASE);
    }
}

bool tl_live_tuning_answered(const tl_live_tuning_answer *answer, uint32_t number, tl_live_tuning_answer *copy) {
    if (__atomic_load_n(&answer->number, __ATOMIC_ACQUIRE) != number) {
        return false;
    }
    *copy = *answer;
    copy->number = number;
    copy->why[sizeof copy->why - 1] = '\0';
    return true;
}

void tl_live_tuning_answer_with(tl_live_tuning_answer *answer, uint32_t number, int64_t tick, const char *why) {
    __atomic_store_n(&answer->refused, why != NULL ? 1 : 0, __ATOMIC_RELAXED);
    __atomic_store_n(&answer->tick, tick, __ATOMIC_RELAXED);
    (void)snprintf(answer->why, sizeof answer->why, "%s", why != NULL ? why : "");
    __atomic_store_n(&answer->number, number, __ATOMIC_RELEASE);
}

/* ---- readers ---- */

static bool is_text(const char *text, size_t size) {
    char clean[TL_LIVE_TUNING_WHY];
    size_t length = strnlen(text, size);
    return length < size && tl_clean_text(text, length, clean, sizeof clean) == length &&
           memcmp(clean, text, length) == 0;
}

static tl_status fail_changed(tl_error *error) {
    return tl_fail(error, TL_TRY_AGAIN, "a tuning is being written");
}

/* Validates a private copy. */
static tl_status check_head(const tl_live_tuning_head *head, tl_error *error) {
    if (head->hash[0] == '\0' || !tl_identity_is_sound(head->hash)) {
        return tl_fail(error, TL_BAD_DATA, "tuning: its hash is invalid");
    }
    if (!is_text(head->who, sizeof head->who) || !is_text(head->origin, sizeof head->origin) ||
        !is_text(head->why, sizeof head->why)) {
        return tl_fail(error, TL_BAD_DATA, "tuning: a text is invalid");
    }
    if (head->size > TL_CONFIG_MAX_BYTES) {
        return tl_fail(error, TL_BAD_DATA, "tuning: its configuration has %u bytes (expected at most %d)",
                       (unsigned)head->size, (int)TL_CONFIG_MAX_BYTES);
    }
    return tl_tuning_check(&head->tuning, error);
}

tl_status tl_live_tuning_read(const tl_live_tuning *block, tl_live_tuning_head *head, tl_error *error) {
    uint32_t number = __atomic_load_n(&block->head.number, __ATOMIC_ACQUIRE);
    if (number == 0 || number % 2 != 0) {
        return fail_changed(error);
    }
    memset(head, 0, sizeof *head);
    head->number = number;
    head->size = __atomic_load_n(&block->head.size, __ATOMIC_ACQUIRE);
    tl_words_load((char *)head + BEHIND, (const char *)&block->head + BEHIND, sizeof *head - BEHIND);
    return tl_live_tuning_number(block) != number ? fail_changed(error) : check_head(head, error);
}

tl_status tl_live_tuning_read_text(const tl_live_tuning *block, tl_live_tuning_head *head,
                                   char text[TL_CONFIG_MAX_BYTES + 1], tl_error *error) {
    char digest[TL_SHA256_TEXT];
    tl_status status = tl_live_tuning_read(block, head, error);
    if (status != TL_OK) {
        return status;
    }
    tl_words_load(text, block->text, head->size);
    text[head->size] = '\0';
    if (tl_live_tuning_number(block) != head->number) {
        return fail_changed(error);
    }
    tl_sha256(text, head->size, digest);
    if (strlen(text) != head->size || strcmp(digest, head->hash) != 0) {
        return tl_fail(error, TL_BAD_DATA, "tuning: its text does not match its hash");
    }
    return TL_OK;
}

void tl_live_tuning_hide_text(const tl_block *block) {
    size_t shown = (offsetof(tl_live_tuning, text) + PAGE - 1) / PAGE * PAGE;
    (void)mprotect((char *)block->bytes + shown, block->size - shown, PROT_NONE);
}
