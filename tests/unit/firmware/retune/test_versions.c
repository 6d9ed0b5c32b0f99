/* The versions on disk: which are stored, active, found and removed, and which text runs at the
 * start. */
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/retune/versions.h"
#include "tests/support/config_text.h"
#include "tests/support/message.h"
#include "tests/support/scratch.h"
#include "tests/support/stderr_capture.h"

static tl_scratch state;
static tl_scratch folder; /* STATE/versions */
static tl_versions versions;
static tl_version_choice choice;
static tl_error error;

void setUp(void) {
    tl_scratch_empty(&folder);
    (void)rmdir(folder.folder);
    tl_scratch_empty(&state);
    error = (tl_error){TL_OK, ""};
    free(choice.text);
    choice = (tl_version_choice){.text = NULL};
}

void tearDown(void) {
    tl_versions_close(&versions);
    free(choice.text);
    choice.text = NULL;
}

static void open_here(void) {
    tl_versions_close(&versions);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_versions_open(state.folder, &versions, &error), error.text);
}

static uint64_t add_of(const char *text, tl_change_origin origin) {
    uint64_t number = 0;
    const tl_version_candidate candidate = {
        text, strlen(text), "anna", "omega drifts", origin, TL_RIGHT_RETUNE, TL_CHANGE_IN_PLACE};
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_versions_add(&versions, &candidate, &number, &error), error.text);
    return number;
}

static uint64_t add(const char *text) {
    return add_of(text, TL_ORIGIN_NETWORK);
}

static const tl_probation_account account = {
    .terms = {60, 95.5, true}, .before_steps = 1000, .before_misses = 3, .left_ms = 60000};

static void activate(uint64_t number, bool on_probation) {
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        TL_OK, tl_versions_activate(&versions, number, on_probation ? &account : NULL, &error), error.text);
}

static void expect_result(uint64_t number, tl_version_result result, const char *reason) {
    const tl_version *version = tl_versions_get(&versions, number);
    TEST_ASSERT_NOT_NULL(version);
    TEST_ASSERT_EQUAL_STRING(tl_version_results[result], tl_version_results[version->result]);
    TEST_ASSERT_EQUAL_STRING(reason, version->reason);
}

/* The reason has all parts. */
static void expect_reason(uint64_t number, tl_version_result result, const char *parts) {
    const tl_version *version = tl_versions_get(&versions, number);
    TEST_ASSERT_NOT_NULL(version);
    TEST_ASSERT_EQUAL_STRING(tl_version_results[result], tl_version_results[version->result]);
    TL_EXPECT_PARTS(parts, version->reason);
}

static void expect_text(uint64_t number, const char *expected) {
    char *text = NULL;
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_versions_read(&versions, number, &text, &error), error.text);
    TEST_ASSERT_EQUAL_STRING(expected, text);
    free(text);
}

static void expect_choice(const char *file, const char *text, uint64_t number, bool is_candidate) {
    free(choice.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        TL_OK, tl_versions_choose(&versions, file, file != NULL ? strlen(file) : 0, &choice, &error), error.text);
    TEST_ASSERT_EQUAL_STRING(text, choice.text != NULL ? choice.text : file);
    TEST_ASSERT_EQUAL_size_t(strlen(text), choice.size);
    TEST_ASSERT_EQUAL_UINT64(number, choice.number);
    TEST_ASSERT_EQUAL_INT(is_candidate, choice.is_candidate);
}

/* The log has all parts, too. */
static void expect_choice_said(const char *file, const char *text, uint64_t number, bool is_candidate,
                               const char *parts) {
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    expect_choice(file, text, number, is_candidate);
    char *found = tl_stderr_capture_end();
    TL_EXPECT_PARTS(parts, found);
    free(found);
}

static void expect_no_choice(void) {
    free(choice.text);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_versions_choose(&versions, NULL, 0, &choice, &error));
    TL_EXPECT_PARTS("configuration|file|version", error.text);
    TEST_ASSERT_NULL(choice.text);
}

/* Version 1, "one", is active. It was read from the configuration's file. */
static void begin(void) {
    open_here();
    expect_choice("one", "one", 0, true);
    activate(add_of("one", TL_ORIGIN_START), false);
}

static void write_file(const char *name, const char *text) {
    FILE *file = fopen(tl_scratch_path(&folder, name), "w");
    TEST_ASSERT_NOT_NULL(file);
    TEST_ASSERT_GREATER_OR_EQUAL_INT(0, fputs(text, file));
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
}

static bool exists(const char *name) {
    return access(tl_scratch_path(&folder, name), F_OK) == 0;
}

