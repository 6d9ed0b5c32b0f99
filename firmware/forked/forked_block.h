/* What the processes of one FMU share with the process that calls it: one request at a time, its answer, and who there is.
 *
 * Purpose: private to this room. The twin writes a request into `message` and wakes one process, which answers in the same place. A process
 *          has a *slot*; one of them goes on, all others are snapshots and wait.
 * Waiting: by futexes, which every process of the block can wake; first a moment without the kernel, since an answer may take a microsecond.
 * Trust:   an FMU may write anything into all of it, at any time. The twin believes no number in it: it keeps to itself which slots it uses, and takes
 *          values and texts as what an FMU has said.
 * Memory:  shared, without a file, made before the processes and inherited by them.
 * Thread:  the twin's end is the thread of the FMUs; each process has one thread.
 */
#ifndef TL_FIRMWARE_FORKED_FORKED_BLOCK_H
#define TL_FIRMWARE_FORKED_FORKED_BLOCK_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/types.h>

#include "firmware/process/fmu_call.h"

/* Bytes of values and texts of one call. */
enum { TL_FORKED_BYTES = 256 * 1024, TL_FORKED_NUMBERS = 4, TL_FORKED_REALS = 2 };

/* Of the answer to a fork: pages of the process that forks which a state does not share with the one before it, as far as the process can tell: those that it
 * has begun to use, or to write, since it was forked or has forked. */
enum { TL_FORKED_TOUCHED = 1 };

/* Instances of one FMU at a time. */
enum { TL_FORKED_INSTANCES = 8 };

/* What is asked for, besides a tl_fmu_function of its own. */
enum {
    TL_FORKED_STEP = TL_FMU_FUNCTIONS, /* set Reals, step, get Reals */
    TL_FORKED_FORK,                    /* into slot numbers[0]; the answer has numbers[TL_FORKED_TOUCHED] */
    TL_FORKED_REQUESTS
};

typedef struct tl_forked_message {
    uint32_t number;   /* of the request */
    uint32_t function; /* tl_fmu_function, or one of the above */
    uint32_t instance;
    int32_t status; /* of the answer: fmi2Status, or a tl_status of loading */
    uint32_t numbers[TL_FORKED_NUMBERS];
    double reals[TL_FORKED_REALS];
    unsigned char bytes[TL_FORKED_BYTES] __attribute__((aligned(16)));
} tl_forked_message;

/* One process. */
typedef struct tl_forked_slot {
    uint32_t asked;  /* futex: requests so far */
    uint32_t over;   /* it is to end */
    int32_t process; /* 0: none */
    uint32_t ended;  /* it has ended and is reaped, */
    int32_t how;     /* as waitpid() tells */
} __attribute__((aligned(64))) tl_forked_slot;

typedef struct tl_forked_block {
    uint32_t news; /* futex: answers, and ends of processes */
    uint32_t answered;
    uint32_t saves;   /* after a step, since the FMU was loaded: by whichever process */
    uint32_t stepped; /* since the last save */
    tl_fmu_calls calls;
    tl_forked_message message __attribute__((aligned(64)));
    tl_forked_slot slots[];
} tl_forked_block;

/* NULL, with errno. */
tl_forked_block *tl_forked_block_make(uint32_t slots);
void tl_forked_block_free(tl_forked_block *block, uint32_t slots);

/* Until *word is not `old` any more, or for `patience_ms`; 0: for ever. May return early. */
void tl_forked_wait(const uint32_t *word, uint32_t old, unsigned patience_ms);

/* Another value for *word, and whoever waits for one is woken. */
void tl_forked_wake(uint32_t *word);

#endif
