/* One FMU instance: the order of FMI 2.0 calls, the meaning of each status, values by base type,
 * snapshots. */
#include <math.h>
#include <string.h>
#include <unity.h>

#include "master/fmi/component.h"
#include "tests/support/message.h"
#include "tests/support/test_fmu.h"

static tl_test_log call_log;
static tl_test_fmu fmu;
static tl_component component;
static fmi2FMUstate state;
static tl_error error;

/* The ports of the component. */
static fmi2ValueReference in_references[2];
static fmi2ValueReference out_references[2];
static fmi2ValueReference integer_references[2];
static fmi2ValueReference boolean_references[2];
static fmi2Real in_reals[2];
static fmi2Real out_reals[2];
static fmi2Integer integers[2];
static fmi2Boolean booleans[2];

void setUp(void) {
    state = NULL;
    tl_test_log_clear(&call_log);
    tl_test_fmu_init(&fmu, 2, true, &call_log);
    in_references[0] = tl_test_fmu_variable(&fmu, "u0")->reference;
    in_references[1] = tl_test_fmu_variable(&fmu, "u1")->reference;
    out_references[0] = tl_test_fmu_variable(&fmu, "y0")->reference;
    out_references[1] = tl_test_fmu_variable(&fmu, "y1")->reference;
    integer_references[0] = tl_test_fmu_variable(&fmu, "count")->reference;
    integer_references[1] = tl_test_fmu_variable(&fmu, "count_out")->reference;
    boolean_references[0] = tl_test_fmu_variable(&fmu, "flag")->reference;
    boolean_references[1] = tl_test_fmu_variable(&fmu, "flag_out")->reference;
    memset(in_reals, 0, sizeof in_reals);
    memset(out_reals, 0, sizeof out_reals);
    memset(integers, 0, sizeof integers);
    memset(booleans, 0, sizeof booleans);
    component = (tl_component){
        .name = "motor",
        .model = &fmu.model,
        .fmi = &fmu.functions,
        .inputs = {2, 1, 1, in_references, integer_references, boolean_references, in_reals, integers, booleans},
        .outputs = {2, 1, 1, out_references, integer_references + 1, boolean_references + 1, out_reals, integers + 1,
                    booleans + 1},
    };
    error.status = TL_OK;
    error.text[0] = '\0';
}

void tearDown(void) {
    tl_component_forget(&component, &state);
    tl_component_free(&component);
    tl_test_fmu_end(&fmu);
    TEST_ASSERT_EQUAL_STRING("", call_log.first_violation);
    TEST_ASSERT_TRUE(fmu.living == 0 || fmu.dead);
}

/* Asserts that the calls from number `first` to the last are exactly these. */
static void assert_calls(size_t first, const tl_test_call *calls, size_t count) {
    for (size_t i = 0; i < count && first + i < call_log.count; i++) {
        TEST_ASSERT_EQUAL_STRING(tl_test_call_name(calls[i]), tl_test_call_name(call_log.entries[first + i].call));
    }
    TEST_ASSERT_EQUAL_UINT64(first + count, call_log.count);
}

static void start(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_instantiate(&component, &fmu.callbacks, "file:///r", &error));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_enter_initialization(&component, 0.0, &error));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_exit_initialization(&component, &error));
}

static tl_status step(int64_t number) {
    return tl_component_step(&component, (double)number / 10.0, 0.1, false, &error);
}