/* The name of the file that contains a version's text. */
static const char *text_name(uint64_t number) {
    static char name[TL_SHA256_TEXT + 8];
    (void)snprintf(name, sizeof name, "%s.json", tl_versions_get(&versions, number)->hash);
    return name;
}

/* ---- the life of a version ---- */

static void test_the_first_one(void) {
    begin();
    TEST_ASSERT_EQUAL_UINT64(1, versions.active);
    TEST_ASSERT_EQUAL_size_t(1, versions.count);
    expect_result(1, TL_VERSION_ACTIVE, "");
    open_here();
    const tl_version *one = tl_versions_get(&versions, 1);
    TEST_ASSERT_NOT_NULL(one);
    TEST_ASSERT_EQUAL_UINT64(0, one->parent);
    TEST_ASSERT_EQUAL_UINT64(3, one->size);
    TEST_ASSERT_EQUAL_INT(TL_ORIGIN_START, one->origin);
    TEST_ASSERT_EQUAL_INT(TL_RIGHT_RETUNE, one->right);
    TEST_ASSERT_EQUAL_INT(TL_CHANGE_IN_PLACE, one->kind);
    TEST_ASSERT_EQUAL_STRING("anna", one->who);
    TEST_ASSERT_EQUAL_STRING("omega drifts", one->why);
    TEST_ASSERT_EQUAL_size_t(64, strlen(one->hash));
    TEST_ASSERT_EQUAL_size_t(24, strlen(one->at));
    TEST_ASSERT_GREATER_THAN_UINT64(0, one->boottime_ms);
    TEST_ASSERT_EQUAL_STRING(one->hash, versions.file_hash);
    expect_result(1, TL_VERSION_ACTIVE, "");
    expect_text(1, "one");
    expect_choice("one", "one", 1, false);
    expect_choice(NULL, "one", 1, false);
}

static void expect_probation(uint64_t left_ms) {
    const tl_probation_account *kept = &versions.probation.account;
    TEST_ASSERT_EQUAL_UINT64(2, versions.active);
    TEST_ASSERT_EQUAL_UINT64(2, versions.probation.version);
    TEST_ASSERT_EQUAL_UINT64(1, versions.probation.return_to);
    TEST_ASSERT_EQUAL_UINT32(60, kept->terms.given_s);
    TEST_ASSERT_EQUAL_DOUBLE(95.5, kept->terms.require_lock);
    TEST_ASSERT_TRUE(kept->terms.must_confirm);
    TEST_ASSERT_EQUAL_UINT64(1000, kept->before_steps);
    TEST_ASSERT_EQUAL_UINT64(3, kept->before_misses);
    TEST_ASSERT_EQUAL_UINT64(left_ms, kept->left_ms);
    expect_result(2, TL_VERSION_PROBATION, "");
    expect_result(1, TL_VERSION_ACTIVE, "");
}

static void test_probation(void) {
    begin();
    activate(add("two"), true);
    expect_probation(60000);
    open_here();
    expect_probation(60000);
    tl_probation_account passed = versions.probation.account;
    passed.left_ms = 50000;
    passed.steps = 1001;
    passed.misses = 2;
    passed.skipped = 1;
    passed.lock.steps[TL_LOCK_LOCKED] = 900;
    passed.lock.steps[TL_LOCK_LOST] = 101;
    passed.lock_before.steps[TL_LOCK_LOST] = 500;
    passed.tolerances.match[1].tolerance = 0.1;
    passed.tolerances.match[1].weight = 1e300;
    (void)snprintf(passed.widened, sizeof passed.widened, "motor.omega: tolerance 1 → 3");
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_versions_save_probation(&versions, &passed, &error));
    open_here();
    expect_probation(50000);
    TEST_ASSERT_EQUAL_UINT64(1001, versions.probation.account.steps);
    TEST_ASSERT_EQUAL_UINT64(2, versions.probation.account.misses);
    TEST_ASSERT_EQUAL_UINT64(1, versions.probation.account.skipped);
    TEST_ASSERT_EQUAL_UINT64(900, versions.probation.account.lock.steps[TL_LOCK_LOCKED]);
    TEST_ASSERT_EQUAL_UINT64(101, versions.probation.account.lock.steps[TL_LOCK_LOST]);
    TEST_ASSERT_EQUAL_UINT64(500, versions.probation.account.lock_before.steps[TL_LOCK_LOST]);
    TEST_ASSERT_EQUAL_MEMORY(&passed.tolerances, &versions.probation.account.tolerances, sizeof passed.tolerances);
    TEST_ASSERT_EQUAL_STRING("motor.omega: tolerance 1 → 3", versions.probation.account.widened);
    expect_choice("one", "two", 2, false);
}

