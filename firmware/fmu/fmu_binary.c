/* The binary of an FMU and its libraries, see fmu_binary.h. */
#include "firmware/fmu/fmu_binary.h"

#include <dirent.h>
#include <dlfcn.h>
#include <elf.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/fmu/own_copies.h"
#include "firmware/process/process_end.h"
#include "firmware/rollback/fmu_regions.h"

/* ---- library ---- */

/* ---- Python ---------------------------------------------------------------------------------- */

typedef const char *version_function(void);

/* The result of Py_GetVersion(), found through `handle`: "3.11.2 (main, …". Returns NULL if the
 * library is not Python. The function may be called before the interpreter is initialised. */
static const char *python_version(void *handle) {
    void *address = dlsym(handle, "Py_GetVersion");
    version_function *function = NULL;
    if (address == NULL) {
        return NULL;
    }
    /* dlsym() returns an object pointer, and ISO C has no cast from it to a function pointer. */
    memcpy(&function, &address, sizeof address);
    return function();
}

/* The first opened Python hides the symbols of a second one, so a second one is rejected. */
static tl_status check_python(const char *path, void *opened, tl_error *error) {
    void *all_loaded = dlopen(NULL, RTLD_NOW);
    const char *own = python_version(opened);
    const char *loaded = all_loaded == NULL ? NULL : python_version(all_loaded);
    tl_status status = TL_OK;
    if (own != NULL && loaded != NULL && dlsym(opened, "Py_GetVersion") != dlsym(all_loaded, "Py_GetVersion")) {
        status = tl_fail(
            error, TL_BAD_DATA,
            "\"%.200s\" is Python %.*s, but Python %.*s is already loaded, and a process can run only one: name the "
            "same library in all components",
            path, (int)strcspn(own, " "), own, (int)strcspn(loaded, " "), loaded);
    }
    if (all_loaded != NULL) {
        (void)dlclose(all_loaded);
    }
    return status;
}

/* ---- Opening --------------------------------------------------------------------------------- */

/* The text of dlerror() begins with the name of the library. */
static tl_status fail_open(const char *path, const char *reason, tl_error *error) {
    static const char python[] = "libpython";
    const char *text = reason == NULL ? path : reason;
    if (tl_shortage_is_reported(text)) {
        return tl_fail(error, TL_TRY_AGAIN,
                       "the library cannot be opened: %.240s; free memory or descriptors and try again", text);
    }
    if (strncmp(path, python, strlen(python)) == 0) {
        int length = (int)(strstr(path, ".so") == NULL ? strlen(path) : (size_t)(strstr(path, ".so") - path));
        return tl_fail(
            error, TL_BAD_DATA,
            "the library cannot be opened: %.240s; install it (Debian package %.*s), or name the installed one "
            "(ldconfig -p | grep libpython)",
            text, length < 40 ? length : 40, path);
    }
    return tl_fail(
        error, TL_BAD_DATA,
        "the library cannot be opened: %.240s; install it, or give its path relative to the configuration, with a "
        "slash, for example \"./libmodel.so\"",
        text);
}

/* Returns the number of loaded libraries. The first call excludes the program's own from the
 * regions of FMUs. */
static size_t count_loaded(void) {
    static bool has_begun;
    if (!has_begun) {
        has_begun = true;
        tl_fmu_regions_exclude();
    }
    return tl_fmu_regions_loaded();
}

tl_status tl_library_open(const char *path, tl_error *error) {
    (void)count_loaded();
    void *opened = dlopen(path, RTLD_NOW | RTLD_GLOBAL | RTLD_NODELETE);
    if (opened == NULL) {
        return fail_open(path, dlerror(), error);
    }
    tl_process_run_exit_handlers();
    if (python_version(opened) != NULL) { /* threads of NumPy would prevent rollback by memory */
        (void)setenv("OPENBLAS_NUM_THREADS", "1", 0);
    }
    return check_python(path, opened, error);
}