static void a_life_is_in_legal_order(void) {
    static const tl_test_call calls[] = {
        TL_TEST_INSTANTIATE,
        TL_TEST_SETUP_EXPERIMENT,
        TL_TEST_ENTER_INITIALIZATION,
        TL_TEST_EXIT_INITIALIZATION,
        TL_TEST_GET_STATE,
        TL_TEST_SET_REAL,
        TL_TEST_SET_INTEGER,
        TL_TEST_SET_BOOLEAN,
        TL_TEST_DO_STEP,
        TL_TEST_GET_REAL,
        TL_TEST_GET_INTEGER,
        TL_TEST_GET_BOOLEAN,
        TL_TEST_SET_STATE,
        TL_TEST_FREE_STATE,
        TL_TEST_TERMINATE,
        TL_TEST_FREE_INSTANCE,
    };
    start();
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_save(&component, &state, &error));
    TEST_ASSERT_EQUAL_INT(TL_OK, step(0));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_restore(&component, state, &error));
    tl_component_forget(&component, &state);
    tl_component_free(&component);
    assert_calls(0, calls, sizeof calls / sizeof calls[0]);
    TEST_ASSERT_EQUAL_INT(TL_MODE_ABSENT, component.mode);
    tl_component_free(&component); /* a second time calls nothing */
    TEST_ASSERT_EQUAL_UINT64(sizeof calls / sizeof calls[0], call_log.count);
}

static void the_experiment_starts_at_0_and_never_ends(void) {
    start();
    TEST_ASSERT_EQUAL_INT(TL_TEST_SETUP_EXPERIMENT, call_log.entries[1].call);
    TEST_ASSERT_EQUAL_DOUBLE(0.0, call_log.entries[1].time);
    TEST_ASSERT_FALSE(call_log.entries[1].final);
}

static void the_experiment_has_the_times_of_the_component(void) {
    component.start_s = 64800.0;
    component.stop_s = 64801.0;
    start();
    TEST_ASSERT_EQUAL_DOUBLE(64800.0, call_log.entries[1].time);
    TEST_ASSERT_TRUE(call_log.entries[1].final);
    TEST_ASSERT_EQUAL_INT(TL_OK, step(0));
    TEST_ASSERT_EQUAL_INT(TL_OK, step(1));
    TEST_ASSERT_EQUAL_DOUBLE(64800.0 + 0.1, tl_test_log_step(&call_log, &fmu, 1)->time);
}

static void an_instance_is_freed_as_its_mode_allows(void) {
    static const tl_test_call instantiated[] = {TL_TEST_INSTANTIATE, TL_TEST_FREE_INSTANCE};
    static const tl_test_call initializing[] = {TL_TEST_INSTANTIATE, TL_TEST_SETUP_EXPERIMENT,
                                                TL_TEST_ENTER_INITIALIZATION, TL_TEST_FREE_INSTANCE};
    tl_component_free(&component);
    TEST_ASSERT_EQUAL_UINT64(0, call_log.count);
    (void)tl_component_instantiate(&component, &fmu.callbacks, "file:///r", &error);
    tl_component_free(&component);
    assert_calls(0, instantiated, 2);
    (void)tl_component_instantiate(&component, &fmu.callbacks, "file:///r", &error);
    (void)tl_component_enter_initialization(&component, 0.0, &error);
    tl_component_free(&component);
    assert_calls(2, initializing, 4);
}

static void another_guid_is_refused_with_advice(void) {
    fmu.model.guid = "{another}";
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, tl_component_instantiate(&component, &fmu.callbacks, "file:///r", &error));
    TL_EXPECT_PARTS("motor|GUID|{another}", error.text);
}

static void start_values_go_to_their_own_base_type(void) {
    char label[] = "left";
    const tl_value real = {.type = TL_REAL, .real = 2.5};
    const tl_value integer = {.type = TL_INTEGER, .integer = -7};
    const tl_value boolean = {.type = TL_BOOLEAN, .integer = 5};
    const tl_value text = {.type = TL_STRING, .text = label};
    const fmi2ValueReference zero = 0;
    fmi2String label_now = NULL;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_instantiate(&component, &fmu.callbacks, "file:///r", &error));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_set_start(&component, tl_test_fmu_variable(&fmu, "gain"), &real, &error));
    TEST_ASSERT_EQUAL_INT(TL_OK,
                          tl_component_set_start(&component, tl_test_fmu_variable(&fmu, "count"), &integer, &error));
    TEST_ASSERT_EQUAL_INT(TL_OK,
                          tl_component_set_start(&component, tl_test_fmu_variable(&fmu, "mode"), &integer, &error));
    TEST_ASSERT_EQUAL_INT(TL_OK,
                          tl_component_set_start(&component, tl_test_fmu_variable(&fmu, "flag"), &boolean, &error));
    TEST_ASSERT_EQUAL_INT(TL_OK,
                          tl_component_set_start(&component, tl_test_fmu_variable(&fmu, "label"), &text, &error));
    label[0] = '?';
    (void)tl_component_enter_initialization(&component, 0.0, &error);
    (void)fmu.functions.get_string(component.instance, &zero, 1, &label_now);
    TEST_ASSERT_EQUAL_STRING("left", label_now);
    (void)tl_component_exit_initialization(&component, &error);
    in_reals[0] = 2.0;
    integers[0] = 4;
    TEST_ASSERT_EQUAL_INT(TL_OK, step(0));
    TEST_ASSERT_EQUAL_DOUBLE(5.0, out_reals[0]);
    TEST_ASSERT_EQUAL_INT32(4, integers[1]);
}

