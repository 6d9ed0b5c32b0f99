/* See writer_bench.h. */
#include "tests/support/writer_bench.h"

#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "tests/support/made_run.h"
#include "tests/support/sql.h"

enum { WAITS = 4000, WAIT_US = 5000, PUT_US = 300 };

static void *share(size_t bytes) {
    /* cppcheck-suppress invalidFunctionArg ; an anonymous mapping has no file, which is -1 */
    void *memory = mmap(NULL, bytes, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    TEST_ASSERT_TRUE(memory != MAP_FAILED);
    return memory;
}

static void make_memory(tl_writer_bench *bench) {
    const tl_recorder_shape shape = {
        .plant = TL_MADE_PLANT, .match = TL_MADE_MATCH, .adjust = TL_MADE_ADJUST, .components = TL_MADE_COMPONENTS};
    bench->settings[0] = (tl_record_queue_settings){.shape = shape, .checkpoint_bytes = TL_BENCH_CHECKPOINT};
    bench->settings[0].ring_bytes = tl_record_queue_ring_bytes(&shape, bench->record.step);
    bench->settings[TL_BENCH_IO] = (tl_record_queue_settings){.shape = shape};
    bench->settings[TL_BENCH_OTHER] = bench->settings[TL_BENCH_TWIN];
    bench->state = share(sizeof *bench->state);
    for (int i = 0; i < TL_BENCH_QUEUES; i++) {
        bench->bytes[i] = tl_record_queue_bytes(&bench->settings[i]);
        bench->memory[i] = share(bench->bytes[i]);
        bench->queues[i] =
            (tl_recorder_writer_queue){i == TL_BENCH_IO ? "io" : "twin", bench->settings[i], bench->memory[i]};
    }
    tl_record_queue_open(&bench->settings[0], bench->memory[0], &bench->state->taken[0], &bench->twin);
    tl_record_queue_open(&bench->settings[1], bench->memory[1], &bench->state->taken[1], &bench->io);
    tl_record_queue_open(&bench->settings[2], bench->memory[2], &bench->state->taken[2], &bench->other);
    bench->ring = TL_BENCH_TWIN;
    bench->continues = false;
    bench->is_last = false;
    bench->plant = (tl_recorder_plant){.take = NULL};
    bench->writer = NULL;
    bench->error = (tl_error){TL_OK, ""};
}

static void free_memory(tl_writer_bench *bench) {
    (void)tl_recorder_writer_close(bench->writer, 0, NULL);
    for (int i = 0; i < TL_BENCH_QUEUES; i++) {
        (void)munmap(bench->memory[i], bench->bytes[i]);
    }
    (void)munmap(bench->state, sizeof *bench->state);
}

void tl_writer_bench_begin(tl_writer_bench *bench) {
    (void)snprintf(bench->path, sizeof bench->path, "%s", tl_scratch_path(&bench->scratch, "run.db"));
    bench->record = tl_made_settings(bench->path);
    bench->record.verb = "run";
    bench->record.open_policy = TL_DATABASE_ANYHOW;
    make_memory(bench);
}

void tl_writer_bench_end(tl_writer_bench *bench) {
    if (bench->child > 0) {
        (void)kill(bench->child, SIGKILL);
        (void)waitpid(bench->child, NULL, 0);
        bench->child = 0;
    }
    free_memory(bench);
    tl_scratch_empty(&bench->scratch);
}

void tl_writer_bench_forget(tl_writer_bench *bench) {
    free_memory(bench);
    make_memory(bench);
}

static bool continues(void *context) {
    const tl_writer_bench *bench = context;
    return bench->continues;
}

tl_status tl_writer_bench_try_open(tl_writer_bench *bench) {
    bench->queues[TL_BENCH_TWIN].memory = bench->ring == TL_BENCH_TWIN ? bench->memory[TL_BENCH_TWIN] : NULL;
    bench->queues[TL_BENCH_OTHER].memory = bench->ring == TL_BENCH_OTHER ? bench->memory[TL_BENCH_OTHER] : NULL;
    const tl_recorder_writer_settings settings = {.record = &bench->record,
                                                  .observe = bench->observe,
                                                  .queues = bench->queues,
                                                  .queue_count = TL_BENCH_QUEUES,
                                                  .ring = bench->ring,
                                                  .hand_over = TL_BENCH_HAND_OVER,
                                                  .continues = continues,
                                                  .context = bench,
                                                  .state = bench->state,
                                                  .plant = bench->plant,
                                                  .is_last = bench->is_last};
    return tl_recorder_writer_open(&settings, &bench->writer, &bench->error);
}

void tl_writer_bench_open(tl_writer_bench *bench) {
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_writer_bench_try_open(bench), bench->error.text);
}