/* ---- The shared object of an FMU: its folder, its machine and its functions. */

/* ---- This machine ---------------------------------------------------------------------------- */

/* Names of folders in binaries/: first those of FMI 2.0 (linux64, linux32) or the tuples that FMI
 * 2.0.x recommends for other machines, then names that exporters use in practice. The first one
 * with a binary for this machine is used. */
#if defined(__x86_64__)
#define OWN_MACHINE EM_X86_64
#define FOLDERS "linux64", "x86_64-linux", "x86_64-linux-gnu"
#elif defined(__aarch64__)
#define OWN_MACHINE EM_AARCH64
#define FOLDERS "aarch64-linux", "aarch64-linux-gnu", "linux64"
#elif defined(__arm__)
#define OWN_MACHINE EM_ARM
#define FOLDERS "aarch32-linux", "armv7l-linux-gnueabihf", "arm-linux-gnueabihf", "linux32"
#elif defined(__i386__)
#define OWN_MACHINE EM_386
#define FOLDERS "linux32", "x86-linux", "i686-linux"
#elif defined(__riscv) && __riscv_xlen == 64
#define OWN_MACHINE EM_RISCV
#define FOLDERS "riscv64-linux", "riscv64-linux-gnu", "linux64"
#else
#error "Add the FMI platform folders and the ELF machine of this architecture"
#endif

#define OWN_CLASS (sizeof(void *) == 8 ? ELFCLASS64 : ELFCLASS32)
#if __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__
#define OWN_ORDER ELFDATA2LSB
#else
#define OWN_ORDER ELFDATA2MSB
#endif

static const char *const folder_names[] = {FOLDERS};
enum { FOLDER_COUNT = sizeof folder_names / sizeof folder_names[0] };

/* ---- ELF ------------------------------------------------------------------------------------- */

static const char *machine_name(unsigned machine) {
    static const struct {
        unsigned machine;
        const char *name;
    } names[] = {{EM_X86_64, "x86-64"}, {EM_386, "x86"},      {EM_AARCH64, "AArch64"},
                 {EM_ARM, "ARM"},       {EM_RISCV, "RISC-V"}, {EM_PPC, "PowerPC"},
                 {EM_PPC64, "PowerPC"}, {EM_MIPS, "MIPS"},    {EM_S390, "S/390"}};
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        if (names[i].machine == machine) {
            return names[i].name;
        }
    }
    return "an unknown machine";
}

/* Reads the start of the header, which is the same for 32 and 64 bits. Returns false if the file is
 * not an ELF file; errno is then 0, or the reason why it cannot be opened. */
static bool read_elf(const char *path, Elf32_Ehdr *head) {
    int file = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (file < 0) {
        return false;
    }
    errno = 0;
    ssize_t got = read(file, head, sizeof *head);
    (void)close(file);
    if (got != (ssize_t)sizeof *head || memcmp(head->e_ident, ELFMAG, SELFMAG) != 0) {
        return false;
    }
    if (head->e_ident[EI_DATA] != OWN_ORDER) {
        head->e_type = __builtin_bswap16(head->e_type);
        head->e_machine = __builtin_bswap16(head->e_machine);
    }
    return true;
}

