/* A system clock that a test can set for one process tree: linked into a program, this definition
 * replaces that of the C library.
 *
 * CLOCK_REALTIME is the real one plus the seconds in the file EXECUTABLE.shift: a double, which the
 * test may change at any time. No other clock is changed. The file is mapped when a program starts,
 * before it is confined. Without the file nothing is shifted.
 */
#include <dlfcn.h>
#include <fcntl.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

typedef int gettime_function(clockid_t clock, struct timespec *now);

static gettime_function *real_gettime;
static const volatile double *shift;

__attribute__((constructor)) static void map_shift(void) {
    char program[PATH_MAX] = "";
    char path[PATH_MAX + sizeof ".shift"];
    (void)!readlink("/proc/self/exe", program, sizeof program - 1);
    (void)snprintf(path, sizeof path, "%s.shift", program);
    int file = open(path, O_RDONLY | O_CLOEXEC);
    void *memory = file >= 0 ? mmap(NULL, sizeof *shift, PROT_READ, MAP_SHARED, file, 0) : MAP_FAILED;
    shift = memory != MAP_FAILED ? memory : NULL;
    if (file >= 0) {
        (void)close(file);
    }
}

// NOLINTNEXTLINE(readability-inconsistent-declaration-parameter-name): the C library's header calls them otherwise
int clock_gettime(clockid_t clock, struct timespec *now) {
    if (real_gettime == NULL) {
        void *symbol = dlsym(RTLD_NEXT, "clock_gettime");
        memcpy(&real_gettime, &symbol, sizeof symbol);
    }
    int result = real_gettime(clock, now);
    if (result == 0 && clock == CLOCK_REALTIME && shift != NULL) {
        const double seconds = *shift;
        const double whole = floor(seconds);
        now->tv_sec += (time_t)whole;
        now->tv_nsec += (long)((seconds - whole) * 1e9);
        now->tv_sec += now->tv_nsec / 1000000000;
        now->tv_nsec %= 1000000000;
    }
    return result;
}