static void keep(uint64_t number) {
    activate(number, true);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_versions_end_probation(&versions, TL_VERSION_KEPT, "in lock", &error));
}

/* The newest kept version that was sent with the right to commission. It is never removed to
 * make room. */
static void test_the_version_that_was_commissioned_last(void) {
    char text[32];
    begin();
    TEST_ASSERT_EQUAL_UINT64(1, tl_versions_commissioned(&versions)->number);
    keep(add_of("by hand", TL_ORIGIN_HAND));
    TEST_ASSERT_EQUAL_UINT64(2, tl_versions_commissioned(&versions)->number);
    activate(add_of("on probation", TL_ORIGIN_HAND), true);
    TEST_ASSERT_EQUAL_UINT64(2, tl_versions_commissioned(&versions)->number);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_versions_end_probation(&versions, TL_VERSION_ROLLED_BACK, "lost", &error));
    for (int i = 0; i < 2 * TL_VERSIONS_MOST; i++) {
        (void)snprintf(text, sizeof text, "by retune %d", i);
        keep(add(text));
    }
    TEST_ASSERT_EQUAL_UINT64(2, tl_versions_commissioned(&versions)->number);
    open_here();
    TEST_ASSERT_EQUAL_UINT64(2, tl_versions_commissioned(&versions)->number);
    expect_text(2, "by hand");
}

static void expect_after(uint64_t active, tl_version_result result, const char *reason) {
    for (int i = 0; i < 2; i++) {
        TEST_ASSERT_EQUAL_UINT64(active, versions.active);
        TEST_ASSERT_EQUAL_UINT64(0, versions.probation.version);
        expect_result(2, result, reason);
        expect_result(1, TL_VERSION_ACTIVE, "");
        open_here();
    }
}

static void test_kept(void) {
    begin();
    activate(add("two"), true);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_versions_end_probation(&versions, TL_VERSION_KEPT, "ben has confirmed it", &error));
    expect_after(2, TL_VERSION_KEPT, "ben has confirmed it");
    expect_choice("one", "two", 2, false);
}

static void test_returned(void) {
    begin();
    activate(add("two"), true);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_versions_end_probation(&versions, TL_VERSION_ROLLED_BACK, "not confirmed", &error));
    expect_after(1, TL_VERSION_ROLLED_BACK, "not confirmed");
    expect_choice("one", "one", 1, false);
}

static void test_no_probation_is_under_way(void) {
    begin();
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_versions_end_probation(&versions, TL_VERSION_KEPT, "", &error));
    TL_EXPECT_PARTS("version|probation", error.text);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_versions_end_probation(&versions, TL_VERSION_ROLLED_BACK, "", &error));
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_versions_save_probation(&versions, &account, &error));
    TEST_ASSERT_EQUAL_UINT64(1, versions.active);
    expect_result(1, TL_VERSION_ACTIVE, "");
}

/* The version to return to is the last kept one. */
static void test_replaced_by_another(void) {
    begin();
    activate(add("two"), true);
    activate(add("three"), true);
    TEST_ASSERT_EQUAL_UINT64(1, versions.probation.return_to);
    TEST_ASSERT_EQUAL_UINT64(2, tl_versions_get(&versions, 3)->parent);
    expect_reason(2, TL_VERSION_ROLLED_BACK, "version 3");
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_versions_end_probation(&versions, TL_VERSION_ROLLED_BACK, "lost", &error));
    TEST_ASSERT_EQUAL_UINT64(1, versions.active);
    open_here();
    expect_reason(2, TL_VERSION_ROLLED_BACK, "version 3");
    expect_result(3, TL_VERSION_ROLLED_BACK, "lost");
}

static void test_version_to_return_to_needs_no_probation(void) {
    begin();
    activate(add("two"), true);
    activate(1, true);
    TEST_ASSERT_EQUAL_UINT64(1, versions.active);
    TEST_ASSERT_EQUAL_UINT64(0, versions.probation.version);
    open_here();
    TEST_ASSERT_EQUAL_UINT64(0, versions.probation.version);
    expect_result(1, TL_VERSION_ACTIVE, "");
    expect_reason(2, TL_VERSION_ROLLED_BACK, "version 1");
}

/* A version that was returned is activated again. */
static void test_activated_again(void) {
    begin();
    activate(add("two"), true);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_versions_end_probation(&versions, TL_VERSION_ROLLED_BACK, "lost", &error));
    activate(2, true);
    for (int i = 0; i < 2; i++) {
        expect_result(2, TL_VERSION_PROBATION, "");
        TEST_ASSERT_EQUAL_UINT64(1, versions.probation.return_to);
        open_here();
    }
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_versions_end_probation(&versions, TL_VERSION_ROLLED_BACK, "lost again", &error));
    activate(2, false);
    for (int i = 0; i < 2; i++) {
        expect_result(2, TL_VERSION_ACTIVE, "");
        open_here();
    }
}

