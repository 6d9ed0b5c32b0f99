/* Functions of the C library that FMUs get from us, since they keep state: random numbers, locale, names of users, conversions: see fmu_keeping.h. */
#include "firmware/rollback/fmu_keeping.h"

#include <dlfcn.h>
#include <grp.h>
#include <iconv.h>
#include <libintl.h>
#include <locale.h>
#include <netdb.h>
#include <pwd.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <wchar.h>

/* ---- fmu random ---- */

/* As large as the C library's own, which has the same numbers then. */
enum { STATE = 128, FIRST_SEED = 1 };

typedef struct random_state {
    struct random_data data;   /* of rand() and random() */
    struct drand48_data words; /* of drand48() and its like */
    char state[STATE];
} random_state;

static void begin(random_state *self) {
    memset(self, 0, sizeof *self);
    (void)initstate_r(FIRST_SEED, self->state, sizeof self->state, &self->data);
}

bool tl_fmu_random_begin(tl_fmu_heap *heap) {
    random_state *self = tl_fmu_heap_take(heap, sizeof *self, 1);
    if (self != NULL) {
        begin(self);
        heap->first = self;
    }
    return self != NULL;
}

/* ---- which state ---- */

/* Of all who are in no call of an FMU with a heap: several threads may ask at a time. */
static random_state common;
static bool common_has_begun;
static bool common_is_taken;

static random_state *take(void) {
    if (tl_fmu_allocation_heap != NULL) {
        return tl_fmu_allocation_heap->first;
    }
    while (__atomic_test_and_set(&common_is_taken, __ATOMIC_ACQUIRE)) {
    }
    if (!common_has_begun) {
        begin(&common);
        common_has_begun = true;
    }
    return &common;
}

static void give_back(const random_state *state) {
    if (state == &common) {
        __atomic_clear(&common_is_taken, __ATOMIC_RELEASE);
    }
}

// NOLINTBEGIN(readability-inconsistent-declaration-parameter-name): the C library's headers call them otherwise

/* ---- rand() and random() ---- */

long random(void) {
    int32_t number = 0;
    random_state *state = take();
    (void)random_r(&state->data, &number);
    give_back(state);
    return number;
}

void srandom(unsigned seed) {
    random_state *state = take();
    (void)srandom_r(seed, &state->data);
    give_back(state);
}

int rand(void) {
    return (int)random();
}

void srand(unsigned seed) {
    srandom(seed);
}

/* The bytes that the caller gave, as the C library hands them out: one word before the numbers. */
static char *bytes_of(const random_state *state) {
    return (char *)(state->data.state - 1);
}

char *initstate(unsigned seed, char *bytes, size_t size) {
    random_state *state = take();
    char *before = bytes_of(state);
    int failed = initstate_r(seed, bytes, size, &state->data);
    give_back(state);
    return failed != 0 ? NULL : before;
}

char *setstate(char *bytes) {
    random_state *state = take();
    char *before = bytes_of(state);
    int failed = setstate_r(bytes, &state->data);
    give_back(state);
    return failed != 0 ? NULL : before;
}

/* ---- drand48() and its like ---- */

double drand48(void) {
    double number = 0.0;
    random_state *state = take();
    (void)drand48_r(&state->words, &number);
    give_back(state);
    return number;
}

double erand48(unsigned short words[3]) {
    double number = 0.0;
    random_state *state = take();
    (void)erand48_r(words, &state->words, &number);
    give_back(state);
    return number;
}

long lrand48(void) {
    long number = 0;
    random_state *state = take();
    (void)lrand48_r(&state->words, &number);
    give_back(state);
    return number;
}

long nrand48(unsigned short words[3]) {
    long number = 0;
    random_state *state = take();
    (void)nrand48_r(words, &state->words, &number);
    give_back(state);
    return number;
}

long mrand48(void) {
    long number = 0;
    random_state *state = take();
    (void)mrand48_r(&state->words, &number);
    give_back(state);
    return number;
}

long jrand48(unsigned short words[3]) {
    long number = 0;
    random_state *state = take();
    (void)jrand48_r(words, &state->words, &number);
    give_back(state);
    return number;
}

void srand48(long seed) {
    random_state *state = take();
    (void)srand48_r(seed, &state->words);
    give_back(state);
}

unsigned short *seed48(unsigned short words[3]) {
    random_state *state = take();
    (void)seed48_r(words, &state->words);
    give_back(state);
    return state->words.__old_x;
}

void lcong48(unsigned short parameters[7]) {
    random_state *state = take();
    (void)lcong48_r(parameters, &state->words);
    give_back(state);
}

