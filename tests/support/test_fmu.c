/* FMUs inside the test process: see test_fmu.h. */
#include "tests/support/test_fmu.h"

#include <assert.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tests/support/random_numbers.h"

static const char GUID[] = "{8c4e810f-3df3-4a00-8276-176fa3c9f001}";

/* ---- variables ---- */

/* Value references, one series per base type. */
enum { REAL_U = 0, REAL_Y = 4, REAL_SUM = 8, REAL_GAIN, REAL_OFFSET, REAL_LAG, REAL_START, REALS };
enum { INTEGER_COUNT, INTEGER_COUNT_OUT, INTEGER_MODE, INTEGER_MODE_OUT, INTEGERS };
enum { BOOLEAN_FLAG, BOOLEAN_FLAG_OUT, BOOLEANS };
enum { STRING_LABEL, STRING_LABEL_OUT, STRINGS };
enum { LABEL_SIZE = 32 };

/* Largest value that an FMU with `telling` adds to its first channel. */
static const double TELLING = 1e-4;

/* An FMU with `ends` sets `flag_out` if y[0] is at least this. */
#define END_POSITION 0.5

/* Added to its drives while `flag` is true. */
static const double RAISED = 0.25;

static tl_variable *add(tl_test_fmu *fmu, const char *name, tl_type type, uint32_t reference, tl_causality causality) {
    tl_variable *variable = &fmu->variables[fmu->model.variable_count++];
    assert(fmu->model.variable_count <= TL_TEST_VARIABLES);
    *variable = (tl_variable){.name = name,
                              .description = "",
                              .reference = reference,
                              .type = type,
                              .causality = causality,
                              .variability = type == TL_REAL ? TL_CONTINUOUS : TL_DISCRETE,
                              .minimum = -HUGE_VAL,
                              .maximum = HUGE_VAL,
                              .nominal = 1.0,
                              .initial = TL_INITIAL_CALCULATED};
    variable->start.type = type;
    variable->start.text = "";
    if (causality != TL_OUTPUT) {
        variable->has_start = true;
        variable->initial = causality == TL_INPUT ? TL_INITIAL_NONE : TL_INITIAL_EXACT;
    }
    return variable;
}

static void add_parameter(tl_test_fmu *fmu, const char *name, uint32_t reference, tl_variability variability,
                          double start) {
    tl_variable *variable = add(fmu, name, TL_REAL, reference, TL_PARAMETER);
    variable->variability = variability;
    variable->start.real = start;
}

static void add_reals(tl_test_fmu *fmu, size_t width) {
    static const char *const inputs[TL_TEST_WIDTH] = {"u0", "u1", "u2", "u3"};
    static const char *const outputs[TL_TEST_WIDTH] = {"y0", "y1", "y2", "y3"};
    for (size_t c = 0; c < width; c++) {
        (void)add(fmu, inputs[c], TL_REAL, REAL_U + (uint32_t)c, TL_INPUT);
        (void)add(fmu, outputs[c], TL_REAL, REAL_Y + (uint32_t)c, TL_OUTPUT);
    }
    (void)add(fmu, "sum", TL_REAL, REAL_SUM, TL_OUTPUT);
    add_parameter(fmu, "gain", REAL_GAIN, TL_TUNABLE, 1.0);
    add_parameter(fmu, "offset", REAL_OFFSET, TL_TUNABLE, 0.0);
    add_parameter(fmu, "lag", REAL_LAG, TL_FIXED, 0.0);
    add_parameter(fmu, "start", REAL_START, TL_FIXED, 0.0);
}

static void add_discretes(tl_test_fmu *fmu) {
    (void)add(fmu, "count", TL_INTEGER, INTEGER_COUNT, TL_INPUT);
    (void)add(fmu, "count_out", TL_INTEGER, INTEGER_COUNT_OUT, TL_OUTPUT);
    (void)add(fmu, "mode", TL_ENUMERATION, INTEGER_MODE, TL_INPUT);
    (void)add(fmu, "mode_out", TL_ENUMERATION, INTEGER_MODE_OUT, TL_OUTPUT);
    (void)add(fmu, "flag", TL_BOOLEAN, BOOLEAN_FLAG, TL_INPUT);
    (void)add(fmu, "flag_out", TL_BOOLEAN, BOOLEAN_FLAG_OUT, TL_OUTPUT);
    add(fmu, "label", TL_STRING, STRING_LABEL, TL_PARAMETER)->variability = TL_FIXED;
    (void)add(fmu, "label_out", TL_STRING, STRING_LABEL_OUT, TL_OUTPUT);
}

