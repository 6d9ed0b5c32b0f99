/* Versions of large memory: any order, byte by byte. Changed pages are reported by the kernel or
 * found by comparison. */
#include <fcntl.h>
#include <malloc.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/rollback/fmu_heap.h"
#include "firmware/rollback/fmu_libc.h"
#include "firmware/rollback/fmu_pages.h"
#include "tests/support/random_numbers.h"

enum { SKIPPED = 77, FIXED = 40, GROWING = 200, VERSIONS = 24, ROUNDS = 2500, ALL = FIXED + GROWING, LASTING = 2000 };

static unsigned char *memory; /* two ranges with a gap between them, the second one first in memory */
static tl_fmu_pages *pages;
static tl_fmu_version versions[VERSIONS];
static unsigned char *copies[VERSIONS];
static size_t used_of[VERSIONS];
static size_t used;
static tl_test_random dice;
static bool was_written;       /* since the last save or restore */
static bool knows_writes;      /* `was_written` is kept */
static size_t base = VERSIONS; /* version of the last save or restore; VERSIONS: none */

static unsigned char *fixed(void) {
    return memory + (size_t)(GROWING + 3) * TL_FMU_PAGE;
}

/* True if the kernel records writes to the address: "uw" in the flags of its mapping is the write
 * protection of userfaultfd. */
static bool is_watched(const void *address) {
    char line[1024];
    bool is_here = false;
    bool found = false;
    FILE *file = fopen("/proc/self/smaps", "r");
    TEST_ASSERT_NOT_NULL(file);
    while (!found && fgets(line, sizeof line, file) != NULL) {
        char *rest = NULL;
        unsigned long begin = strtoul(line, &rest, 16);
        if (rest > line && *rest == '-') { /* "55d0c0a00000-55d0c0a21000 rw-p …": start of a mapping */
            is_here = begin <= (unsigned long)address && (unsigned long)address < strtoul(rest + 1, NULL, 16);
        }
        found = is_here && strncmp(line, "VmFlags:", 8) == 0;
    }
    (void)fclose(file);
    return found && strstr(line, " uw") != NULL;
}

void setUp(void) {
    tl_error error;
    /* cppcheck-suppress invalidFunctionArg ; an anonymous mapping has no file, which is -1 */
    memory = mmap(NULL, (size_t)(ALL + 3) * TL_FMU_PAGE, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    TEST_ASSERT_TRUE(memory != MAP_FAILED);
    const tl_fmu_region ranges[] = {{.begin = fixed(), .size = FIXED * TL_FMU_PAGE, .has_pages = true},
                                    {.begin = memory, .size = GROWING * TL_FMU_PAGE, .has_pages = true}};
    pages = tl_fmu_pages_open(ranges, 2, &error);
    TEST_ASSERT_NOT_NULL(pages);
    TEST_ASSERT_EQUAL_INT(tl_fmu_written_serves(), is_watched(fixed()) && is_watched(memory));
    for (int i = 0; i < VERSIONS; i++) {
        copies[i] = calloc(ALL, TL_FMU_PAGE);
    }
    used = 10000;
    knows_writes = false;
    base = VERSIONS;
    dice = (tl_test_random){20261125};
}

void tearDown(void) {
    for (int i = 0; i < VERSIONS; i++) {
        tl_fmu_pages_forget(pages, &versions[i]);
        free(copies[i]);
    }
    (void)munmap(memory, (size_t)(ALL + 3) * TL_FMU_PAGE);
}

static size_t random_below(size_t most) {
    return tl_test_random_below(&dice, most);
}

static void write_anywhere(void) {
    for (size_t i = random_below(6); i > 0; i--) {
        fixed()[random_below((size_t)FIXED * TL_FMU_PAGE)]++;
        memory[random_below(used)]++;
    }
}

static void grow_memory(void) {
    size_t more = random_below(50000);
    if (used + more < (size_t)GROWING * TL_FMU_PAGE) {
        memset(memory + used, 7, more);
        used += more;
    }
}

/* As an FMU: most steps write the same few pages, some only the old values, a few of them nearly
 * everything. */
static void write_some(void) {
    size_t what = random_below(40);
    was_written = true;
    fixed()[7]++;
    memory[4096 * 2]++;
    if (what < 12) {
        write_anywhere();
    } else if (what == 12) {
        memset(memory, (int)random_below(256), used);
    } else if (what == 13) {
        memset(fixed() + TL_FMU_PAGE, (int)random_below(3), (size_t)(FIXED - 1) * TL_FMU_PAGE);
    } else if (what < 16) {
        grow_memory();
    } else if (what == 16) {
        memmove(memory, memory, used); /* written, but equal */
        ((volatile unsigned char *)fixed())[9 * TL_FMU_PAGE] = fixed()[9 * TL_FMU_PAGE];
    }
}

static bool differs(const unsigned char *bytes, const unsigned char *others, size_t count) {
    return memcmp(bytes, others, count) != 0;
}

/* Pages that differ from the last save or restore: the whole pages, which contain bytes after the
 * used part too. */
static size_t count_different(void) {
    size_t count = 0;
    for (size_t i = 0; i < FIXED; i++) {
        count += differs(fixed() + i * TL_FMU_PAGE, copies[base] + i * TL_FMU_PAGE, TL_FMU_PAGE) ? 1 : 0;
    }
    for (size_t i = 0; i * TL_FMU_PAGE < used; i++) {
        count += differs(memory + i * TL_FMU_PAGE, copies[base] + (FIXED + i) * TL_FMU_PAGE, TL_FMU_PAGE) ? 1 : 0;
    }
    return count;
}

/* The whole of memory, zeros after the used part included. */
static void save(size_t i) {
    tl_error error;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_fmu_pages_save(pages, used, !knows_writes || was_written, &versions[i], &error));
    memcpy(copies[i], fixed(), (size_t)FIXED * TL_FMU_PAGE);
    memcpy(copies[i] + (size_t)FIXED * TL_FMU_PAGE, memory, (size_t)GROWING * TL_FMU_PAGE);
    used_of[i] = used;
    was_written = false;
    base = i;
}

