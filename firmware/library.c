/* Shared libraries for FMUs: see library.h. */
#include "firmware/library.h"

#include <dlfcn.h>
#include <signal.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "firmware/shortage.h"

/* ---- Python -------------------------------------------------------------------------------------------- */

typedef const char *version_function(void);

/* What Py_GetVersion() says, found by way of `handle`: "3.11.2 (main, …". NULL where there is no Python. It may be called
 * before the interpreter is initialised. */
static const char *python_version(void *handle) {
    void *address = dlsym(handle, "Py_GetVersion");
    version_function *function = NULL;
    if (address == NULL) {
        return NULL;
    }
    /* POSIX makes an address a function pointer; ISO C knows no cast for that. */
    memcpy(&function, &address, sizeof address);
    return function();
}

/* The symbols that everybody sees are those of the library that was opened first. */
static tl_status check_python(const char *path, void *opened, tl_error *error) {
    void *everybody = dlopen(NULL, RTLD_NOW);
    const char *own = python_version(opened);
    const char *seen = everybody == NULL ? NULL : python_version(everybody);
    tl_status status = TL_OK;
    if (own != NULL && seen != NULL && dlsym(opened, "Py_GetVersion") != dlsym(everybody, "Py_GetVersion")) {
        status =
            tl_fail(error, TL_BAD_DATA,
                    "\"%.200s\" is Python %.*s, and Python %.*s is open already: one program runs one Python; name the "
                    "same library in all components",
                    path, (int)strcspn(own, " "), own, (int)strcspn(seen, " "), seen);
    }
    if (everybody != NULL) {
        (void)dlclose(everybody);
    }
    return status;
}

/* ---- Opening ------------------------------------------------------------------------------------------- */

/* dlopen()'s own text begins with the name. */
static tl_status fail_open(const char *path, const char *reason, tl_error *error) {
    static const char python[] = "libpython";
    const char *said = reason == NULL ? path : reason;
    if (tl_shortage_is_told(said)) {
        return tl_fail(error, TL_TRY_AGAIN, "the library cannot be opened: %.240s; try again", said);
    }
    if (strncmp(path, python, strlen(python)) == 0) {
        int length = (int)(strstr(path, ".so") == NULL ? strlen(path) : (size_t)(strstr(path, ".so") - path));
        return tl_fail(
            error, TL_BAD_DATA,
            "the library cannot be opened: %.240s; install it (in Debian it is the package %.*s), or name the "
            "one that is there (ldconfig -p | grep libpython)",
            said, length < 40 ? length : 40, path);
    }
    return tl_fail(
        error, TL_BAD_DATA,
        "the library cannot be opened: %.240s; install it, or give the path of the file, which starts at the "
        "configuration's folder and has a slash, for example \"./libmodel.so\"",
        said);
}

/* Runs after what FMUs have registered for the end of the process, since it was registered before they were opened. What the
 * loader would do then is left out: PythonFMU's binaries cannot be unloaded (they define unique symbols), they end the
 * interpreter both as a registered destructor and once more when the loader ends them, and the second time is in memory that
 * was freed. */
static void end_process(int code, void *unused) {
    (void)unused;
    (void)fflush(NULL);
    _exit(code);
}

static void end_by_default(int number) {
    (void)signal(number, SIG_DFL);
    (void)raise(number);
}

/* Python takes SIGINT where nobody handles it, and then waits for its own main thread, which never comes; where somebody does,
 * it leaves it alone. */
static void claim_interrupt(void) {
    struct sigaction now;
    if (sigaction(SIGINT, NULL, &now) == 0 && now.sa_handler == SIG_DFL) {
        (void)signal(SIGINT, end_by_default);
    }
}

static bool prepare(void) {
    static bool prepared; /* of the process, as the libraries are */
    if (!prepared && on_exit(end_process, NULL) == 0) {
        claim_interrupt();
        prepared = true;
    }
    return prepared;
}

tl_status tl_library_open(const char *path, tl_error *error) {
    if (!prepare()) {
        return tl_fail(error, TL_TRY_AGAIN, "out of memory; free some and try again");
    }
    void *opened = dlopen(path, RTLD_NOW | RTLD_GLOBAL | RTLD_NODELETE);
    if (opened == NULL) {
        return fail_open(path, dlerror(), error);
    }
    return check_python(path, opened, error);
}