/* ---- instances ---- */

/* States of the calling sequence, as bits, because a call may be legal in several. */
enum {
    INSTANTIATED = 1,
    INITIALIZING = 2,
    STEPPING = 4,
    STEP_FAILED = 8, /* fmi2DoStep was discarded */
    ERROR = 16,
    TERMINATED = 32
};

/* State that fmi2GetFMUstate saves. */
typedef struct values {
    double reals[REALS];
    fmi2Integer integers[INTEGERS];
    fmi2Boolean booleans[BOOLEANS];
    char label[LABEL_SIZE];
    double time;      /* s, where the last step ended */
    uint64_t lineage; /* hash of all inputs of all steps since the start */
} values;

/* A state handle. */
typedef struct saved {
    struct saved *next;
    const struct tl_test_instance *owner;
    size_t life; /* of the owner */
    values values;
    unsigned char ballast[];
} saved;

typedef struct tl_test_instance {
    struct tl_test_instance *next;
    saved *states;
    tl_test_fmu *fmu;
    size_t number;
    size_t life; /* resets so far */
    unsigned mode;
    values now;
    bool is_set_up;     /* fmi2SetupExperiment was called */
    bool set_unstepped; /* something was set since the last step */
    double final_time;  /* s, no state before this may be restored */
    /* One bit per value reference: inputs and tunables that were set, and those not set again since
     * a restore. */
    unsigned used_reals, used_integers, used_booleans;
    unsigned stale_reals, stale_integers, stale_booleans;
} instance;

static void violate(const instance *self, tl_test_call call, const char *what) {
    tl_test_log *log = self->fmu->log;
    if (log->violations++ == 0) {
        (void)snprintf(log->first_violation, sizeof log->first_violation, "call %u: %s of instance %u: %s",
                       (unsigned)log->count, tl_test_call_name(call), (unsigned)self->number, what);
    }
}

static void record(const instance *self, tl_test_call call, const tl_test_entry *details, fmi2Status status) {
    tl_test_log *log = self->fmu->log;
    if (log->count < TL_TEST_ENTRIES) {
        tl_test_entry *entry = &log->entries[log->count];
        *entry = *details;
        entry->fmu = self->fmu;
        entry->instance = self->number;
        entry->call = call;
        entry->status = status;
    }
    log->count++;
}

/* True if a step with these values fails because a drive is above the limit. */
static bool is_above(const instance *self) {
    for (size_t c = 0; c < self->fmu->width; c++) {
        const double *reals = self->now.reals;
        if (reals[REAL_GAIN] * reals[REAL_U + c] + reals[REAL_OFFSET] > self->fmu->control.fault.above) {
            return true;
        }
    }
    return false;
}

/* True if the call that was counted last must fail. */
static bool is_faulty(const instance *self, tl_test_call call) {
    const tl_test_fault *fault = &self->fmu->control.fault;
    uint64_t number = self->fmu->calls[call];
    return fault->call == call &&
           ((number >= fault->first && number <= fault->last) || (call == TL_TEST_DO_STEP && is_above(self)));
}

/* The status that this call must return. */
static fmi2Status injected(instance *self, tl_test_call call) {
    tl_test_fmu *fmu = self->fmu;
    const tl_test_fault *fault = &fmu->control.fault;
    if (!is_faulty(self, call) || fault->kind == TL_TEST_NAN) {
        return fmi2OK;
    }
    if (fault->kind == TL_TEST_FATAL) {
        fmu->dead = true;
        return fmi2Fatal;
    }
    if (fault->kind == TL_TEST_ERROR) {
        self->mode = ERROR;
        return fmi2Error;
    }
    self->mode = call == TL_TEST_DO_STEP ? STEP_FAILED : self->mode;
    return fmi2Discard;
}

/* Starts a call: checks and counts it. Returns fmi2OK if it may continue. */
static fmi2Status begin(instance *self, tl_test_call call, unsigned modes) {
    self->fmu->calls[call]++;
    if (self->fmu->dead) {
        violate(self, call, "after fmi2Fatal");
        return fmi2Fatal;
    }
    if ((self->mode & modes) == 0) {
        violate(self, call, "not in this state");
        return fmi2Error;
    }
    return injected(self, call);
}

