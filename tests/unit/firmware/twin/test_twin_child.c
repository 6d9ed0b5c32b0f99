/* The parent of the FMU process, with an honest process and with malicious ones (liars).
 * A liar is this program, executed again. The name of its configuration selects the lie. */
#include <errno.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/process/process_end.h"
#include "firmware/process/role.h"
#include "firmware/process/sanitizer.h"
#include "firmware/twin/twin_child.h"
#include "firmware/twin/twin_role.h"
#include "tests/support/config_text.h"
#include "tests/support/message.h"
#include "tests/support/scratch.h"
#include "tests/support/stderr_capture.h"

#define LOCK TL_SOURCE_DIR "/tests/support/motor_lock.json"
#define LIE "lie: "

enum { PAGE = 4096, LINE = 64, TICKS = 300 };

/* ---- a liar, in another process ---- */

static tl_channel_settings wire;
static uint8_t *own; /* its block, */
static const uint8_t *others;
static tl_twin_extra *extra;
static uint32_t sent;

/* Any message, allowed or not. */
static void send_any(uint32_t type, uint32_t length, const void *payload) {
    size_t stride = (8 + tl_protocol_longest(&wire.sizes, TL_CHILD) + LINE - 1) / LINE * LINE;
    uint8_t *slot = own + PAGE + sent % TL_CHANNEL_DEPTH * stride;
    memcpy(slot, &type, sizeof type);
    memcpy(slot + 4, &length, sizeof length);
    memcpy(slot + 8, payload, wire.sizes.bytes[type]);
    sent++;
    __atomic_store_n((uint32_t *)(void *)own, sent, __ATOMIC_SEQ_CST);
}

static void send_message(tl_message type, const void *payload) {
    send_any(type, wire.sizes.bytes[type], payload);
}

static void send_word(tl_message type, int32_t status, const char *error) {
    const int32_t word = status;
    (void)snprintf(extra->error, sizeof extra->error, "%s", error);
    send_message(type, &word);
}

static void send_ready(void) {
    const tl_confine_facts facts = {.filter = true, .notifies = true, .landlock = 9, .memory = true, .user = true};
    send_message(TL_MESSAGE_READY, &facts);
}

/* It fits motor_lock.json. */
static void make_account(tl_account *account) {
    *account = (tl_account){.components = 3, .matches = 1, .adjusts = 1, .prediction = 1, .lead = 1};
}

static void send_built(void) {
    make_account(&extra->built);
    send_word(TL_MESSAGE_BUILT, TL_OK, "");
}

static void send_result(int64_t tick, int32_t status, const char *error) {
    static tl_twin_result result;
    result = (tl_twin_result){.tick = tick, .status = status, .ready = 0};
    (void)snprintf(extra->error, sizeof extra->error, "%s", error);
    send_message(TL_MESSAGE_RESULT, &result);
}

/* Waits until the parent has read all messages. */
static void wait_until_taken(void) {
    const struct timespec pause = {.tv_nsec = 1000000};
    while (__atomic_load_n((const uint32_t *)(const void *)(others + LINE), __ATOMIC_SEQ_CST) != sent) {
        (void)nanosleep(&pause, NULL);
    }
}

static void sleep_for_ever(void) {
    for (;;) {
        (void)pause();
    }
}

