/* The guard around an FMU's functions: it passes calls on, notes them, and restores the process
 * state. */
#include "firmware/fmu/fmu_guard.h"

#include <fenv.h>
#include <locale.h>
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/process/host_state.h"
#include "master/fmi/component.h"
#include "tests/support/message.h"
#include "tests/support/stderr_capture.h"
#include "tests/support/test_fmu.h"

static tl_test_log call_log;
static tl_test_fmu fmu;
static tl_fmi2 vendor; /* the FMU's functions; a test replaces single ones */
static tl_fmu_guard guard;
static tl_component component;
static tl_error error;
static tl_fmu_call seen; /* the call that the FMU found noted */
static fmi2CallbackFunctions given;

/* ---- functions of a misbehaving FMU ---- */

/* The test FMU gets its own environment. */
static fmi2Component note_callbacks(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                    const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging) {
    given = *callbacks;
    TEST_ASSERT_TRUE(tl_fmu_calls_poll(tl_fmu_calls_in_use(), &seen));
    return fmu.functions.instantiate(name, type, guid, resources, &fmu.callbacks, visible, logging);
}

static fmi2Status note_call(fmi2Component instance, fmi2Real now, fmi2Real step, fmi2Boolean final) {
    TEST_ASSERT_TRUE(tl_fmu_calls_poll(tl_fmu_calls_in_use(), &seen));
    return fmu.functions.do_step(instance, now, step, final);
}

static fmi2Status step_and_round_upwards(fmi2Component instance, fmi2Real now, fmi2Real step, fmi2Boolean final) {
    fmi2Status status = fmu.functions.do_step(instance, now, step, final);
    (void)fesetround(FE_UPWARD);
    return status;
}

static void round_upwards(void) {
    (void)fesetround(FE_UPWARD);
}

static void use_another_locale(void) {
    static locale_t other;
    other = other == (locale_t)0 ? newlocale(LC_ALL_MASK, "POSIX", (locale_t)0) : other;
    other = newlocale(LC_CTYPE_MASK, "C.UTF-8", other);
    (void)uselocale(other);
}

#if defined(__x86_64__)
static void enable_traps(void) {
    (void)feenableexcept(FE_DIVBYZERO | FE_INVALID);
}

static void enable_an_sse_trap(void) {
    tl_fp_control_set(tl_fp_control_get() & ~(uint64_t)0x0200);
}

static void use_single_precision(void) {
    uint16_t single = 0x007F;
    __asm__ volatile("fldcw %0" : : "m"(single));
}
#endif

static void (*meddle)(void);

static fmi2Status meddle_and_get_real(fmi2Component instance, const fmi2ValueReference references[], size_t count,
                                      fmi2Real values[]) {
    fmi2Status status = fmu.functions.get_real(instance, references, count, values);
    meddle();
    return status;
}

static fmi2Status meddle_and_get_state(fmi2Component instance, fmi2FMUstate *state) {
    meddle();
    return fmu.functions.get_fmu_state(instance, state);
}

static fmi2Status ignore_signals(fmi2Component instance) {
    sigset_t all;
    (void)sigfillset(&all);
    (void)pthread_sigmask(SIG_BLOCK, &all, NULL);
    (void)signal(SIGTERM, SIG_IGN);
    TEST_ASSERT_EQUAL_INT(0, chdir("/"));
    return fmu.functions.exit_initialization_mode(instance);
}

static fmi2Status ignore_sigterm(fmi2Component instance, fmi2Real now, fmi2Real step, fmi2Boolean final) {
    (void)signal(SIGTERM, SIG_IGN);
    return fmu.functions.do_step(instance, now, step, final);
}

static fmi2Status give_no_state(fmi2Component instance, fmi2FMUstate *state) {
    (void)instance;
    *state = NULL;
    return fmi2OK;
}

static fmi2Status make_no_state(fmi2Component instance, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
    (void)bytes;
    (void)size;
    return give_no_state(instance, state);
}

static double started_at; /* of the last fmi2SetupExperiment that was accepted */
static double stopped_at;
static double stepped_at;

static fmi2Status start_at_0_only(fmi2Component instance, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real begin,
                                  fmi2Boolean has_stop, fmi2Real stop) {
    if (begin > 0.0) {
        return fmi2Error;
    }
    started_at = begin;
    stopped_at = stop;
    return fmu.functions.setup_experiment(instance, has_tolerance, tolerance, begin, has_stop, stop);
}

static fmi2Status note_time(fmi2Component instance, fmi2Real now, fmi2Real step, fmi2Boolean final) {
    stepped_at = now;
    return fmu.functions.do_step(instance, now, step, final);
}