static void test_refused(void) {
    begin();
    uint64_t two = add_of("two", TL_ORIGIN_RELOAD);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_versions_refuse(&versions, two, "step_s is missing", &error));
    for (int i = 0; i < 2; i++) {
        expect_result(2, TL_VERSION_REFUSED, "step_s is missing");
        TEST_ASSERT_EQUAL_UINT64(1, versions.active);
        expect_choice("two", "one", 1, false); /* a refused file is not tried again */
        open_here();
    }
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_versions_refuse(&versions, add("three"), "", &error));
    TEST_ASSERT_EQUAL_STRING(tl_versions_get(&versions, 2)->hash, versions.file_hash);
}

static void test_escaped_texts(void) {
    uint64_t number = 0;
    open_here();
    const tl_version_candidate candidate = {
        "{}", 2, "an\xFFna\x1b[31m", "\"why\"\n\xC2\x9B", TL_ORIGIN_LIMITED, TL_RIGHT_COMMISSION, TL_CHANGE_RESTART};
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_versions_add(&versions, &candidate, &number, &error));
    open_here();
    const tl_version *version = tl_versions_get(&versions, number);
    TEST_ASSERT_EQUAL_STRING("an\\xFFna\\x1B[31m", version->who);
    TEST_ASSERT_EQUAL_STRING("\"why\"\\x0A\\u{9B}", version->why);
    TEST_ASSERT_EQUAL_STRING("limited", tl_change_origins[version->origin]);
}

/* A reason that is not UTF-8, and one that is too long: the record can be read again. */
static void test_escaped_reasons(void) {
    char reason[3 * TL_VERSION_WHY];
    for (size_t i = 0; i + 2 < sizeof reason; i += 2) {
        memcpy(&reason[i], "\xC3\xA9", 3);
    }
    begin();
    activate(add("two"), true);
    TEST_ASSERT_EQUAL_INT(
        TL_OK, tl_versions_end_probation(&versions, TL_VERSION_ROLLED_BACK, "fmi2DoStep said \xC3\n", &error));
    open_here();
    expect_result(2, TL_VERSION_ROLLED_BACK, "fmi2DoStep said \\xC3\\x0A");
    for (size_t cut = 0; cut < 2; cut++) {
        activate(2, true);
        TEST_ASSERT_EQUAL_INT(TL_OK,
                              tl_versions_end_probation(&versions, TL_VERSION_ROLLED_BACK, reason + cut, &error));
        open_here();
        TEST_ASSERT_EQUAL_UINT64(1, versions.active);
        TEST_ASSERT_GREATER_THAN_size_t(TL_VERSION_WHY - 8, strlen(tl_versions_get(&versions, 2)->reason));
    }
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_versions_refuse(&versions, add("three"), "\xFF", &error));
    open_here();
    expect_result(3, TL_VERSION_REFUSED, "\\xFF");
}

/* A text is stored byte by byte, also with a NUL. */
static void test_bytes(void) {
    uint64_t number = 0;
    char *text = NULL;
    open_here();
    const tl_version_candidate candidate = {"a\0b\r\n", 5, "", "", TL_ORIGIN_NETWORK, TL_RIGHT_RETUNE, TL_CHANGE_NONE};
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_versions_add(&versions, &candidate, &number, &error));
    open_here();
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_versions_read(&versions, number, &text, &error));
    TEST_ASSERT_EQUAL_MEMORY("a\0b\r\n", text, 6);
    free(text);
}

static void test_finding_by_hash(void) {
    char hash[TL_SHA256_TEXT];
    begin();
    (void)add("two");
    (void)add("one");
    (void)snprintf(hash, sizeof hash, "%s", tl_versions_get(&versions, 1)->hash);
    TEST_ASSERT_EQUAL_UINT64(3, tl_versions_of_hash(&versions, hash)->number); /* the newest */
    TEST_ASSERT_EQUAL_UINT64(2, tl_versions_of_hash(&versions, tl_versions_get(&versions, 2)->hash)->number);
    TEST_ASSERT_NULL(tl_versions_of_hash(&versions, ""));
}

/* ---- removal of old versions ---- */