/* Checks, counts and records a call without arguments. */
static fmi2Status plain(instance *self, tl_test_call call, unsigned modes) {
    const tl_test_entry none = {0};
    fmi2Status status = begin(self, call, modes);
    record(self, call, &none, status);
    return status;
}

static void start_values(values *now, const tl_model *model) {
    for (size_t i = 0; i < model->variable_count; i++) {
        const tl_variable *variable = &model->variables[i];
        switch (variable->type) {
        case TL_REAL:
            now->reals[variable->reference] = variable->start.real;
            break;
        case TL_INTEGER:
        case TL_ENUMERATION:
            now->integers[variable->reference] = variable->start.integer;
            break;
        case TL_BOOLEAN:
            now->booleans[variable->reference] = variable->start.integer;
            break;
        case TL_STRING:
            break;
        }
    }
}

static void begin_life(instance *self) {
    self->mode = INSTANTIATED;
    self->final_time = -HUGE_VAL;
    start_values(&self->now, &self->fmu->model);
}

static fmi2Component instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                 const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging) {
    (void)name;
    (void)resources;
    (void)visible;
    (void)logging;
    tl_test_fmu *fmu = callbacks->componentEnvironment;
    instance *self = calloc(1, sizeof *self);
    assert(self != NULL);
    self->fmu = fmu;
    self->number = fmu->instances++;
    begin_life(self);
    fmi2Status status = plain(self, TL_TEST_INSTANTIATE, INSTANTIATED);
    if (status != fmi2OK || type != fmi2CoSimulation || strcmp(guid, GUID) != 0) {
        free(self);
        return NULL;
    }
    fmu->living++;
    self->next = fmu->alive;
    fmu->alive = self;
    return self;
}

/* Removes an instance from the list of its FMU. */
static void unlink_instance(instance *self) {
    instance **link = &self->fmu->alive;
    while (*link != self) {
        link = &(*link)->next;
    }
    *link = self->next;
}

static void release(instance *self) {
    while (self->states != NULL) {
        saved *next = self->states->next;
        free(self->states);
        self->states = next;
    }
    free(self);
}

static void free_instance(fmi2Component component) {
    instance *self = component;
    tl_test_fmu *fmu = self->fmu;
    (void)plain(self, TL_TEST_FREE_INSTANCE, INSTANTIATED | INITIALIZING | STEPPING | STEP_FAILED | ERROR | TERMINATED);
    fmu->living--;
    if (self->states != NULL) {
        violate(self, TL_TEST_FREE_INSTANCE, "states were not freed before");
    }
    unlink_instance(self);
    release(self);
}

static fmi2Status setup_experiment(fmi2Component component, fmi2Boolean tolerance_defined, fmi2Real tolerance,
                                   fmi2Real start, fmi2Boolean stop_defined, fmi2Real stop) {
    (void)tolerance_defined;
    (void)tolerance;
    (void)stop;
    instance *self = component;
    const tl_test_entry details = {.time = start, .final = stop_defined != fmi2False};
    fmi2Status status = begin(self, TL_TEST_SETUP_EXPERIMENT, INSTANTIATED);
    record(self, TL_TEST_SETUP_EXPERIMENT, &details, status);
    self->now.time = start;
    self->is_set_up = true;
    return status;
}

static void feed_through(instance *self) {
    double *reals = self->now.reals;
    reals[REAL_SUM] = 0.0;
    for (size_t c = 0; c < self->fmu->width; c++) {
        bool follows = self->fmu->control.feed_through;
        double drive = reals[REAL_GAIN] * reals[REAL_U + c] + reals[REAL_OFFSET];
        reals[REAL_Y + c] = follows ? drive : reals[REAL_START];
        reals[REAL_SUM] += reals[REAL_Y + c];
    }
}

static fmi2Status enter_initialization_mode(fmi2Component component) {
    instance *self = component;
    fmi2Status status = plain(self, TL_TEST_ENTER_INITIALIZATION, INSTANTIATED);
    if (!self->is_set_up) {
        violate(self, TL_TEST_ENTER_INITIALIZATION, "without fmi2SetupExperiment");
    }
    if (status == fmi2OK) {
        self->mode = INITIALIZING;
        feed_through(self);
    }
    return status;
}

static fmi2Status exit_initialization_mode(fmi2Component component) {
    instance *self = component;
    fmi2Status status = plain(self, TL_TEST_EXIT_INITIALIZATION, INITIALIZING);
    if (status == fmi2OK) {
        self->mode = STEPPING;
    }
    return status;
}