/* Memory after the used part is zero, as in the heap. */
static void restore(size_t i) {
    tl_fmu_pages_restore(pages, &versions[i], !knows_writes || was_written);
    used = used_of[i];
    memset(memory + used, 0, (size_t)GROWING * TL_FMU_PAGE - used);
    was_written = false;
    base = i;
}

static void expect(size_t i) {
    TEST_ASSERT_EQUAL_MEMORY(copies[i], fixed(), (size_t)FIXED * TL_FMU_PAGE);
    TEST_ASSERT_EQUAL_MEMORY(copies[i] + (size_t)FIXED * TL_FMU_PAGE, memory, (size_t)GROWING * TL_FMU_PAGE);
}

/* The estimate counts pages by contents, not by what the kernel reports. */
static void save_and_count(size_t i) {
    size_t different = base < VERSIONS ? count_different() : 0;
    tl_fmu_pages_remeasure(pages);
    for (int time = 0; time < 2; time++) { /* the second one finds no difference */
        save(i);
        if (different > 0) {
            size_t counted = tl_fmu_pages_size(pages) / TL_FMU_PAGE;
            TEST_ASSERT_GREATER_OR_EQUAL_size_t(different, counted);
            TEST_ASSERT_LESS_OR_EQUAL_size_t(different + different / 16 + 1, counted);
        }
    }
}

static void overwrite_unrecorded(void) {
    memset(memory, (int)random_below(256), used);
    tl_fmu_pages_invalidate(pages);
    base = VERSIONS;
}

/* Against full copies. The operations come in any order, often without a write between them. */
static void run_operations(uint64_t seed) {
    dice = (tl_test_random){seed};
    knows_writes = true;
    was_written = true;
    for (int round = 0; round < ROUNDS; round++) {
        size_t i = random_below(VERSIONS);
        size_t what = random_below(64);
        if (what < 30) {
            write_some();
        } else if (what < 42) {
            save(i);
        } else if (what < 60 && versions[i].leaf != NULL) {
            restore(i);
            expect(i);
        } else if (what == 60) {
            tl_fmu_pages_forget(pages, &versions[i]);
            base = base == i ? VERSIONS : base;
        } else if (what == 61) {
            overwrite_unrecorded();
        } else if (what >= 62) {
            save_and_count(i);
        }
    }
    for (size_t i = 0; i < VERSIONS; i++) {
        if (versions[i].leaf != NULL) {
            restore(i);
            expect(i);
        }
    }
}