/* ---- set-up ---- */

static void take_sigterm(int signal) {
    (void)signal;
}

void setUp(void) {
    const struct sigaction action = {.sa_handler = take_sigterm};
    TEST_ASSERT_EQUAL_INT(0, tl_host_state_handle(SIGTERM, &action, NULL));
    tl_test_log_clear(&call_log);
    tl_test_fmu_init(&fmu, 1, false, &call_log);
    vendor = fmu.functions;
    vendor.instantiate = note_callbacks;
    error = (tl_error){TL_OK, ""};
}

static void begin(tl_component *one) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_instantiate(one, &guard.callbacks, "file:///tmp", &error));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_enter_initialization(one, 0.0, &error));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_exit_initialization(one, &error));
}

static void start(void) {
    static fmi2ValueReference zero;
    static fmi2Real u;
    static fmi2Real y;
    tl_fmu_guard_open(&guard, "box", "tests");
    tl_fmu_guard_front(&guard, &vendor);
    component = (tl_component){.name = "box1", .model = &fmu.model, .fmi = &guard.functions, .reals_run = 1};
    component.inputs = (tl_ports){.real_count = 1, .real_references = &zero, .reals = &u};
    component.outputs = (tl_ports){.real_count = 1, .real_references = &zero, .reals = &y};
    u = 1.0;
    begin(&component);
}

void tearDown(void) {
    tl_component_free(&component);
    tl_fmu_guard_close(&guard);
    tl_test_fmu_end(&fmu);
    TEST_ASSERT_EQUAL_size_t_MESSAGE(0, call_log.violations, call_log.first_violation);
}

/* ---- tests ---- */

static void expect_line(const char *parts) {
    tl_stderr_expect_lines(&parts, 1);
}

static void steps_pass_through(void) {
    start();
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_step(&component, 0.0, 0.1, false, &error));
    TEST_ASSERT_EQUAL_DOUBLE(1.0, component.outputs.reals[0]);
    TEST_ASSERT_EQUAL_UINT64(1, component.executions);
    TEST_ASSERT_EQUAL_size_t(1, tl_test_log_count(&call_log, &fmu, TL_TEST_DO_STEP));
}

static fmi2Boolean had_stop;

static fmi2Status note_stop(fmi2Component instance, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real begin,
                            fmi2Boolean has_stop, fmi2Real stop) {
    had_stop = has_stop;
    return fmu.functions.setup_experiment(instance, has_tolerance, tolerance, begin, has_stop, stop);
}

/* Returns whether the FMU gets it. */
static bool gets_stop(double stop) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_renew(&component, &error));
    TEST_ASSERT_EQUAL_INT(fmi2OK,
                          guard.functions.setup_experiment(component.instance, fmi2False, 0.0, 100.0, fmi2True, stop));
    return had_stop != fmi2False;
}

static void openmodelica_gets_no_far_stop_time(void) {
    vendor.setup_experiment = note_stop;
    start();
    TEST_ASSERT_TRUE(gets_stop(100.0 + TL_EXPERIMENT_FAR));
    guard.is_by_openmodelica = true;
    TEST_ASSERT_FALSE(gets_stop(100.0 + TL_EXPERIMENT_FAR));
    TEST_ASSERT_TRUE(gets_stop(1e8));
}

static void a_start_time_that_is_refused_is_shifted(void) {
    const tl_fmi2 *functions = &guard.functions;
    vendor.setup_experiment = start_at_0_only;
    vendor.do_step = note_time;
    start();
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_renew(&component, &error));
    fmi2Component instance = component.instance;
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    TEST_ASSERT_EQUAL_INT(fmi2OK, functions->setup_experiment(instance, fmi2False, 0.0, 3600.0, fmi2True, 3700.0));
    expect_line("warning|box|3600 s|0 s");
    TEST_ASSERT_EQUAL_DOUBLE(0.0, started_at);
    TEST_ASSERT_EQUAL_DOUBLE(100.0, stopped_at);
    TEST_ASSERT_EQUAL_INT(fmi2OK, functions->enter_initialization_mode(instance));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_exit_initialization(&component, &error));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_step(&component, 3600.0, 0.5, false, &error));
    TEST_ASSERT_EQUAL_DOUBLE(0.0, stepped_at);
    TEST_ASSERT_EQUAL_INT(fmi2OK, functions->do_step(instance, 3600.5, 0.5, fmi2True));
    TEST_ASSERT_EQUAL_DOUBLE(0.5, stepped_at);
}