// NOLINTEND(readability-inconsistent-declaration-parameter-name)

/* ---- fmu keeping ---- */

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define HAS_ANOTHER_ALLOCATOR 1
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define HAS_ANOTHER_ALLOCATOR 1
#endif
#endif

#ifdef HAS_ANOTHER_ALLOCATOR

void tl_fmu_keeping_begin(void) {}

#else

/* Which are macros if a compiler optimises. */
#undef textdomain
#undef bindtextdomain
#undef bind_textdomain_codeset
#undef dcgettext
#undef dgettext
#undef gettext

/* POSIX makes an address a function pointer; ISO C knows no cast for that. */
static void find_next(const char *name, void *function, size_t size) {
    void *address = dlsym(RTLD_NEXT, name);
    memcpy(function, &address, size);
}

/* The C library's function of that name, and in front of it ours, which calls it outside of any heap. */
// NOLINTBEGIN(bugprone-macro-parentheses): a type, and lists that have their own
#define OUTSIDE(Result, Name, Parameters, Arguments)                                                                   \
    static Result(*own_##Name) Parameters;                                                                             \
    Result Name Parameters {                                                                                           \
        if (own_##Name == NULL) {                                                                                      \
            find_next(#Name, (void *)&own_##Name, sizeof own_##Name);                                                  \
        }                                                                                                              \
        tl_fmu_heap *heap = tl_fmu_allocation_enter(NULL);                                                             \
        Result answer = own_##Name Arguments;                                                                          \
        (void)tl_fmu_allocation_enter(heap);                                                                           \
        return answer;                                                                                                 \
    }
// NOLINTEND(bugprone-macro-parentheses)

// NOLINTBEGIN(readability-inconsistent-declaration-parameter-name,readability-identifier-naming,bugprone-reserved-identifier,cert-dcl37-c,cert-dcl51-cpp): the names are the C library's

/* What compiled C++ and the C library's own atexit() call; no header has them. */
int __cxa_atexit(void (*function)(void *), void *context, void *library);
int __cxa_thread_atexit_impl(void (*function)(void *), void *context, void *library);

OUTSIDE(int, setenv, (const char *name, const char *value, int replaces), (name, value, replaces))
OUTSIDE(int, putenv, (char *pair), (pair))
OUTSIDE(char *, setlocale, (int category, const char *locale), (category, locale))
OUTSIDE(locale_t, newlocale, (int mask, const char *locale, locale_t base), (mask, locale, base))
OUTSIDE(struct tm *, localtime, (const time_t *time), (time))
OUTSIDE(struct tm *, localtime_r, (const time_t *time, struct tm *result), (time, result))
OUTSIDE(struct tm *, gmtime, (const time_t *time), (time))
OUTSIDE(struct tm *, gmtime_r, (const time_t *time, struct tm *result), (time, result))
OUTSIDE(time_t, mktime, (struct tm * time), (time))
OUTSIDE(time_t, timelocal, (struct tm * time), (time))
OUTSIDE(char *, ctime, (const time_t *time), (time))
OUTSIDE(char *, ctime_r, (const time_t *time, char *text), (time, text))
OUTSIDE(size_t, strftime, (char *text, size_t size, const char *format, const struct tm *time),
        (text, size, format, time))
OUTSIDE(size_t, strftime_l, (char *text, size_t size, const char *format, const struct tm *time, locale_t locale),
        (text, size, format, time, locale))
OUTSIDE(size_t, wcsftime, (wchar_t * text, size_t size, const wchar_t *format, const struct tm *time),
        (text, size, format, time))
OUTSIDE(int, __cxa_atexit, (void (*function)(void *), void *context, void *library), (function, context, library))
OUTSIDE(int, __cxa_thread_atexit_impl, (void (*function)(void *), void *context, void *library),
        (function, context, library))
OUTSIDE(int, on_exit, (void (*function)(int, void *), void *context), (function, context))
OUTSIDE(iconv_t, iconv_open, (const char *to, const char *from), (to, from))
OUTSIDE(char *, textdomain, (const char *domain), (domain))
OUTSIDE(char *, bindtextdomain, (const char *domain, const char *folder), (domain, folder))
OUTSIDE(char *, bind_textdomain_codeset, (const char *domain, const char *codes), (domain, codes))
OUTSIDE(char *, dcgettext, (const char *domain, const char *text, int category), (domain, text, category))
OUTSIDE(char *, dgettext, (const char *domain, const char *text), (domain, text))
OUTSIDE(char *, gettext, (const char *text), (text))
OUTSIDE(struct passwd *, getpwnam, (const char *name), (name))
OUTSIDE(struct passwd *, getpwuid, (uid_t user), (user))
OUTSIDE(int, getpwnam_r, (const char *name, struct passwd *entry, char *bytes, size_t size, struct passwd **found),
        (name, entry, bytes, size, found))
OUTSIDE(int, getpwuid_r, (uid_t user, struct passwd *entry, char *bytes, size_t size, struct passwd **found),
        (user, entry, bytes, size, found))
OUTSIDE(struct group *, getgrnam, (const char *name), (name))
OUTSIDE(struct group *, getgrgid, (gid_t group), (group))
OUTSIDE(struct hostent *, gethostbyname, (const char *name), (name))
OUTSIDE(int, getaddrinfo,
        (const char *node, const char *service, const struct addrinfo *hints, struct addrinfo **found),
        (node, service, hints, found))

static void (*own_tzset)(void);

void tzset(void) {
    if (own_tzset == NULL) {
        find_next("tzset", (void *)&own_tzset, sizeof own_tzset);
    }
    tl_fmu_heap *heap = tl_fmu_allocation_enter(NULL);
    own_tzset();
    (void)tl_fmu_allocation_enter(heap);
}

// NOLINTEND(readability-inconsistent-declaration-parameter-name,readability-identifier-naming,bugprone-reserved-identifier,cert-dcl37-c,cert-dcl51-cpp)

void tl_fmu_keeping_begin(void) {
    find_next("setenv", (void *)&own_setenv, sizeof own_setenv);
    find_next("putenv", (void *)&own_putenv, sizeof own_putenv);
    find_next("setlocale", (void *)&own_setlocale, sizeof own_setlocale);
    find_next("newlocale", (void *)&own_newlocale, sizeof own_newlocale);
    find_next("localtime", (void *)&own_localtime, sizeof own_localtime);
    find_next("localtime_r", (void *)&own_localtime_r, sizeof own_localtime_r);
    find_next("tzset", (void *)&own_tzset, sizeof own_tzset);
    find_next("gmtime", (void *)&own_gmtime, sizeof own_gmtime);
    find_next("gmtime_r", (void *)&own_gmtime_r, sizeof own_gmtime_r);
    find_next("mktime", (void *)&own_mktime, sizeof own_mktime);
    find_next("timelocal", (void *)&own_timelocal, sizeof own_timelocal);
    find_next("ctime", (void *)&own_ctime, sizeof own_ctime);
    find_next("ctime_r", (void *)&own_ctime_r, sizeof own_ctime_r);
    find_next("strftime", (void *)&own_strftime, sizeof own_strftime);
    find_next("strftime_l", (void *)&own_strftime_l, sizeof own_strftime_l);
    find_next("wcsftime", (void *)&own_wcsftime, sizeof own_wcsftime);
    find_next("__cxa_atexit", (void *)&own___cxa_atexit, sizeof own___cxa_atexit);
    find_next("__cxa_thread_atexit_impl", (void *)&own___cxa_thread_atexit_impl, sizeof own___cxa_thread_atexit_impl);
    find_next("on_exit", (void *)&own_on_exit, sizeof own_on_exit);
    find_next("iconv_open", (void *)&own_iconv_open, sizeof own_iconv_open);
    find_next("textdomain", (void *)&own_textdomain, sizeof own_textdomain);
    find_next("bindtextdomain", (void *)&own_bindtextdomain, sizeof own_bindtextdomain);
    find_next("bind_textdomain_codeset", (void *)&own_bind_textdomain_codeset, sizeof own_bind_textdomain_codeset);
    find_next("dcgettext", (void *)&own_dcgettext, sizeof own_dcgettext);
    find_next("dgettext", (void *)&own_dgettext, sizeof own_dgettext);
    find_next("gettext", (void *)&own_gettext, sizeof own_gettext);
    find_next("getpwnam", (void *)&own_getpwnam, sizeof own_getpwnam);
    find_next("getpwuid", (void *)&own_getpwuid, sizeof own_getpwuid);
    find_next("getpwnam_r", (void *)&own_getpwnam_r, sizeof own_getpwnam_r);
    find_next("getpwuid_r", (void *)&own_getpwuid_r, sizeof own_getpwuid_r);
    find_next("getgrnam", (void *)&own_getgrnam, sizeof own_getgrnam);
    find_next("getgrgid", (void *)&own_getgrgid, sizeof own_getgrgid);
    find_next("gethostbyname", (void *)&own_gethostbyname, sizeof own_gethostbyname);
    find_next("getaddrinfo", (void *)&own_getaddrinfo, sizeof own_getaddrinfo);
}

#endif