static void test_any_order(void) {
    for (uint64_t seed = 1; seed <= 6; seed++) {
        run_operations(20261125 * seed);
    }
}

/* After a write that was not recorded, old and new versions are still right. */
static void test_a_write_that_is_not_recorded(void) {
    save(0);
    memset(memory, 5, used);
    tl_fmu_pages_invalidate(pages);
    save(1);
    restore(0);
    expect(0);
    restore(1);
    expect(1);
}

/* A system call must not fail with EFAULT on a protected page. */
static void test_a_system_call_may_write(void) {
    int zeros = open("/dev/zero", O_RDONLY | O_CLOEXEC);
    memset(fixed(), 9, (size_t)FIXED * TL_FMU_PAGE);
    save(0);
    TEST_ASSERT_EQUAL_INT(3 * TL_FMU_PAGE, read(zeros, fixed() + 100, 3 * TL_FMU_PAGE));
    save(1);
    restore(0);
    expect(0);
    restore(1);
    expect(1);
    TEST_ASSERT_EQUAL_INT(0, close(zeros));
}

/* The size of a version is estimated from the differences between versions. */
static void test_the_estimated_size(void) {
    save(0);
    size_t supposed = tl_fmu_pages_size(pages);
    for (size_t i = 1; i < VERSIONS; i++) {
        fixed()[0]++;
        memory[TL_FMU_PAGE]++;
        save(i);
    }
    TEST_ASSERT_LESS_THAN_size_t(supposed / 16, tl_fmu_pages_size(pages));
    TEST_ASSERT_GREATER_THAN_size_t(2 * TL_FMU_PAGE, tl_fmu_pages_size(pages));
}

static void write_all(void) {
    for (size_t i = 0; i < FIXED; i++) {
        fixed()[i * TL_FMU_PAGE]++;
    }
}

/* Large versions do not count in the estimate while they are excluded, or after a new
 * measurement. */
static void test_excluded_versions(void) {
    test_the_estimated_size();
    size_t known = tl_fmu_pages_size(pages);
    tl_fmu_pages_freeze_estimate(pages, true);
    write_all();
    save(0);
    restore(1);
    restore(0);
    tl_fmu_pages_freeze_estimate(pages, false);
    TEST_ASSERT_EQUAL_size_t(known, tl_fmu_pages_size(pages));
    write_all();
    save(1);
    TEST_ASSERT_GREATER_THAN_size_t(FIXED * TL_FMU_PAGE, tl_fmu_pages_size(pages));
    expect(1);
    restore(0);
    expect(0);
    tl_fmu_pages_remeasure(pages);
    test_the_estimated_size();
    TEST_ASSERT_LESS_OR_EQUAL_size_t(known + (size_t)FIXED * TL_FMU_PAGE / 2, tl_fmu_pages_size(pages));
}

/* Allocated memory of the C library, and pages of the address space. */
typedef struct footprint {
    size_t given_out;
    unsigned long long pages;
} footprint;

static footprint footprint_now(void) {
    static char text[64]; /* without a stream, because a stream allocates */
    int file = open("/proc/self/statm", O_RDONLY | O_CLOEXEC);
    ssize_t size = read(file, text, sizeof text - 1);
    (void)close(file);
    text[size > 0 ? size : 0] = '\0';
    return (footprint){.given_out = mallinfo2().uordblks, .pages = strtoull(text, NULL, 10)};
}

static void write_to_three(void) {
    for (size_t i = 0; i < 3; i++) {
        memory[random_below(used)]++;
    }
}

/* As in a twin: the first versions give the estimate. Then memory for all is reserved, and
 * nothing is allocated. */