/* A lie before the twin is built. */
static bool lie_early(const char *lie) {
    if (strcmp(lie, "ends at once") == 0) {
        _exit(0);
    }
    if (strcmp(lie, "fails at its start") == 0) {
        _exit(3);
    }
    send_ready();
    if (strcmp(lie, "a result before it is built") == 0) {
        send_result(0, TL_OK, "");
    } else if (strcmp(lie, "ready twice") == 0) {
        send_ready();
    } else if (strcmp(lie, "fails and says nothing") == 0) {
        send_word(TL_MESSAGE_BUILT, TL_BAD_DATA, "");
    } else if (strcmp(lie, "fails with escapes") == 0) {
        send_word(TL_MESSAGE_BUILT, TL_FMU_FAILED, "red \033[31m, \302\233, \177 and\nnew");
    } else if (strcmp(lie, "a status that is none") == 0) {
        send_word(TL_MESSAGE_BUILT, 4711, "why");
    } else if (strcmp(lie, "interrupted") == 0) {
        send_word(TL_MESSAGE_BUILT, TL_INTERRUPTED, "why");
    } else if (strcmp(lie, "ended instead of built") == 0) {
        send_word(TL_MESSAGE_ENDED, TL_OK, "");
    } else if (strcmp(lie, "a pair that is none") == 0) {
        send_built();
        memset(&extra->pair, '\033', sizeof extra->pair);
        _exit(3);
    } else if (strcmp(lie, "ways that are none") == 0) {
        send_built();
        memset(&extra->ways, '\033', sizeof extra->ways);
        _exit(3);
    } else if (strcmp(lie, "an account of another") == 0) {
        make_account(&extra->built);
        extra->built.components++;
        send_word(TL_MESSAGE_BUILT, TL_OK, "");
    } else if (strcmp(lie, "an account without end") == 0) {
        make_account(&extra->built);
        memset(extra->built.algorithm, 'x', sizeof extra->built.algorithm);
        send_word(TL_MESSAGE_BUILT, TL_OK, "");
    } else if (strcmp(lie, "writes the account of its end") == 0) {
        make_account(&extra->built);
        memset(&extra->ended, 'x', sizeof extra->ended);
        send_word(TL_MESSAGE_BUILT, TL_OK, "");
    } else {
        return false;
    }
    return true;
}

/* A lie afterwards. */
static void lie_late(const char *lie) {
    send_built();
    if (strcmp(lie, "built twice") == 0) {
        send_built();
    } else if (strcmp(lie, "a result of another tick") == 0) {
        send_result(1, TL_OK, "");
    } else if (strcmp(lie, "interrupted at a tick") == 0) {
        send_result(0, TL_INTERRUPTED, "");
    } else if (strcmp(lie, "a step fails with escapes") == 0) {
        send_result(0, TL_FMU_FAILED, "in \033]0;title\007 motor");
    } else if (strcmp(lie, "a step fails silently") == 0) {
        send_result(0, TL_FMU_FAILED, "");
    } else if (strcmp(lie, "a result that is too short") == 0) {
        send_any(TL_MESSAGE_RESULT, 1, extra);
    } else if (strcmp(lie, "a tick") == 0) {
        send_any(TL_MESSAGE_TICK, wire.sizes.bytes[TL_MESSAGE_TICK], extra);
    } else if (strcmp(lie, "more than a ring") == 0) {
        wait_until_taken();
        __atomic_store_n((uint32_t *)(void *)own, 2 * TL_CHANNEL_DEPTH, __ATOMIC_SEQ_CST);
    } else if (strcmp(lie, "ended unasked") == 0) {
        send_word(TL_MESSAGE_ENDED, TL_OK, "");
    } else if (strcmp(lie, "ended with a reason") == 0) {
        send_word(TL_MESSAGE_ENDED, TL_TRY_AGAIN, "no\tmemory");
    } else if (strcmp(lie, "ended silently") == 0) {
        send_word(TL_MESSAGE_ENDED, TL_FMU_FAILED, "");
    } else if (strcmp(lie, "crashes in a call") == 0) {
        tl_fmu_calls_use(&extra->calls);
        tl_fmu_call_begin(tl_fmu_calls_name("mot\033[1mor"), TL_FMU_DO_STEP);
        (void)signal(SIGSEGV, SIG_DFL);
        (void)raise(SIGSEGV);
    } else if (strcmp(lie, "hangs in a call") == 0) {
        tl_fmu_calls_use(&extra->calls);
        tl_fmu_call_begin(tl_fmu_calls_name("motor"), TL_FMU_DO_STEP);
    } else if (strcmp(lie, "shows without end") == 0) {
        for (int i = 0; i < 100; i++) {
            send_message(TL_MESSAGE_SHOWN, extra);
        }
    } else if (strcmp(lie, "ends unannounced") == 0) {
        _exit(0);
    } else if (strcmp(lie, "prints") == 0) {
        (void)!write(STDOUT_FILENO, "\033[31mred\a\r\n<3>\033[2J forged\nno end", 32);
        _exit(3);
    }
}

