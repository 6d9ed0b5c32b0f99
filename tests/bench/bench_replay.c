/* A replay with its FMUs in this process, for replay.py: what `twinlock replay` would take if it trusted them.
 *
 * usage: bench_replay CONFIG RECORDING
 *
 * The same loop, feed and twin as the program's; only the process of the FMUs is missing. Prints how many steps it made.
 */
#include <inttypes.h>
#include <stdio.h>

#include "firmware/base/os.h"
#include "firmware/twin/replay.h"
#include "tests/support/read_assembly.h"

static int run(tl_assembly *assembly, const char *recording) {
    static tl_account account;
    static tl_lock_judge judge;
    static tl_journal journal;
    static tl_watch watch;
    tl_replay replay = {.config = &assembly->config, .account = &account, .watch = &watch, .judge = &judge};
    tl_summary summary;
    tl_error error;
    tl_account_take(assembly->twin, &account);
    tl_lock_judge_init(&judge, &assembly->config, &account);
    tl_journal_init(&journal, NULL);
    tl_watch_init(&watch, &assembly->config, &journal);
    tl_status status = tl_recording_open(recording, &assembly->config, &replay.recording, &error);
    if (status == TL_OK) {
        const tl_twin_feed_settings settings = {.config = &assembly->config,
                                                .account = &account,
                                                .recording = replay.recording,
                                                .assembly = assembly,
                                                .tells = TL_TELLS_RECORDS};
        status = tl_twin_feed_open(&settings, &replay.feed, &error);
    }
    if (status == TL_OK) {
        status = tl_replay_run(&replay, &summary, &error);
    }
    if (status != TL_OK) {
        (void)fprintf(stderr, "bench_replay: %s\n", error.text);
        return tl_exit_code(status);
    }
    (void)printf("%" PRIu64 "\n", summary.figures.steps);
    tl_twin_feed_close(replay.feed);
    tl_recording_close(replay.recording);
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