/* `shown`: the path within the FMU. */
static tl_status check_elf(const char *path, const char *shown, const char *label, tl_error *error) {
    Elf32_Ehdr head;
    bool is_elf = read_elf(path, &head);
    if (!is_elf && tl_shortage_is(errno)) {
        return tl_fail(error, TL_TRY_AGAIN, "%s: %s cannot be opened: %s; free memory or descriptors and try again",
                       label, shown, strerror(errno));
    }
    if (!is_elf) {
        return tl_fail(error, TL_BAD_DATA, "%s: %s is not an ELF shared object; export the FMU for Linux on %s", label,
                       shown, machine_name(OWN_MACHINE));
    }
    if (head.e_ident[EI_CLASS] != OWN_CLASS || head.e_ident[EI_DATA] != OWN_ORDER || head.e_machine != OWN_MACHINE) {
        return tl_fail(error, TL_BAD_DATA,
                       "%s: %s is for %s (ELF machine %u, %d bits, %s endian), this machine is %s (ELF machine %d, %d "
                       "bits); export the FMU for it",
                       label, shown, machine_name(head.e_machine), head.e_machine,
                       head.e_ident[EI_CLASS] == ELFCLASS32 ? 32 : 64,
                       head.e_ident[EI_DATA] == ELFDATA2MSB ? "big" : "little", machine_name(OWN_MACHINE), OWN_MACHINE,
                       (int)sizeof(void *) * CHAR_BIT);
    }
    if (head.e_type != ET_DYN) {
        return tl_fail(error, TL_BAD_DATA,
                       "%s: %s is an ELF file but not a shared object (type %u, not %d); export the FMU again", label,
                       shown, head.e_type, ET_DYN);
    }
    return TL_OK;
}

/* ---- The right binary ------------------------------------------------------------------------ */

/* Lists the names in binaries/, separated by commas. */
static void list_platforms(const char *folder, char *text, size_t size) {
    char path[PATH_MAX];
    size_t used = 0;
    text[0] = '\0';
    if ((size_t)snprintf(path, sizeof path, "%s/binaries", folder) >= sizeof path) {
        return;
    }
    DIR *binaries = opendir(path);
    if (binaries == NULL) {
        return;
    }
    for (struct dirent *entry = readdir(binaries); entry != NULL && used < size - 1; entry = readdir(binaries)) {
        if (entry->d_name[0] != '.') {
            int length = snprintf(text + used, size - used, "%s%.40s", used == 0 ? "" : ", ", entry->d_name);
            used += length > 0 ? (size_t)length : 0;
        }
    }
    (void)closedir(binaries);
}

/* Libraries in a folder for this machine, if none has the expected name. */
typedef struct misnamed {
    const char *folder;      /* in binaries/; NULL: no folder has libraries */
    char names[160];         /* separated by commas */
    char best[NAME_MAX + 1]; /* the only one, or the one that differs in letter case only; "": none */
} misnamed;

static void list_libraries(DIR *entries, const char *expected, misnamed *found) {
    size_t count = 0;
    bool is_likely = false;
    for (struct dirent *entry = readdir(entries); entry != NULL; entry = readdir(entries)) {
        const char *end = strrchr(entry->d_name, '.');
        if (end == NULL || strcmp(end, ".so") != 0) {
            continue;
        }
        bool is_alike = strcasecmp(entry->d_name, expected) == 0;
        size_t used = strlen(found->names);
        (void)snprintf(found->names + used, sizeof found->names - used, "%s%.40s", count > 0 ? ", " : "",
                       entry->d_name);
        if (is_alike || !is_likely) {
            (void)snprintf(found->best, sizeof found->best, "%s", count == 0 || is_alike ? entry->d_name : "");
        }
        is_likely = is_likely || is_alike;
        count++;
    }
}

static void find_misnamed(const char *folder, const char *identifier, misnamed *found) {
    char expected[NAME_MAX + 4];
    (void)snprintf(expected, sizeof expected, "%s.so", identifier);
    *found = (misnamed){.folder = NULL};
    for (size_t i = 0; i < FOLDER_COUNT && found->folder == NULL; i++) {
        char path[PATH_MAX];
        int length = snprintf(path, sizeof path, "%s/binaries/%s", folder, folder_names[i]);
        DIR *entries = length > 0 && (size_t)length < sizeof path ? opendir(path) : NULL;
        if (entries != NULL) {
            list_libraries(entries, expected, found);
            (void)closedir(entries);
            found->folder = found->names[0] != '\0' ? folder_names[i] : NULL;
        }
    }
}