static void test_the_newest_are_kept(void) {
    char text[16];
    begin();
    activate(add("two"), false);
    activate(add("three"), true);
    for (int i = 0; i < 3 * TL_VERSIONS_MOST; i++) {
        (void)snprintf(text, sizeof text, "%d", i % 2 == 0 ? 7 : i);
        (void)add(text);
        TEST_ASSERT_LESS_OR_EQUAL_size_t(TL_VERSIONS_MOST, versions.count);
    }
    for (int i = 0; i < 2; i++) {
        TEST_ASSERT_EQUAL_size_t(TL_VERSIONS_MOST, versions.count);
        expect_text(1, "one");
        expect_text(2, "two");
        expect_text(3, "three");
        expect_text(153, "149");
        expect_text(152, "7");
        expect_text(107, "103");
        TEST_ASSERT_NULL(tl_versions_get(&versions, 106));
        open_here();
    }
    /* records; texts of 1, 2, 3, "7" and 24 others; active.json */
    TEST_ASSERT_EQUAL_INT(TL_VERSIONS_MOST + 4 + 24 + 1, tl_scratch_count(&folder));
    TEST_ASSERT_EQUAL_UINT64(154, add("four"));
}

/* The active version's parent is stored, too, although the run would return to another version. */
static void test_needed_versions_are_kept(void) {
    char text[16];
    begin();
    (void)add("x");
    activate(add("two"), false);
    activate(add("three"), true);
    activate(add("four"), true); /* parent 4, returns to 3 */
    for (int i = 0; i < 2 * TL_VERSIONS_MOST; i++) {
        (void)snprintf(text, sizeof text, "%d", i);
        (void)add(text);
    }
    TEST_ASSERT_EQUAL_UINT64(5, versions.active);
    TEST_ASSERT_EQUAL_UINT64(3, versions.probation.return_to);
    TEST_ASSERT_NOT_NULL(tl_versions_get(&versions, 1));
    TEST_ASSERT_NULL(tl_versions_get(&versions, 2));
    for (uint64_t number = 3; number <= 5; number++) {
        TEST_ASSERT_NOT_NULL(tl_versions_get(&versions, number));
    }
}

static void test_bytes_are_bounded(void) {
    enum { MEGABYTE = 1024 * 1024 };
    char *text = malloc(MEGABYTE + 1);
    TEST_ASSERT_NOT_NULL(text);
    memset(text, 'x', MEGABYTE);
    text[MEGABYTE] = '\0';
    open_here();
    for (int i = 0; i < 30; i++) {
        text[0] = (char)('a' + i);
        (void)add(text);
        TEST_ASSERT_LESS_OR_EQUAL_size_t(16, versions.count);
    }
    TEST_ASSERT_EQUAL_size_t(16, versions.count);
    TEST_ASSERT_NOT_NULL(tl_versions_get(&versions, 1));
    TEST_ASSERT_NULL(tl_versions_get(&versions, 15));
    TEST_ASSERT_NOT_NULL(tl_versions_get(&versions, 16));
    TEST_ASSERT_EQUAL_INT(32, tl_scratch_count(&folder));
    free(text);
}

/* ---- damaged files ---- */

static void test_damaged_record(void) {
    static const char *const damages[] = {"", "{", "[]", "{\"version\": 2}", "\xFF"};
    for (size_t i = 0; i < sizeof damages / sizeof damages[0]; i++) {
        setUp();
        begin();
        (void)add("two");
        char name[TL_SHA256_TEXT + 8];
        (void)snprintf(name, sizeof name, "%s", text_name(2));
        write_file("2.record.json", damages[i]);
        TEST_ASSERT_TRUE(tl_stderr_capture_begin());
        open_here();
        char *said = tl_stderr_capture_end();
        TL_EXPECT_PARTS("/2.record.json|damaged|version 2", said);
        free(said);
        TEST_ASSERT_EQUAL_size_t(1, versions.count);
        TEST_ASSERT_TRUE(exists(name)); /* is not removed */
        TEST_ASSERT_EQUAL_UINT64(3, add("three"));
    }
}