tl_status tl_writer_bench_close(tl_writer_bench *bench) {
    tl_recorder_writer *closing = bench->writer;
    bench->writer = NULL;
    return tl_recorder_writer_close(closing, 0, &bench->error);
}

void tl_writer_bench_close_well(tl_writer_bench *bench) {
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_writer_bench_close(bench), bench->error.text);
}

void tl_writer_bench_write_until(tl_writer_bench *bench, uint64_t written) {
    for (int i = 0; i < WAITS && tl_recorder_state_get(bench->state).written < written; i++) {
        tl_recorder_writer_write(bench->writer);
        usleep(WAIT_US);
    }
    TEST_ASSERT_EQUAL_UINT64(written, tl_recorder_state_get(bench->state).written);
}

static void write_forever(tl_writer_bench *bench, void (*write)(void)) {
    tl_log_set_level(TL_LOG_ERROR);
    if (tl_writer_bench_try_open(bench) == TL_OK) {
        for (;;) {
            write();
        }
    }
    _exit(1);
}

void tl_writer_bench_live(tl_writer_bench *bench, tl_time until, void (*write)(void), void (*put)(void)) {
    int how = 0;
    bench->child = fork();
    if (bench->child == 0) {
        write_forever(bench, write);
    }
    TEST_ASSERT_GREATER_THAN(0, bench->child);
    while (tl_clock_now(NULL) < until) {
        put();
        usleep(PUT_US);
    }
    TEST_ASSERT_EQUAL_INT(0, kill(bench->child, SIGKILL));
    TEST_ASSERT_EQUAL_INT(bench->child, waitpid(bench->child, &how, 0));
    bench->child = 0;
    TEST_ASSERT_TRUE(WIFSIGNALED(how)); /* was killed, did not exit */
}

void tl_writer_bench_start(tl_writer_bench *bench, tl_time start) {
    static tl_record_queue_start made; /* too large for the stack */
    tl_made_beginning(start, &made);
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&bench->twin, &made));
}

void tl_writer_bench_put(tl_writer_bench *bench, int64_t first, int64_t ticks) {
    TEST_ASSERT_TRUE(tl_made_put_out(&bench->twin, first, ticks));
}

void tl_writer_bench_record(tl_writer_bench *bench, int64_t ticks) {
    tl_writer_bench_open(bench);
    tl_writer_bench_start(bench, 0);
    tl_writer_bench_put(bench, 0, ticks);
    TEST_ASSERT_TRUE(tl_record_queue_put_end(&bench->twin, "SIGTERM"));
    tl_writer_bench_close_well(bench);
}

void tl_writer_bench_expect_whole(const char *path) {
    static const char *const none[] = {
        "SELECT count(*) FROM (SELECT count(*) AS n FROM samples GROUP BY run, tick) WHERE n <> 3",
        "SELECT count(*) FROM steps s WHERE 2 <> (SELECT count(*) FROM outputs o WHERE o.run = s.run AND"
        " o.step = s.step) OR 2 <> (SELECT count(*) FROM adjustments a WHERE a.run = s.run AND a.step = s.step)",
        "SELECT count(*) FROM runs r WHERE samples_written <> (SELECT count(DISTINCT tick) FROM samples s WHERE"
        " s.run = r.run) OR steps_written <> (SELECT count(*) FROM steps s WHERE s.run = r.run) OR"
        " events_written <> (SELECT count(*) FROM events e WHERE e.run = r.run)",
    };
    TEST_ASSERT_EQUAL_STRING("ok", tl_sql_text(path, "PRAGMA integrity_check"));
    for (size_t i = 0; i < sizeof none / sizeof none[0]; i++) {
        TEST_ASSERT_EQUAL_INT64_MESSAGE(0, tl_sql_integer(path, none[i]), none[i]);
    }
}

int64_t tl_writer_bench_count_own(const char *path, const char *parts) {
    return tl_sql_count_events(path, "recorder", parts);
}