static fmi2Status terminate(fmi2Component component) {
    instance *self = component;
    fmi2Status status = plain(self, TL_TEST_TERMINATE, STEPPING | STEP_FAILED);
    if (status == fmi2OK) {
        self->mode = TERMINATED;
    }
    return status;
}

/* Resets an instance to its state after instantiation. Its state handles stay valid. */
static fmi2Status reset(fmi2Component component) {
    instance *self = component;
    fmi2Status status =
        plain(self, TL_TEST_RESET, INSTANTIATED | INITIALIZING | STEPPING | STEP_FAILED | ERROR | TERMINATED);
    if (status != fmi2OK) {
        return status;
    }
    *self = (instance){
        .next = self->next, .states = self->states, .fmu = self->fmu, .number = self->number, .life = self->life + 1};
    begin_life(self);
    return fmi2OK;
}

/* ---- values ---- */

enum { SETTABLE = INSTANTIATED | INITIALIZING | STEPPING, GETTABLE = INITIALIZING | STEPPING | ERROR | TERMINATED };

static const tl_variable *variable_of(const instance *self, tl_type type, uint32_t reference) {
    for (size_t i = 0; i < self->fmu->model.variable_count; i++) {
        const tl_variable *variable = &self->fmu->variables[i];
        tl_type base = variable->type == TL_ENUMERATION ? TL_INTEGER : variable->type;
        if (base == type && variable->reference == reference) {
            return variable;
        }
    }
    return NULL;
}

/* True if FMI permits to set the variable in the current state. */
static bool is_settable(const instance *self, const tl_variable *variable) {
    if (variable->causality == TL_INPUT) {
        return true;
    }
    if (self->mode == STEPPING) {
        return variable->causality == TL_PARAMETER && variable->variability == TL_TUNABLE;
    }
    return variable->initial == TL_INITIAL_EXACT && variable->variability != TL_CONSTANT;
}

/* Checks and records fmi2Set…, and marks the variables as set. */
static fmi2Status begin_set(instance *self, tl_test_call call, tl_type type, const fmi2ValueReference references[],
                            size_t count, unsigned *used, unsigned *stale) {
    unsigned mode = self->mode;
    fmi2Status status = plain(self, call, SETTABLE);
    for (size_t i = 0; i < count && status == fmi2OK; i++) {
        const tl_variable *variable = variable_of(self, type, references[i]);
        if (variable == NULL || !is_settable(self, variable)) {
            violate(self, call, variable == NULL ? "no such value reference" : variable->name);
            return fmi2Error;
        }
        if (mode != INSTANTIATED) {
            *used |= 1U << references[i];
        }
        *stale &= ~(1U << references[i]);
    }
    self->set_unstepped = self->set_unstepped || mode == STEPPING;
    return status;
}

/* Checks and records fmi2Get…. */
static fmi2Status begin_get(instance *self, tl_test_call call, tl_type type, const fmi2ValueReference references[],
                            size_t count) {
    fmi2Status status = plain(self, call, GETTABLE);
    if (self->mode == STEPPING && self->set_unstepped) {
        violate(self, call, "after Set without a step between");
    }
    for (size_t i = 0; i < count; i++) {
        if (variable_of(self, type, references[i]) == NULL) {
            violate(self, call, "no such value reference");
            return fmi2Error;
        }
    }
    return status;
}

static fmi2Status set_real(fmi2Component component, const fmi2ValueReference references[], size_t count,
                           const fmi2Real value[]) {
    instance *self = component;
    fmi2Status status =
        begin_set(self, TL_TEST_SET_REAL, TL_REAL, references, count, &self->used_reals, &self->stale_reals);
    for (size_t i = 0; i < count && status == fmi2OK; i++) {
        if (!isfinite(value[i])) {
            violate(self, TL_TEST_SET_REAL, "a value that is not finite");
        }
        self->now.reals[references[i]] = value[i];
    }
    if (self->mode == INITIALIZING) {
        feed_through(self);
    }
    return status;
}

static fmi2Status set_integer(fmi2Component component, const fmi2ValueReference references[], size_t count,
                              const fmi2Integer value[]) {
    instance *self = component;
    fmi2Status status = begin_set(self, TL_TEST_SET_INTEGER, TL_INTEGER, references, count, &self->used_integers,
                                  &self->stale_integers);
    for (size_t i = 0; i < count && status == fmi2OK; i++) {
        self->now.integers[references[i]] = value[i];
    }
    return status;
}