static void be_liar(const char *lie) {
    static tl_config config; /* the configuration of the parent, from the job */
    static tl_block blocks[TL_SIDES];
    tl_block job_block;
    tl_twin_job job;
    tl_report report = {0};
    tl_error error;
    tl_role_enter();
    (void)close(TL_TWIN_START_SOCKET);
    if (tl_block_take(TL_TWIN_JOB, 0, TL_BLOCK_IS_WRITTEN, &job_block, &error) != TL_OK ||
        tl_twin_job_read(&job_block, &job, &error) != TL_OK ||
        tl_config_read_text(job.path, job.text, strlen(job.text), &config, &report) != TL_OK) {
        _exit(100);
    }
    wire = tl_twin_wire(&config, job.attached);
    if (tl_block_take(TL_TWIN_PARENTS_BLOCK, tl_channel_bytes(&wire, TL_PARENT), TL_BLOCK_WE_WRITE, &blocks[TL_PARENT],
                      &error) != TL_OK ||
        tl_block_take(TL_TWIN_OWN_BLOCK, tl_channel_bytes(&wire, TL_CHILD), TL_BLOCK_THEY_WRITE, &blocks[TL_CHILD],
                      &error) != TL_OK) {
        _exit(101);
    }
    own = blocks[TL_CHILD].bytes;
    others = blocks[TL_PARENT].bytes;
    extra = tl_channel_extra(&wire, TL_CHILD, own);
    if (!lie_early(lie)) {
        lie_late(lie);
    }
    sleep_for_ever();
}

/* ---- the parent ---- */

static tl_scratch scratch; /* TMPDIR */
static tl_config config;
static tl_twin_job order;
static tl_twin_child *child;
static tl_account account;
static tl_error error;
static tl_recording_tick tick;
static tl_twin_result result;
static FILE *page;

static tl_status print_page(const tl_assembly *assembly, const tl_twin_job *job, tl_status status,
                            const tl_read_back_host *host, FILE *out, tl_twin_check *found) {
    (void)fprintf(out, "%s: %zu components\n", assembly->config.name, assembly->config.component_count);
    (void)host;
    *found = (tl_twin_check){.warnings = 7, .least = 1, .worst = job->brief ? -1 : 2, .memory = 3, .why = "y is\033"};
    return status;
}

void setUp(void) {
    tl_report report = {0};
    TEST_ASSERT_EQUAL_INT(0, setenv("TWINLOCK_FMU_PATH", TL_BINARY_DIR "/fmus", 1));
    TEST_ASSERT_EQUAL_INT(0, setenv("TMPDIR", scratch.folder, 1));
    error = (tl_error){TL_OK, ""};
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_config_read(LOCK, &config, &report));
    tl_config_use_lookups(&config);
    order = (tl_twin_job){.task = TL_TASK_STEP, .path = LOCK, .text = config.text};
    tick = (tl_recording_tick){.sample = {.values = {0, 63}}};
}

/* No process and no folder is left. */
void tearDown(void) {
    tl_twin_child_close(child);
    child = NULL;
    TEST_ASSERT_EQUAL_INT(-1, waitpid(-1, NULL, WNOHANG));
    TEST_ASSERT_EQUAL_INT(ECHILD, errno);
    TEST_ASSERT_EQUAL_INT(0, tl_scratch_count(&scratch));
    tl_config_free(&config);
}

static tl_status start(tl_time call_limit) {
    const tl_twin_child_settings settings = {
        .job = &order, .config = &config, .page = page, .print_page = print_page, .call_limit = call_limit};
    return tl_twin_child_start(&settings, &child, &error);
}

static void expect_text(const char *parts) {
    TL_EXPECT_PARTS(parts, error.text);
}

/* The text names no function of an FMU. */
static void expect_no_call(void) {
    TEST_ASSERT_NULL_MESSAGE(strstr(error.text, "fmi2"), error.text);
}

/* ---- an honest process ---- */

static void give(int64_t number, bool last) {
    tick.sample.tick = number;
    tick.sample.instant = number * config.step;
    tick.sample.stamps[0] = tick.sample.instant;
    tick.sample.stamps[1] = tick.sample.instant;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_child_enqueue(child, &tick, last, &error));
}

static void take(int64_t number, unsigned wanted) {
    bool stopped = true;
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_twin_child_take(child, number, wanted, &result, &stopped, &error),
                                  error.text);
    TEST_ASSERT_FALSE(stopped);
    TEST_ASSERT_EQUAL_INT64(number, result.tick);
}

static void start_honest(void) {
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, start(0), error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_twin_child_build(child, &account, &error), error.text);
    TEST_ASSERT_EQUAL_UINT32(3, account.components);
    TEST_ASSERT_EQUAL_STRING("motor", account.component[1].name);
}

