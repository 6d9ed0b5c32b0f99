/* The C library keeps no pointer into the heap of an FMU that called it. Searches all of its
 * writable memory. */
#include <grp.h>
#include <iconv.h>
#include <libintl.h>
#include <link.h>
#include <locale.h>
#include <pwd.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <wchar.h>

#include <unity.h>

#include "firmware/rollback/fmu_heap.h"
#include "firmware/rollback/fmu_libc.h"

enum { SKIPPED = 77, AT_EXIT = 70 };

static tl_fmu_heap *heap;

static size_t before; /* words that look like such a pointer, but are older than the heap */

static int count_in_object(struct dl_phdr_info *object, size_t size, void *context) {
    (void)size;
    for (size_t i = 0; strstr(object->dlpi_name, "/libc.so") != NULL && i < object->dlpi_phnum; i++) {
        const ElfW(Phdr) *segment = &object->dlpi_phdr[i];
        const char *begin = NULL;
        uintptr_t address = (object->dlpi_addr + segment->p_vaddr + sizeof(void *) - 1) & ~(sizeof(void *) - 1);
        memcpy(&begin, &address, sizeof begin);
        for (size_t at = 0; segment->p_type == PT_LOAD && (segment->p_flags & PF_W) != 0 &&
                            at + 2 * sizeof(void *) <= segment->p_memsz;
             at += sizeof(void *)) {
            const void *kept = NULL;
            memcpy(&kept, begin + at, sizeof kept);
            *(size_t *)context += tl_fmu_heap_holds(heap, kept) ? 1 : 0;
        }
    }
    return 0;
}

static size_t count_kept(void) {
    size_t count = 0;
    (void)tl_fmu_libc_enter(NULL);
    (void)dl_iterate_phdr(count_in_object, &count);
    return count - before;
}

void setUp(void) {
    tl_error error;
    heap = tl_fmu_libc_open((size_t)1 << 24, &error);
    TEST_ASSERT_NOT_NULL(heap);
    before = 0;
    before = count_kept();
    (void)tl_fmu_libc_enter(heap);
}

void tearDown(void) {
    (void)tl_fmu_libc_enter(NULL);
}

/* These allocations are freed with the heap. NOLINTBEGIN(clang-analyzer-unix.Malloc) */

/* strtok() is not replaced and keeps a pointer: the search finds it. */
static void test_the_search_finds_a_pointer(void) {
    char *text = strdup("two words");
    /* cppcheck-suppress strtokCalled ; the test needs the pointer that it keeps, here and below */
    TEST_ASSERT_NOT_NULL(strtok(text, " ")); /* NOLINT(concurrency-mt-unsafe) */
    TEST_ASSERT_GREATER_THAN_size_t(0, count_kept());
    /* cppcheck-suppress strtokCalled */
    while (strtok(NULL, " ") != NULL) { /* NOLINT(concurrency-mt-unsafe) */
    }
}

static void test_the_environment(void) {
    char *pair = strdup("TL_KEEPING_TWO=2");
    TEST_ASSERT_EQUAL_INT(0, setenv("TL_KEEPING", "1", 1));
    TEST_ASSERT_EQUAL_INT(0, unsetenv("TL_KEEPING"));
    TEST_ASSERT_EQUAL_INT(0, count_kept());
    (void)tl_fmu_libc_enter(heap);
    TEST_ASSERT_EQUAL_INT(0, putenv(pair)); /* the library keeps the pair itself in no own memory */
    TEST_ASSERT_EQUAL_INT(0, count_kept());
    TEST_ASSERT_EQUAL_STRING("2", getenv("TL_KEEPING_TWO"));
    TEST_ASSERT_EQUAL_INT(0, unsetenv("TL_KEEPING_TWO"));
}

static void test_locales(void) {
    locale_t made = newlocale(LC_ALL_MASK, "C.UTF-8", (locale_t)0);
    (void)setlocale(LC_ALL, "C.UTF-8");
    (void)setlocale(LC_ALL, "C");
    if (made != (locale_t)0) {
        freelocale(made);
    }
    TEST_ASSERT_EQUAL_INT(0, count_kept());
}

