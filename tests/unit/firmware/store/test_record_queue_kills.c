/* Record queue whose writer is killed repeatedly. A process puts entries, checkpoints and, from two
 * threads, events until SIGKILL ends it at any instruction. Another process reads meanwhile. Then
 * the next process continues. Each published entry is read exactly once, in order and complete.
 *
 * Ticks continue from process to process: each one finds the end of the one before in the queue.
 * Every second one resumes its run and repeats the sample without a step. Notes in other shared
 * memory have what was put for certain. TL_RECORD_QUEUE_PROCESSES is the number of processes. */
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/base/os.h"
#include "firmware/process/block.h"
#include "firmware/store/record_queue.h"
#include "tests/support/made_run.h"
#include "tests/support/random_numbers.h"

enum { PAGE = 4096, TELLERS = 2, CHECKPOINT = 20000, LIVES = 2000, BETWEEN = 16, LONGEST_US = 2500 };

static const tl_record_queue_settings settings = {.shape = {.plant = TL_MADE_PLANT,
                                                            .match = TL_MADE_MATCH,
                                                            .adjust = TL_MADE_ADJUST,
                                                            .components = TL_MADE_COMPONENTS},
                                                  .ring_bytes = 256 * 1024,
                                                  .checkpoint_bytes = CHECKPOINT};

/* What a process has put for certain, in shared memory. */
typedef struct notes {
    int64_t life; /* number of the process that puts */
    int64_t samples;
    int64_t steps;
    int64_t checkpoint;
    uint64_t events;
    uint64_t halves; /* incomplete checkpoints */
} notes;

static tl_block block;    /* of writers */
static tl_block readable; /* of the reader */
static tl_block takes;
static tl_block notebook;
static tl_record_queue_taken *taken;
static notes *noted;
static tl_record_queue queue;
static tl_recorder_entry entry;
static int64_t life;

static void *share(tl_block *made) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_block_make("page", PAGE, TL_BLOCK_THEY_WRITE, made, NULL));
    return made->bytes;
}

void setUp(void) {
    size_t size = tl_record_queue_bytes(&settings);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_block_make("outbox", size, TL_BLOCK_WE_WRITE, &block, NULL));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_block_take(dup(block.descriptor), size, TL_BLOCK_WE_WRITE, &readable, NULL));
    taken = share(&takes);
    noted = share(&notebook);
    noted->samples = noted->steps = noted->checkpoint = -1;
}

void tearDown(void) {
    tl_block_close(&block);
    tl_block_close(&readable);
    tl_block_close(&takes);
    tl_block_close(&notebook);
}

static void note(int64_t *what, int64_t value) {
    __atomic_store_n(what, value, __ATOMIC_RELEASE);
}

/* ---- content of entries and checkpoints ---- */

static void fill(unsigned char *bytes, size_t size, int64_t tick) {
    for (size_t i = 0; i < size; i++) {
        bytes[i] = (unsigned char)((uint64_t)tick * 7 + i * 31 + (i >> 8));
    }
}

static bool is_filled(const unsigned char *bytes, size_t size, int64_t tick) {
    static unsigned char right[CHECKPOINT];
    fill(right, size, tick);
    return memcmp(bytes, right, size) == 0;
}

/* Position of a reader. */
typedef struct progress {
    int64_t sample; /* newest one */
    int64_t step;
    int64_t starts;
    bool waits; /* the sample is the last entry and cannot be read yet */
} progress;

/* Returns true if the entry is complete and the expected next one. */
static bool follows(const tl_recorder_entry *found, progress *at) {
    tl_sample sample;
    tl_record record;
    at->waits = found->kind == TL_ENTRY_SAMPLE;
    switch (found->kind) {
    case TL_ENTRY_START:
        at->starts++;
        return found->start.resumption.tick == at->sample + 1 && found->start.resumption.run == -1 &&
               (found->start.holds || found->start.account.lead == (uint32_t)at->sample + 1);
    case TL_ENTRY_SAMPLE:
        at->sample++;
        tl_made_sample(at->sample, &sample);
        return at->sample == at->step + 1 && found->sample.tick == at->sample &&
               memcmp(found->sample.values, sample.values, TL_MADE_PLANT * sizeof(double)) == 0 &&
               memcmp(found->sample.stamps, sample.stamps, TL_MADE_PLANT * sizeof(tl_time)) == 0;
    case TL_ENTRY_STEP:
        at->step++;
        tl_made_record(at->step, &record);
        return at->step == at->sample && found->record.step == at->step &&
               memcmp(found->record.measured, record.measured, TL_MADE_MATCH * sizeof(double)) == 0 &&
               memcmp(found->record.u, record.u, TL_MADE_ADJUST * sizeof(double)) == 0;
    case TL_ENTRY_TUNING: /* repeated if its tick was lost */
        return found->tuning.tick == at->sample + 1 && found->tuning.number == (uint32_t)found->tuning.tick &&
               found->tuning.values.margin == (double)found->tuning.tick;
    case TL_ENTRY_END:
        break;
    }
    return false;
}

