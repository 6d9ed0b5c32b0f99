/* The last inputs of an FMU, of all types, are saved with a state and restored with it. */
#include "firmware/fmu/last_inputs.h"

#include <stdlib.h>
#include <string.h>
#include <unity.h>

static const fmi2ValueReference real_references[] = {3, 1};
static const fmi2ValueReference integer_references[] = {2};
static const fmi2ValueReference boolean_references[] = {0, 5, 4};
static double reals[2];
static fmi2Integer integers[1];
static fmi2Boolean booleans[3];
static tl_ports ports;
static tl_last_inputs *given;

static struct {
    double reals[2];
    fmi2Integer integers[1];
    fmi2Boolean booleans[3];
    unsigned calls;
    fmi2Status answer;
} fmu;

static fmi2Status set_real(fmi2Component instance, const fmi2ValueReference references[], size_t count,
                           const fmi2Real values[]) {
    (void)instance;
    TEST_ASSERT_EQUAL_PTR(ports.real_references, references);
    TEST_ASSERT_EQUAL_size_t(2, count);
    memcpy(fmu.reals, values, sizeof fmu.reals);
    fmu.calls++;
    return fmu.answer;
}

static fmi2Status set_integer(fmi2Component instance, const fmi2ValueReference references[], size_t count,
                              const fmi2Integer values[]) {
    (void)instance;
    TEST_ASSERT_EQUAL_PTR(ports.integer_references, references);
    TEST_ASSERT_EQUAL_size_t(1, count);
    memcpy(fmu.integers, values, sizeof fmu.integers);
    fmu.calls++;
    return fmi2OK;
}

static fmi2Status set_boolean(fmi2Component instance, const fmi2ValueReference references[], size_t count,
                              const fmi2Boolean values[]) {
    (void)instance;
    TEST_ASSERT_EQUAL_PTR(ports.boolean_references, references);
    TEST_ASSERT_EQUAL_size_t(3, count);
    memcpy(fmu.booleans, values, sizeof fmu.booleans);
    fmu.calls++;
    return fmi2OK;
}

static const tl_fmi2 functions = {.set_real = set_real, .set_integer = set_integer, .set_boolean = set_boolean};

static fmi2ValueReference *own_references(const fmi2ValueReference *references, size_t count) {
    fmi2ValueReference *made = malloc(count * sizeof *made);
    TEST_ASSERT_NOT_NULL(made);
    memcpy(made, references, count * sizeof *made);
    return made;
}

void setUp(void) {
    memset(&fmu, 0, sizeof fmu);
    ports = (tl_ports){.real_count = 2, .integer_count = 1, .boolean_count = 3};
    ports.real_references = own_references(real_references, 2);
    ports.integer_references = own_references(integer_references, 1);
    ports.boolean_references = own_references(boolean_references, 3);
    ports.reals = reals;
    ports.integers = integers;
    ports.booleans = booleans;
    reals[0] = 0.5;
    reals[1] = -2.0;
    integers[0] = 7;
    booleans[0] = fmi2True;
    booleans[1] = fmi2False;
    booleans[2] = fmi2True;
    given = tl_last_inputs_open(&ports);
    TEST_ASSERT_NOT_NULL(given);
}

void tearDown(void) {
    free(given);
    free(ports.real_references);
    free(ports.integer_references);
    free(ports.boolean_references);
}

static void test_what_was_in_the_ports_was_given(void) {
    tl_last_inputs_state *state = tl_last_inputs_save(given, NULL);
    TEST_ASSERT_NOT_NULL(state);
    TEST_ASSERT_NULL(state->own);
    TEST_ASSERT_EQUAL_INT(fmi2OK, tl_last_inputs_restore(given, state, &functions, NULL));
    TEST_ASSERT_EQUAL_MEMORY(reals, fmu.reals, sizeof reals);
    TEST_ASSERT_EQUAL_MEMORY(integers, fmu.integers, sizeof integers);
    TEST_ASSERT_EQUAL_MEMORY(booleans, fmu.booleans, sizeof booleans);
    free(state);
}

static void test_each_state_has_its_own(void) {
    static const double later[] = {8.0, 9.0};
    static const fmi2Integer later_integers[] = {-1};
    static const fmi2Boolean later_booleans[] = {fmi2False, fmi2True, fmi2True};
    tl_last_inputs_state *first = tl_last_inputs_save(given, NULL);
    TEST_ASSERT_NOT_NULL(first);
    tl_last_inputs_note(given, TL_PROLOGUE_SET_REAL, ports.real_references, later);
    tl_last_inputs_note(given, TL_PROLOGUE_SET_INTEGER, ports.integer_references, later_integers);
    tl_last_inputs_note(given, TL_PROLOGUE_SET_BOOLEAN, ports.boolean_references, later_booleans);
    tl_last_inputs_state *second = tl_last_inputs_save(given, NULL);
    TEST_ASSERT_NOT_NULL(second);
    (void)tl_last_inputs_restore(given, first, &functions, NULL);
    TEST_ASSERT_EQUAL_MEMORY(reals, fmu.reals, sizeof reals);
    (void)tl_last_inputs_restore(given, second, &functions, NULL);
    TEST_ASSERT_EQUAL_MEMORY(later, fmu.reals, sizeof later);
    TEST_ASSERT_EQUAL_MEMORY(later_integers, fmu.integers, sizeof later_integers);
    TEST_ASSERT_EQUAL_MEMORY(later_booleans, fmu.booleans, sizeof later_booleans);
    (void)tl_last_inputs_save(given, first); /* the restored inputs are the last ones now */
    (void)tl_last_inputs_restore(given, first, &functions, NULL);
    TEST_ASSERT_EQUAL_MEMORY(later, fmu.reals, sizeof later);
    free(first);
    free(second);
}

/* Calls with other variables, and calls that set nothing, are not noted. */
static void test_other_calls_say_nothing(void) {
    static const double other[] = {8.0, 9.0};
    tl_last_inputs_note(given, TL_PROLOGUE_SET_REAL, real_references, other);
    tl_last_inputs_note(given, TL_PROLOGUE_GET_REAL, ports.real_references, other);
    tl_last_inputs_state *state = tl_last_inputs_save(given, NULL);
    TEST_ASSERT_NOT_NULL(state);
    (void)tl_last_inputs_restore(given, state, &functions, NULL);
    TEST_ASSERT_EQUAL_MEMORY(reals, fmu.reals, sizeof reals);
    free(state);
}

static void test_an_fmu_that_refuses(void) {
    tl_last_inputs_state *state = tl_last_inputs_save(given, NULL);
    TEST_ASSERT_NOT_NULL(state);
    fmu.answer = fmi2Error;
    TEST_ASSERT_EQUAL_INT(fmi2Error, tl_last_inputs_restore(given, state, &functions, NULL));
    TEST_ASSERT_EQUAL_UINT(1, fmu.calls);
    free(state);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_what_was_in_the_ports_was_given);
    RUN_TEST(test_each_state_has_its_own);
    RUN_TEST(test_other_calls_say_nothing);
    RUN_TEST(test_an_fmu_that_refuses);
    return UNITY_END();
}
