/* Changes a property of the process or thread in the function AT, and does not restore it. CHANGE
 * is ROUNDING, FOLDER, UMASK, LOCALE (of the thread: a decimal comma), PROCESSORS (only one), SLACK
 * (of timers), or LIMITS (of open files). */
#include "tests/fmu/hostile/hostile.h"

#include <fenv.h>
#include <locale.h>
#include <sched.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

enum { ROUNDING, FOLDER, UMASK, LOCALE, PROCESSORS, SLACK, LIMITS };

static bool use_one_processor(void) {
    cpu_set_t all;
    cpu_set_t one;
    size_t processor = 0;
    CPU_ZERO(&one);
    if (sched_getaffinity(0, sizeof all, &all) != 0) {
        return false;
    }
    while (!CPU_ISSET(processor, &all)) {
        processor++;
    }
    CPU_SET(processor, &one);
    return sched_setaffinity(0, sizeof one, &one) == 0;
}

static bool limit_files(void) {
    struct rlimit limit;
    return getrlimit(RLIMIT_NOFILE, &limit) == 0 &&
           setrlimit(RLIMIT_NOFILE, &(struct rlimit){limit.rlim_cur - 1, limit.rlim_max}) == 0;
}

static bool change(void) {
    switch (CHANGE) {
    case ROUNDING:
        return fesetround(FE_UPWARD) == 0;
    case FOLDER:
        return chdir("/") == 0;
    case LOCALE:
        return uselocale(newlocale(LC_ALL_MASK, "de_DE.UTF-8", (locale_t)0)) != (locale_t)0;
    case PROCESSORS:
        return use_one_processor();
    case SLACK:
        return prctl(PR_SET_TIMERSLACK, 1000000UL) == 0;
    case LIMITS:
        return limit_files();
    default:
        (void)umask(0);
        return true;
    }
}

bool hostile_before(const char *function) {
    return strcmp(function, AT) != 0 || change();
}