/* ---- the writer's process ---- */

enum { NOTHING_LEFT = 1, OLD_CHECKPOINT, BAD_CHECKPOINT, BAD_ENTRY, LESS_THAN_PUT, REFUSED, ORPHAN };

static void demand(bool right, int otherwise) {
    if (!right) {
        _exit(otherwise);
    }
}

/* Checks a checkpoint and the entries after it. */
static progress look_back(unsigned which) {
    tl_record_queue_saved left;
    demand(tl_record_queue_saved_checkpoint(&queue, which, &left), NOTHING_LEFT);
    progress at = {.sample = left.tick, .step = left.tick};
    demand(which > 0 || left.tick >= noted->checkpoint, OLD_CHECKPOINT);
    demand(is_filled(left.bytes, left.size, left.tick), BAD_CHECKPOINT);
    while (tl_record_queue_saved_entry(&queue, &left.position, &entry)) {
        demand(follows(&entry, &at), BAD_ENTRY);
    }
    demand(at.sample >= noted->samples && at.step >= noted->steps, LESS_THAN_PUT);
    return at;
}

static void put_checkpoint(int64_t tick) {
    size_t capacity = 0;
    unsigned char *room = tl_record_queue_checkpoint_room(&queue, &capacity);
    size_t size = (size_t)(tl_test_mix((uint64_t)tick) % CHECKPOINT) + 1;
    fill(room, size, tick);
    tl_record_queue_put_checkpoint(&queue, tick, size);
    note(&noted->checkpoint, tick);
}

static void put_start(int64_t tick, tl_resumed_from from) {
    static tl_record_queue_start start;
    start.holds = tl_test_mix((uint64_t)life) % 4 != 0;
    start.resumption = (tl_resumption){.from = from, .run = -1, .tick = tick, .start = life * 1000};
    start.account.lead = (uint32_t)tick;
    demand(tl_record_queue_wait_for_room(&queue, INT64_MAX) && tl_record_queue_put_start(&queue, &start), REFUSED);
}

/* Must be put before the sample of its tick. */
static void put_tuning(int64_t tick) {
    const tl_run_tuning tuning = {.tick = tick, .number = (uint32_t)tick, .values = {.margin = (double)tick}};
    demand(tl_record_queue_wait_for_room(&queue, INT64_MAX) && tl_record_queue_put_tuning(&queue, &tuning), REFUSED);
}

static void put_sample(int64_t tick) {
    tl_sample sample;
    tl_made_sample(tick, &sample);
    for (size_t i = 0; i < TL_MADE_PLANT; i++) {
        sample.stamps[i] += sample.stamps[i] == TL_TIME_NEVER ? 0 : life * 1000;
    }
    demand(tl_record_queue_wait_for_room(&queue, INT64_MAX) && tl_record_queue_put_sample(&queue, &sample), REFUSED);
    note(&noted->samples, tick);
}

static void put_step(int64_t step) {
    tl_record record;
    tl_execution_counts ledger[TL_MADE_COMPONENTS];
    tl_made_record(step, &record);
    tl_made_ledger(step, ledger);
    demand(tl_record_queue_wait_for_room(&queue, INT64_MAX) && tl_record_queue_put_step(&queue, &record, ledger),
           REFUSED);
    note(&noted->steps, step);
}

