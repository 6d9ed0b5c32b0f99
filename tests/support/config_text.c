/* See config_text.h. */
#include "tests/support/config_text.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "tests/support/message.h"

char *tl_test_read_text(const char *path) {
    FILE *file = fopen(path, "rb");
    char *text = file != NULL ? calloc(1, TL_CONFIG_MAX_BYTES + 1) : NULL;
    if (text != NULL && fread(text, 1, TL_CONFIG_MAX_BYTES, file) == 0) {
        free(text);
        text = NULL;
    }
    if (file != NULL) {
        (void)fclose(file);
    }
    return text;
}

char *tl_test_replaced(const char *text, const char *old, const char *new) {
    const char *at = strstr(text, old);
    if (at == NULL || strstr(at + 1, old) != NULL) {
        return NULL;
    }
    size_t size = strlen(text) + strlen(new) + 1;
    char *result = malloc(size);
    if (result != NULL) {
        (void)snprintf(result, size, "%.*s%s%s", (int)(at - text), text, new, at + strlen(old));
    }
    return result;
}

bool tl_test_write_replaced(const char *from, const char *to, const char *old, const char *new) {
    char *text = tl_test_read_text(from);
    char *changed = text != NULL ? tl_test_replaced(text, old, new) : NULL;
    FILE *output = changed != NULL ? fopen(to, "w") : NULL;
    bool written = output != NULL && fputs(changed, output) >= 0;
    written = output != NULL && fclose(output) == 0 && written;
    free(text);
    free(changed);
    return written;
}

size_t tl_test_line_of(const char *text, const char *part) {
    const char *at = strstr(text, part);
    size_t line = at != NULL ? 1 : 0;
    for (const char *c = text; c < at; c++) {
        line += *c == '\n' ? 1 : 0;
    }
    return line;
}

static void add_problem(void *context, tl_status status, const char *where, const char *text) {
    tl_test_verdict *verdict = context;
    if (verdict->count < TL_TEST_PROBLEMS) {
        tl_test_problem *problem = &verdict->problems[verdict->count];
        problem->status = status;
        (void)snprintf(problem->where, sizeof problem->where, "%s", where);
        (void)snprintf(problem->text, sizeof problem->text, "%s", text);
    }
    verdict->count++;
}

void tl_test_judge_text(const char *text, size_t size, tl_test_verdict *verdict) {
    *verdict = (tl_test_verdict){.count = 0};
    tl_report report = {.add = add_problem, .context = verdict};
    verdict->status = tl_config_read_text("bench/motor.json", text, size, &verdict->config, &report);
}

void tl_test_judge_file(const char *path, tl_test_verdict *verdict) {
    *verdict = (tl_test_verdict){.count = 0};
    tl_report report = {.add = add_problem, .context = verdict};
    verdict->status = tl_config_read(path, &verdict->config, &report);
}

static void expect_problem(const char *base, const tl_test_change *change) {
    static tl_test_verdict verdict;
    char place[32];
    char *text = tl_test_replaced(base, change->old, change->new);
    TEST_ASSERT_NOT_NULL_MESSAGE(text, change->old);
    size_t line = tl_test_line_of(base, change->at != NULL ? change->at : change->old);
    TEST_ASSERT_NOT_EQUAL_size_t(0, line);
    (void)snprintf(place, sizeof place, "line %zu", line);
    tl_test_judge_text(text, strlen(text), &verdict);
    free(text);
    TEST_ASSERT_EQUAL_STRING_MESSAGE(change->where, verdict.problems[0].where, change->new);
    TL_EXPECT_PARTS(place, verdict.problems[0].text);
    TL_EXPECT_PARTS(change->parts, verdict.problems[0].text);
    TEST_ASSERT_EQUAL_STRING_MESSAGE("", verdict.problems[1].text, change->new);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, verdict.status);
    TEST_ASSERT_NULL(verdict.config.tree);
}

void tl_test_expect_problems(const char *base, const tl_test_change *changes, size_t count) {
    for (size_t i = 0; i < count; i++) {
        expect_problem(base, &changes[i]);
    }
}