static fmi2InstantiateTYPE *real_instantiate;
static unsigned asked_silent;
static unsigned asked_logging;

/* An FMU that can be instantiated only with logging on. */
static fmi2Component instantiate_with_logging(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible,
                                              fmi2Boolean logging) {
    asked_silent += logging == fmi2True ? 0 : 1;
    asked_logging += logging == fmi2True ? 1 : 0;
    return logging == fmi2True ? real_instantiate(name, type, guid, resources, callbacks, visible, logging) : NULL;
}

static void a_refused_instantiation_is_retried_with_logging(void) {
    for (unsigned logging = 0; logging < 2; logging++) {
        asked_silent = asked_logging = 0;
        real_instantiate = fmu.functions.instantiate;
        fmu.functions.instantiate = instantiate_with_logging;
        component.logging = logging == 1;
        TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_instantiate(&component, &fmu.callbacks, "file:///r", &error));
        TEST_ASSERT_EQUAL_UINT(1 - logging, asked_silent);
        TEST_ASSERT_EQUAL_UINT(1, asked_logging);
        tl_component_free(&component);
        fmu.functions.instantiate = real_instantiate;
    }
}

static void a_refused_start_value_is_a_failure(void) {
    const tl_value real = {.type = TL_REAL, .real = 2.5};
    (void)tl_component_instantiate(&component, &fmu.callbacks, "file:///r", &error);
    tl_test_fmu_fail(&fmu, TL_TEST_SET_REAL, TL_TEST_DISCARD, 1, 1);
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED,
                          tl_component_set_start(&component, tl_test_fmu_variable(&fmu, "gain"), &real, &error));
    TL_EXPECT_PARTS("motor|fmi2SetReal|fmi2Discard", error.text);
}

/* Starts the component with two start values. */
static void begin_with_starts(tl_start_value *starts) {
    starts[0] = (tl_start_value){tl_test_fmu_variable(&fmu, "gain"), {.type = TL_REAL, .real = 2.5}};
    starts[1] = (tl_start_value){tl_test_fmu_variable(&fmu, "start"), {.type = TL_REAL, .real = -1.0}};
    component.starts = starts;
    component.start_count = 2;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_instantiate(&component, &fmu.callbacks, "file:///r", &error));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_set_starts(&component, &error));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_enter_initialization(&component, 0.0, &error));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_exit_initialization(&component, &error));
}

static void a_reset_restores_the_start_values(void) {
    static const tl_test_call calls[] = {TL_TEST_RESET, TL_TEST_SET_REAL, TL_TEST_SET_REAL};
    tl_start_value starts[2];
    begin_with_starts(starts);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_save(&component, &state, &error));
    in_reals[0] = 1.5;
    TEST_ASSERT_EQUAL_INT(TL_OK, step(0));
    size_t before = call_log.count;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_reset(&component, &error));
    TEST_ASSERT_EQUAL_INT(TL_MODE_INSTANTIATED, component.mode);
    assert_calls(before, calls, 3);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_enter_initialization(&component, 0.5, &error));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_exit_initialization(&component, &error));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_get_outputs(&component, &error));
    TEST_ASSERT_EQUAL_DOUBLE(-1.0, out_reals[0]);
    /* reuses the handle */
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_save(&component, &state, &error));
    TEST_ASSERT_EQUAL_UINT64(1, fmu.states);
    TEST_ASSERT_EQUAL_INT(TL_OK, step(5));
    TEST_ASSERT_EQUAL_DOUBLE(3.75, out_reals[0]);
    TEST_ASSERT_EQUAL_UINT64(2, component.executions);
}