static fmi2Status set_boolean(fmi2Component component, const fmi2ValueReference references[], size_t count,
                              const fmi2Boolean value[]) {
    instance *self = component;
    fmi2Status status = begin_set(self, TL_TEST_SET_BOOLEAN, TL_BOOLEAN, references, count, &self->used_booleans,
                                  &self->stale_booleans);
    for (size_t i = 0; i < count && status == fmi2OK; i++) {
        if (value[i] != fmi2False && value[i] != fmi2True) {
            violate(self, TL_TEST_SET_BOOLEAN, "neither fmi2False nor fmi2True");
        }
        self->now.booleans[references[i]] = value[i];
    }
    return status;
}

static fmi2Status set_string(fmi2Component component, const fmi2ValueReference references[], size_t count,
                             const fmi2String value[]) {
    instance *self = component;
    unsigned used = 0;
    unsigned stale = 0;
    fmi2Status status = begin_set(self, TL_TEST_SET_STRING, TL_STRING, references, count, &used, &stale);
    for (size_t i = 0; i < count && status == fmi2OK; i++) {
        (void)snprintf(self->now.label, sizeof self->now.label, "%s", value[i]);
    }
    return status;
}

static fmi2Status get_real(fmi2Component component, const fmi2ValueReference references[], size_t count,
                           fmi2Real value[]) {
    instance *self = component;
    fmi2Status status = begin_get(self, TL_TEST_GET_REAL, TL_REAL, references, count);
    for (size_t i = 0; i < count && status == fmi2OK; i++) {
        value[i] = self->now.reals[references[i]];
    }
    return status;
}

static fmi2Status get_integer(fmi2Component component, const fmi2ValueReference references[], size_t count,
                              fmi2Integer value[]) {
    instance *self = component;
    fmi2Status status = begin_get(self, TL_TEST_GET_INTEGER, TL_INTEGER, references, count);
    for (size_t i = 0; i < count && status == fmi2OK; i++) {
        value[i] = self->now.integers[references[i]];
    }
    return status;
}

static fmi2Status get_boolean(fmi2Component component, const fmi2ValueReference references[], size_t count,
                              fmi2Boolean value[]) {
    instance *self = component;
    fmi2Status status = begin_get(self, TL_TEST_GET_BOOLEAN, TL_BOOLEAN, references, count);
    for (size_t i = 0; i < count && status == fmi2OK; i++) {
        bool is_true = self->now.booleans[references[i]] != fmi2False;
        value[i] = !is_true ? fmi2False : self->fmu->control.raw_true ? 7 : fmi2True;
    }
    return status;
}

static fmi2Status get_string(fmi2Component component, const fmi2ValueReference references[], size_t count,
                             fmi2String value[]) {
    instance *self = component;
    fmi2Status status = begin_get(self, TL_TEST_GET_STRING, TL_STRING, references, count);
    for (size_t i = 0; i < count && status == fmi2OK; i++) {
        value[i] = self->now.label;
    }
    return status;
}

/* ---- steps ---- */

/* Checks the arguments of fmi2DoStep. */
static void judge_step(instance *self, double time, double step) {
    if (fabs(time - self->now.time) > 1e-9 * (1.0 + fabs(time))) {
        violate(self, TL_TEST_DO_STEP, "does not continue where the last step ended");
    }
    if (!(step > 0.0)) {
        violate(self, TL_TEST_DO_STEP, "step size is not above 0");
    }
    if ((self->stale_reals | self->stale_integers | self->stale_booleans) != 0) {
        violate(self, TL_TEST_DO_STEP, "inputs were not set again after fmi2SetFMUstate");
    }
}

/* Adds all inputs of a step to the hash `sum`. */
static uint64_t add_inputs(const instance *self, uint64_t sum) {
    const values *now = &self->now;
    sum = tl_test_mix(sum + (uint64_t)(uint32_t)now->integers[INTEGER_COUNT]);
    sum = tl_test_mix(sum + (uint64_t)(uint32_t)now->integers[INTEGER_MODE]);
    sum = tl_test_mix(sum + (now->booleans[BOOLEAN_FLAG] != fmi2False ? 1 : 0));
    for (size_t i = 0; i < REALS; i++) {
        uint64_t bits = 0;
        memcpy(&bits, &now->reals[i], sizeof bits);
        sum = i < REAL_Y || i > REAL_SUM ? tl_test_mix(sum + bits + i) : sum;
    }
    return sum;
}

