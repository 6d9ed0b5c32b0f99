/* Another process gets the names and arguments of refused system calls. */
#include "firmware/process/refusal.h"

#include <errno.h>
#include <poll.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/process/confine.h"
#include "tests/support/confined.h"

static tl_confined confined;

void setUp(void) {}

void tearDown(void) {}

static bool ask_for_socket(void *context) {
    (void)context;
    return TL_EXPECT(tl_confined_has_no_socket(AF_INET6, SOCK_DGRAM, 17)) &&
           TL_EXPECT(syscall(433, 1L, 2L, 3L, 4L, 5L, 6L) == -1 && errno == EPERM) && /* fspick */
           TL_EXPECT(syscall(0x7fffff) == -1 && errno == EPERM);
}

static void need_notifications(void) {
    tl_confine_facts facts;
    tl_confine_probe(&facts);
    if (!facts.notifies) {
        TEST_IGNORE_MESSAGE("this kernel does not tell of refused calls");
    }
}

static void a_refused_call_is_named(void) {
    const tl_confine_settings settings = {0};
    need_notifications();
    tl_confined_run(settings, ask_for_socket, NULL, &confined);
    TEST_ASSERT_TRUE(confined.succeeded);
    TEST_ASSERT_EQUAL_size_t(3, confined.refusal_count);
    TEST_ASSERT_EQUAL_STRING("socket", confined.refusals[0].name);
    TEST_ASSERT_EQUAL_STRING("fspick", confined.refusals[1].name);
    TEST_ASSERT_EQUAL_STRING("call 8388607", confined.refusals[2].name);
}

/* A thread with its own filter, which requests a socket. */
typedef struct asker {
    sem_t listens;
    int listener;
    bool continues;
    bool refused;
} asker;

static void *ask_in_thread(void *context) {
    const tl_confine_settings settings = {.start_socket = -1};
    asker *self = context;
    tl_error error;
    if (tl_filter_load(&settings, &self->listener, &error) != TL_OK) {
        self->listener = -1;
    }
    (void)sem_post(&self->listens);
    self->refused = tl_confined_has_no_socket(AF_INET, SOCK_STREAM, 0);
    __atomic_store_n(&self->continues, true, __ATOMIC_SEQ_CST);
    return NULL;
}

/* The caller waits for the answer, so there is time to read its arguments. */
static void the_caller_stands_still_until_it_is_answered(void) {
    static asker self;
    pthread_t thread;
    tl_refusal refusal;
    need_notifications();
    TEST_ASSERT_EQUAL_INT(0, sem_init(&self.listens, 0, 0));
    TEST_ASSERT_EQUAL_INT(0, pthread_create(&thread, NULL, ask_in_thread, &self));
    TEST_ASSERT_EQUAL_INT(0, sem_wait(&self.listens));
    struct pollfd waiting = {.fd = self.listener, .events = POLLIN};
    TEST_ASSERT_EQUAL_INT(1, poll(&waiting, 1, 10000));
    TEST_ASSERT_TRUE(tl_refusal_take(self.listener, &refusal));
    TEST_ASSERT_FALSE(tl_refusal_take(self.listener, &refusal)); /* reported once, also if not answered yet */
    (void)poll(NULL, 0, 50);
    bool went_on = __atomic_load_n(&self.continues, __ATOMIC_SEQ_CST);
    tl_refusal_answer(self.listener, &refusal);
    (void)pthread_join(thread, NULL);
    tl_refusal_answer(self.listener, &refusal); /* a second answer: the caller is gone */
    (void)close(self.listener);
    TEST_ASSERT_FALSE(went_on);
    TEST_ASSERT_TRUE(self.refused);
}

static bool end_while_waiting(void *context) {
    (void)alarm(1); /* ends the process, refused or not */
    while (context == NULL) {
        (void)tl_confined_has_no_socket(AF_INET, SOCK_STREAM, 0);
    }
    return true;
}

static void a_process_that_ends_meanwhile_is_no_trouble(void) {
    const tl_confine_settings settings = {0};
    need_notifications();
    tl_confined_run(settings, end_while_waiting, NULL, &confined);
    TEST_ASSERT_EQUAL_INT(14, confined.signal);
    TEST_ASSERT_TRUE(confined.refusal_count > 10);
}

static void where_there_is_no_listener_there_is_nothing_to_take(void) {
    tl_refusal refusal;
    int pipes[2];
    TEST_ASSERT_FALSE(tl_refusal_take(-1, &refusal));
    TEST_ASSERT_EQUAL_INT(0, pipe(pipes));
    TEST_ASSERT_EQUAL_INT(1, write(pipes[1], "a", 1));
    TEST_ASSERT_FALSE(tl_refusal_take(pipes[0], &refusal)); /* a descriptor of another kind */
    (void)close(pipes[0]);
    (void)close(pipes[1]);
}

/* A call that Python makes during import is not the cause of a later failure. */
static void only_the_failed_call_has_a_cause(void) {
    static tl_fmu_refusals refusals;
    static tl_fmu_calls calls;
    const tl_refusal refusal = {.name = "socket"};
    tl_fmu_calls_use(&calls);
    uint32_t fmu = tl_fmu_calls_name("motor");
    tl_fmu_call_begin(fmu, TL_FMU_INSTANTIATE);
    TEST_ASSERT_TRUE(tl_fmu_refusals_note(&refusals, &refusal, &calls));
    TEST_ASSERT_TRUE(tl_fmu_refusals_may_be_cause(&refusals, &calls)); /* the FMU may have crashed in this call */
    tl_fmu_call_fail();
    tl_fmu_call_end();
    TEST_ASSERT_TRUE(tl_fmu_refusals_may_be_cause(&refusals, &calls));
    tl_fmu_call_begin(fmu, TL_FMU_DO_STEP);
    TEST_ASSERT_FALSE(tl_fmu_refusals_may_be_cause(&refusals, &calls));
    TEST_ASSERT_FALSE(tl_fmu_refusals_note(&refusals, &refusal, &calls)); /* noted before */
    TEST_ASSERT_TRUE(tl_fmu_refusals_may_be_cause(&refusals, &calls));
    tl_fmu_call_end();
    TEST_ASSERT_FALSE(tl_fmu_refusals_may_be_cause(&refusals, &calls));
    TEST_ASSERT_TRUE(tl_fmu_refusals_note(&refusals, &refusal, &calls)); /* by a thread, outside a call */
    TEST_ASSERT_TRUE(tl_fmu_refusals_may_be_cause(&refusals, &calls));
    tl_fmu_calls_use(NULL);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(a_refused_call_is_named);
    RUN_TEST(a_process_that_ends_meanwhile_is_no_trouble);
    RUN_TEST(only_the_failed_call_has_a_cause);
    RUN_TEST(where_there_is_no_listener_there_is_nothing_to_take);
    RUN_TEST(the_caller_stands_still_until_it_is_answered); /* last: libseccomp listens once per process */
    return UNITY_END();
}
