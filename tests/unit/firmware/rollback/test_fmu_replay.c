/* Rollback by reset and replay: bit-identical from any state. An FMU that does not repeat its
 * values is reported. */
#include "firmware/rollback/fmu_replay.h"

#include <math.h>
#include <string.h>
#include <unity.h>

enum { MOST = 40, STEPS = 20 };

/* One input of each kind, one output of each kind. */
typedef struct model {
    double u, y, start;
    int n, count;
    int on, was_on;
} model;

static model fmu;
static double drift; /* added by each step, and not reset */
static bool refuses_reset;
static unsigned resets;

static fmi2ValueReference reference[] = {0};
static double u[1], y[1];
static fmi2Integer n[1], count[1];
static fmi2Boolean on[1], was_on[1];
static const tl_ports inputs = {1, 1, 1, reference, reference, reference, u, n, on};
static const tl_ports outputs = {1, 1, 1, reference, reference, reference, y, count, was_on};

static fmi2Status set_real(fmi2Component self, const fmi2ValueReference references[], size_t size,
                           const fmi2Real values[]) {
    (void)references, (void)size;
    ((model *)self)->u = values[0];
    return fmi2OK;
}

static fmi2Status set_integer(fmi2Component self, const fmi2ValueReference references[], size_t size,
                              const fmi2Integer values[]) {
    (void)references, (void)size;
    ((model *)self)->n = values[0];
    return fmi2OK;
}

static fmi2Status set_boolean(fmi2Component self, const fmi2ValueReference references[], size_t size,
                              const fmi2Boolean values[]) {
    (void)references, (void)size;
    ((model *)self)->on = values[0];
    return fmi2OK;
}

static fmi2Status get_real(fmi2Component self, const fmi2ValueReference references[], size_t size, fmi2Real values[]) {
    (void)references, (void)size;
    values[0] = ((model *)self)->y;
    return fmi2OK;
}

static fmi2Status get_integer(fmi2Component self, const fmi2ValueReference references[], size_t size,
                              fmi2Integer values[]) {
    (void)references, (void)size;
    values[0] = ((model *)self)->count;
    return fmi2OK;
}

static fmi2Status get_boolean(fmi2Component self, const fmi2ValueReference references[], size_t size,
                              fmi2Boolean values[]) {
    (void)references, (void)size;
    values[0] = ((model *)self)->was_on;
    return fmi2OK;
}

static fmi2Status do_step(fmi2Component component, fmi2Real now, fmi2Real size, fmi2Boolean final) {
    model *self = component;
    (void) final;
    self->y = 0.9 * self->y + sin(self->u + now) * size + drift;
    self->count += self->n;
    self->was_on = self->was_on != self->on;
    return self->u > 1e6 ? fmi2Error : fmi2OK;
}

static fmi2Status reset(fmi2Component self) {
    resets++;
    *(model *)self = (model){.y = 0.25};
    return refuses_reset ? fmi2Error : fmi2OK;
}

static const tl_fmi2 functions = {.set_real = set_real,
                                  .set_integer = set_integer,
                                  .set_boolean = set_boolean,
                                  .get_real = get_real,
                                  .get_integer = get_integer,
                                  .get_boolean = get_boolean,
                                  .do_step = do_step};

static tl_fmi2_replay results;
static tl_fmu_replay replay;

void setUp(void) {
    drift = 0.0;
    refuses_reset = false;
    resets = 0;
    results = (tl_fmi2_replay){.most = MOST};
    replay = (tl_fmu_replay){.most = MOST,
                             .results = &results,
                             .functions = &functions,
                             .instance = &fmu,
                             .reset = reset,
                             .inputs = &inputs,
                             .outputs = &outputs};
    fmu = (model){.y = 0.25};
    tl_fmu_replay_begin(&replay);
    u[0] = 3.5; /* a start value before the first step */
    (void)set_real(&fmu, reference, 1, u);
    tl_fmu_replay_note(&replay, TL_PROLOGUE_SET_REAL, reference, 1, u, fmi2OK);
    TEST_ASSERT_EQUAL_INT(fmi2OK, tl_fmu_replay_start(&replay));
}

