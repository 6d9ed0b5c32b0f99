/* Allowed names from lists and configurations, and invalid lists. test_config_change.c tests their
 * use for a change. */
#include <unity.h>

#include "firmware/config/config_change.h"
#include "tests/support/message.h"

static tl_allowed_names allowed;
static tl_error error;

void setUp(void) {
    error = (tl_error){TL_OK, ""};
}

void tearDown(void) {
    tl_allowed_names_free(&allowed);
}

/* More names than the initial capacity. */
static void test_a_list(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_allowed_names_add_list(&allowed, "", &error));
    TEST_ASSERT_FALSE(tl_allowed_names_have(&allowed, TL_NAMES_FILE, ""));
    for (int i = 0; i < 40; i++) {
        TEST_ASSERT_EQUAL_INT(TL_OK,
                              tl_allowed_names_add_list(&allowed, "file /a\nlibrary \t /b c \r\n#file /d", &error));
    }
    TEST_ASSERT_TRUE(tl_allowed_names_have(&allowed, TL_NAMES_FILE, "/a"));
    TEST_ASSERT_TRUE(tl_allowed_names_have(&allowed, TL_NAMES_LIBRARY, "/b c"));
    TEST_ASSERT_FALSE(tl_allowed_names_have(&allowed, TL_NAMES_LIBRARY, "/a"));
    TEST_ASSERT_FALSE(tl_allowed_names_have(&allowed, TL_NAMES_FILE, "/d"));
    TEST_ASSERT_FALSE(tl_allowed_names_have(&allowed, TL_NAMES_FILE, "//a"));
}

static void test_a_configuration(void) {
    const char *text =
        "{\"components\": {\"a\": {\"fmu\": \"/opt/a.fmu\", \"libraries\": [\"/l\"], \"read\": [\"/r\"], \"set\":"
        " {\"x\": \"/s\", \"y\": \"word\"}}}, \"sources\": {\"c\": {\"csv\": {\"file\": \"f\"}}}, \"record\":"
        " {\"file\": \"/db\"}}";
    static const struct {
        tl_change_named kind;
        const char *name;
        bool is_there;
    } cases[] = {{TL_NAMES_FMU, "/opt/a.fmu", true}, {TL_NAMES_LIBRARY, "/l", true}, {TL_NAMES_FILE, "/r", true},
                 {TL_NAMES_FILE, "/s", true},        {TL_NAMES_FILE, "f", true},     {TL_NAMES_FILE, "word", false},
                 {TL_NAMES_FILE, "/db", false},      {TL_NAMES_FILE, "/l", false},   {TL_NAMES_LIBRARY, "/r", false}};
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_allowed_names_add_configuration(&allowed, text, &error));
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        TEST_ASSERT_EQUAL_MESSAGE(cases[i].is_there, tl_allowed_names_have(&allowed, cases[i].kind, cases[i].name),
                                  cases[i].name);
    }
}

static void test_invalid_lists(void) {
    static const struct {
        const char *list, *parts;
    } cases[] = {{"file /a\nfiles /b\n", "line 2|\"files /b\"|file|NAME"},
                 {"library", "line 1|\"library\""},
                 {"file \t\n", "line 1|\"file\""},
                 {"\n\n/srv/a", "line 3|\"/srv/a\""}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_allowed_names_add_list(&allowed, cases[i].list, &error));
        TL_EXPECT_PARTS(cases[i].parts, error.text);
    }
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_allowed_names_add_configuration(&allowed, "{", &error));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_allowed_names_add_list(&allowed, "", &error));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_a_list);
    RUN_TEST(test_a_configuration);
    RUN_TEST(test_invalid_lists);
    return UNITY_END();
}
