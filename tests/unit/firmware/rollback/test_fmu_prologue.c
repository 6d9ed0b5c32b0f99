/* The calls that an FMU got before its first step are repeated in order, with their values. */
#include "firmware/rollback/fmu_replay.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <unity.h>

static tl_fmu_prologue prologue;
static char calls[1 << 12]; /* the calls, as text */
static const char *failing;
static int instance;

static fmi2Status called(const char *format, ...) __attribute__((format(printf, 1, 2)));

static fmi2Status called(const char *format, ...) {
    size_t length = strlen(calls);
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(calls + length, sizeof calls - length, format, arguments);
    va_end(arguments);
    return failing != NULL && strstr(calls + length, failing) != NULL ? fmi2Discard : fmi2OK;
}

static fmi2Status set_real(fmi2Component component, const fmi2ValueReference references[], size_t count,
                           const fmi2Real values[]) {
    TEST_ASSERT_EQUAL_PTR(&instance, component);
    return called("real %zu %u %u %g %g;", count, references[0], references[count - 1], values[0], values[count - 1]);
}

static fmi2Status set_integer(fmi2Component component, const fmi2ValueReference references[], size_t count,
                              const fmi2Integer values[]) {
    (void)component;
    return called("integer %zu %u %d;", count, references[0], values[0]);
}

static fmi2Status set_boolean(fmi2Component component, const fmi2ValueReference references[], size_t count,
                              const fmi2Boolean values[]) {
    (void)component;
    return called("boolean %zu %u %d;", count, references[0], values[0]);
}

static fmi2Status set_string(fmi2Component component, const fmi2ValueReference references[], size_t count,
                             const fmi2String values[]) {
    (void)component;
    return called("string %zu %u %s %s;", count, references[count - 1], values[0], values[count - 1]);
}

static fmi2Status get_real(fmi2Component component, const fmi2ValueReference references[], size_t count,
                           fmi2Real values[]) {
    (void)component;
    memset(values, 0, count * sizeof *values);
    return called("get real %zu %u;", count, references[0]);
}

static fmi2Status get_integer(fmi2Component component, const fmi2ValueReference references[], size_t count,
                              fmi2Integer values[]) {
    (void)component;
    memset(values, 0, count * sizeof *values);
    return called("get integer %zu %u;", count, references[0]);
}

static fmi2Status get_boolean(fmi2Component component, const fmi2ValueReference references[], size_t count,
                              fmi2Boolean values[]) {
    (void)component;
    memset(values, 0, count * sizeof *values);
    return called("get boolean %zu %u;", count, references[0]);
}

static fmi2Status setup_experiment(fmi2Component component, fmi2Boolean has_tolerance, fmi2Real tolerance,
                                   fmi2Real start, fmi2Boolean has_stop, fmi2Real stop) {
    (void)component;
    return called("setup %d %g %g %d %g;", has_tolerance, tolerance, start, has_stop, stop);
}

static fmi2Status enter(fmi2Component component) {
    (void)component;
    return called("enter;");
}

static fmi2Status leave(fmi2Component component) {
    (void)component;
    return called("exit;");
}

static const tl_fmi2 functions = {.set_real = set_real,
                                  .set_integer = set_integer,
                                  .set_boolean = set_boolean,
                                  .set_string = set_string,
                                  .get_real = get_real,
                                  .get_integer = get_integer,
                                  .get_boolean = get_boolean,
                                  .setup_experiment = setup_experiment,
                                  .enter_initialization_mode = enter,
                                  .exit_initialization_mode = leave};