/* A number in [0, 1) that depends on all bits of a hash. */
static double fraction(uint64_t sum) {
    return (double)(sum >> 11) / 9007199254740992.0;
}

static void pass_on(instance *self) {
    values *now = &self->now;
    bool telling = self->fmu->control.telling;
    now->integers[INTEGER_COUNT_OUT] =
        telling ? (fmi2Integer)(now->lineage & 0x7FFFFFFF) : now->integers[INTEGER_COUNT];
    now->integers[INTEGER_MODE_OUT] = now->integers[INTEGER_MODE];
    bool ended = now->reals[REAL_Y] >= END_POSITION;
    now->booleans[BOOLEAN_FLAG_OUT] = !self->fmu->control.ends ? now->booleans[BOOLEAN_FLAG]
                                      : ended                  ? fmi2True
                                                               : fmi2False;
}

static void advance(instance *self, double step) {
    self->now.lineage = add_inputs(self, self->now.lineage);
    bool telling = self->fmu->control.telling;
    double offset = telling ? TELLING * fraction(self->now.lineage) : 0.0;
    double raised = telling && self->now.booleans[BOOLEAN_FLAG] != fmi2False ? RAISED : 0.0;
    double *reals = self->now.reals;
    bool not_a_number = self->fmu->control.fault.kind == TL_TEST_NAN && is_faulty(self, TL_TEST_DO_STEP);
    reals[REAL_SUM] = 0.0;
    for (size_t c = 0; c < self->fmu->width; c++) {
        double drive = reals[REAL_GAIN] * reals[REAL_U + c] + reals[REAL_OFFSET] + raised;
        double *y = &reals[REAL_Y + c];
        *y += (reals[REAL_LAG] > 0.0 ? step / reals[REAL_LAG] : 1.0) * (drive - *y);
        *y = reals[REAL_LAG] > 0.0 ? *y : drive;
        *y = not_a_number ? (double)NAN : *y;
        *y += offset * (double)(c + 1);
        reals[REAL_SUM] += *y;
    }
    pass_on(self);
}

static fmi2Status do_step(fmi2Component component, fmi2Real time, fmi2Real step, fmi2Boolean final) {
    instance *self = component;
    const tl_test_control *control = &self->fmu->control;
    const double *reals = self->now.reals;
    tl_test_entry details = {.instance = self->number,
                             .time = time,
                             .step = step,
                             .final = final != fmi2False,
                             .gain = reals[REAL_GAIN],
                             .offset = reals[REAL_OFFSET]};
    memcpy(details.u, &reals[REAL_U], sizeof details.u);
    fmi2Status status = begin(self, TL_TEST_DO_STEP, STEPPING);
    judge_step(self, time, step);
    record(self, TL_TEST_DO_STEP, &details, status);
    if (control->clock != NULL) {
        *control->clock += control->cost;
    }
    if (final != fmi2False) {
        self->final_time = time;
    }
    if (status == fmi2OK) {
        advance(self, step);
        self->now.time = time + step;
        self->set_unstepped = false;
    }
    if (control->trace != NULL) {
        details.status = status;
        control->trace(control->context, self->fmu, &details, self->now.lineage);
    }
    return status;
}

/* ---- states ---- */

static saved *new_state(instance *self) {
    saved *handle = calloc(1, sizeof *handle + self->fmu->control.ballast);
    assert(handle != NULL);
    memset(handle->ballast, 1, self->fmu->control.ballast);
    self->fmu->states++;
    handle->owner = self;
    handle->next = self->states;
    self->states = handle;
    return handle;
}

static fmi2Status get_state(fmi2Component component, fmi2FMUstate *state) {
    instance *self = component;
    saved *handle = *state;
    fmi2Status status = begin(self, TL_TEST_GET_STATE, ~0U);
    if (self->fmu->control.clock != NULL) {
        *self->fmu->control.clock += self->fmu->control.save_cost;
    }
    if (status == fmi2OK) {
        if (handle != NULL && handle->owner != self) {
            violate(self, TL_TEST_GET_STATE, "foreign handle");
        }
        handle = handle != NULL ? handle : new_state(self);
        handle->values = self->now;
        handle->life = self->life;
        *state = handle;
    }
    const tl_test_entry details = {.handle = handle};
    record(self, TL_TEST_GET_STATE, &details, status);
    return status;
}