/* Puts events. Each one has the number of the process, the thread and the event. */
static void *put_events(void *context) {
    char text[TL_EVENT_TEXT];
    const char *source = context;
    for (int64_t number = 0;; number++) {
        memset(text, 'A' + (int)(number % 50), sizeof text);
        text[sizeof text - 1] = '\0';
        tl_record_queue_event(&queue, life * 1000000000 + number, TL_EVENT_INFO, source, text);
        (void)__atomic_add_fetch(&noted->events, 1, __ATOMIC_RELEASE);
        if (number % 8 == 7) {
            (void)sched_yield();
        }
    }
    return NULL;
}

static void start_tellers(void) {
    static char sources[TELLERS][2] = {"0", "1"};
    pthread_t thread;
    for (int i = 0; i < TELLERS; i++) {
        demand(pthread_create(&thread, NULL, put_events, sources[i]) == 0, REFUSED);
    }
}

static void live(pid_t reader) {
    tl_record_queue_saved older;
    (void)prctl(PR_SET_PDEATHSIG, SIGKILL); /* if the test fails */
    demand(getppid() == reader, ORPHAN);
    (void)mprotect(taken, PAGE, PROT_READ);
    tl_record_queue_open(&settings, block.bytes, taken, &queue);
    (void)tl_record_queue_reserve_checkpoint(&queue, CHECKPOINT);
    progress at = look_back(0);
    if (tl_record_queue_saved_checkpoint(&queue, 1, &older)) {
        progress same = look_back(1);
        demand(same.sample == at.sample && same.step == at.step, LESS_THAN_PUT);
    } else {
        noted->halves++;
    }
    start_tellers();
    note(&noted->life, life);
    if (life % 2 != 0 && at.waits) { /* is dropped and put again */
        at.sample = at.step;
        note(&noted->samples, at.sample);
    }
    put_start(at.sample + 1, life % 2 != 0 ? TL_RESUMED_CHECKPOINT : TL_RESUMED_NOT);
    if (at.step < at.sample) {
        put_step(++at.step);
    }
    put_checkpoint(at.sample);
    for (int64_t tick = at.sample + 1;; tick++) {
        if (tick % 3 == 0) {
            put_tuning(tick);
        }
        put_sample(tick);
        put_step(tick);
        if (tick % BETWEEN == 0) {
            put_checkpoint(tick);
        }
    }
}

/* ---- the reader ---- */

static tl_record_queue_reader reader;
static progress at;
static int64_t newest_checkpoint;
static uint64_t events;
static uint64_t skipped;
static uint64_t checkpoints;
static int64_t newest_event[TELLERS]; /* process · 10⁹ + number of the newest event */

static void take_entries(void) {
    uint64_t position = taken->ring;
    uint64_t end = tl_record_queue_reader_end(&reader, position);
    while (position != end) {
        TEST_ASSERT_TRUE_MESSAGE(tl_record_queue_reader_entry(&reader, &position, end, &entry), reader.fault);
        TEST_ASSERT_TRUE(follows(&entry, &at));
    }
    __atomic_store_n(&taken->ring, position, __ATOMIC_RELEASE);
}

static void check_event(const tl_recorder_event_entry *event) {
    char right[TL_EVENT_TEXT];
    int64_t *last = &newest_event[event->source[0] == '1'];
    memset(right, 'A' + (int)(event->tick % 1000000000 % 50), sizeof right);
    right[sizeof right - 1] = '\0';
    TEST_ASSERT_EQUAL_STRING(right, event->text);
    TEST_ASSERT_GREATER_THAN_INT64(*last, event->tick);
    *last = event->tick;
}

static void take_events(void) {
    tl_recorder_event_entry event;
    bool skip = false;
    while (tl_record_queue_reader_event(&reader, taken->events, &event, &skip)) {
        skipped += skip ? 1 : 0;
        events += skip ? 0 : 1;
        if (!skip) {
            check_event(&event);
        }
        __atomic_store_n(&taken->events, taken->events + 1, __ATOMIC_RELEASE);
    }
}

static void take_checkpoint(void) {
    static unsigned char bytes[CHECKPOINT];
    size_t size = 0;
    int64_t tick = 0;
    uint64_t number = 0;
    if (tl_record_queue_reader_checkpoint(&reader, taken->checkpoint, taken->ring, bytes, &size, &tick, &number)) {
        TEST_ASSERT_TRUE(is_filled(bytes, size, tick));
        TEST_ASSERT_GREATER_THAN_UINT64(taken->checkpoint, number);
        TEST_ASSERT_TRUE(tick >= newest_checkpoint && tick <= at.step);
        newest_checkpoint = tick;
        checkpoints++;
        __atomic_store_n(&taken->checkpoint, number, __ATOMIC_RELEASE);
    }
}