static tl_status fail_missing(const char *folder, const misnamed *other, const tl_model *model, const char *label,
                              tl_error *error) {
    char found[160];
    if (other->folder != NULL) {
        return tl_fail(error, TL_BAD_DATA,
                       "%s: binaries/%s has %s, but modelIdentifier is %.100s: rename the file in the FMU, or export "
                       "it again",
                       label, other->folder, other->names, model->identifier);
    }
    list_platforms(folder, found, sizeof found);
    return tl_fail(error, TL_BAD_DATA,
                   "%s: there is no binaries/%s/%.100s.so for this machine (%s); binaries/ has %s; export the FMU for "
                   "Linux on %s",
                   label, folder_names[0], model->identifier, machine_name(OWN_MACHINE),
                   found[0] == '\0' ? "nothing" : found, machine_name(OWN_MACHINE));
}

/* Uses a library of another name if there is no doubt which one is meant. */
static tl_status use_misnamed(const char *folder, const tl_model *model, const char *label, char *path, size_t size,
                              tl_error *error) {
    misnamed other;
    find_misnamed(folder, model->identifier, &other);
    int length =
        snprintf(path, size, "%s/binaries/%s/%s", folder, other.folder != NULL ? other.folder : "", other.best);
    if (other.best[0] == '\0' || length < 0 || (size_t)length >= size) {
        return fail_missing(folder, &other, model, label, error);
    }
    tl_status status = check_elf(path, path + strlen(folder) + 1, label, error);
    if (status == TL_OK) {
        tl_log(TL_LOG_NOTICE, "%s: modelIdentifier is %.100s, and no library has that name: %s is used", label,
               model->identifier, path + strlen(folder) + 1);
    }
    return status;
}

/* Finds the binary for this machine. */
static tl_status find_binary(const char *folder, const tl_model *model, const char *label, char *path, size_t size,
                             tl_error *error) {
    tl_error first = {TL_OK, ""};
    for (size_t i = 0; i < FOLDER_COUNT; i++) {
        int length = snprintf(path, size, "%s/binaries/%s/%s.so", folder, folder_names[i], model->identifier);
        if (length < 0 || (size_t)length >= size || access(path, F_OK) != 0) {
            continue;
        }
        /* Only the first problem is reported, and only if no later folder contains a suitable
         * binary. */
        tl_error *fault = first.status == TL_OK ? &first : NULL;
        if (check_elf(path, path + strlen(folder) + 1, label, fault) == TL_OK) {
            return TL_OK;
        }
    }
    return first.status != TL_OK ? tl_fail(error, first.status, "%s", first.text)
                                 : use_misnamed(folder, model, label, path, size, error);
}

/* ---- Functions ------------------------------------------------------------------------------- */

typedef enum need { ALWAYS, IF_THERE, FOR_STATE, FOR_SERIALIZING } need;

typedef struct symbol {
    const char *name;
    size_t offset; /* offset in tl_fmi2 */
    need need;
} symbol;