/* FMI allows fmi2Reset() after fmi2Error. */
static void a_failed_fmu_can_be_reset(void) {
    tl_start_value starts[2];
    begin_with_starts(starts);
    tl_test_fmu_fail(&fmu, TL_TEST_DO_STEP, TL_TEST_ERROR, 1, 1);
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, step(0));
    TEST_ASSERT_EQUAL_INT(TL_MODE_FAILED, component.mode);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_reset(&component, &error));
    TEST_ASSERT_EQUAL_INT(TL_MODE_INSTANTIATED, component.mode);
}

/* An instance that refuses a reset is freed without fmi2Terminate(), in any mode. */
static void a_refused_reset_leads_to_a_new_instance(void) {
    static const tl_test_call calls[] = {TL_TEST_FREE_INSTANCE, TL_TEST_INSTANTIATE, TL_TEST_SET_REAL,
                                         TL_TEST_SET_REAL};
    static const tl_test_fault_kind kinds[] = {TL_TEST_ERROR, TL_TEST_DISCARD};
    tl_start_value starts[2];
    for (size_t i = 0; i < 2; i++) {
        begin_with_starts(starts);
        tl_test_fmu_fail(&fmu, TL_TEST_RESET, kinds[i], i + 1, i + 1);
        TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, tl_component_reset(&component, &error));
        TL_EXPECT_PARTS("motor|fmi2Reset", error.text);
        TEST_ASSERT_EQUAL_INT(TL_MODE_FAILED, component.mode);
        size_t before = call_log.count;
        TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_renew(&component, &error));
        assert_calls(before, calls, 4);
        TEST_ASSERT_EQUAL_INT(TL_MODE_INSTANTIATED, component.mode);
        tl_component_free(&component);
    }
}

static void after_a_fatal_reset_nothing_is_called(void) {
    start();
    tl_test_fmu_fail(&fmu, TL_TEST_RESET, TL_TEST_FATAL, 1, 1);
    TEST_ASSERT_EQUAL_INT(TL_FMU_FATAL, tl_component_reset(&component, &error));
    TEST_ASSERT_EQUAL_INT(TL_MODE_DEAD, component.mode);
    size_t before = call_log.count;
    TEST_ASSERT_EQUAL_INT(TL_FMU_FATAL, tl_component_renew(&component, &error));
    TL_EXPECT_PARTS("motor|fmi2Fatal", error.text);
    TEST_ASSERT_EQUAL_UINT64(before, call_log.count);
}

static void a_step_sets_steps_and_reads(void) {
    start();
    in_reals[0] = 1.5;
    in_reals[1] = -2.5;
    integers[0] = -2147483647 - 1;
    booleans[0] = fmi2True;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_step(&component, 0.0, 0.1, true, &error));
    TEST_ASSERT_EQUAL_DOUBLE(1.5, out_reals[0]);
    TEST_ASSERT_EQUAL_DOUBLE(-2.5, out_reals[1]);
    TEST_ASSERT_EQUAL_INT32(-2147483647 - 1, integers[1]);
    TEST_ASSERT_EQUAL_INT32(fmi2True, booleans[1]);
    const tl_test_entry *entry = tl_test_log_step(&call_log, &fmu, 0);
    TEST_ASSERT_EQUAL_DOUBLE(0.0, entry->time);
    TEST_ASSERT_EQUAL_DOUBLE(0.1, entry->step);
    TEST_ASSERT_TRUE(entry->final);
    TEST_ASSERT_EQUAL_INT(TL_OK, step(1));
    TEST_ASSERT_FALSE(tl_test_log_step(&call_log, &fmu, 1)->final);
    TEST_ASSERT_EQUAL_UINT64(2, component.executions);
}

