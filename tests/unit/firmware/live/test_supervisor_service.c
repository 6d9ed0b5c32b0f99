/* The supervisor and a service manager that does not read: the supervisor does not wait, and
 * repeats its notifications. */
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/live/supervisor.h"
#include "firmware/process/service.h"
#include "tests/support/stage.h"

static tl_stage *stage;

void setUp(void) {
    tl_stage_set();
}

void tearDown(void) {
    tl_stage_clear();
}

static char notify_path[64];

/* Returns a full socket that is not read. */
static int fill_notify_socket(void) {
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    (void)snprintf(notify_path, sizeof notify_path, "/tmp/twinlock-notify-%d", (int)getpid());
    (void)snprintf(address.sun_path, sizeof address.sun_path, "%s", notify_path);
    (void)unlink(notify_path);
    int socket_ = socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK, 0);
    int sender = socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK, 0);
    TEST_ASSERT_EQUAL_INT(0, bind(socket_, (struct sockaddr *)&address, sizeof address));
    while (sendto(sender, "X", 1, 0, (struct sockaddr *)&address, sizeof address) == 1) {
    }
    (void)close(sender);
    TEST_ASSERT_EQUAL_INT(0, setenv("NOTIFY_SOCKET", notify_path, 1));
    return socket_;
}

/* The hanging child may take all of the service manager's processor time. */
static void test_nobody_waits_for_the_service_manager(void) {
    int socket_ = fill_notify_socket();
    tl_stage_expect_code("h0", 0);
    (void)close(socket_);
    (void)unlink(notify_path);
}

static bool receives(int socket_, const char *wanted) {
    char text[TL_HEARTBEAT_STATUS] = "";
    for (int i = 0; i < 500; i++) {
        ssize_t size = recv(socket_, text, sizeof text - 1, 0);
        text[size < 0 ? 0 : size] = '\0';
        if (strcmp(text, wanted) == 0) {
            return true;
        }
        tl_stage_pause_ms(size < 0 ? 10 : 0);
    }
    return false;
}

/* systemd ends a service that never reports READY. */
static void test_ready_is_told_until_it_is_heard(void) {
    int socket_ = fill_notify_socket();
    (void)setenv("WATCHDOG_USEC", "100000000", 1);
    pid_t self = getpid();
    pid_t manager = fork();
    if (manager == 0) {
        tl_stage_pause_ms(500);
        bool received = receives(socket_, "READY=1");
        (void)kill(self, SIGTERM);
        _exit(received ? 0 : 1);
    }
    tl_stage_expect_code("w", 0);
    int how = 1;
    TEST_ASSERT_EQUAL_INT(manager, waitpid(manager, &how, 0));
    (void)close(socket_);
    (void)unlink(notify_path);
    TEST_ASSERT_EQUAL_INT64(100 * TL_SECOND, tl_service_watchdog_period());
    (void)setenv("WATCHDOG_PID", "1", 1);
    TEST_ASSERT_EQUAL_INT64(0, tl_service_watchdog_period());
    (void)unsetenv("WATCHDOG_PID");
    TEST_ASSERT_EQUAL_INT(0, how);
}

static void order_a_config_manager(bool ends, tl_orders *orders) {
    (void)ends;
    orders->config_manager = true;
}

/* The twin has ended in order, and a deaf config manager lives for 2 s more. A shorter watchdog
 * timeout must not reset the box. */
static void test_strokes_go_on_until_all_have_ended(void) {
    int socket_ = fill_notify_socket();
    (void)setenv("WATCHDOG_USEC", "400000", 1);
    tl_stage_cast(TL_MEMBER_CONFIG_MANAGER, "b");
    stage->play_on = order_a_config_manager;
    pid_t self = getpid();
    pid_t manager = fork();
    if (manager == 0) {
        bool received = receives(socket_, "READY=1");
        for (int i = 0; i < 1000 && !tl_stage_is_ready(TL_MEMBER_CONFIG_MANAGER); i++) {
            tl_stage_pause_ms(receives(socket_, "WATCHDOG=1") ? 0 : 10);
        }
        (void)kill(self, SIGTERM);
        received = received && receives(socket_, "STOPPING=1");
        for (int i = 0; i < 8; i++) { /* 20 keepalives are due in 2 s */
            received = received && receives(socket_, "WATCHDOG=1");
        }
        _exit(received ? 0 : 1);
    }
    tl_stage_expect_code("w", 0);
    int how = 1;
    TEST_ASSERT_EQUAL_INT(manager, waitpid(manager, &how, 0));
    (void)close(socket_);
    (void)unlink(notify_path);
    if (tl_service_watchdog_period() == 0) {
        TEST_IGNORE_MESSAGE("built without libsystemd");
    }
    TEST_ASSERT_EQUAL_INT(0, how);
}

int main(void) {
    UNITY_BEGIN();
    stage = tl_stage_open(TL_BINARY_DIR, "test_supervisor_service");
    RUN_TEST(test_nobody_waits_for_the_service_manager);
    RUN_TEST(test_ready_is_told_until_it_is_heard);
    RUN_TEST(test_strokes_go_on_until_all_have_ended);
    return tl_stage_close(UNITY_END());
}
