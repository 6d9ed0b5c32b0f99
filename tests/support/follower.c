/* The smallest twin that can be locked: see follower.h. */
#include "tests/support/follower.h"

#include <string.h>

#include <unity.h>

void tl_follower_begin(tl_follower *follower, tl_time step) {
    tl_test_plan *plan = &follower->plan;
    memset(&follower->assembly, 0, sizeof follower->assembly);
    tl_test_log_clear(&follower->log);
    tl_test_fmu_init(&follower->fmu, 1, false, &follower->log);
    tl_test_plan_init(plan, step);
    (void)tl_test_plan_component(plan, "motor", &follower->fmu);
    follower->signal.plan = *tl_test_plan_signal(plan, "speed", TL_REAL, "");
    (void)tl_test_plan_adjust(plan, "motor.u0", 1.0);
}

void tl_follower_build(tl_follower *follower, double tolerance) {
    tl_test_plan *plan = &follower->plan;
    (void)tl_test_plan_match(plan, "motor.y0", "plant.speed", tolerance);
    follower->assembly.twin = tl_test_plan_build(plan);
    TEST_ASSERT_EQUAL_STRING("", plan->problems[0].text);
    follower->assembly.config = (tl_config){
        .name = "test",
        .step = plan->plan.step,
        .signals = &follower->signal,
        .own_count = 1,
        .signal_count = 1,
        .adjust = plan->adjust,
        .adjust_count = 1,
        .match = plan->match,
        .match_count = 1,
        .measurements = plan->plan.measurements,
        .budget_evaluations = 60,
        .budget_time = plan->plan.step,
    };
}

tl_recorder_settings tl_follower_recording(const tl_follower *follower, const char *path) {
    static const tl_recorder_signal SPEED = {.name = "plant.speed", .unit = "", .type = TL_REAL};
    static const tl_recorder_signal OUTPUT = {.name = "motor.y0", .unit = "", .to = "plant.speed", .type = TL_REAL};
    static const tl_recorder_signal ADJUSTED = {.name = "motor.u0", .unit = "", .type = TL_REAL};
    return (tl_recorder_settings){
        .path = path,
        .verb = "run",
        .name = "test",
        .configuration = "{}",
        .step = follower->assembly.config.step,
        .measurements = follower->assembly.config.measurements,
        .plant = &SPEED,
        .match = &OUTPUT,
        .adjust = &ADJUSTED,
        .plant_count = 1,
        .match_count = 1,
        .adjust_count = 1,
        .component_count = 2,
    };
}

void tl_follower_end(tl_follower *follower) {
    tl_twin_destroy(follower->assembly.twin);
    follower->assembly.twin = NULL;
    tl_test_fmu_end(&follower->fmu);
    TEST_ASSERT_EQUAL_STRING("", follower->log.first_violation);
}
