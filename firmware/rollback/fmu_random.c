/* The random numbers of the C library as part of an FMU's memory: see fmu_random.h. */
#include "firmware/rollback/fmu_random.h"

#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/rollback/fmu_allocation.h"

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
