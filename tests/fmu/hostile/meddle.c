/* Changes a property of the process or thread in the function AT, and does not restore it. CHANGE
 * is ROUNDING, FOLDER, UMASK, or LOCALE (of the thread: a decimal comma). */
#include "tests/fmu/hostile/hostile.h"

#include <fenv.h>
#include <locale.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

enum { ROUNDING, FOLDER, UMASK, LOCALE };

static bool change(void) {
    switch (CHANGE) {
    case ROUNDING:
        return fesetround(FE_UPWARD) == 0;
    case FOLDER:
        return chdir("/") == 0;
    case LOCALE:
        return uselocale(newlocale(LC_ALL_MASK, "de_DE.UTF-8", (locale_t)0)) != (locale_t)0;
    default:
        (void)umask(0);
        return true;
    }
}

bool hostile_before(const char *function) {
    return strcmp(function, AT) != 0 || change();
}