static void take_all(void) {
    take_entries();
    take_events();
    take_checkpoint();
    TEST_ASSERT_EQUAL_STRING("", reader.fault);
}

/* ---- test ---- */

static bool is_dead(pid_t child) {
    siginfo_t info = {.si_pid = 0};
    return waitid(P_PID, (id_t)child, &info, WEXITED | WNOHANG | WNOWAIT) == 0 && info.si_pid == child;
}

/* Reads for a random time after the process has started to put, or sometimes after its fork. */
static void take_for(pid_t child, tl_test_random *random) {
    bool at_once = tl_test_random_chance(random, 15);
    tl_time length = (tl_time)tl_test_random_below(random, LONGEST_US) * 1000;
    tl_time begun = tl_clock_now(NULL);
    tl_time last_time = begun + 20 * TL_SECOND;
    while (!at_once && __atomic_load_n(&noted->life, __ATOMIC_ACQUIRE) != life && begun < last_time &&
           !is_dead(child)) {
        take_all();
        begun = tl_clock_now(NULL);
    }
    while (tl_clock_now(NULL) - begun < length) {
        take_all();
    }
}

static void expect_killed(pid_t child) {
    int status = 0;
    char text[80];
    TEST_ASSERT_EQUAL_INT(child, waitpid(child, &status, 0));
    (void)snprintf(text, sizeof text, "process %lld ended with %d", (long long)life,
                   WIFEXITED(status) ? WEXITSTATUS(status) : 0);
    TEST_ASSERT_TRUE_MESSAGE(WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL, text);
}

/* With sanitizers or an emulator, a fork takes ten times as long. */
static size_t usual_lives(void) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
    return LIVES / 10;
#else
    return getenv("TL_EMULATOR") != NULL ? LIVES / 10 : LIVES;
#endif
}

/* Puts a start and a checkpoint for the first process. */
static void begin(void) {
    at = (progress){.sample = -1, .step = -1};
    newest_checkpoint = life = noted->life = -1;
    memset(newest_event, 0xFF, sizeof newest_event);
    tl_record_queue_reader_open(&settings, readable.bytes, &reader);
    tl_record_queue_open(&settings, block.bytes, taken, &queue);
    TEST_ASSERT_TRUE(tl_record_queue_reserve_checkpoint(&queue, CHECKPOINT));
    put_start(0, TL_RESUMED_NOT);
    put_checkpoint(-1);
}

static void each_killed_writer_has_a_successor(void) {
    tl_test_random random = {1};
    char text[200];
    int64_t lives = (int64_t)tl_test_campaign("TL_RECORD_QUEUE_PROCESSES", usual_lives());
    begin();
    for (life = 0; life < lives; life++) {
        pid_t self = getpid();
        pid_t child = fork();
        if (child == 0) {
            live(self);
        }
        TEST_ASSERT_GREATER_THAN_INT(0, child);
        take_for(child, &random);
        (void)kill(child, SIGKILL);
        expect_killed(child);
        take_all();
        TEST_ASSERT_GREATER_OR_EQUAL_INT64(noted->steps, at.sample); /* may wait */
        TEST_ASSERT_GREATER_OR_EQUAL_INT64(noted->steps, at.step);
    }
    tl_record_queue_open(&settings, block.bytes, taken, &queue);
    take_all();
    uint64_t accounted = events + tl_record_queue_lost(&queue);
    TEST_ASSERT_GREATER_OR_EQUAL_UINT64(noted->events, accounted);
    TEST_ASSERT_LESS_OR_EQUAL_UINT64(noted->events + (uint64_t)(TELLERS * lives), accounted);
    (void)snprintf(
        text, sizeof text,
        "%lld processes, %lld ticks; %llu events read, %llu incomplete; %llu checkpoints read, %llu incomplete",
        (long long)lives, (long long)at.sample + 1, (unsigned long long)events, (unsigned long long)skipped,
        (unsigned long long)checkpoints, (unsigned long long)noted->halves);
    TEST_MESSAGE(text);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(each_killed_writer_has_a_successor);
    return UNITY_END();
}