/* The arguments are valid only during the call, so they must be copied. */
static void give_all(void) {
    fmi2ValueReference references[] = {7, 8, 9};
    fmi2Real reals[] = {0.5, 1.5, -2.5};
    fmi2Integer integers[] = {-3};
    fmi2Boolean booleans[] = {fmi2True};
    char first[] = "a text";
    char last[] = "";
    fmi2String texts[] = {first, last};
    tl_fmu_setup setup = {.tolerance = 1e-4, .start = 2.0, .stop = 9.0, .has_tolerance = 1, .has_stop = 1};
    tl_fmu_prologue_add(&prologue, TL_PROLOGUE_SET_REAL, references, 3, reals);
    tl_fmu_prologue_add(&prologue, TL_PROLOGUE_SET_INTEGER, references, 1, integers);
    tl_fmu_prologue_add(&prologue, TL_PROLOGUE_SET_BOOLEAN, references, 1, booleans);
    tl_fmu_prologue_add(&prologue, TL_PROLOGUE_SET_STRING, references, 2, texts);
    tl_fmu_prologue_add(&prologue, TL_PROLOGUE_SETUP, NULL, 1, &setup);
    tl_fmu_prologue_add(&prologue, TL_PROLOGUE_ENTER_INITIALIZATION, NULL, 0, NULL);
    tl_fmu_prologue_add(&prologue, TL_PROLOGUE_GET_REAL, references, 3, NULL);
    tl_fmu_prologue_add(&prologue, TL_PROLOGUE_GET_INTEGER, references + 1, 2, NULL);
    tl_fmu_prologue_add(&prologue, TL_PROLOGUE_GET_BOOLEAN, references + 2, 1, NULL);
    tl_fmu_prologue_add(&prologue, TL_PROLOGUE_EXIT_INITIALIZATION, NULL, 0, NULL);
    memset(references, 0, sizeof references);
    memset(reals, 0, sizeof reals);
    memset(first, 'x', sizeof first - 1);
}

static const char all[] = "real 3 7 9 0.5 -2.5;integer 1 7 -3;boolean 1 7 1;string 2 8 a text ;setup 1 0.0001 2 1 9;"
                          "enter;get real 3 7;get integer 2 8;get boolean 1 9;exit;";

void setUp(void) {
    prologue = (tl_fmu_prologue){0};
    calls[0] = '\0';
    failing = NULL;
}

void tearDown(void) {
    tl_fmu_prologue_end(&prologue);
}

static void test_all_again_and_as_often_as_wanted(void) {
    give_all();
    for (int i = 0; i < 3; i++) {
        calls[0] = '\0';
        TEST_ASSERT_EQUAL_INT(fmi2OK, tl_fmu_prologue_play(&prologue, &functions, &instance));
        TEST_ASSERT_EQUAL_STRING(all, calls);
    }
}

static void test_nothing_is_given_again_of_before(void) {
    give_all();
    tl_fmu_prologue_end(&prologue);
    TEST_ASSERT_EQUAL_INT(fmi2OK, tl_fmu_prologue_play(&prologue, &functions, &instance));
    TEST_ASSERT_EQUAL_STRING("", calls);
    give_all();
    (void)tl_fmu_prologue_play(&prologue, &functions, &instance);
    TEST_ASSERT_EQUAL_STRING(all, calls);
}

/* A failing call ends the repetition. */
static void test_the_first_that_fails_ends_it(void) {
    give_all();
    failing = "setup";
    TEST_ASSERT_EQUAL_INT(fmi2Discard, tl_fmu_prologue_play(&prologue, &functions, &instance));
    TEST_ASSERT_NULL(strstr(calls, "enter"));
}

static void test_many(void) {
    enum { MANY = 5000 };
    static fmi2ValueReference references[MANY];
    static fmi2Real reals[MANY];
    char wanted[64];
    for (unsigned i = 0; i < MANY; i++) {
        references[i] = i;
        reals[i] = i;
        tl_fmu_prologue_add(&prologue, TL_PROLOGUE_SET_REAL, references, i + 1, reals);
    }
    TEST_ASSERT_FALSE(prologue.is_cut);
    TEST_ASSERT_EQUAL_INT(fmi2OK, tl_fmu_prologue_play(&prologue, &(tl_fmi2){.set_real = set_real}, &instance));
    (void)snprintf(wanted, sizeof wanted, "real 1 0 0 0 0;real 2 0 1 0 1;");
    TEST_ASSERT_EQUAL_STRING_LEN(wanted, calls, strlen(wanted));
}

/* Some calls were not kept, so none is repeated. */
static void test_one_that_is_cut(void) {
    give_all();
    prologue.is_cut = true;
    TEST_ASSERT_EQUAL_INT(fmi2Error, tl_fmu_prologue_play(&prologue, &functions, &instance));
    TEST_ASSERT_EQUAL_STRING("", calls);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_all_again_and_as_often_as_wanted);
    RUN_TEST(test_nothing_is_given_again_of_before);
    RUN_TEST(test_the_first_that_fails_ends_it);
    RUN_TEST(test_many);
    RUN_TEST(test_one_that_is_cut);
    return UNITY_END();
}