static void a_true_of_7_is_plain_true(void) {
    fmu.control.raw_true = true;
    start();
    booleans[0] = fmi2True;
    TEST_ASSERT_EQUAL_INT(TL_OK, step(0));
    TEST_ASSERT_EQUAL_INT32(fmi2True, booleans[1]);
}

static void a_snapshot_reuses_its_handle_and_restores_the_state(void) {
    start();
    for (int64_t i = 0; i < 5; i++) {
        in_reals[0] = (double)i;
        TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_save(&component, &state, &error));
        TEST_ASSERT_EQUAL_INT(TL_OK, step(i));
        TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_restore(&component, state, &error));
        TEST_ASSERT_EQUAL_INT(TL_OK, step(i));
        TEST_ASSERT_EQUAL_DOUBLE((double)i, out_reals[0]);
    }
    TEST_ASSERT_EQUAL_UINT64(1, fmu.states);
    TEST_ASSERT_EQUAL_UINT64(5, tl_test_log_count(&call_log, &fmu, TL_TEST_GET_STATE));
}

static fmi2GetFMUstateTYPE *real_get;

/* Returns a new handle each time and does not free the old one. */
static fmi2Status get_new_state(fmi2Component instance, fmi2FMUstate *handle) {
    *handle = NULL;
    return real_get(instance, handle);
}

static void states_that_are_not_reused_are_freed_first(void) {
    start();
    real_get = fmu.functions.get_fmu_state;
    fmu.functions.get_fmu_state = get_new_state;
    for (int64_t i = 0; i < 100; i++) {
        TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_save(&component, &state, &error));
    }
    TEST_ASSERT_EQUAL_UINT64(2, fmu.states); /* the first one, which the FMU lost, and the newest */
    tl_test_fmu_fail(&fmu, TL_TEST_FREE_STATE, TL_TEST_FATAL, fmu.calls[TL_TEST_FREE_STATE] + 1, UINT64_MAX);
    TEST_ASSERT_EQUAL_INT(TL_FMU_FATAL, tl_component_save(&component, &state, &error));
    TEST_ASSERT_NULL(state);
    fmu.functions.get_fmu_state = real_get;
}

static void a_discarded_step_can_be_rolled_back(void) {
    start();
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_save(&component, &state, &error));
    tl_test_fmu_fail(&fmu, TL_TEST_DO_STEP, TL_TEST_DISCARD, 1, 1);
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, step(0));
    TL_EXPECT_PARTS("motor|fmi2DoStep|fmi2Discard", error.text);
    TEST_ASSERT_EQUAL_UINT64(1, component.executions);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_restore(&component, state, &error));
    TEST_ASSERT_EQUAL_INT(TL_OK, step(0));
}

static void after_an_error_only_a_restore_helps(void) {
    start();
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_save(&component, &state, &error));
    tl_test_fmu_fail(&fmu, TL_TEST_DO_STEP, TL_TEST_ERROR, 1, 1);
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, step(0));
    TEST_ASSERT_EQUAL_INT(TL_MODE_FAILED, component.mode);
    size_t calls = call_log.count;
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, step(0));
    TEST_ASSERT_EQUAL_UINT64(calls, call_log.count);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_restore(&component, state, &error));
    TEST_ASSERT_EQUAL_INT(TL_OK, step(0));
}

static void a_failed_instance_is_freed_without_terminating(void) {
    start();
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_save(&component, &state, &error));
    tl_test_fmu_fail(&fmu, TL_TEST_DO_STEP, TL_TEST_ERROR, 1, 1);
    (void)step(0);
    tl_component_forget(&component, &state);
    tl_component_free(&component);
    TEST_ASSERT_EQUAL_UINT64(0, fmu.calls[TL_TEST_TERMINATE]);
    TEST_ASSERT_EQUAL_UINT64(0, fmu.living);
    TEST_ASSERT_EQUAL_UINT64(0, fmu.states);
}