/* One invalid value. */
static void test_invalid_record(void) {
    static const char *const changes[][2] = {{"\"version\":\t1", "\"version\":\t2"},
                                             {"\"parent\":\t0", "\"parent\":\t1"},
                                             {"\"bytes\":\t3", "\"bytes\":\t16777217"},
                                             {"\"bytes\":\t3", "\"bytes\":\t-3"},
                                             {"\"origin\":\t\"start\"", "\"origin\":\t\"mars\""},
                                             {"\"right\":\t\"retune\"", "\"right\":\t\"read\""},
                                             {"\"kind\":\t\"in place\"", "\"kind\":\t\"\""},
                                             {"\"result\":\t\"active\"", "\"result\":\t7"},
                                             {"\"hash\":\t\"7", "\"hash\":\t\"g"},
                                             {"\"who\":", "\"whom\":"}};
    begin();
    char *record = tl_test_read_text(tl_scratch_path(&folder, "1.record.json"));
    TEST_ASSERT_NOT_NULL(record);
    for (size_t i = 0; i < sizeof changes / sizeof changes[0]; i++) {
        char *changed = tl_test_replaced(record, changes[i][0], changes[i][1]);
        TEST_ASSERT_NOT_NULL_MESSAGE(changed, changes[i][0]);
        write_file("1.record.json", changed);
        free(changed);
        TEST_ASSERT_TRUE(tl_stderr_capture_begin());
        open_here();
        free(tl_stderr_capture_end());
        TEST_ASSERT_EQUAL_size_t_MESSAGE(0, versions.count, changes[i][1]);
    }
    write_file("1.record.json", record);
    free(record);
    open_here();
    TEST_ASSERT_EQUAL_size_t(1, versions.count);
}

/* A foreign file has the largest possible number. */
static void test_no_number_is_left(void) {
    uint64_t number = 0;
    const tl_version_candidate candidate = {"two", 3, "", "", TL_ORIGIN_NETWORK, TL_RIGHT_RETUNE, TL_CHANGE_NONE};
    begin();
    write_file("999999999999999.record.json", "");
    (void)tl_stderr_capture_begin();
    open_here();
    free(tl_stderr_capture_end());
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_versions_add(&versions, &candidate, &number, &error));
    TL_EXPECT_PARTS("/versions|record|number", error.text);
    TEST_ASSERT_EQUAL_size_t(1, versions.count);
    write_file("1000000000000000.record.json", ""); /* too many digits */
    TEST_ASSERT_EQUAL_INT(0, unlink(tl_scratch_path(&folder, "999999999999999.record.json")));
    open_here();
    TEST_ASSERT_EQUAL_UINT64(2, add("two"));
}

static void test_damaged_text(void) {
    char *text = NULL;
    begin();
    activate(add("two"), false);
    write_file(text_name(2), "twp");
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_versions_read(&versions, 2, &text, &error));
    TEST_ASSERT_NULL(text);
    TL_EXPECT_PARTS("version 2|damaged", error.text);
    TL_EXPECT_PARTS(text_name(2), error.text);
    write_file(text_name(2), "two and more");
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_versions_read(&versions, 2, &text, &error));
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_versions_read(&versions, 9, &text, &error));
    TEST_ASSERT_EQUAL_UINT64(3, add("two")); /* repairs the text */
    expect_text(2, "two");
}

static void test_falling_back(void) {
    begin();
    activate(add("two"), false);
    activate(add("three"), true);
    TEST_ASSERT_EQUAL_INT(0, unlink(tl_scratch_path(&folder, text_name(3))));
    expect_choice_said("one", "two", 2, false, "version 3|version 2");
    TEST_ASSERT_EQUAL_UINT64(2, versions.active);
    TEST_ASSERT_EQUAL_UINT64(0, versions.probation.version);
    write_file(text_name(2), "");
    open_here();
    expect_choice_said("one", "one", 1, false, "version 2|version 1|damaged");
    write_file(text_name(1), "");
    expect_no_choice();
    TEST_ASSERT_EQUAL_UINT64(1, versions.active);
}

/* The configuration's file has the same text as the damaged version and repairs it. */
static void test_the_file_repairs_the_active_version(void) {
    begin();
    write_file(text_name(1), "");
    expect_choice("one", "one", 1, false);
    expect_text(1, "one");
}

static void test_falling_back_to_the_file(void) {
    begin();
    activate(add("two"), true);
    write_file(text_name(1), "");
    write_file(text_name(2), "");
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_versions_refuse(&versions, add_of("other", TL_ORIGIN_RELOAD), "", &error));
    expect_choice_said("other", "other", 0, true, "version 2|configuration|file");
    open_here();
    TEST_ASSERT_EQUAL_UINT64(0, versions.active);
    TEST_ASSERT_EQUAL_UINT64(0, versions.probation.version);
}

