/* System calls of a server that listens already. It can connect to local sockets only. */
#include "firmware/process/confine.h"

#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <unity.h>

#include "tests/support/confined.h"
#include "tests/support/scratch.h"

static tl_scratch scratch;
static tl_confined confined;

void setUp(void) {
    tl_confine_facts facts;
    tl_confine_probe(&facts);
    if (!facts.filter) {
        TEST_IGNORE_MESSAGE("no seccomp");
    }
}

void tearDown(void) {
    tl_scratch_empty(&scratch);
}

static void expect(tl_confined_body *body, void *context) {
    const tl_confine_settings settings = {
        .folder = scratch.folder, .whole_process = true, .is_server = true, .only_denies = true};
    tl_confined_run(settings, body, context, &confined);
    TEST_ASSERT_EQUAL_INT(0, confined.signal);
    TEST_ASSERT_TRUE(confined.succeeded);
}

static bool answer_and_ask(void *context) {
    const int *listener = context;

    char byte = 'a';
    int memory = memfd_create("text", MFD_CLOEXEC | MFD_ALLOW_SEALING);
    struct sockaddr_un nobody = {.sun_family = AF_UNIX, .sun_path = "nobody"};
    int local = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0);

    return TL_EXPECT(accept4(*listener, NULL, NULL, SOCK_CLOEXEC | SOCK_NONBLOCK) >= 0) && TL_EXPECT(local >= 0) &&
           TL_EXPECT(connect(local, (const struct sockaddr *)&nobody, sizeof nobody) == -1 && errno == ENOENT) &&
           TL_EXPECT(memory >= 0 && write(memory, &byte, 1) == 1) &&
           TL_EXPECT(fcntl(memory, F_ADD_SEALS, F_SEAL_WRITE | F_SEAL_SEAL) == 0);
}

/* A listener with a client that waits for accept(). */
static void a_server_accepts_and_asks_local_sockets(void) {
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    socklen_t size = sizeof address;
    int listener = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    int client = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    TEST_ASSERT_EQUAL_INT(0, bind(listener, (struct sockaddr *)&address, sizeof address));
    TEST_ASSERT_EQUAL_INT(0, listen(listener, 1));
    TEST_ASSERT_EQUAL_INT(0, getsockname(listener, (struct sockaddr *)&address, &size));
    TEST_ASSERT_EQUAL_INT(0, connect(client, (struct sockaddr *)&address, size));
    expect(answer_and_ask, &listener);
    TEST_ASSERT_EQUAL_size_t(0, confined.refusal_count);
    (void)close(client);
    (void)close(listener);
}

static bool reach_out(void *context) {
    static const int families[] = {AF_INET, AF_INET6, AF_NETLINK, AF_PACKET, AF_CAN};
    struct sockaddr_un name = {.sun_family = AF_UNIX, .sun_path = "mine"};
    int local = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    bool is_refused = true;
    (void)context;
    for (size_t i = 0; i < sizeof families / sizeof families[0]; i++) {
        is_refused = is_refused && TL_EXPECT(tl_confined_has_no_socket(families[i], SOCK_STREAM, 0)) &&
                     TL_EXPECT(tl_confined_has_no_socket(families[i], SOCK_DGRAM, 0));
    }
    return is_refused && TL_EXPECT(bind(local, (const struct sockaddr *)&name, sizeof name) == -1 && errno == EPERM) &&
           TL_EXPECT(listen(local, 1) == -1 && errno == EPERM) &&
           TL_EXPECT(execl("/bin/true", "true", (char *)NULL) == -1 && errno == EPERM) &&
           TL_EXPECT(fork() == -1 && errno == EPERM) && TL_EXPECT(kill(getppid(), SIGTERM) == -1 && errno == EPERM);
}

static void a_server_reaches_nobody_else(void) {
    expect(reach_out, NULL);
}

static bool read_configuration(void *context) {
    FILE *file = fopen("/etc/passwd", "re");
    int cause = errno;
    (void)context;
    if (file != NULL) {
        (void)fclose(file);
    }
    return TL_EXPECT(file == NULL && cause == EACCES);
}

static void a_server_reads_listed_files_only(void) {
    tl_confine_facts facts;
    tl_confine_probe(&facts);
    if (facts.landlock == 0) {
        TEST_IGNORE_MESSAGE("no Landlock");
    }
    expect(read_configuration, NULL);
}

int main(void) {
    UNITY_BEGIN();
    tl_scratch_make(&scratch, "/tmp", "tl_server_calls");
    RUN_TEST(a_server_accepts_and_asks_local_sockets);
    RUN_TEST(a_server_reaches_nobody_else);
    RUN_TEST(a_server_reads_listed_files_only);
    return tl_scratch_finish(&scratch, UNITY_END());
}