static void end_honest(void) {
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_twin_child_end(child, &account, &error), error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_twin_child_wait(child, &error), error.text);
    TEST_ASSERT_TRUE(tl_twin_child_is_gone(child));
}

static void test_it_is_given_ticks_and_ends(void) {
    uint64_t begun = 0;
    start_honest();
    begun = tl_account_executions(&account);
    for (int64_t i = 0; i < TICKS; i++) {
        give(i, false);
        tl_twin_child_push(child);
        take(i, 1);
    }
    TEST_ASSERT_EQUAL_INT64(TICKS - 2, result.record.step);
    end_honest();
    TEST_ASSERT_GREATER_THAN_UINT64(begun + TICKS, tl_account_executions(&account));
}

/* Sends as many ticks as the ring holds, and takes only some results. */
static void test_it_is_stopped_with_ticks_under_way(void) {
    bool stopped = false;
    start_honest();
    for (int64_t i = 0; i < TL_CHANNEL_DEPTH; i++) {
        give(i, false);
    }
    tl_twin_child_push(child);
    for (int64_t i = 0; i < 10; i++) {
        take(i, 100);
    }
    tl_twin_child_stop(child);
    give(TL_CHANNEL_DEPTH, false); /* ignored */
    for (int64_t i = 10; !stopped; i++) {
        TEST_ASSERT_LESS_OR_EQUAL_INT64(TL_CHANNEL_DEPTH, i);
        TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_child_take(child, i, 1, &result, &stopped, &error));
    }
    end_honest();
}

static void test_its_end_is_not_waited_for(void) {
    start_honest();
    give(0, false);
    tl_twin_child_push(child); /* tearDown() closes it */
}

static void test_a_check(void) {
    char text[128] = "";
    tl_twin_check found;
    order.task = TL_TASK_CHECK;
    page = tmpfile();
    TEST_ASSERT_NOT_NULL(page);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, start(0), error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_twin_child_check(child, &found, &error), error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_twin_child_wait(child, &error), error.text);
    TEST_ASSERT_EQUAL_UINT32(7, found.warnings);
    TEST_ASSERT_EQUAL_INT64(2, found.worst);
    TEST_ASSERT_EQUAL_UINT64(3, found.memory);
    TEST_ASSERT_EQUAL_STRING("y is\\x1B", found.why);
    rewind(page);
    TEST_ASSERT_NOT_NULL(fgets(text, sizeof text, page));
    TEST_ASSERT_EQUAL_STRING("motor bench, locked by the motor's friction: 2 components\n", text);
    (void)fclose(page);
    page = NULL;
}

/* The result of a check is untrusted. */
static void test_a_check_with_a_negative_time(void) {
    tl_twin_check found;
    order.task = TL_TASK_CHECK;
    order.brief = true;
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, start(0), error.text);
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, tl_twin_child_check(child, &found, &error));
    expect_text("killed|check");
}

static void test_a_pair(void) {
    tl_twin_outcome pair;
    order.task = TL_TASK_PAIR;
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, start(0), error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_twin_child_finish(child, &pair, &error), error.text);
    TEST_ASSERT_EQUAL_INT(TL_OK, pair.status);
    TEST_ASSERT_EQUAL_STRING("", pair.text);
    TEST_ASSERT_FALSE(pair.has_ended);
    TEST_ASSERT_GREATER_THAN_UINT32(0, pair.pair.steps);
    TEST_ASSERT_EQUAL_UINT32(1, pair.pair.has_second);
}

static void test_ways(void) {
    tl_twin_outcome tried;
    order.task = TL_TASK_METHODS;
    order.rollback[1] = TL_ROLLBACK_REPLAY;
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, start(0), error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_twin_child_finish(child, &tried, &error), error.text);
    TEST_ASSERT_EQUAL_INT(TL_OK, tried.status);
    TEST_ASSERT_EQUAL_STRING("", tried.text);
    TEST_ASSERT_FALSE(tried.has_ended);
    TEST_ASSERT_EQUAL_UINT32(TL_HAS_SANITIZER ? TL_ROLLBACK_STATE : TL_ROLLBACK_MEMORY, tried.ways.of[0].rollback);
    TEST_ASSERT_EQUAL_UINT32(TL_ROLLBACK_REPLAY, tried.ways.of[1].rollback);
}