static void test_time_zones(void) {
    static const char *const zones[] = {"Europe/Berlin", "EST5EDT", "<+03>-3"};
    for (size_t i = 0; i < sizeof zones / sizeof zones[0]; i++) {
        time_t time = 1000000000;
        struct tm parts;
        char text[64];
        wchar_t wide[64];
        TEST_ASSERT_EQUAL_INT(0, setenv("TZ", zones[i], 1));
        tzset();
        TEST_ASSERT_TRUE(localtime_r(&time, &parts) != NULL && mktime(&parts) == time);
        /* cppcheck-suppress [localtimeCalled, gmtimeCalled] */
        TEST_ASSERT_TRUE(localtime(&time) != NULL && gmtime(&time) != NULL && gmtime_r(&time, &parts) != NULL);
        TEST_ASSERT_EQUAL_INT(6, parts.tm_mon + 1 - 3);
        /* cppcheck-suppress ctimeCalled */
        TEST_ASSERT_TRUE(ctime(&time) != NULL && ctime_r(&time, text) != NULL && timelocal(&parts) != 0);
        TEST_ASSERT_EQUAL_size_t(4, strftime(text, sizeof text, "%Y", &parts));
        TEST_ASSERT_EQUAL_size_t(4, wcsftime(wide, 64, L"%Y", &parts));
        TEST_ASSERT_EQUAL_INT(0, count_kept());
        (void)tl_fmu_libc_enter(heap);
    }
    TEST_ASSERT_EQUAL_INT(0, unsetenv("TZ"));
}

static void at_exit(void) {}

static void test_functions_at_exit(void) {
    for (int i = 0; i < AT_EXIT; i++) {
        TEST_ASSERT_EQUAL_INT(0, atexit(at_exit));
    }
    TEST_ASSERT_EQUAL_INT(0, count_kept());
}

static void test_other_tables(void) {
    struct passwd user;
    struct passwd *found = NULL;
    char bytes[4096];
    iconv_t codes = iconv_open("UTF-16", "ISO-8859-1");
    if (codes != (iconv_t)-1) { /* NOLINT(performance-no-int-to-ptr): so it is defined */
        (void)iconv_close(codes);
    }
    (void)bindtextdomain("keeping", "/nowhere");
    (void)bind_textdomain_codeset("keeping", "UTF-8");
    (void)textdomain("keeping");
    TEST_ASSERT_EQUAL_STRING("word", gettext("word"));
    TEST_ASSERT_EQUAL_STRING("word", dgettext("keeping", "word"));
    TEST_ASSERT_EQUAL_STRING("word", dcgettext("keeping", "word", LC_MESSAGES));
    /* cppcheck-suppress getpwuidCalled */
    (void)getpwuid(0);
    /* cppcheck-suppress getpwnamCalled */
    (void)getpwnam("root");
    (void)getpwuid_r(0, &user, bytes, sizeof bytes, &found);
    (void)getpwnam_r("root", &user, bytes, sizeof bytes, &found);
    /* cppcheck-suppress getgrgidCalled */
    (void)getgrgid(0);
    /* cppcheck-suppress getgrnamCalled */
    (void)getgrnam("root");
    TEST_ASSERT_EQUAL_INT(0, count_kept());
}

/* NOLINTEND(clang-analyzer-unix.Malloc) */

int main(void) {
    if (!tl_fmu_libc_serves()) {
        printf("skipped: not with a sanitizer\n");
        return SKIPPED;
    }
    UNITY_BEGIN();
    RUN_TEST(test_the_environment);
    RUN_TEST(test_locales);
    RUN_TEST(test_time_zones);
    RUN_TEST(test_functions_at_exit);
    RUN_TEST(test_other_tables);
    RUN_TEST(test_the_search_finds_a_pointer);
    return UNITY_END();
}
