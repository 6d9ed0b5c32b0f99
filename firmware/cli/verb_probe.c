/* twinlock probe: asks the plant for each signal, before there is a twin. */
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <unistd.h>

#include "firmware/base/json.h"
#include "firmware/base/log.h"
#include "firmware/base/output.h"
#include "firmware/base/text.h"
#include "firmware/cli/options.h"
#include "firmware/cli/probe_cures.h"
#include "firmware/cli/roles.h"
#include "firmware/config/drivers.h"
#include "firmware/config/probe_modbus.h"
#include "firmware/live/plant_probe.h"
#include "firmware/process/interrupt.h"
#include "firmware/retune/control_client.h"
#include "firmware/store/database.h"

static const double DURATION_S = 5;

/* Equal readings in a row from which a signal is remarked as unchanged. */
enum { FROZEN_LEAST = 5 };

/* Bytes of texts. */
enum { REGISTERS = 48, VERDICT = TL_CONFIG_DESCRIPTION + 2 * TL_EVENT_TEXT };

typedef struct probe_job {
    const tl_options *options;
    FILE *output;
    tl_config config;
    tl_plant_probe found;
    tl_probe_modbus modbus;
    char cures[TL_MAX_SIGNALS][TL_PROBE_CURE];
} probe_job;

/* ---- a run of the same configuration ---- */

/* Returns true if a recorder has the lock of this database (database_file.h). The lock is only
 * tried: this process writes nothing. */
