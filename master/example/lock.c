/* Estimates the brake torque that acts on a motor, by a twin of the motor that is locked to its
 * speed.
 *
 * The plant is a second instance of the same FMU with a known brake. So the true torque is printed
 * beside the estimate.
 * Usage: lock MOTOR.SO, the library binaries/PLATFORM/motor.so of the unpacked motor.fmu.
 */
#include <dlfcn.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "master/twin/twin.h"

/* Prints a problem and ends the program. */
static void stop(void *context, tl_status status, const char *where, const char *text) {
    (void)context;
    (void)fprintf(stderr, "%s: %s\n", where, text);
    exit(tl_exit_code(status));
}

/* ---- The loader: what the master calls of an FMU that exchanges only Reals ---- */

static const struct {
    const char *name;
    size_t offset;
} FUNCTIONS[] = {
    {"fmi2Instantiate", offsetof(tl_fmi2, instantiate)},
    {"fmi2SetupExperiment", offsetof(tl_fmi2, setup_experiment)},
    {"fmi2EnterInitializationMode", offsetof(tl_fmi2, enter_initialization_mode)},
    {"fmi2ExitInitializationMode", offsetof(tl_fmi2, exit_initialization_mode)},
    {"fmi2SetReal", offsetof(tl_fmi2, set_real)},
    {"fmi2DoStep", offsetof(tl_fmi2, do_step)},
    {"fmi2GetReal", offsetof(tl_fmi2, get_real)},
    {"fmi2GetFMUstate", offsetof(tl_fmi2, get_fmu_state)},
    {"fmi2SetFMUstate", offsetof(tl_fmi2, set_fmu_state)},
    {"fmi2FreeFMUstate", offsetof(tl_fmi2, free_fmu_state)},
    {"fmi2Terminate", offsetof(tl_fmi2, terminate)},
    {"fmi2FreeInstance", offsetof(tl_fmi2, free_instance)},
};

static void load(const char *path, tl_fmi2 *functions) {
    void *library = dlopen(path, RTLD_NOW);
    for (size_t i = 0; i < sizeof FUNCTIONS / sizeof FUNCTIONS[0]; i++) {
        void *function = library != NULL ? dlsym(library, FUNCTIONS[i].name) : NULL;
        if (function == NULL) {
            stop(NULL, TL_BAD_DATA, path, dlerror());
        }
        memcpy((char *)functions + FUNCTIONS[i].offset, &function, sizeof function);
    }
}

static void log_message(fmi2ComponentEnvironment environment, fmi2String instance, fmi2Status status,
                        fmi2String category, fmi2String message, ...) {
    (void)environment;
    (void)fprintf(stderr, "%s: status %d, %s: %s\n", instance, (int)status, category, message);
}

/* ---- From modelDescription.xml: the GUID, and the variables that are used ---- */

static const tl_variable VARIABLES[] = {
    {.name = "M_w",
     .reference = 1,
     .causality = TL_INPUT,
     .has_start = true,
     .minimum = -HUGE_VAL,
     .maximum = HUGE_VAL},
    {.name = "omega", .reference = 2, .causality = TL_OUTPUT},
};
static const tl_model MODEL = {
    .guid = "{b1fcced7-195f-44c1-9c5f-c9c53c3e67ad}", .variables = VARIABLES, .variable_count = 2};

/* ---- The lock ---- */

static const tl_time STEP = TL_SECOND / 100;

/* N.m, in macro step i: none for 2 s, then a jump and a slow decay. */
static double true_brake(int64_t i) {
    return i < 200 ? 0.0 : 0.12 - 1e-4 * (double)i;
}

/* Gives a twin the only value of its sample. True: a step is committed, `record` is complete. */
static bool tick(tl_twin *twin, int64_t number, double value, tl_record *record) {
    const tl_sample sample = {.tick = number, .instant = number * STEP, .values = {value}, .stamps = {number * STEP}};
    const tl_budget budget = tl_budget_defaults(STEP);
    tl_error error;
    bool ready;
    if (tl_twin_step(twin, &sample, &budget, record, &ready, &error) != TL_OK) {
        stop(NULL, error.status, "step", error.text);
    }
    return ready;
}

int main(int argc, char **argv) {
    static const fmi2CallbackFunctions callbacks = {log_message, calloc, free, NULL, NULL};
    tl_fmi2 functions = {0};
    load(argc == 2 ? argv[1] : "MOTOR.SO", &functions);
    tl_report report = {.add = stop};
    const tl_plan_component motor = {
        .name = "motor", .model = &MODEL, .functions = &functions, .callbacks = &callbacks};

    /* The plant: the brake feeds an input, nothing is adjusted, the speed is read. */
    const tl_plan_signal brake = {.name = "brake"};
    const tl_plan_connection connection = {.from = "plant.brake", .to = "motor.M_w"};
    const tl_plan_output output = {.variable = "motor.omega"};
    tl_plan plan = tl_plan_defaults(STEP);
    plan.components = &motor, plan.component_count = 1;
    plan.signals = &brake, plan.signal_count = 1;
    plan.connections = &connection, plan.connection_count = 1;
    plan.outputs = &output, plan.output_count = 1;
    tl_twin *plant = tl_twin_build(&plan, &report);

    /* The twin adjusts the torque, first by 0.01 N.m, until its speed is within 0.001 rad/s of that
     * of the plant. */
    const tl_plan_signal speed = {.name = "speed"};
    const tl_plan_adjust adjust = tl_plan_adjust_defaults("motor.M_w", 0.01);
    const tl_plan_match match = tl_plan_match_defaults("motor.omega", "plant.speed", 0.001);
    plan = tl_plan_defaults(STEP);
    plan.components = &motor, plan.component_count = 1;
    plan.signals = &speed, plan.signal_count = 1;
    plan.adjust = &adjust, plan.adjust_count = 1;
    plan.match = &match, plan.match_count = 1;
    tl_twin *twin = tl_twin_build(&plan, &report);

    double largest = 0.0;
    (void)printf("  t [s]  true [N.m]  estimated [N.m]\n");
    for (int64_t i = 0; i <= 1000; i++) {
        tl_record record;
        (void)tick(plant, i, true_brake(i), &record);
        if (tick(twin, i, tl_twin_output(plant, 0), &record)) {
            double truth = true_brake(record.step);
            largest = fmax(largest, fabs(record.u[0] - truth));
            if (i % 100 == 0) {
                (void)printf("%7.2f  %10.5f  %15.5f\n", tl_seconds(i * STEP), truth, record.u[0]);
            }
        }
    }
    (void)printf("largest error of 1000 steps: %.5f N.m\n", largest);
    tl_twin_destroy(twin);
    tl_twin_destroy(plant);
    return EXIT_SUCCESS;
}