static void a_call_is_noted_with_the_instance_while_it_lasts(void) {
    vendor.do_step = note_call;
    start();
    TEST_ASSERT_EQUAL_STRING("fmi2Instantiate", seen.function);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_step(&component, 0.0, 0.1, false, &error));
    TEST_ASSERT_EQUAL_STRING("fmi2DoStep", seen.function);
    TEST_ASSERT_EQUAL_STRING("box1", seen.fmu);
    TEST_ASSERT_FALSE(tl_fmu_calls_poll(tl_fmu_calls_in_use(), &seen));
}

/* The message names the failing call. An execution counts as soon as fmi2DoStep was called. */
static void a_failing_call_of_a_step_is_named(void) {
    static const struct {
        tl_test_call call;
        const char *name;
        uint64_t executions;
    } cases[] = {
        {TL_TEST_SET_REAL, "fmi2SetReal", 0}, {TL_TEST_DO_STEP, "fmi2DoStep", 1}, {TL_TEST_GET_REAL, "fmi2GetReal", 1}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        start();
        tl_test_fmu_fail(&fmu, cases[i].call, TL_TEST_ERROR, fmu.calls[cases[i].call] + 1,
                         fmu.calls[cases[i].call] + 1);
        TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, tl_component_step(&component, 0.0, 0.1, false, &error));
        TL_EXPECT_PARTS(cases[i].name, error.text);
        TEST_ASSERT_EQUAL_UINT64(cases[i].executions, component.executions);
        tl_component_free(&component);
        tl_fmu_guard_close(&guard);
    }
    start();
}

/* Two components in one call: the first one makes its step. */
static void a_failure_among_several_components_is_of_its_own(void) {
    start();
    tl_component both[2] = {component, component};
    size_t failed = 0;
    both[0].reals_run = 2;
    begin(&both[1]);
    tl_test_fmu_fail(&fmu, TL_TEST_DO_STEP, TL_TEST_ERROR, fmu.calls[TL_TEST_DO_STEP] + 2,
                     fmu.calls[TL_TEST_DO_STEP] + 2);
    for (uint64_t i = 0; i < 2; i++) { /* in the second step it refuses to be called */
        TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED,
                              tl_component_step_all(both, 2, 0.1 * (double)i, 0.1, false, &failed, &error));
        TL_EXPECT_PARTS(i == 0 ? "fmi2DoStep" : "earlier failure", error.text);
        TEST_ASSERT_EQUAL_size_t(1, failed);
        TEST_ASSERT_EQUAL_UINT64(i + 1, both[0].executions);
        TEST_ASSERT_EQUAL_UINT64(1, both[1].executions);
    }
    tl_component_free(&both[1]);
}

static void the_rounding_mode_is_restored_and_reported_once(void) {
    vendor.do_step = step_and_round_upwards;
    start();
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    for (int i = 0; i < 3; i++) {
        TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_step(&component, 0.1 * i, 0.1, false, &error));
        TEST_ASSERT_EQUAL_INT(FE_TONEAREST, fegetround());
    }
    expect_line("notice|box1|floating-point|step");
}

/* The second component of a macro step must not compute with settings of the first one. */
static void settings_are_restored_before_the_next_instance_steps(void) {
    static void (*const kinds[])(void) = {
        round_upwards,
        use_another_locale,
#if defined(__x86_64__)
        enable_traps,
        enable_an_sse_trap,
        use_single_precision,
#endif
    };
    vendor.get_real = meddle_and_get_real;
    start();
    const uint64_t control = tl_fp_control_get();
    const locale_t locale = uselocale((locale_t)0);
    for (size_t i = 0; i < sizeof kinds / sizeof kinds[0]; i++) {
        tl_component both[2] = {component, component};
        both[0].reals_run = 2;
        size_t failed = 0;
        meddle = kinds[i];
        both[1].instance = NULL; /* fails before its FMU is called */
        both[1].mode = TL_MODE_FAILED;
        TEST_ASSERT_TRUE(tl_stderr_capture_begin());
        tl_status status = tl_component_step_all(both, 2, 0.1 * (double)i, 0.1, false, &failed, &error);
        free(tl_stderr_capture_end());
        TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, status);
        TEST_ASSERT_EQUAL_size_t(1, failed);
        TEST_ASSERT_EQUAL_HEX64(control, tl_fp_control_get());
        TEST_ASSERT_TRUE(uselocale((locale_t)0) == locale);
    }
}

