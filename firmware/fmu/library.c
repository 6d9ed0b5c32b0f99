/* Shared libraries for FMUs: see library.h. */
#include "firmware/fmu/library.h"

#include <dlfcn.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

#include "firmware/base/shortage.h"
#include "firmware/process/process_end.h"

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

tl_status tl_library_open(const char *path, tl_error *error) {
    void *opened = dlopen(path, RTLD_NOW | RTLD_GLOBAL | RTLD_NODELETE);
    if (opened == NULL) {
        return fail_open(path, dlerror(), error);
    }
    tl_process_run_exit_handlers();
    return check_python(path, opened, error);
}
