/* Lock of the recording process: one process at a time. A child that an FMU has forked does not
 * hold the lock. */
#include "firmware/store/database_file.h"

#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include <unity.h>

#include "tests/support/message.h"
#include "tests/support/scratch.h"

static tl_scratch scratch;
static char path[512];
static tl_error error;

void setUp(void) {
    tl_scratch_make(&scratch, "/tmp", "recorder_lock");
    (void)snprintf(path, sizeof path, "%s", tl_scratch_path(&scratch, "run.db"));
    error = (tl_error){TL_OK, ""};
}

void tearDown(void) {
    tl_scratch_empty(&scratch);
    tl_scratch_remove(&scratch);
}

static void one_at_a_time(void) {
    tl_database_lock first = {.path = ""};
    tl_database_lock second = {.path = ""};
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_database_lock_take(path, TL_SECOND / 5, &first, &error), error.text);
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, tl_database_lock_take(path, TL_SECOND / 5, &second, &error));
    char process[40];
    (void)snprintf(process, sizeof process, "/run.db|twinlock|process %d", (int)getpid());
    TL_EXPECT_PARTS(process, error.text);
    tl_database_lock_release(&first);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_database_lock_take(path, TL_SECOND / 5, &second, &error), error.text);
    tl_database_lock_release(&second);
}

/* The owner takes the lock, forks, sends its child's process number, and is killed. */
static void own_and_die(int own_pipe) {
    tl_database_lock lock = {.path = ""};
    if (tl_database_lock_take(path, TL_SECOND / 5, &lock, &error) == TL_OK) {
        pid_t stray = fork();
        if (stray == 0) {
            (void)pause();
            _exit(0);
        }
        if (write(own_pipe, &stray, sizeof stray) == (ssize_t)sizeof stray) {
            (void)raise(SIGKILL);
        }
    }
    _exit(1);
}

static void a_child_of_a_dead_owner_holds_no_lock(void) {
    int own_pipe[2];
    int how = 0;
    pid_t stray = 0;
    tl_database_lock lock = {.path = ""};
    TEST_ASSERT_EQUAL_INT(0, pipe(own_pipe));
    pid_t owner = fork();
    if (owner == 0) {
        own_and_die(own_pipe[1]);
    }
    TEST_ASSERT_EQUAL_INT(owner, waitpid(owner, &how, 0));
    TEST_ASSERT_TRUE(WIFSIGNALED(how));
    TEST_ASSERT_EQUAL_INT(sizeof stray, read(own_pipe[0], &stray, sizeof stray));
    tl_status status = tl_database_lock_take(path, TL_SECOND / 5, &lock, &error);
    TEST_ASSERT_EQUAL_INT(0, kill(stray, SIGKILL));
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, status, error.text);
    tl_database_lock_release(&lock);
    (void)close(own_pipe[0]);
    (void)close(own_pipe[1]);
}

/* If an owner's lock file was removed, the owner does not remove the lock file of the next
 * owner. */
static void a_lock_that_was_removed(void) {
    tl_database_lock first = {.path = ""};
    tl_database_lock second = {.path = ""};
    tl_database_lock third = {.path = ""};
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_database_lock_take(path, 0, &first, &error), error.text);
    TEST_ASSERT_EQUAL_INT(0, unlink(first.path));
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_database_lock_take(path, 0, &second, &error), error.text);
    tl_database_lock_release(&first);
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, tl_database_lock_take(path, 0, &third, &error));
    tl_database_lock_release(&second);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(one_at_a_time);
    RUN_TEST(a_lock_that_was_removed);
    RUN_TEST(a_child_of_a_dead_owner_holds_no_lock);
    return UNITY_END();
}