static fmi2Status set_state(fmi2Component component, fmi2FMUstate state) {
    instance *self = component;
    const saved *handle = state;
    const tl_test_entry details = {.handle = handle};
    fmi2Status status = begin(self, TL_TEST_SET_STATE, ~0U);
    record(self, TL_TEST_SET_STATE, &details, status);
    if (status != fmi2OK) {
        return status;
    }
    if (handle == NULL || handle->owner != self) {
        violate(self, TL_TEST_SET_STATE, "foreign handle");
        return fmi2Error;
    }
    if (handle->life != self->life) {
        violate(self, TL_TEST_SET_STATE, "goes back behind a reset");
    }
    if (handle->values.time < self->final_time - 1e-9 * (1.0 + fabs(self->final_time))) {
        violate(self, TL_TEST_SET_STATE, "goes back behind a point that was said to be final");
    }
    if (self->fmu->control.state_lies) {
        self->now.time = handle->values.time;
    } else {
        self->now = handle->values;
    }
    self->mode = STEPPING;
    self->set_unstepped = false;
    self->stale_reals = self->used_reals;
    self->stale_integers = self->used_integers;
    self->stale_booleans = self->used_booleans;
    return fmi2OK;
}

static fmi2Status free_state(fmi2Component component, fmi2FMUstate *state) {
    instance *self = component;
    saved *handle = *state;
    const tl_test_entry details = {.handle = handle};
    fmi2Status status = begin(self, TL_TEST_FREE_STATE, ~0U);
    record(self, TL_TEST_FREE_STATE, &details, status);
    if (status != fmi2OK || handle == NULL) {
        return status;
    }
    if (handle->owner != self) {
        violate(self, TL_TEST_FREE_STATE, "foreign handle");
        return fmi2Error;
    }
    saved **link = &self->states;
    while (*link != handle) {
        link = &(*link)->next;
    }
    *link = handle->next;
    free(handle);
    self->fmu->states--;
    *state = NULL;
    return fmi2OK;
}

static fmi2Status serialized_size(fmi2Component component, fmi2FMUstate state, size_t *size) {
    const saved *handle = state;
    const instance *self = component;
    if (handle == NULL || handle->owner != self) {
        violate(self, TL_TEST_SERIALIZED_SIZE, "foreign handle");
    }
    *size = sizeof handle->values;
    return plain(component, TL_TEST_SERIALIZED_SIZE, ~0U);
}

static fmi2Status serialize(fmi2Component component, fmi2FMUstate state, fmi2Byte *bytes, size_t size) {
    const saved *handle = state;
    fmi2Status status = plain(component, TL_TEST_SERIALIZE, ~0U);
    if (size < sizeof handle->values) {
        violate(component, TL_TEST_SERIALIZE, "into fewer bytes than it said");
        return fmi2Error;
    }
    memcpy(bytes, &handle->values, sizeof handle->values);
    return status;
}

static fmi2Status deserialize(fmi2Component component, const fmi2Byte *bytes, size_t size, fmi2FMUstate *state) {
    saved *handle = *state;
    fmi2Status status = plain(component, TL_TEST_DESERIALIZE, ~0U);
    if (status != fmi2OK || size != sizeof handle->values) {
        return status != fmi2OK ? status : fmi2Error;
    }
    handle = handle != NULL ? handle : new_state(component);
    memcpy(&handle->values, bytes, size);
    handle->life = ((instance *)component)->life;
    *state = handle;
    return fmi2OK;
}

/* ---- the FMU ---- */

static const char *get_types_platform(void) {
    return fmi2TypesPlatform;
}

static const char *get_version(void) {
    return "2.0";
}

static void ignore_message(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status,
                           fmi2String category, fmi2String message, ...) {
    (void)environment;
    (void)name;
    (void)status;
    (void)category;
    (void)message;
}

