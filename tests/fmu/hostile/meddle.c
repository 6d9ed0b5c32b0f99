/* Changes something of the whole process at the beginning of the function AT, and leaves it so: CHANGE is ROUNDING, FOLDER or UMASK. */
#include "tests/fmu/hostile/hostile.h"

#include <fenv.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

enum { ROUNDING, FOLDER, UMASK };

static bool change(void) {
    switch (CHANGE) {
    case ROUNDING:
        return fesetround(FE_UPWARD) == 0;
    case FOLDER:
        return chdir("/") == 0;
    default:
        (void)umask(0);
        return true;
    }
}

bool hostile_before(const char *function) {
    return strcmp(function, AT) != 0 || change();
}