static void each_call_that_fails_is_named(void) {
    static const struct {
        tl_test_call call;
        const char *name;
    } cases[] = {{TL_TEST_SET_REAL, "fmi2SetReal"},       {TL_TEST_SET_INTEGER, "fmi2SetInteger"},
                 {TL_TEST_SET_BOOLEAN, "fmi2SetBoolean"}, {TL_TEST_GET_REAL, "fmi2GetReal"},
                 {TL_TEST_GET_INTEGER, "fmi2GetInteger"}, {TL_TEST_GET_BOOLEAN, "fmi2GetBoolean"},
                 {TL_TEST_DO_STEP, "fmi2DoStep"}};
    start();
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_save(&component, &state, &error));
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        uint64_t next = fmu.calls[cases[i].call] + 1;
        tl_test_fmu_fail(&fmu, cases[i].call, TL_TEST_ERROR, next, next);
        TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, step(0));
        TL_EXPECT_PARTS(cases[i].name, error.text);
        TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_restore(&component, state, &error));
    }
}

static void nothing_is_called_after_fatal(void) {
    start();
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_save(&component, &state, &error));
    tl_test_fmu_fail(&fmu, TL_TEST_DO_STEP, TL_TEST_FATAL, 1, 1);
    TEST_ASSERT_EQUAL_INT(TL_FMU_FATAL, step(0));
    TL_EXPECT_PARTS("motor|fmi2DoStep|fmi2Fatal|\"logging\": true", error.text);
    size_t calls = call_log.count;
    TEST_ASSERT_EQUAL_INT(TL_FMU_FATAL, step(0));
    TEST_ASSERT_EQUAL_INT(TL_FMU_FATAL, tl_component_restore(&component, state, &error));
    TEST_ASSERT_EQUAL_INT(TL_FMU_FATAL, tl_component_save(&component, &state, &error));
    tl_component_free(&component);
    TEST_ASSERT_EQUAL_UINT64(calls, call_log.count);
}

static void fatal_while_freeing_ends_the_freeing(void) {
    static const tl_test_call cases[] = {TL_TEST_FREE_STATE, TL_TEST_TERMINATE};
    for (size_t i = 0; i < 2; i++) {
        setUp();
        start();
        TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_save(&component, &state, &error));
        tl_test_fmu_fail(&fmu, cases[i], TL_TEST_FATAL, 1, 1);
        tl_component_forget(&component, &state);
        tl_component_free(&component);
        TEST_ASSERT_EQUAL_INT(cases[i], call_log.entries[call_log.count - 1].call);
        tl_test_fmu_end(&fmu);
    }
}

static void fatal_while_initialising_is_fatal(void) {
    static const tl_test_call cases[] = {TL_TEST_SETUP_EXPERIMENT, TL_TEST_ENTER_INITIALIZATION};
    for (size_t i = 0; i < 2; i++) {
        setUp();
        (void)tl_component_instantiate(&component, &fmu.callbacks, "file:///r", &error);
        tl_test_fmu_fail(&fmu, cases[i], TL_TEST_FATAL, 1, 1);
        TEST_ASSERT_EQUAL_INT(TL_FMU_FATAL, tl_component_enter_initialization(&component, 0.0, &error));
        TEST_ASSERT_EQUAL_INT(TL_MODE_DEAD, component.mode);
        tl_component_free(&component);
        TEST_ASSERT_EQUAL_INT(cases[i], call_log.entries[call_log.count - 1].call);
        tl_test_fmu_end(&fmu);
    }
}