static void the_locale_is_restored_after_each_call(void) {
    fmi2FMUstate state = NULL;
    const locale_t locale = uselocale((locale_t)0);
    vendor.get_fmu_state = meddle_and_get_state;
    meddle = use_another_locale;
    start();
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_save(&component, &state, &error));
    expect_line("notice|box1|locale|fmi2GetFMUstate");
    TEST_ASSERT_TRUE(uselocale((locale_t)0) == locale);
    tl_component_forget(&component, &state);
}

static void changes_during_initialisation_are_restored(void) {
    char before[4096];
    char after[4096];
    sigset_t mask;
    struct sigaction action;
    TEST_ASSERT_NOT_NULL(getcwd(before, sizeof before));
    vendor.exit_initialization_mode = ignore_signals;
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    start();
    expect_line("notice|box1|signal mask|signal handlers|folder|fmi2ExitInitializationMode");
    (void)pthread_sigmask(SIG_SETMASK, NULL, &mask);
    TEST_ASSERT_EQUAL_INT(0, sigismember(&mask, SIGTERM));
    TEST_ASSERT_EQUAL_INT(0, sigaction(SIGTERM, NULL, &action));
    TEST_ASSERT_TRUE(action.sa_handler == take_sigterm);
    TEST_ASSERT_NOT_NULL(getcwd(after, sizeof after));
    TEST_ASSERT_EQUAL_STRING(before, after);
}

static void changes_during_a_step_are_restored_with_the_tick(void) {
    struct sigaction action;
    vendor.do_step = ignore_sigterm;
    start();
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_step(&component, 0.0, 0.1, false, &error));
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    tl_fmu_guard_tick(true);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_step(&component, 0.1, 0.1, false, &error));
    tl_fmu_guard_tick(true);
    expect_line("notice|signal handlers|steps");
    TEST_ASSERT_EQUAL_INT(0, sigaction(SIGTERM, NULL, &action));
    TEST_ASSERT_TRUE(action.sa_handler == take_sigterm);
}

static void success_without_a_state_is_a_failure(void) {
    fmi2FMUstate state = NULL;
    unsigned char byte = 0;
    vendor.get_fmu_state = give_no_state;
    vendor.deserialize_fmu_state = make_no_state;
    start();
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, tl_component_save(&component, &state, &error));
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, tl_component_deserialize(&component, &byte, 1, &state, &error));
    static const char *const parts[] = {"error|box1|fmi2OK|NULL", "error|box1|fmi2OK|NULL"};
    tl_stderr_expect_lines(parts, sizeof parts / sizeof parts[0]);
}

static void missing_functions_of_the_fmu_stay_null(void) {
    vendor.get_fmu_state = NULL;
    vendor.serialize_fmu_state = NULL;
    start();
    TEST_ASSERT_NULL(guard.functions.get_fmu_state);
    TEST_ASSERT_NULL(guard.functions.serialize_fmu_state);
    TEST_ASSERT_NOT_NULL(guard.functions.set_fmu_state);
}

/* Some exporters pass NULL or an invalid pointer. The message is attributed to the FMU that is
 * being called. */
static void a_message_without_environment_belongs_to_the_fmu_in_the_call(void) {
    start();
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    tl_fmu_guard_enter(&guard, TL_FMU_GET_VERSION);
    given.logger(NULL, NULL, fmi2Error, NULL, "no environment");
    given.logger((void *)8, (const char *)8, fmi2Error, (const char *)8, "no pointer");
    tl_fmu_guard_leave(&guard);
    given.logger(given.componentEnvironment, "box1", fmi2Error, "c", "known");
    static const char *const parts[] = {"error|box|no environment", "error|box|(unreadable)|no pointer",
                                        "error|box|box1|known|c"};
    tl_stderr_expect_lines(parts, sizeof parts / sizeof parts[0]);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(steps_pass_through);
    RUN_TEST(openmodelica_gets_no_far_stop_time);
    RUN_TEST(a_start_time_that_is_refused_is_shifted);
    RUN_TEST(a_call_is_noted_with_the_instance_while_it_lasts);
    RUN_TEST(a_failing_call_of_a_step_is_named);
    RUN_TEST(a_failure_among_several_components_is_of_its_own);
    RUN_TEST(the_rounding_mode_is_restored_and_reported_once);
    RUN_TEST(settings_are_restored_before_the_next_instance_steps);
    RUN_TEST(the_locale_is_restored_after_each_call);
    RUN_TEST(changes_during_initialisation_are_restored);
    RUN_TEST(changes_during_a_step_are_restored_with_the_tick);
    RUN_TEST(success_without_a_state_is_a_failure);
    RUN_TEST(missing_functions_of_the_fmu_stay_null);
    RUN_TEST(a_message_without_environment_belongs_to_the_fmu_in_the_call);
    return UNITY_END();
}