/* The process uses the configuration of the job, not the present file. */
static void test_errors_of_building_are_logged(void) {
    char *text = tl_test_replaced(config.text, "\"motor.d\"", "\"motor.J\"");
    TEST_ASSERT_NOT_NULL(text);
    order.text = text;
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    TEST_ASSERT_EQUAL_INT(TL_OK, start(0));
    tl_status status = tl_twin_child_build(child, &account, &error);
    char *said = tl_stderr_capture_end();
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, status);
    TEST_ASSERT_EQUAL_STRING("", error.text);
    TL_EXPECT_PARTS("motor.J|fixed", said);
    free(said);
    free(text);
}

/* The clock would overflow with a multiple of it. */
static void test_a_limit_of_years(void) {
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, start(INT64_C(999999999) * TL_SECOND), error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_twin_child_build(child, &account, &error), error.text);
}

/* ---- liars ---- */

static char lie_name[96];

static void start_liar(const char *lie, tl_time call_limit, tl_status expected) {
    if (getenv("TL_EMULATOR") != NULL) {
        TEST_IGNORE_MESSAGE("an emulator cannot execute this program again");
    }
    (void)snprintf(lie_name, sizeof lie_name, LIE "%s", lie);
    config.name = lie_name;
    TEST_ASSERT_EQUAL_INT_MESSAGE(expected, start(call_limit), error.text);
}

static void expect_start_fails(const char *lie, const char *why) {
    start_liar(lie, 0, TL_FMU_FAILED);
    TEST_ASSERT_NULL(child);
    expect_text(why);
}

static void test_it_ends_at_its_start(void) {
    expect_start_fails("ends at once", "code|0");
    expect_no_call();
}

static void test_it_fails_at_its_start(void) {
    expect_start_fails("fails at its start", "code|3");
    expect_no_call();
}

static void expect_build_fails(const char *lie, const char *why) {
    start_liar(lie, 0, TL_OK);
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, tl_twin_child_build(child, &account, &error));
    expect_text(why);
}

static void expect_killed_at_build(const char *lie, const char *why) {
    expect_build_fails(lie, "killed");
    expect_text(why);
    TEST_ASSERT_TRUE(tl_twin_child_is_gone(child));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_child_end(child, NULL, &error));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_child_wait(child, &error));
}

static void test_a_result_before_it_is_built(void) {
    expect_killed_at_build("a result before it is built", "\"result\"|building");
}

static void test_ready_twice(void) {
    expect_killed_at_build("ready twice", "\"ready\"|building");
}

static void test_ended_instead_of_built(void) {
    expect_killed_at_build("ended instead of built", "message");
}

static void test_an_account_of_another(void) {
    expect_killed_at_build("an account of another", "account");
}

static void test_an_account_without_end(void) {
    expect_killed_at_build("an account without end", "account");
}

/* The process may write its last account while the parent still reads the first one. */
static void test_its_last_account_is_apart(void) {
    start_liar("writes the account of its end", 0, TL_OK);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_twin_child_build(child, &account, &error), error.text);
    TEST_ASSERT_EQUAL_UINT32(3, account.components);
}

static void test_a_building_that_fails(void) {
    start_liar("fails and says nothing", 0, TL_OK);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_twin_child_build(child, &account, &error));
    TEST_ASSERT_EQUAL_STRING("", error.text);
}

static void test_its_texts_are_escaped(void) {
    expect_build_fails("fails with escapes", "red \\x1B[31m, \\u{9B}, \\x7F and\\x0Anew");
    for (const char *c = error.text; *c != '\0'; c++) {
        TEST_ASSERT_TRUE((unsigned char)*c >= ' ' && *c != '\177' && *c != '\302');
    }
}

static void test_an_invalid_status(void) {
    expect_build_fails("a status that is none", "why");
}

/* A run must not look interrupted if it was not. */
static void test_it_cannot_interrupt(void) {
    expect_build_fails("interrupted", "why");
}

static void take_wrong(const char *lie, tl_time call_limit) {
    bool stopped = false;
    start_liar(lie, call_limit, TL_OK);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_twin_child_build(child, &account, &error), error.text);
    result.tick = TL_TWIN_NO_TICK;
    give(0, false);
    tl_twin_child_push(child);
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, tl_twin_child_take(child, 0, 1, &result, &stopped, &error));
}

static void expect_no_result(const char *lie, const char *why) {
    take_wrong(lie, 0);
    expect_text(why);
    TEST_ASSERT_EQUAL_INT64(TL_TWIN_NO_TICK, result.tick);
    TEST_ASSERT_TRUE(tl_twin_child_is_gone(child));
}