/* NaN and infinity of any sign have the same bits. */
static void an_output_that_is_not_finite_is_nan(void) {
    static const double nan_bits = (double)NAN;
    start();
    tl_test_fmu_fail(&fmu, TL_TEST_DO_STEP, TL_TEST_NAN, 1, 1);
    TEST_ASSERT_EQUAL_INT(TL_OK, step(0));
    TEST_ASSERT_FALSE(tl_reals_are_finite(out_reals, 2));
    for (size_t i = 0; i < 4; i++) {
        out_reals[0] = (double[]){-(double)NAN, (double)INFINITY, -(double)INFINITY, (double)NAN}[i];
        tl_component_mark_outputs(&component);
        TEST_ASSERT_EQUAL_MEMORY(&nan_bits, &out_reals[0], sizeof nan_bits);
    }
    in_reals[1] = 1e200;
    TEST_ASSERT_EQUAL_INT(TL_OK, step(1));
    TEST_ASSERT_TRUE(tl_reals_are_finite(out_reals, 2));
}

static fmi2Status pending_step(fmi2Component instance, fmi2Real time, fmi2Real size, fmi2Boolean final) {
    (void)instance;
    (void)time;
    (void)size;
    (void) final;
    return fmi2Pending;
}

static fmi2Boolean is_terminated;

static fmi2Status boolean_status(fmi2Component instance, const fmi2StatusKind kind, fmi2Boolean *value) {
    (void)instance;
    TEST_ASSERT_EQUAL_INT(fmi2Terminated, kind);
    *value = is_terminated;
    return fmi2OK;
}

static void a_step_that_ends_the_fmu_is_named(void) {
    static const struct {
        double declared, stop;
        fmi2Boolean is_terminated;
        tl_test_fault_kind kind;
        const char *parts;
    } cases[] = {
        {0.3, 0.0, fmi2False, TL_TEST_ERROR, "motor|ended itself|stopTime|DefaultExperiment|0.3 s|fmi2Error"},
        {(double)NAN, 0.3, fmi2False, TL_TEST_DISCARD, "motor|ended itself|0.3 s|fmi2Discard|raise \"stop_s\""},
        {(double)NAN, 0.0, fmi2True, TL_TEST_DISCARD, "motor|ended itself|0.3 s|fmi2Discard"},
        {0.2, 0.2, fmi2False, TL_TEST_ERROR, "motor|fmi2DoStep failed|fmi2Error"}, /* long before */
        {0.5, 0.5, fmi2False, TL_TEST_DISCARD, "motor|fmi2DoStep|discarded"},      /* later */
        {0.3, 0.3, fmi2False, TL_TEST_FATAL, "motor|fmi2DoStep failed|fmi2Fatal"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        setUp();
        fmu.functions.get_boolean_status = boolean_status;
        is_terminated = cases[i].is_terminated;
        fmu.model.stop_time = cases[i].declared;
        component.stop_s = cases[i].stop;
        TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_instantiate(&component, &fmu.callbacks, "file:///r", &error));
        TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_enter_initialization(&component, 0.3, &error));
        TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_exit_initialization(&component, &error));
        tl_test_fmu_fail(&fmu, TL_TEST_DO_STEP, cases[i].kind, 1, 1);
        TEST_ASSERT_NOT_EQUAL_INT(TL_OK, step(3));
        TL_EXPECT_PARTS(cases[i].parts, error.text);
        tl_component_free(&component);
        tl_test_fmu_end(&fmu);
    }
}

static fmi2DoStepTYPE *real_step;

static fmi2Status warning_step(fmi2Component instance, fmi2Real time, fmi2Real size, fmi2Boolean final) {
    fmi2Status status = real_step(instance, time, size, final);
    return status == fmi2OK ? fmi2Warning : status;
}

static void a_pending_step_is_a_failure(void) {
    start();
    real_step = fmu.functions.do_step;
    fmu.functions.do_step = pending_step;
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, step(0));
    TL_EXPECT_PARTS("motor|fmi2DoStep|fmi2Pending", error.text);
    fmu.functions.do_step = real_step;
}

static void a_warning_is_success(void) {
    start();
    real_step = fmu.functions.do_step;
    fmu.functions.do_step = warning_step;
    in_reals[0] = 3.0;
    TEST_ASSERT_EQUAL_INT(TL_OK, step(0));
    TEST_ASSERT_EQUAL_DOUBLE(3.0, out_reals[0]);
    fmu.functions.do_step = real_step;
}