static void test_damaged_active(void) {
    static const char *const damages[] = {"", "{\"active\": 2}", "{\"active\": -1}", "[1]", NULL};
    for (size_t i = 0; i < sizeof damages / sizeof damages[0]; i++) {
        setUp();
        begin();
        activate(add("two"), true);
        TEST_ASSERT_EQUAL_INT(TL_OK, tl_versions_end_probation(&versions, TL_VERSION_KEPT, "good", &error));
        activate(add("three"), true);
        char *active = tl_test_read_text(tl_scratch_path(&folder, "active.json"));
        char *changed = tl_test_replaced(active, "\"settled\":\t2", "\"settled\":\t1000000000000");
        write_file("active.json", damages[i] != NULL ? damages[i] : changed);
        free(active);
        free(changed);
        TEST_ASSERT_TRUE(tl_stderr_capture_begin());
        open_here();
        char *said = tl_stderr_capture_end();
        TL_EXPECT_PARTS("/active.json|damaged|2", said);
        free(said);
        TEST_ASSERT_EQUAL_UINT64(2, versions.active);
        expect_reason(3, TL_VERSION_ROLLED_BACK, "known");
        expect_choice("one", "two", 2, false); /* unchanged file */
        expect_choice("new", "new", 0, true);
    }
}

/* active.json of an older release lacks the tolerances before: the probation continues without
 * them. */
static void test_active_of_an_older_version(void) {
    begin();
    activate(add("two"), true);
    char *active = tl_test_read_text(tl_scratch_path(&folder, "active.json"));
    char *newer = strstr(active, ",\n\t\"lock_before_");
    TEST_ASSERT_NOT_NULL_MESSAGE(newer, active);
    memcpy(newer, "\n}", 3);
    write_file("active.json", active);
    free(active);
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    open_here();
    tl_stderr_expect("");
    TEST_ASSERT_EQUAL_UINT64(2, versions.active);
    TEST_ASSERT_EQUAL_UINT64(2, versions.probation.version);
    TEST_ASSERT_EQUAL_UINT64(1000, versions.probation.account.before_steps);
    expect_result(2, TL_VERSION_PROBATION, "");
}

/* After a power cut, a record is older than active.json. */
static void test_records_are_repaired(void) {
    begin();
    activate(add("two"), true);
    char *record = tl_test_read_text(tl_scratch_path(&folder, "2.record.json"));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_versions_end_probation(&versions, TL_VERSION_KEPT, "good", &error));
    write_file("2.record.json", record);
    free(record);
    open_here();
    expect_result(2, TL_VERSION_KEPT, "good");
    write_file("active.json", ""); /* the record is up to date now */
    (void)tl_stderr_capture_begin();
    open_here();
    free(tl_stderr_capture_end());
    TEST_ASSERT_EQUAL_UINT64(2, versions.active);
}

static void test_left_over_files(void) {
    begin();
    write_file("active.json.new-12-0", "{");
    write_file("7.record.json.new-12-0", "{");
    write_file("notes.txt", "mine");
    write_file("0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef.json", "orphan");
    open_here();
    TEST_ASSERT_FALSE(exists("active.json.new-12-0"));
    TEST_ASSERT_FALSE(exists("7.record.json.new-12-0"));
    TEST_ASSERT_FALSE(exists("0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef.json"));
    TEST_ASSERT_TRUE(exists("notes.txt"));
    TEST_ASSERT_EQUAL_size_t(1, versions.count);
}

/* ---- at the start ---- */

static void test_an_edited_file(void) {
    begin();
    activate(add("two"), false);
    expect_choice("one", "two", 2, false);
    expect_choice_said("edited", "edited", 0, true, "configuration|file|changed");
    activate(add_of("edited", TL_ORIGIN_START), true);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_versions_end_probation(&versions, TL_VERSION_ROLLED_BACK, "lost", &error));
    open_here();
    expect_choice("edited", "two", 2, false); /* not tried again */
    expect_choice("one", "one", 0, true);     /* changed again */
}

/* The file gets the text of the active version: that is no change. The file is not new either
 * when the next version arrives by network. */
static void test_a_file_that_follows(void) {
    begin();
    activate(add("two"), false);
    expect_choice("two", "two", 2, false);
    TEST_ASSERT_EQUAL_STRING(tl_versions_get(&versions, 2)->hash, versions.file_hash);
    activate(add("three"), false);
    open_here();
    expect_choice("two", "three", 3, false);
}

/* An old version is activated again: the unchanged file is not tried again. */
static void test_an_unchanged_file(void) {
    begin();
    activate(add_of("two", TL_ORIGIN_RELOAD), false);
    activate(1, true);
    open_here();
    expect_choice("two", "one", 1, false);
}

static void test_a_first_file_that_was_refused(void) {
    open_here();
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_versions_refuse(&versions, add_of("one", TL_ORIGIN_START), "bad", &error));
    expect_choice("one", "one", 0, true);
    expect_no_choice();
}

/* ---- errors of the disk ---- */