static bool is_recorded_into(const char *database) {
    char path[PATH_MAX];
    char lock[PATH_MAX + sizeof "-writer"];
    if (tl_database_resolve(database, path, NULL) != TL_OK) {
        return false;
    }
    (void)snprintf(lock, sizeof lock, "%s-writer", path);
    int file = open(lock, O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
    if (file < 0) {
        return false;
    }
    const bool is_held = flock(file, LOCK_SH | LOCK_NB) != 0 && errno == EWOULDBLOCK;
    (void)close(file);
    return is_held;
}

/* Two processes would take rows of a FIFO from each other, and a serial line has one master. A run
 * shows itself by its control socket, or by the lock of the configured database. */
static tl_status check_not_running(const probe_job *job, tl_error *error) {
    const char *subject = job->options->subject;
    char path[PATH_MAX];
    int socket = -1;
    bool runs = tl_control_client_find(subject, NULL, path, error) == TL_OK &&
                tl_control_connect(path, &socket, error) != TL_PLANT_DOWN;
    if (socket >= 0) {
        (void)close(socket);
    }
    if (!runs && job->config.record_file != NULL) {
        runs = tl_config_file_path(&job->config, job->config.record_file, path, sizeof path) && is_recorded_into(path);
    }
    return runs
               ? tl_fail(error, TL_TRY_AGAIN,
                         "%s is running and reads the plant: see its page or `twinlock show`, or end it first", subject)
               : TL_OK;
}

/* ---- verdicts ---- */

static bool is_good(const tl_plant_probe_signal *signal) {
    return signal->last.quality == TL_GOOD;
}

static bool are_all_good(const probe_job *job) {
    bool good = true;
    for (size_t i = 0; i < job->config.own_count; i++) {
        good = good && is_good(&job->found.signals[i]);
    }
    return good;
}

static bool has_value(const tl_plant_probe_signal *signal) {
    return signal->readings > 0 && signal->last.quality != TL_NO_LINK && signal->last.quality != TL_NOT_A_NUMBER;
}

static bool is_unchanged(const tl_plant_probe_signal *signal) {
    return signal->readings >= FROZEN_LEAST && !signal->has_changed;
}

static double rate_of(const probe_job *job, const tl_plant_probe_signal *signal) {
    return job->found.lasted > 0 ? (double)signal->readings / tl_seconds(job->found.lasted) : 0;
}

/* Writes that a Modbus device delivers less than half of the readings that its polls should
 * bring; "" if it delivers more. */
static void describe_slowness(const probe_job *job, size_t index, char *text, size_t size) {
    const tl_config_signal *configured = &job->config.signals[index];
    double period = job->config.sources[configured->source].period_s;
    double expected = 1 / fmax(period, tl_seconds(configured->every));
    double rate = rate_of(job, &job->found.signals[index]);
    text[0] = '\0';
    if (tl_probe_modbus_has_source(&job->config, configured->source) && 2 * rate < expected) {
        (void)snprintf(text, size, "; %.3g readings/s instead of %.3g: the device is slow: raise period_s, now %g s",
                       rate, expected, period);
    }
}

static void describe_verdict(const probe_job *job, size_t index, char text[VERDICT]) {
    const tl_plant_probe_signal *signal = &job->found.signals[index];
    const tl_quality quality = signal->last.quality;
    char what[TL_CONFIG_DESCRIPTION];
    if (is_good(signal)) {
        describe_slowness(job, index, what, sizeof what);
        (void)snprintf(text, VERDICT, "ok%s%s%s%s", is_unchanged(signal) ? ", never changed" : "", what,
                       signal->cause[0] != '\0' ? "; " : "", signal->cause);
    } else if (quality == TL_NO_LINK && signal->cause[0] != '\0') {
        (void)snprintf(text, VERDICT, "no value: %s%s%s", signal->cause, signal->later[0] != '\0' ? "; then: " : "",
                       signal->later);
    } else {
        tl_config_describe_quality(&job->config, index, signal->last.value, quality, signal->age, what);
        (void)snprintf(text, VERDICT, "%s: %s", what, tl_config_quality_remedy(&job->config, index, quality));
    }
}

/* ---- output ---- */

/* Writes "0..1: 427B EC8B"; "" if the registers of a signal are not known. */
static void describe_registers(const probe_job *job, size_t index, char text[REGISTERS]) {
    const tl_modbus_channel *channel = &job->modbus.channels[index];
    text[0] = '\0';
    const double raw = (job->found.signals[index].last.value - channel->offset) / channel->scale;
    const bool is_wide = channel->type == TL_MODBUS_INT64 || channel->type == TL_MODBUS_UINT64;
    const bool is_exact = !is_wide || fabs(raw) <= 9007199254740992.0; /* 2^53: a double has 53 bits */
    if (!job->modbus.has_registers[index] || channel->type == TL_MODBUS_BIT || !is_exact ||
        job->found.signals[index].last.quality == TL_NO_LINK) {
        return;
    }
    const size_t count = tl_modbus_registers(channel->type);
    size_t used =
        (size_t)snprintf(text, REGISTERS, "%u..%zu:", (unsigned)channel->address, channel->address + count - 1);
    for (size_t i = 0; i < count; i++) {
        used += (size_t)snprintf(text + used, REGISTERS - used, " %04X", (unsigned)job->modbus.registers[index][i]);
    }
}

static void add_row(const probe_job *job, size_t index, tl_show_table *table) {
    const tl_plant_probe_signal *signal = &job->found.signals[index];
    const tl_config_signal *configured = &job->config.signals[index];
    char value[32] = "-";
    char age[32] = "-";
    char registers[REGISTERS];
    char verdict[VERDICT];
    if (has_value(signal)) {
        tl_show_number(signal->last.value, false, value, sizeof value);
        (void)snprintf(age, sizeof age, "%.3f", tl_seconds(signal->age));
    }
    describe_registers(job, index, registers);
    describe_verdict(job, index, verdict);
    tl_show_table_add(table, "%s", configured->plan.name);
    tl_show_table_add(table, "%s", value);
    tl_show_table_add(table, "%s", configured->plan.unit != NULL ? tl_show_unit(configured->plan.unit) : "");
    tl_show_table_add(table, "%.4g", rate_of(job, signal));
    tl_show_table_add(table, "%s", age);
    tl_show_table_add(table, "%s", registers);
    tl_show_table_add(table, "%s", verdict);
}

static tl_status print_table(const probe_job *job, tl_error *error) {
    static const char *const header[] = {"signal", "value", "unit", "new 1/s", "age s", "registers", "verdict"};
    const tl_config *config = &job->config;
    tl_show_table table;
    (void)fprintf(job->output, "%s: %s, read for %.1f s\n", config->path, config->name, tl_seconds(job->found.lasted));
    tl_show_table_begin(&table, tl_show_style_of(job->output), "lrlrrll");
    for (size_t i = 0; i < sizeof header / sizeof header[0]; i++) {
        tl_show_table_add(&table, "%s", header[i]);
    }
    for (size_t i = 0; i < config->own_count; i++) {
        add_row(job, i, &table);
    }
    tl_status status = tl_show_table_end(&table, job->output, error);
    for (size_t i = 0; i < config->own_count && status == TL_OK; i++) {
        if (job->cures[i][0] != '\0') {
            (void)fprintf(job->output, "plant.%s.modbus: %s\n", config->signals[i].plan.name, job->cures[i]);
        }
    }
    return status;
}

static void add_signal(const probe_job *job, size_t index, tl_json_writer *json) {
    const tl_plant_probe_signal *signal = &job->found.signals[index];
    const tl_config_signal *configured = &job->config.signals[index];
    char registers[REGISTERS];
    char verdict[VERDICT];
    describe_registers(job, index, registers);
    describe_verdict(job, index, verdict);
    tl_json_open_object(json, configured->plan.name);
    tl_json_add_text(json, "source", job->config.sources[configured->source].name);
    tl_json_add_number(json, "value", has_value(signal) ? signal->last.value : (double)NAN);
    tl_json_add_text(json, "unit", configured->plan.unit);
    tl_json_add_count(json, "readings", signal->readings);
    tl_json_add_number(json, "readings_per_s", rate_of(job, signal));
    tl_json_add_number(json, "age_s", has_value(signal) ? tl_seconds(signal->age) : (double)NAN);
    tl_json_add_count(json, "rejected", signal->rejected);
    tl_json_add_truth(json, "unchanged", is_unchanged(signal));
    tl_json_add_text(json, "quality", tl_quality_name(signal->last.quality));
    tl_json_add_text(json, "verdict", verdict);
    tl_json_add_text(json, "registers", registers[0] != '\0' ? registers : NULL);
    tl_json_add_text(json, "cure", job->cures[index][0] != '\0' ? job->cures[index] : NULL);
    tl_json_close(json);
}

static tl_status print_json(const probe_job *job, tl_error *error) {
    const tl_config *config = &job->config;
    tl_json_writer json;
    tl_json_writer_begin(&json);
    tl_json_add_text(&json, "name", config->name);
    tl_json_add_text(&json, "configuration", config->hash);
    tl_json_add_number(&json, "duration_s", tl_seconds(job->found.lasted));
    tl_json_add_truth(&json, "good", are_all_good(job));
    tl_json_open_object(&json, "signals");
    for (size_t i = 0; i < config->own_count; i++) {
        add_signal(job, i, &json);
    }
    tl_status status = tl_json_writer_print(&json, job->output, error);
    tl_json_writer_free(&json);
    return status;
}

/* ---- the verb ---- */

static int run_role(const char *title, void *context) {
    (void)context;
    return tl_roles_run(title);
}

static tl_status read_config(probe_job *job) {
    tl_problems problems;
    tl_problems_init(&problems, job->options->subject);
    tl_status status = tl_config_read(job->options->subject, &job->config, &problems.report);
    if (status == TL_OK) {
        tl_config_use_lookups(&job->config);
    } else if (problems.report.count > 1) {
        tl_log(TL_LOG_ERROR, "%zu problems", problems.report.count);
    }
    return status;
}

static tl_status probe_plant(probe_job *job, tl_error *error) {
    const double duration_s = job->options->duration_s > 0 ? job->options->duration_s : DURATION_S;
    tl_probe_modbus_begin(&job->modbus, &job->config);
    char *text = tl_probe_modbus_text(&job->modbus);
    const tl_plant_probe_settings settings = {
        .config = &job->config,
        .text = text,
        .duration = tl_time_of_seconds(duration_s),
        .run_role = run_role,
        .convert = tl_probe_modbus_convert,
        .concerns = tl_probe_modbus_concerns,
        .context = &job->modbus,
    };
    tl_status status = text != NULL ? check_not_running(job, error)
                                    : tl_fail(error, TL_TRY_AGAIN, "not enough memory for the configuration");
    status = status == TL_OK ? tl_plant_probe_run(&settings, &job->found, error) : status;
    free(text);
    if (status == TL_OK && tl_interrupt_requested() == NULL &&
        tl_probe_cures_find(&job->found, &job->modbus, run_role, job->cures, error) != TL_OK) {
        tl_log(TL_LOG_WARNING, "not all other mappings were tried: %s", error->text); /* the probe is valid */
    }
    if (status == TL_OK) {
        status = job->options->json ? print_json(job, error) : print_table(job, error);
    }
    return status;
}

int tl_verb_probe(const tl_options *options) {
    static probe_job job; /* static, because it is too large for the stack */
    tl_error error;
    job = (probe_job){.options = options, .output = tl_output_claim()};
    tl_interrupt_install();
    tl_status status = read_config(&job);
    if (status == TL_OK) {
        status = probe_plant(&job, &error);
        if (status != TL_OK) {
            tl_log(TL_LOG_ERROR, "%s", error.text);
        } else if (!are_all_good(&job)) {
            status = TL_BAD_DATA;
        }
    }
    tl_config_free(&job.config);
    return tl_exit_code(tl_output_finish(job.output, status));
}