/* `sum` is no port. */
static void a_hash_shows_outputs_that_are_not_connected(void) {
    component.outputs = (tl_ports){0};
    start();
    in_reals[0] = 3.0;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_save(&component, &state, &error));
    TEST_ASSERT_EQUAL_INT(TL_OK, step(0));
    uint64_t first = tl_component_hash(&component);
    TEST_ASSERT_NOT_EQUAL_UINT64(0, first);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_restore(&component, state, &error));
    in_reals[0] = 4.0;
    TEST_ASSERT_EQUAL_INT(TL_OK, step(0));
    TEST_ASSERT_NOT_EQUAL_UINT64(first, tl_component_hash(&component));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_restore(&component, state, &error));
    in_reals[0] = 3.0;
    TEST_ASSERT_EQUAL_INT(TL_OK, step(0));
    TEST_ASSERT_EQUAL_UINT64(first, tl_component_hash(&component));
}

static void a_variable_that_is_refused_ends_the_hashes(void) {
    component.outputs = (tl_ports){0};
    start();
    fmu.control.fault = (tl_test_fault){
        .kind = TL_TEST_DISCARD, .call = TL_TEST_GET_REAL, .first = 1, .last = 1, .above = (double)INFINITY};
    TEST_ASSERT_EQUAL_INT(TL_OK, step(0));
    TEST_ASSERT_EQUAL_UINT64(0, tl_component_hash(&component));
    TEST_ASSERT_EQUAL_UINT64(0, tl_component_hash(&component));
    TEST_ASSERT_EQUAL_UINT64(1, fmu.calls[TL_TEST_GET_REAL]);
    TEST_ASSERT_EQUAL_INT(TL_OK, step(1));
}

static void no_ports_no_calls(void) {
    component.inputs = (tl_ports){0};
    component.outputs = (tl_ports){0};
    start();
    TEST_ASSERT_EQUAL_INT(TL_OK, step(0));
    TEST_ASSERT_EQUAL_UINT64(5, call_log.count);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(a_life_is_in_legal_order);
    RUN_TEST(the_experiment_starts_at_0_and_never_ends);
    RUN_TEST(the_experiment_has_the_times_of_the_component);
    RUN_TEST(an_instance_is_freed_as_its_mode_allows);
    RUN_TEST(another_guid_is_refused_with_advice);
    RUN_TEST(start_values_go_to_their_own_base_type);
    RUN_TEST(a_refused_instantiation_is_retried_with_logging);
    RUN_TEST(a_refused_start_value_is_a_failure);
    RUN_TEST(a_reset_restores_the_start_values);
    RUN_TEST(a_failed_fmu_can_be_reset);
    RUN_TEST(a_refused_reset_leads_to_a_new_instance);
    RUN_TEST(after_a_fatal_reset_nothing_is_called);
    RUN_TEST(a_step_sets_steps_and_reads);
    RUN_TEST(a_true_of_7_is_plain_true);
    RUN_TEST(a_snapshot_reuses_its_handle_and_restores_the_state);
    RUN_TEST(states_that_are_not_reused_are_freed_first);
    RUN_TEST(a_discarded_step_can_be_rolled_back);
    RUN_TEST(after_an_error_only_a_restore_helps);
    RUN_TEST(a_failed_instance_is_freed_without_terminating);
    RUN_TEST(each_call_that_fails_is_named);
    RUN_TEST(nothing_is_called_after_fatal);
    RUN_TEST(fatal_while_freeing_ends_the_freeing);
    RUN_TEST(fatal_while_initialising_is_fatal);
    RUN_TEST(an_output_that_is_not_finite_is_nan);
    RUN_TEST(a_step_that_ends_the_fmu_is_named);
    RUN_TEST(a_pending_step_is_a_failure);
    RUN_TEST(a_warning_is_success);
    RUN_TEST(a_hash_shows_outputs_that_are_not_connected);
    RUN_TEST(a_variable_that_is_refused_ends_the_hashes);
    RUN_TEST(no_ports_no_calls);
    return UNITY_END();
}