static void test_built_twice(void) {
    expect_no_result("built twice", "\"built\"|stepping");
}

static void test_a_result_of_another_tick(void) {
    expect_no_result("a result of another tick", "killed|result");
}

static void test_it_cannot_interrupt_at_a_tick(void) {
    expect_no_result("interrupted at a tick", "killed|result");
}

static void test_a_result_that_is_too_short(void) {
    expect_no_result("a result that is too short", "\"result\"|1 bytes");
}

static void test_a_message_of_ours(void) {
    expect_no_result("a tick", "\"tick\"|stepping");
}

static void test_more_messages_than_a_ring_holds(void) {
    char parts[32];
    (void)snprintf(parts, sizeof parts, "messages|%d", (int)TL_CHANNEL_DEPTH);
    expect_no_result("more than a ring", parts);
}

/* The recording has more ticks. */
static void test_it_ends_before_it_was_told_to(void) {
    expect_no_result("ended unasked", "killed|ended");
}

static void test_it_ends_unannounced(void) {
    expect_no_result("ends unannounced", "code|0");
    expect_no_call();
}

static void test_it_ends_with_a_reason(void) {
    bool stopped = false;
    start_liar("ended with a reason", 0, TL_OK);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_twin_child_build(child, &account, &error), error.text);
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, tl_twin_child_take(child, 0, 1, &result, &stopped, &error));
    TEST_ASSERT_EQUAL_STRING("no\tmemory", error.text);
}

static void test_it_ends_silently(void) {
    take_wrong("ended silently", 0);
    expect_text("FMU|ended");
}

static void test_a_step_that_fails(void) {
    take_wrong("a step fails with escapes", 0);
    TEST_ASSERT_EQUAL_STRING("in \\x1B]0;title\\x07 motor", error.text);
    TEST_ASSERT_EQUAL_INT64(0, result.tick);
}

static void test_a_step_that_fails_silently(void) {
    take_wrong("a step fails silently", 0);
    expect_text("FMU|step");
}

static void test_it_crashes_in_a_call(void) {
    expect_no_result("crashes in a call", "11|Segmentation fault|fmi2DoStep|mot\\x1B[1mor");
}

static void test_it_hangs_in_a_call(void) {
    take_wrong("hangs in a call", TL_SECOND / 5);
    expect_text("fmi2DoStep|motor");
    TEST_ASSERT_TRUE(tl_twin_child_is_gone(child));
}

/* A process with destroyed memory may report no call. */
static void test_it_does_nothing(void) {
    take_wrong("does nothing", TL_SECOND / 20);
    expect_text("killed|--call-limit");
    expect_no_call();
    TEST_ASSERT_TRUE(tl_twin_child_is_gone(child));
}

/* Its output is escaped, and each line is marked, so that it does not look like our log. */
static void test_what_it_prints(void) {
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    take_wrong("prints", 0);
    tl_twin_child_close(child);
    child = NULL;
    tl_stderr_expect("fmu: \\x1B[31mred\\x07\\x0D\n"
                     "twinlock: error: \\x1B[2J forged\n"
                     "fmu: no end\n");
    expect_text("code|3");
}

static void test_invalid_ways(void) {
    tl_twin_outcome tried;
    order.task = TL_TASK_METHODS;
    start_liar("ways that are none", 0, TL_OK);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_twin_child_finish(child, &tried, &error), error.text);
    TEST_ASSERT_EQUAL_STRING("", error.text);
    TEST_ASSERT_TRUE(tried.has_ended);
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, tried.status);
    TEST_ASSERT_LESS_THAN_UINT64(TL_ASSEMBLY_NAME, strlen(tried.ways.component));
    TEST_ASSERT_NULL(strchr(tried.ways.component, '\033'));
    TEST_ASSERT_EQUAL_UINT32(TL_ROLLBACK_NONE, tried.ways.of[0].rollback);
    TL_EXPECT_PARTS("code|3", tried.text);
}

static void test_an_invalid_pair(void) {
    tl_twin_outcome pair;
    order.task = TL_TASK_PAIR;
    start_liar("a pair that is none", 0, TL_OK);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_twin_child_finish(child, &pair, &error), error.text);
    TEST_ASSERT_TRUE(pair.has_ended);
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, pair.status);
    TEST_ASSERT_EQUAL_UINT32(TL_PAIR_STEPS, pair.pair.steps);
    TEST_ASSERT_LESS_THAN_UINT64(TL_PAIR_NAME, strlen(pair.pair.component));
    TEST_ASSERT_NULL(strchr(pair.pair.component, '\033'));
    TL_EXPECT_PARTS("code|3", pair.text);
}

