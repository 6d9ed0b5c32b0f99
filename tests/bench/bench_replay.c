/* A replay with the FMUs in this process, for replay.py: its time is that of `twinlock replay`
 * without a separate FMU process.
 *
 * usage: bench_replay CONFIG RECORDING
 *
 * It executes and evaluates the same ticks with the same functions. Prints the number of steps, and the processor time of a
 * tick after the first ones, ns.
 */
#include <inttypes.h>
#include <stdio.h>
#include <time.h>

#include "firmware/base/os.h"
#include "firmware/report/summary.h"
#include "firmware/twin/twin_step.h"
#include "tests/support/read_assembly.h"

enum { FIRST_TICKS = 5 }; /* with the start of the FMUs */

static int64_t processor_time(void) {
    struct timespec time;
    (void)clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
    return (int64_t)time.tv_sec * 1000000000 + time.tv_nsec;
}

static int run(tl_assembly *assembly, const char *path) {
    static tl_account account;
    static tl_lock_monitor lock_monitor;
    static tl_recovery recovery;
    static tl_recording_tick tick;
    static tl_twin_result result;
    const tl_config *config = &assembly->config;
    tl_recording *recording = NULL;
    tl_summary summary = {.wall_s = 0.0};
    tl_error error;
    bool end = false;
    int64_t begun = 0;
    int64_t ticks = 0;
    tl_account_take(assembly->twin, &account);
    tl_lock_monitor_init(&lock_monitor, config, &account);
    tl_recovery_init(&recovery, config, &account);
    tl_status status = tl_recording_open(path, config, &recording, &error);
    while (status == TL_OK && !end) {
        status = tl_recording_next(recording, &tick, &end, &error);
        if (status != TL_OK || end) {
            break;
        }
        begun = ++ticks == FIRST_TICKS ? processor_time() : begun;
        status = tl_twin_execute(assembly, &tick, TL_ATTACHED_NONE, &recovery, &result, &error);
        tl_summary_sample(&summary, config, &tick.sample);
        tl_lock_monitor_sample(&lock_monitor, &tick.sample);
        if (result.ready != 0) {
            tl_summary_add(&summary, config, &result.record);
            (void)tl_lock_monitor_step(&lock_monitor, &result.record);
        }
    }
    if (status != TL_OK) {
        (void)fprintf(stderr, "bench_replay: %s\n", error.text);
        return tl_exit_code(status);
    }
    int64_t counted = ticks > FIRST_TICKS ? ticks - FIRST_TICKS : 1;
    (void)printf("%" PRIu64 " %" PRId64 "\n", summary.figures.steps, (processor_time() - begun) / counted);
    tl_recording_close(recording);
    return 0;
}

int main(int argc, char **argv) {
    tl_assembly assembly;
    if (argc != 3) {
        (void)fputs("usage: bench_replay CONFIG RECORDING\n", stderr);
        return tl_exit_code(TL_BAD_USAGE);
    }
    tl_locale_use();
    tl_status status = tl_test_load_assembly(argv[1], &assembly);
    int code = status == TL_OK ? run(&assembly, argv[2]) : tl_exit_code(status);
    tl_assembly_free(&assembly);
    return code;
}