static void test_what_is_reserved_is_enough(void) {
    for (size_t i = 0; i < 12; i++) {
        write_to_three();
        save(i % 2);
        tl_fmu_pages_restore(pages, &versions[0], true);
    }
    TEST_ASSERT_TRUE(tl_fmu_pages_reserve(pages, VERSIONS));
    for (size_t i = 2; i < VERSIONS; i++) {
        TEST_ASSERT_TRUE(tl_fmu_pages_reserve_version(pages, &versions[i]));
    }
    footprint before = footprint_now();
    for (size_t i = 0; i < LASTING; i++) {
        write_to_three();
        save(i < VERSIONS ? i : random_below(VERSIONS));
        tl_fmu_pages_restore(pages, &versions[random_below(i < VERSIONS ? i + 1 : VERSIONS)], true);
        footprint now = i % 16 == 0 || i + 1 == LASTING ? footprint_now() : before;
        TEST_ASSERT_EQUAL_size_t(before.given_out, now.given_out);
        TEST_ASSERT_EQUAL_UINT64(before.pages, now.pages);
    }
}

/* Bytes of private memory, as RLIMIT_DATA counts them: the sixth number. */
static size_t private_memory(void) {
    char line[256] = "";
    char *rest = line;
    unsigned long number = 0;
    FILE *file = fopen("/proc/self/statm", "r");
    TEST_ASSERT_NOT_NULL(file);
    TEST_ASSERT_NOT_NULL(fgets(line, sizeof line, file));
    (void)fclose(file);
    for (int i = 0; i < 6; i++) {
        number = strtoul(rest, &rest, 10);
    }
    return number * (size_t)sysconf(_SC_PAGESIZE);
}

/* A growing list of an FMU moves as a whole, once in many steps. */
static void test_a_large_change_reserves_little(void) {
    enum { LARGE = 16 << 20, SEVERAL = 100 };
    static tl_fmu_version all[SEVERAL];
    tl_error error;
    /* cppcheck-suppress invalidFunctionArg ; an anonymous mapping has no file, which is -1 */
    unsigned char *list = mmap(NULL, LARGE, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    TEST_ASSERT_TRUE(list != MAP_FAILED);
    const tl_fmu_region range = {.begin = list, .size = LARGE, .has_pages = true};
    tl_fmu_pages *large = tl_fmu_pages_open(&range, 1, &error);
    TEST_ASSERT_NOT_NULL(large);
    memset(list, 1, LARGE);
    for (int i = 0; i < SEVERAL; i++) {
        TEST_ASSERT_EQUAL_INT(TL_OK, tl_fmu_pages_save(large, LARGE, true, &all[i], &error));
    }
    memset(list, 2, LARGE);
    size_t before = private_memory();
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_fmu_pages_save(large, LARGE, true, &all[0], &error));
    TEST_ASSERT_LESS_THAN_size_t((size_t)128 << 20, private_memory() - before); /* not SEVERAL · LARGE */
    for (int i = 0; i < SEVERAL; i++) {
        tl_fmu_pages_forget(large, &all[i]);
    }
    (void)munmap(list, LARGE);
}

static int run_all(void) {
    UNITY_BEGIN();
    RUN_TEST(test_what_is_reserved_is_enough);
    RUN_TEST(test_any_order);
    RUN_TEST(test_a_write_that_is_not_recorded);
    RUN_TEST(test_a_system_call_may_write);
    RUN_TEST(test_the_estimated_size);
    RUN_TEST(test_a_large_change_reserves_little);
    RUN_TEST(test_excluded_versions);
    return UNITY_END();
}

/* Runs without userfaultfd, because no descriptor is available at the start. */
static int run_without_kernel(void) {
    struct rlimit before;
    (void)getrlimit(RLIMIT_NOFILE, &before);
    const struct rlimit none = {.rlim_cur = 3, .rlim_max = before.rlim_max};
    (void)setrlimit(RLIMIT_NOFILE, &none);
    tl_fmu_written_begin();
    (void)setrlimit(RLIMIT_NOFILE, &before);
    return tl_fmu_written_serves() ? 1 : run_all();
}

int main(void) {
    int status = 0;
    if (!tl_fmu_libc_serves()) {
        printf("skipped: not with a sanitizer\n");
        return SKIPPED;
    }
    (void)fflush(stdout);
    pid_t child = fork();
    if (child == 0) {
        (void)close_range(3, ~0U, 0);
        int result = run_without_kernel();
        (void)fflush(stdout);
        _exit(result);
    }
    bool is_right = child > 0 && waitpid(child, &status, 0) == child && status == 0;
    printf("userfaultfd: %s\n", tl_fmu_written_serves() ? "yes" : "no");
    return run_all() != 0 || !is_right;
}