void tl_test_fmu_init(tl_test_fmu *fmu, size_t width, bool discrete, tl_test_log *log) {
    static const tl_fmi2 functions = {
        .get_types_platform = get_types_platform,
        .get_version = get_version,
        .instantiate = instantiate,
        .free_instance = free_instance,
        .setup_experiment = setup_experiment,
        .enter_initialization_mode = enter_initialization_mode,
        .exit_initialization_mode = exit_initialization_mode,
        .terminate = terminate,
        .reset = reset,
        .get_real = get_real,
        .get_integer = get_integer,
        .get_boolean = get_boolean,
        .get_string = get_string,
        .set_real = set_real,
        .set_integer = set_integer,
        .set_boolean = set_boolean,
        .set_string = set_string,
        .get_fmu_state = get_state,
        .set_fmu_state = set_state,
        .free_fmu_state = free_state,
        .serialized_fmu_state_size = serialized_size,
        .serialize_fmu_state = serialize,
        .deserialize_fmu_state = deserialize,
        .do_step = do_step,
    };
    assert(width >= 1 && width <= TL_TEST_WIDTH);
    memset(fmu, 0, sizeof *fmu);
    fmu->functions = functions;
    fmu->callbacks = (fmi2CallbackFunctions){
        .logger = ignore_message, .allocateMemory = calloc, .freeMemory = free, .componentEnvironment = fmu};
    fmu->log = log;
    fmu->width = width;
    fmu->control.fault.above = HUGE_VAL;
    fmu->model = (tl_model){.name = "test", .identifier = "test", .guid = GUID, .generation_tool = ""};
    fmu->model.capabilities.can_get_and_set_state = true;
    fmu->model.variables = fmu->variables;
    add_reals(fmu, width);
    if (discrete) {
        add_discretes(fmu);
    }
}

void tl_test_fmu_end(tl_test_fmu *fmu) {
    while (fmu->alive != NULL) {
        instance *next = fmu->alive->next;
        release(fmu->alive);
        fmu->alive = next;
    }
}

void tl_test_fmu_fail(tl_test_fmu *fmu, tl_test_call call, tl_test_fault_kind kind, uint64_t first, uint64_t last) {
    fmu->control.fault = (tl_test_fault){.kind = kind, .call = call, .first = first, .last = last, .above = HUGE_VAL};
}

void tl_test_fmu_fail_above(tl_test_fmu *fmu, tl_test_fault_kind kind, double above) {
    fmu->control.fault = (tl_test_fault){.kind = kind, .call = TL_TEST_DO_STEP, .above = above};
}

tl_variable *tl_test_fmu_variable(tl_test_fmu *fmu, const char *name) {
    for (size_t i = 0; i < fmu->model.variable_count; i++) {
        if (strcmp(fmu->variables[i].name, name) == 0) {
            return &fmu->variables[i];
        }
    }
    abort();
}

/* ---- the log ---- */

void tl_test_log_clear(tl_test_log *log) {
    log->count = 0;
    log->violations = 0;
    log->first_violation[0] = '\0';
}

static size_t kept(const tl_test_log *log) {
    return log->count < TL_TEST_ENTRIES ? log->count : TL_TEST_ENTRIES;
}

const tl_test_entry *tl_test_log_step(const tl_test_log *log, const tl_test_fmu *fmu, size_t n) {
    for (size_t i = 0; i < kept(log); i++) {
        const tl_test_entry *entry = &log->entries[i];
        if (entry->fmu == fmu && entry->call == TL_TEST_DO_STEP && n-- == 0) {
            return entry;
        }
    }
    return NULL;
}

size_t tl_test_log_count(const tl_test_log *log, const tl_test_fmu *fmu, tl_test_call call) {
    size_t count = 0;
    for (size_t i = 0; i < kept(log); i++) {
        const tl_test_entry *entry = &log->entries[i];
        count += (fmu == NULL || entry->fmu == fmu) && entry->call == call ? 1 : 0;
    }
    return count;
}

const char *tl_test_call_name(tl_test_call call) {
    static const char *const names[TL_TEST_CALLS] = {"fmi2Instantiate",
                                                     "fmi2SetupExperiment",
                                                     "fmi2EnterInitializationMode",
                                                     "fmi2ExitInitializationMode",
                                                     "fmi2SetReal",
                                                     "fmi2SetInteger",
                                                     "fmi2SetBoolean",
                                                     "fmi2SetString",
                                                     "fmi2GetReal",
                                                     "fmi2GetInteger",
                                                     "fmi2GetBoolean",
                                                     "fmi2GetString",
                                                     "fmi2GetFMUstate",
                                                     "fmi2SetFMUstate",
                                                     "fmi2FreeFMUstate",
                                                     "fmi2SerializedFMUstateSize",
                                                     "fmi2SerializeFMUstate",
                                                     "fmi2DeSerializeFMUstate",
                                                     "fmi2DoStep",
                                                     "fmi2Terminate",
                                                     "fmi2Reset",
                                                     "fmi2FreeInstance"};
    return call < TL_TEST_CALLS ? names[call] : "?";
}
