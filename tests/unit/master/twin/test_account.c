/* An account comes from an untrusted process: which values are accepted. */
#include "master/twin/account.h"

#include <stdio.h>
#include <string.h>
#include <unity.h>

static tl_account account;

static void set_text(char text[TL_ACCOUNT_TEXT], const char *value) {
    (void)snprintf(text, TL_ACCOUNT_TEXT, "%s", value);
}

void setUp(void) {
    memset(&account, 0, sizeof account);
    account.components = 2;
    account.matches = 1;
    account.adjusts = 1;
    set_text(account.algorithm, "secant");
    set_text(account.component[0].name, "motor");
    set_text(account.component[1].name, "plant");
    set_text(account.match[0].unit, "°/s");
    set_text(account.adjust[0].unit, "N.m");
}

void tearDown(void) {}

static void test_an_honest_account_is_sound(void) {
    TEST_ASSERT_TRUE(tl_account_is_sound(&account));
}

static void test_counts_stay_within_their_arrays(void) {
    uint32_t *const counts[] = {&account.components, &account.matches, &account.adjusts};
    const uint32_t most[] = {TL_ACCOUNT_COMPONENTS, TL_MAX_MATCH, TL_MAX_ADJUST};
    for (size_t i = 0; i < 3; i++) {
        setUp();
        *counts[i] = most[i];
        TEST_ASSERT_TRUE(tl_account_is_sound(&account));
        *counts[i] = most[i] + 1;
        TEST_ASSERT_FALSE(tl_account_is_sound(&account));
        *counts[i] = UINT32_MAX;
        TEST_ASSERT_FALSE(tl_account_is_sound(&account));
    }
}

static void test_texts_end(void) {
    char *const texts[] = {account.algorithm,        account.fallback,       account.component[1].name,
                           account.match[0].unit,    account.adjust[0].unit, account.finding.component,
                           account.finding.variable, account.finding.unit};
    for (size_t i = 0; i < sizeof texts / sizeof texts[0]; i++) {
        setUp();
        memset(texts[i], 'x', TL_ACCOUNT_TEXT);
        TEST_ASSERT_FALSE(tl_account_is_sound(&account));
        texts[i][TL_ACCOUNT_TEXT - 1] = '\0';
        TEST_ASSERT_TRUE(tl_account_is_sound(&account));
    }
}

/* Units are printed on a terminal. */
static void test_texts_have_no_control_characters(void) {
    static const char turning[] = {'\xE2', '\x80', '\xAE', 'm', '\0'}; /* U+202E */
    static const char *const bad[] = {"\x1b[2J",  "a\nb", "\t",    "\x7f",    "\xC2\x9B|31m",
                                      "\x9B|31m", "\xFF", turning, "\xE2\x80"};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        setUp();
        set_text(account.match[0].unit, bad[i]);
        TEST_ASSERT_FALSE(tl_account_is_sound(&account));
    }
}

static void test_enumerations_exist(void) {
    int wrong = 77;
    memcpy(&account.match[0].type, &wrong, sizeof wrong);
    TEST_ASSERT_FALSE(tl_account_is_sound(&account));
    setUp();
    memcpy(&account.adjust[0].type, &wrong, sizeof wrong);
    TEST_ASSERT_FALSE(tl_account_is_sound(&account));
    setUp();
    memcpy(&account.delay.state, &wrong, sizeof wrong);
    TEST_ASSERT_FALSE(tl_account_is_sound(&account));
    setUp();
    account.finding.mended = TL_REPAIRED_COUNT;
    TEST_ASSERT_FALSE(tl_account_is_sound(&account));
}

static void test_executions_are_those_of_all_components(void) {
    account.component[0].executions = 40;
    account.component[1].executions = 2;
    account.component[2].executions = 1000; /* does not exist */
    TEST_ASSERT_EQUAL_UINT64(42, tl_account_executions(&account));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_an_honest_account_is_sound);
    RUN_TEST(test_counts_stay_within_their_arrays);
    RUN_TEST(test_texts_end);
    RUN_TEST(test_texts_have_no_control_characters);
    RUN_TEST(test_enumerations_exist);
    RUN_TEST(test_executions_are_those_of_all_components);
    return UNITY_END();
}