static const symbol fmi_symbols[] = {
    {"fmi2GetTypesPlatform", offsetof(tl_fmi2, get_types_platform), ALWAYS},
    {"fmi2GetVersion", offsetof(tl_fmi2, get_version), ALWAYS},
    {"fmi2Instantiate", offsetof(tl_fmi2, instantiate), ALWAYS},
    {"fmi2FreeInstance", offsetof(tl_fmi2, free_instance), ALWAYS},
    {"fmi2SetupExperiment", offsetof(tl_fmi2, setup_experiment), ALWAYS},
    {"fmi2EnterInitializationMode", offsetof(tl_fmi2, enter_initialization_mode), ALWAYS},
    {"fmi2ExitInitializationMode", offsetof(tl_fmi2, exit_initialization_mode), ALWAYS},
    {"fmi2Terminate", offsetof(tl_fmi2, terminate), ALWAYS},
    {"fmi2Reset", offsetof(tl_fmi2, reset), ALWAYS},
    {"fmi2GetReal", offsetof(tl_fmi2, get_real), ALWAYS},
    {"fmi2GetInteger", offsetof(tl_fmi2, get_integer), ALWAYS},
    {"fmi2GetBoolean", offsetof(tl_fmi2, get_boolean), ALWAYS},
    {"fmi2GetString", offsetof(tl_fmi2, get_string), ALWAYS},
    {"fmi2SetReal", offsetof(tl_fmi2, set_real), ALWAYS},
    {"fmi2SetInteger", offsetof(tl_fmi2, set_integer), ALWAYS},
    {"fmi2SetBoolean", offsetof(tl_fmi2, set_boolean), ALWAYS},
    {"fmi2SetString", offsetof(tl_fmi2, set_string), ALWAYS},
    {"fmi2GetFMUstate", offsetof(tl_fmi2, get_fmu_state), FOR_STATE},
    {"fmi2SetFMUstate", offsetof(tl_fmi2, set_fmu_state), FOR_STATE},
    {"fmi2FreeFMUstate", offsetof(tl_fmi2, free_fmu_state), FOR_STATE},
    {"fmi2SerializedFMUstateSize", offsetof(tl_fmi2, serialized_fmu_state_size), FOR_SERIALIZING},
    {"fmi2SerializeFMUstate", offsetof(tl_fmi2, serialize_fmu_state), FOR_SERIALIZING},
    {"fmi2DeSerializeFMUstate", offsetof(tl_fmi2, deserialize_fmu_state), FOR_SERIALIZING},
    {"fmi2GetBooleanStatus", offsetof(tl_fmi2, get_boolean_status), IF_THERE},
    {"fmi2DoStep", offsetof(tl_fmi2, do_step), ALWAYS},
};

static tl_status resolve_symbols(void *handle, const tl_model *model, const char *label, tl_fmi2 *functions,
                                 tl_error *error) {
    memset(functions, 0, sizeof *functions);
    for (size_t i = 0; i < sizeof fmi_symbols / sizeof fmi_symbols[0]; i++) {
        bool is_claimed = fmi_symbols[i].need == FOR_STATE ? model->capabilities.can_get_and_set_state
                                                           : model->capabilities.can_serialize_state;
        if (fmi_symbols[i].need > IF_THERE && !is_claimed) {
            continue;
        }
        void *address = dlsym(handle, fmi_symbols[i].name);
        if (address == NULL && fmi_symbols[i].need != IF_THERE) {
            (void)tl_fail(error, TL_BAD_DATA,
                          "%s: the binary has no function %s, which FMI 2.0 %s; export the FMU again", label,
                          fmi_symbols[i].name,
                          fmi_symbols[i].need == ALWAYS ? "requires of all FMUs"
                                                        : "requires because modelDescription.xml claims it");
            return TL_BAD_DATA;
        }
        /* dlsym() returns an object pointer, and ISO C has no cast from it to a function pointer.
         */
        memcpy((char *)functions + fmi_symbols[i].offset, &address, sizeof address);
    }
    return TL_OK;
}

static tl_status check_version(tl_fmu_guard *guard, const tl_fmi2 *functions, const char *label, tl_error *error) {
    tl_fmu_guard_enter(guard, TL_FMU_GET_TYPES_PLATFORM);
    const char *platform = functions->get_types_platform();
    tl_fmu_guard_leave(guard);
    tl_fmu_guard_enter(guard, TL_FMU_GET_VERSION);
    const char *version = functions->get_version();
    tl_fmu_guard_leave(guard);
    /* In some FMUs the text does not end after this name. */
    if (platform == NULL || strncmp(platform, fmi2TypesPlatform, strlen(fmi2TypesPlatform)) != 0) {
        return tl_fail(error, TL_BAD_DATA,
                       "%s: the binary is for the types platform \"%.40s\", not \"%s\"; export the FMU again", label,
                       platform == NULL ? "" : platform, fmi2TypesPlatform);
    }
    if (version == NULL || strcmp(version, "2.0") != 0) {
        return tl_fail(error, TL_BAD_DATA,
                       "%s: the binary is FMI %.20s, but modelDescription.xml says 2.0; export the FMU again", label,
                       version == NULL ? "?" : version);
    }
    return TL_OK;
}