static void test_an_unusable_folder(void) {
    FILE *file = fopen(folder.folder, "w");
    TEST_ASSERT_NOT_NULL(file);
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, tl_versions_open(state.folder, &versions, &error));
    TL_EXPECT_PARTS("/versions|folder|user", error.text);
    TEST_ASSERT_EQUAL_INT(0, unlink(folder.folder));
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, tl_versions_open(folder.folder, &versions, &error));
    TL_EXPECT_PARTS("/versions/versions|No such file", error.text);
    char name[PATH_MAX];
    memset(name, 'x', sizeof name);
    name[sizeof name - 20] = '\0';
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_versions_open(name, &versions, &error));
    TEST_ASSERT_NULL(versions.list);
}

static struct rlimit usual;

static void fill_disk(void) {
    struct rlimit none = usual;
    none.rlim_cur = 0;
    TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_FSIZE, &none));
}

static void empty_disk(void) {
    TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_FSIZE, &usual));
}

static void expect_as_before(tl_status status) {
    empty_disk();
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, status);
    TL_EXPECT_PARTS("/versions|File too large", error.text);
    for (int i = 0; i < 2; i++) {
        TEST_ASSERT_EQUAL_size_t(3, versions.count);
        expect_probation(60000);
        expect_result(3, TL_VERSION_CANDIDATE, "");
        TEST_ASSERT_EQUAL_INT(7, tl_scratch_count(&folder));
        open_here();
    }
    fill_disk();
}

static void test_a_full_disk(void) {
    uint64_t number = 0;
    const tl_version_candidate candidate = {"four", 4, "", "", TL_ORIGIN_NETWORK, TL_RIGHT_RETUNE, TL_CHANGE_NONE};
    (void)signal(SIGXFSZ, SIG_IGN);
    TEST_ASSERT_EQUAL_INT(0, getrlimit(RLIMIT_FSIZE, &usual));
    begin();
    activate(add("two"), true);
    (void)add_of("three", TL_ORIGIN_RELOAD);
    fill_disk();
    expect_as_before(tl_versions_add(&versions, &candidate, &number, &error));
    expect_as_before(tl_versions_activate(&versions, 3, &account, &error));
    expect_as_before(tl_versions_refuse(&versions, 3, "bad", &error));
    expect_as_before(tl_versions_save_probation(&versions, &account, &error));
    expect_as_before(tl_versions_end_probation(&versions, TL_VERSION_KEPT, "", &error));
    expect_as_before(tl_versions_end_probation(&versions, TL_VERSION_ROLLED_BACK, "", &error));
    expect_choice("edited", "edited", 0, true); /* a run can start */
    expect_choice("one", "two", 2, false);
    empty_disk();
}

int main(void) {
    tl_scratch_make(&state, TL_BINARY_DIR, "versions");
    (void)snprintf(folder.folder, sizeof folder.folder, "%.*s/versions", PATH_MAX - 20, state.folder);
    UNITY_BEGIN();
    RUN_TEST(test_the_first_one);
    RUN_TEST(test_probation);
    RUN_TEST(test_the_version_that_was_commissioned_last);
    RUN_TEST(test_kept);
    RUN_TEST(test_returned);
    RUN_TEST(test_no_probation_is_under_way);
    RUN_TEST(test_replaced_by_another);
    RUN_TEST(test_version_to_return_to_needs_no_probation);
    RUN_TEST(test_activated_again);
    RUN_TEST(test_refused);
    RUN_TEST(test_escaped_texts);
    RUN_TEST(test_escaped_reasons);
    RUN_TEST(test_bytes);
    RUN_TEST(test_finding_by_hash);
    RUN_TEST(test_the_newest_are_kept);
    RUN_TEST(test_needed_versions_are_kept);
    RUN_TEST(test_bytes_are_bounded);
    RUN_TEST(test_damaged_record);
    RUN_TEST(test_invalid_record);
    RUN_TEST(test_no_number_is_left);
    RUN_TEST(test_damaged_text);
    RUN_TEST(test_falling_back);
    RUN_TEST(test_the_file_repairs_the_active_version);
    RUN_TEST(test_falling_back_to_the_file);
    RUN_TEST(test_damaged_active);
    RUN_TEST(test_active_of_an_older_version);
    RUN_TEST(test_records_are_repaired);
    RUN_TEST(test_left_over_files);
    RUN_TEST(test_an_edited_file);
    RUN_TEST(test_a_file_that_follows);
    RUN_TEST(test_an_unchanged_file);
    RUN_TEST(test_a_first_file_that_was_refused);
    RUN_TEST(test_an_unusable_folder);
    RUN_TEST(test_a_full_disk);
    setUp();
    return tl_scratch_finish(&state, UNITY_END());
}
