/* The FMU call that is under way: which FMU, and which function of it.
 *
 * Purpose: a crash, a hang and an exit inside an FMU are told with the FMU's name and the function, by whoever notices: a signal
 *          handler, the thread that waits, or the supervisor in its own process.
 * Memory:  one block per process. It is private until tl_fmu_calls_use() names one that another process sees as well.
 * Thread:  the thread that calls FMUs writes, and it is the only one. Any thread, any signal handler and any process that maps the
 *          block may look. Wait-free.
 * Trust:   a process with FMUs may write anything into the block, so tl_fmu_calls_look() believes no index, and cleans a name
 *          (text.h).
 */
#ifndef TL_FIRMWARE_PROCESS_FMU_CALL_H
#define TL_FIRMWARE_PROCESS_FMU_CALL_H

#include <stdbool.h>
#include <stdint.h>

enum {
    TL_FMU_CALL_FMUS = 128, /* names that are kept; further FMUs share the last one */
    TL_FMU_CALL_NAME = 64
};

typedef enum tl_fmu_function {
    TL_FMU_NO_CALL,
    TL_FMU_LOADING, /* its library is opened: its constructors run */
    TL_FMU_GET_TYPES_PLATFORM,
    TL_FMU_GET_VERSION,
    TL_FMU_INSTANTIATE,
    TL_FMU_FREE_INSTANCE,
    TL_FMU_SETUP_EXPERIMENT,
    TL_FMU_ENTER_INITIALIZATION_MODE,
    TL_FMU_EXIT_INITIALIZATION_MODE,
    TL_FMU_TERMINATE,
    TL_FMU_RESET,
    TL_FMU_GET_REAL,
    TL_FMU_GET_INTEGER,
    TL_FMU_GET_BOOLEAN,
    TL_FMU_GET_STRING,
    TL_FMU_SET_REAL,
    TL_FMU_SET_INTEGER,
    TL_FMU_SET_BOOLEAN,
    TL_FMU_SET_STRING,
    TL_FMU_GET_STATE,
    TL_FMU_SET_STATE,
    TL_FMU_FREE_STATE,
    TL_FMU_SERIALIZED_SIZE,
    TL_FMU_SERIALIZE,
    TL_FMU_DESERIALIZE,
    TL_FMU_DO_STEP,
    TL_FMU_FUNCTIONS /* how many there are */
} tl_fmu_function;

/* Fields are private. A zeroed block is one without calls. */
typedef struct tl_fmu_calls {
    uint32_t begun; /* calls so far, those of a step together; wraps around */
    uint32_t now;   /* FMU · 256 + function; 0: none */
    uint32_t fmus;  /* names in use */
    uint32_t asked; /* 1: the process has received the signal that asks it to end */
    char names[TL_FMU_CALL_FMUS][TL_FMU_CALL_NAME];
} tl_fmu_calls;

/* A call as somebody saw it. */
typedef struct tl_fmu_call {
    uint32_t begun;       /* two looks that find the same number have found the same call */
    const char *function; /* "fmi2DoStep" */
    char fmu[TL_FMU_CALL_NAME];
} tl_fmu_call;

/* ---- the process that calls ---- */

/* From now on calls are noted there; NULL: in private memory. Before an FMU is loaded. The block must stay. */
void tl_fmu_calls_use(tl_fmu_calls *block);

/* Where calls are noted now. */
const tl_fmu_calls *tl_fmu_calls_here(void);

/* The number that stands for an FMU of this name, a component's name for example; the same for the same name. */
uint32_t tl_fmu_calls_name(const char *name);

/* The process has received the signal that asks it to end. */
void tl_fmu_calls_note_asked(void);

/* Between these two the FMU may do what it likes. A call that begins before the one before it has ended takes its place. Inline,
 * since an FMU's step may take no longer than a function call. */
static inline void tl_fmu_call_begin(uint32_t fmu, tl_fmu_function function);
/* Goes on with another function, under the number of the call that began: to count costs more than to note. */
static inline void tl_fmu_call_go_on(uint32_t fmu, tl_fmu_function function);
static inline void tl_fmu_call_end(void);

/* ---- who looks ---- */

/* False: no FMU is being called. Safe in a signal handler. */
bool tl_fmu_calls_look(const tl_fmu_calls *block, tl_fmu_call *call);

/* False: an FMU may have ignored or taken the signal, so it has to be sent again. */
bool tl_fmu_calls_is_asked(const tl_fmu_calls *block);

/* ---- inline ---- */

extern tl_fmu_calls *tl_fmu_calls_block; /* private: tl_fmu_calls_here() */

enum { TL_FMU_CALL_FUNCTION_BITS = 8 };

static inline void tl_fmu_call_go_on(uint32_t fmu, tl_fmu_function function) {
    __atomic_store_n(&tl_fmu_calls_block->now, fmu << TL_FMU_CALL_FUNCTION_BITS | (uint32_t)function, __ATOMIC_RELAXED);
}

static inline void tl_fmu_call_begin(uint32_t fmu, tl_fmu_function function) {
    uint32_t *begun = &tl_fmu_calls_block->begun;
    __atomic_store_n(begun, __atomic_load_n(begun, __ATOMIC_RELAXED) + 1, __ATOMIC_RELAXED);
    tl_fmu_call_go_on(fmu, function);
}

static inline void tl_fmu_call_end(void) {
    __atomic_store_n(&tl_fmu_calls_block->now, 0, __ATOMIC_RELAXED);
}

#endif