/* ---- Opening --------------------------------------------------------------------------------- */

/* Returns true if dlerror() names a symbol of Python: "…/box.so: undefined symbol: Py_Initialize".
 */
static bool needs_python(const char *path, const char *reason) {
    const char *found = strstr(reason, path);
    const char *text = found == NULL ? reason : found + strlen(path);
    return strstr(text, " Py") != NULL || strstr(text, " _Py") != NULL;
}

/* The text of dlerror() names the file, and the missing library or symbol. */
static tl_status fail_open_binary(const char *path, const char *label, const char *reason, tl_error *error) {
    struct statvfs system;
    if (reason != NULL &&
        strstr(reason, "static TLS") != NULL) { /* the size of this block is fixed at the start of the process */
        return tl_fail(
            error, TL_BAD_DATA,
            "%s: the binary cannot be opened: cannot allocate memory in static TLS block (earlier FMUs use all of "
            "it); start twinlock with GLIBC_TUNABLES=glibc.rtld.optional_static_tls=65536 in its environment "
            "(service: systemctl edit, [Service] Environment=)",
            label);
    }
    bool no_programs = statvfs(path, &system) == 0 && (system.f_flag & ST_NOEXEC) != 0;
    /* The loader may report a failed mapping without a cause. By far the most likely cause is
     * missing memory. */
    bool shortage =
        reason != NULL && (tl_shortage_is_reported(reason) || strstr(reason, "failed to map segment") != NULL);
    const char *advice =
        "install the missing library, export the FMU with it, or name the library that has the symbol in "
        "\"libraries\" of the component";
    if (no_programs) {
        advice = "the folder is mounted noexec; set TMPDIR to one that is not";
    } else if (shortage) {
        advice = "free memory or descriptors and try again";
    } else if (reason != NULL && needs_python(path, reason)) {
        advice = "it needs Python's library; name the one of this machine in the component, for example \"libraries\": "
                 "[\"libpython3.11.so.1.0\"]";
    }
    return tl_fail(error, no_programs || shortage ? TL_TRY_AGAIN : TL_BAD_DATA,
                   "%s: the binary cannot be opened: %.260s; %s", label, reason == NULL ? "no reason given" : reason,
                   advice);
}

/* As tl_fmu_regions_claim() expects it. */
static const char *user_of(const char *folder, const tl_fmu_guard *guard) {
    return guard->memory == NULL || guard->memory == &guard->own_memory ? folder : NULL;
}

void tl_library_claim(const char *path, const char *folder, const tl_fmu_guard *guard) {
    void *opened = dlopen(path, RTLD_LAZY | RTLD_NOLOAD);
    if (opened != NULL) {
        tl_fmu_regions_claim(user_of(folder, guard), opened, SIZE_MAX);
        (void)dlclose(opened);
    }
}

tl_status tl_fmu_binary_open(const char *folder, const tl_model *model, const char *label, tl_fmu_guard *guard,
                             tl_error *error) {
    char path[PATH_MAX];
    tl_fmi2 functions;
    tl_status status = find_binary(folder, model, label, path, sizeof path, error);
    if (status != TL_OK) {
        return status;
    }
    status = tl_own_copies_make(folder, path, label, error);
    if (status != TL_OK) {
        return status;
    }
    size_t before = count_loaded();
    tl_fmu_guard_enter(guard, TL_FMU_LOADING); /* dlopen() runs code of the FMU */
    void *opened = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    tl_fmu_guard_leave(guard);
    if (opened == NULL) {
        return fail_open_binary(path, label, dlerror(), error);
    }
    tl_fmu_regions_claim(user_of(folder, guard), opened, before);
    status = resolve_symbols(opened, model, label, &functions, error);
    if (status == TL_OK) {
        status = check_version(guard, &functions, label, error);
    }
    if (status == TL_OK) {
        tl_fmu_guard_front(guard, &functions);
    }
    return status;
}