/* The check does not end with its page. */
static void expect_check_fails(const char *lie, const char *why) {
    tl_twin_check found;
    order.task = TL_TASK_CHECK;
    start_liar(lie, 0, TL_OK);
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, tl_twin_child_check(child, &found, &error));
    expect_text(why);
    TEST_ASSERT_TRUE(tl_twin_child_is_gone(child));
}

static void test_a_result_in_a_check(void) {
    expect_check_fails("a result of another tick", "message");
}

/* Each further process does the same, and is killed. */
static void test_a_check_that_shows_without_end(void) {
    order.reads_back = true;
    expect_check_fails("shows without end", "killed|processes");
}

static void test_a_check_that_has_nothing_to_show(void) {
    expect_check_fails("shows without end", "killed|processes");
}

static void test_a_check_that_ends_unbuilt(void) {
    expect_check_fails("ended instead of built", "message");
}

static void be_role(const char *title) {
    static const char *const begin = "twin [" LIE;
    static const tl_twin_role_tasks tasks = {.print_page = print_page};
    char lie[96];
    if (strncmp(title, begin, strlen(begin)) == 0) {
        (void)snprintf(lie, sizeof lie, "%s", title + strlen(begin));
        lie[strcspn(lie, "]")] = '\0';
        be_liar(lie);
    }
    tl_process_end(tl_twin_role_run(&tasks));
}

int main(int argc, char **argv) {
    (void)argc;
    const char *title = tl_role_begin(argv);
    if (title != NULL) {
        be_role(title);
    }
    tl_scratch_make(&scratch, "/tmp", "twin_child");
    UNITY_BEGIN();
    RUN_TEST(test_it_is_given_ticks_and_ends);
    RUN_TEST(test_it_is_stopped_with_ticks_under_way);
    RUN_TEST(test_its_end_is_not_waited_for);
    RUN_TEST(test_a_check);
    RUN_TEST(test_a_check_with_a_negative_time);
    RUN_TEST(test_a_pair);
    RUN_TEST(test_an_invalid_pair);
    RUN_TEST(test_ways);
    RUN_TEST(test_invalid_ways);
    RUN_TEST(test_errors_of_building_are_logged);
    RUN_TEST(test_a_limit_of_years);
    RUN_TEST(test_it_ends_at_its_start);
    RUN_TEST(test_it_fails_at_its_start);
    RUN_TEST(test_a_result_before_it_is_built);
    RUN_TEST(test_ready_twice);
    RUN_TEST(test_ended_instead_of_built);
    RUN_TEST(test_an_account_of_another);
    RUN_TEST(test_an_account_without_end);
    RUN_TEST(test_its_last_account_is_apart);
    RUN_TEST(test_a_building_that_fails);
    RUN_TEST(test_its_texts_are_escaped);
    RUN_TEST(test_an_invalid_status);
    RUN_TEST(test_it_cannot_interrupt);
    RUN_TEST(test_built_twice);
    RUN_TEST(test_a_result_of_another_tick);
    RUN_TEST(test_it_cannot_interrupt_at_a_tick);
    RUN_TEST(test_a_result_that_is_too_short);
    RUN_TEST(test_a_message_of_ours);
    RUN_TEST(test_more_messages_than_a_ring_holds);
    RUN_TEST(test_it_ends_before_it_was_told_to);
    RUN_TEST(test_it_ends_unannounced);
    RUN_TEST(test_it_ends_with_a_reason);
    RUN_TEST(test_it_ends_silently);
    RUN_TEST(test_a_step_that_fails);
    RUN_TEST(test_a_step_that_fails_silently);
    RUN_TEST(test_it_crashes_in_a_call);
    RUN_TEST(test_it_hangs_in_a_call);
    RUN_TEST(test_it_does_nothing);
    RUN_TEST(test_what_it_prints);
    RUN_TEST(test_a_result_in_a_check);
    RUN_TEST(test_a_check_that_shows_without_end);
    RUN_TEST(test_a_check_that_has_nothing_to_show);
    RUN_TEST(test_a_check_that_ends_unbuilt);
    return tl_scratch_finish(&scratch, UNITY_END());
}
