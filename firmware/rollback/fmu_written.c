/* Which pages were written: see fmu_written.h. */
#include "firmware/rollback/fmu_written.h"

#include <fcntl.h>
#include <linux/userfaultfd.h>
#include <stdint.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <unistd.h>

/* As Linux 6.7 has them, and older headers do not. */
enum {
    USER_MODE_ONLY = 1,        /* UFFD_USER_MODE_ONLY */
    UNPOPULATED_TOO = 1 << 13, /* UFFD_FEATURE_WP_UNPOPULATED */
    ASYNCHRONOUS = 1 << 15,    /* UFFD_FEATURE_WP_ASYNC */
    IS_WRITTEN = 1 << 1,       /* PAGE_IS_WRITTEN */
    PROTECT_FOUND = 1 << 0,
    ONLY_WATCHED = 1 << 1 /* PM_SCAN_WP_MATCHING, PM_SCAN_CHECK_WPASYNC */
};

typedef struct found_run {
    uint64_t begin;
    uint64_t end;
    uint64_t categories;
} found_run;

typedef struct scan_order {
    uint64_t size;
    uint64_t flags;
    uint64_t begin;
    uint64_t end;
    uint64_t walked; /* answer: up to here */
    uint64_t runs;
    uint64_t room;
    uint64_t most_pages;
    uint64_t inverted;
    uint64_t all_of;
    uint64_t any_of;
    uint64_t told;
} scan_order;

#define SCAN _IOWR('f', 16, scan_order)

enum { RUNS = 256 };

static bool has_begun;
static bool serves;
static int watcher = -1;
static int map = -1;

static void count_pages(void *context, size_t first, size_t count) {
    (void)first;
    *(size_t *)context += count;
}

static size_t count_written(const unsigned char *page) {
    size_t count = 0;
    return tl_fmu_written_find(page, TL_FMU_PAGE, true, count_pages, &count) ? count : SIZE_MAX;
}

/* A page of our own: written, looked at, not written, written. */
static bool is_true_of(unsigned char *page) {
    page[0] = 1;
    if (!tl_fmu_written_watch(page, TL_FMU_PAGE) || count_written(page) != 1 || count_written(page) != 0) {
        return false;
    }
    page[1] = 1;
    return count_written(page) == 1;
}

static bool try_it(void) {
    /* cppcheck-suppress invalidFunctionArg ; an anonymous mapping has no file, which is -1 */
    void *page = mmap(NULL, TL_FMU_PAGE, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    bool is_true = page != MAP_FAILED && is_true_of(page);
    if (page != MAP_FAILED) {
        (void)munmap(page, TL_FMU_PAGE);
    }
    return is_true;
}

void tl_fmu_written_begin(void) {
    struct uffdio_api wanted = {.api = UFFD_API, .features = ASYNCHRONOUS | UNPOPULATED_TOO};
    if (has_begun) {
        return;
    }
    has_begun = true;
    if (sysconf(_SC_PAGESIZE) != TL_FMU_PAGE) {
        return;
    }
    watcher = (int)syscall(SYS_userfaultfd, O_CLOEXEC | O_NONBLOCK | USER_MODE_ONLY);
    map = open("/proc/self/pagemap", O_RDONLY | O_CLOEXEC);
    serves = watcher >= 0 && map >= 0 && ioctl(watcher, UFFDIO_API, &wanted) == 0 && try_it();
    if (!serves && watcher >= 0) {
        (void)close(watcher);
    }
    if (!serves && map >= 0) {
        (void)close(map);
    }
}

bool tl_fmu_written_serves(void) {
    tl_fmu_written_begin();
    return serves;
}

bool tl_fmu_written_watch(const unsigned char *begin, size_t size) {
    struct uffdio_register order = {.range = {.start = (uintptr_t)begin, .len = size}, .mode = UFFDIO_REGISTER_MODE_WP};
    return ioctl(watcher, UFFDIO_REGISTER, &order) == 0;
}

bool tl_fmu_written_find(const unsigned char *begin, size_t size, bool forget, tl_fmu_written_take *take,
                         void *context) {
    found_run runs[RUNS];
    scan_order order = {.size = sizeof order,
                        .flags = ONLY_WATCHED | (forget ? PROTECT_FOUND : 0),
                        .walked = (uintptr_t)begin,
                        .end = (uintptr_t)begin + size,
                        .runs = (uintptr_t)runs,
                        .room = RUNS,
                        .all_of = IS_WRITTEN,
                        .told = IS_WRITTEN};
    while (order.walked < order.end) {
        order.begin = order.walked;
        int count = ioctl(map, SCAN, &order);
        if (count < 0 || order.walked <= order.begin) {
            return false;
        }
        for (int i = 0; i < count; i++) {
            take(context, (size_t)(runs[i].begin - (uintptr_t)begin) / TL_FMU_PAGE,
                 (size_t)(runs[i].end - runs[i].begin) / TL_FMU_PAGE);
        }
    }
    return true;
}
