/* Current FMU call: which FMU is being called, and which function of it.
 *
 * Purpose: reports of a crash, a hang or an exit inside an FMU contain the FMU's name and the
 *          function. The reporter is a signal handler, the waiting thread, or the supervisor in its
 *          own process.
 * Memory:  one block per process. It is private memory until tl_fmu_calls_use() sets a block that
 *          another process maps too.
 * Thread:  only the thread that calls FMUs writes, except tl_fmu_calls_note_end_request(): any
 *          thread. Any thread, signal handler, or process that maps the block may read. Wait-free.
 * Trust:   an FMU process may write anything into the block, so tl_fmu_calls_poll() checks the
 *          index and cleans the name (text.h).
 */
#ifndef TL_FIRMWARE_PROCESS_FMU_CALL_H
#define TL_FIRMWARE_PROCESS_FMU_CALL_H

#include <stdbool.h>
#include <stdint.h>

enum {
    TL_FMU_CALL_FMUS = 128, /* maximum number of names; further FMUs share the last one */
    TL_FMU_CALL_NAME = 64   /* bytes of a name with its terminating 0 */
};

typedef enum tl_fmu_function {
    TL_FMU_NO_CALL,
    TL_FMU_LOADING, /* opening its library, which runs its constructors */
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
    TL_FMU_GET_BOOLEAN_STATUS,
    TL_FMU_DO_STEP,
    TL_FMU_FUNCTIONS /* number of values */
} tl_fmu_function;

/* Fields are private. Zeroed: no calls. */
typedef struct tl_fmu_calls {
    uint32_t begun;  /* number of calls so far; all calls in one step of one FMU count as one; wraps around */
    uint32_t now;    /* present call: number of the FMU + function; 0: none */
    uint32_t fmus;   /* number of names in use */
    uint32_t asked;  /* 1: the process has noted the signal to end */
    uint32_t failed; /* `begun` of the last call that failed; 0: none */
    char names[TL_FMU_CALL_FMUS][TL_FMU_CALL_NAME];
} tl_fmu_calls;

/* A call, as read from the block. */
typedef struct tl_fmu_call {
    uint32_t begun;       /* number of the call; equal in two reads: the same call, or the same step of the same FMU */
    const char *function; /* for example "fmi2DoStep" */
    char fmu[TL_FMU_CALL_NAME];
} tl_fmu_call;

/* ---- in the process that calls FMUs ---- */

/* Sets the block to which calls are written; NULL: private memory. Call it before an FMU is loaded.
 * The block must stay mapped. */
void tl_fmu_calls_use(tl_fmu_calls *block);

/* Returns the block in use. */
const tl_fmu_calls *tl_fmu_calls_in_use(void);

/* Notes that the calling thread is the one that calls FMUs. */
void tl_fmu_calls_enter_thread(void);

/* Returns true in that thread, and false in all others, for example in threads of an FMU. */
bool tl_fmu_calls_is_own_thread(void);

/* Registers an FMU by name, for example its component's name, and returns its number, a multiple of
 * 256. The same name gives the same number. Names are truncated to TL_FMU_CALL_NAME - 1 bytes. */
uint32_t tl_fmu_calls_name(const char *name);

/* Notes that the process has received the signal to end. */
void tl_fmu_calls_note_end_request(void);

/* Mark the beginning and the end of an FMU call. `fmu`: result of tl_fmu_calls_name(). `block`:
 * tl_fmu_calls_block. A call that begins before the previous one has ended replaces that one. These
 * functions are inline, so that an FMU call costs hardly more. */
static inline void tl_fmu_call_begin(uint32_t fmu, tl_fmu_function function);
static inline void tl_fmu_call_begin_in(tl_fmu_calls *block, uint32_t fmu, tl_fmu_function function);
/* Notes another function as part of the present call, without counting a new call, because counting
 * costs more than storing the function. `block`: tl_fmu_calls_block. */
static inline void tl_fmu_call_continue(tl_fmu_calls *block, uint32_t fmu, tl_fmu_function function);
static inline void tl_fmu_call_end(void);
/* Notes that the present call has failed. */
static inline void tl_fmu_call_fail(void);

/* ---- readers ---- */

/* Reads the current call. Returns false if no FMU is being called; then only call->begun is set.
 * Safe in a signal handler. */
bool tl_fmu_calls_poll(const tl_fmu_calls *block, tl_fmu_call *call);

/* Returns `begun` of the call during which the process has ended, or else of the last call that has
 * failed; 0: none. Call it after the process has ended. */
uint32_t tl_fmu_calls_failed(const tl_fmu_calls *block);

/* Returns true if the process has noted the signal to end. If not, an FMU may have ignored or
 * caught the signal: send it again. */
bool tl_fmu_calls_end_is_requested(const tl_fmu_calls *block);

/* ---- inline ---- */

extern tl_fmu_calls *tl_fmu_calls_block; /* private: use tl_fmu_calls_in_use() */

enum { TL_FMU_CALL_FUNCTION_BITS = 8 };

static inline void tl_fmu_call_continue(tl_fmu_calls *block, uint32_t fmu, tl_fmu_function function) {
    __atomic_store_n(&block->now, fmu | (uint32_t)function, __ATOMIC_RELAXED);
}

static inline void tl_fmu_call_begin_in(tl_fmu_calls *block, uint32_t fmu, tl_fmu_function function) {
    __atomic_store_n(&block->begun, __atomic_load_n(&block->begun, __ATOMIC_RELAXED) + 1, __ATOMIC_RELAXED);
    tl_fmu_call_continue(block, fmu, function);
}

static inline void tl_fmu_call_begin(uint32_t fmu, tl_fmu_function function) {
    tl_fmu_call_begin_in(tl_fmu_calls_block, fmu, function);
}

static inline void tl_fmu_call_end(void) {
    __atomic_store_n(&tl_fmu_calls_block->now, 0, __ATOMIC_RELAXED);
}

static inline void tl_fmu_call_fail(void) {
    __atomic_store_n(&tl_fmu_calls_block->failed, __atomic_load_n(&tl_fmu_calls_block->begun, __ATOMIC_RELAXED),
                     __ATOMIC_RELAXED);
}

#endif