void tearDown(void) {
    tl_fmu_replay_end(&replay);
}

/* One step as in a twin, with the notes of the guard. */
static fmi2Status step(unsigned number, double value) {
    const tl_fmi2_step made = {.now = number * 0.1, .size = 0.1};
    u[0] = value;
    n[0] = (fmi2Integer)number % 3;
    on[0] = number % 4 == 1;
    (void)set_real(&fmu, reference, 1, u);
    tl_fmu_replay_note(&replay, TL_PROLOGUE_SET_REAL, reference, 1, u, fmi2OK);
    (void)set_integer(&fmu, reference, 1, n);
    tl_fmu_replay_note(&replay, TL_PROLOGUE_SET_INTEGER, reference, 1, n, fmi2OK);
    (void)set_boolean(&fmu, reference, 1, on);
    tl_fmu_replay_note(&replay, TL_PROLOGUE_SET_BOOLEAN, reference, 1, on, fmi2OK);
    fmi2Status status = do_step(&fmu, made.now, made.size, fmi2False);
    tl_fmu_replay_note_step(&replay, &made, status);
    if (status == fmi2OK) {
        (void)get_real(&fmu, reference, 1, y);
        tl_fmu_replay_note(&replay, TL_PROLOGUE_GET_REAL, reference, 1, y, fmi2OK);
        (void)get_integer(&fmu, reference, 1, count);
        tl_fmu_replay_note(&replay, TL_PROLOGUE_GET_INTEGER, reference, 1, count, fmi2OK);
        (void)get_boolean(&fmu, reference, 1, was_on);
        tl_fmu_replay_note(&replay, TL_PROLOGUE_GET_BOOLEAN, reference, 1, was_on, fmi2OK);
    }
    return status;
}

static void test_to_any_place_in_any_order(void) {
    static const unsigned order[] = {3, 19, 0, 7, 7, 12, 1};
    fmi2FMUstate states[STEPS] = {NULL};
    model then[STEPS];
    for (unsigned i = 0; i < STEPS; i++) {
        TEST_ASSERT_EQUAL_INT(fmi2OK, tl_fmu_replay_save(&replay, &states[i]));
        then[i] = fmu;
        (void)step(i, i * 0.3);
    }
    for (size_t i = 0; i < sizeof order / sizeof order[0]; i++) {
        TEST_ASSERT_EQUAL_INT(fmi2OK, tl_fmu_replay_restore(&replay, states[order[i]]));
        TEST_ASSERT_EQUAL_MEMORY(&then[order[i]], &fmu, sizeof fmu);
        (void)step(order[i], -5.0); /* from another state */
    }
    TEST_ASSERT_FALSE(results.differs || results.is_disabled);
    TEST_ASSERT_GREATER_THAN_UINT64(0, results.steps);
    for (unsigned i = 0; i < STEPS; i++) {
        tl_fmu_replay_forget(&replay, &states[i]);
        TEST_ASSERT_NULL(states[i]);
    }
}

/* A later state is reached without a reset, and steps after a restored state are kept. */
static void test_forward_without_a_reset(void) {
    fmi2FMUstate begin = NULL;
    fmi2FMUstate end = NULL;
    (void)tl_fmu_replay_save(&replay, &begin);
    for (unsigned i = 0; i < 5; i++) {
        (void)step(i, 1.0);
    }
    model then = fmu;
    (void)tl_fmu_replay_save(&replay, &end);
    TEST_ASSERT_EQUAL_INT(fmi2OK, tl_fmu_replay_restore(&replay, begin));
    TEST_ASSERT_EQUAL_UINT(1, resets);
    TEST_ASSERT_EQUAL_INT(fmi2OK, tl_fmu_replay_restore(&replay, end));
    TEST_ASSERT_EQUAL_UINT(1, resets);
    TEST_ASSERT_EQUAL_MEMORY(&then, &fmu, sizeof fmu);
    tl_fmu_replay_forget(&replay, &begin);
    tl_fmu_replay_forget(&replay, &end);
}

static void test_one_that_does_not_do_the_same_again(void) {
    fmi2FMUstate state = NULL;
    (void)step(0, 1.0);
    (void)tl_fmu_replay_save(&replay, &state);
    (void)step(1, 1.0);
    drift = 1e-12;
    TEST_ASSERT_EQUAL_INT(fmi2OK, tl_fmu_replay_restore(&replay, state));
    TEST_ASSERT_TRUE(results.differs);
    TEST_ASSERT_EQUAL_INT(fmi2OK, tl_fmu_replay_restore_start(&replay));
    TEST_ASSERT_FALSE(results.differs);
    tl_fmu_replay_forget(&replay, &state);
}

static void test_one_that_cannot_be_reset(void) {
    fmi2FMUstate state = NULL;
    (void)tl_fmu_replay_save(&replay, &state);
    (void)step(0, 1.0);
    refuses_reset = true;
    TEST_ASSERT_EQUAL_INT(fmi2Error, tl_fmu_replay_restore(&replay, state));
    TEST_ASSERT_EQUAL_INT(fmi2Error, tl_fmu_replay_restore_start(&replay));
    tl_fmu_replay_forget(&replay, &state);
}

/* A failed step leaves an unknown state; the FMU can be restored all the same. */
static void test_after_a_step_that_failed(void) {
    fmi2FMUstate state = NULL;
    (void)step(0, 1.0);
    (void)tl_fmu_replay_save(&replay, &state);
    model then = fmu;
    TEST_ASSERT_EQUAL_INT(fmi2Error, step(1, 2e6));
    TEST_ASSERT_EQUAL_INT(fmi2OK, tl_fmu_replay_restore(&replay, state));
    TEST_ASSERT_EQUAL_MEMORY(&then, &fmu, sizeof fmu);
    tl_fmu_replay_forget(&replay, &state);
}

static void test_too_far(void) {
    fmi2FMUstate state = NULL;
    for (unsigned i = 0; i < MOST; i++) {
        (void)step(i, 0.5);
        TEST_ASSERT_FALSE(results.is_disabled);
    }
    (void)step(MOST, 0.5);
    (void)tl_fmu_replay_save(&replay, &state);
    (void)step(MOST + 1, 0.5);
    TEST_ASSERT_EQUAL_INT(fmi2Error, tl_fmu_replay_restore(&replay, state));
    tl_fmu_replay_forget(&replay, &state);
}

/* A call with other variables than in steps: the inputs of the FMU are unknown from then on. */
static void test_an_unknown_call(void) {
    static const fmi2ValueReference other[] = {5};
    tl_fmu_replay_note(&replay, TL_PROLOGUE_SET_REAL, other, 1, u, fmi2OK);
    TEST_ASSERT_TRUE(results.is_disabled);
}

static void test_without_ports(void) {
    tl_fmu_replay_end(&replay);
    replay =
        (tl_fmu_replay){.most = MOST, .results = &results, .functions = &functions, .instance = &fmu, .reset = reset};
    tl_fmu_replay_begin(&replay);
    TEST_ASSERT_EQUAL_INT(fmi2Error, tl_fmu_replay_start(&replay));
    TEST_ASSERT_EQUAL_INT(fmi2Error, tl_fmu_replay_restore_start(&replay));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_to_any_place_in_any_order);
    RUN_TEST(test_forward_without_a_reset);
    RUN_TEST(test_one_that_does_not_do_the_same_again);
    RUN_TEST(test_one_that_cannot_be_reset);
    RUN_TEST(test_after_a_step_that_failed);
    RUN_TEST(test_too_far);
    RUN_TEST(test_an_unknown_call);
    RUN_TEST(test_without_ports);
    return UNITY_END();
}
