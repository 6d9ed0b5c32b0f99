/* Control socket: requests and replies arrive complete or not at all, also from a faulty peer. */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/retune/control.h"
#include "tests/support/scratch.h"

static const char text[] = "{\"name\": \"motor\"}";
static const tl_time SOON = TL_SECOND;

static tl_scratch scratch; /* in /tmp, because a socket's path is short */
static char plant[96];
static char path[128];
static int listener;
static int client;
static tl_control_peer peer;
static tl_error error;
static char taken[TL_CONTROL_MOST + 1];
static size_t size;

static size_t open_descriptors(void) {
    size_t count = 0;
    DIR *list = opendir("/proc/self/fd");
    if (list == NULL) {
        return 0;
    }
    while (readdir(list) != NULL) {
        count++;
    }
    (void)closedir(list);
    return count;
}

void setUp(void) {
    (void)snprintf(plant, sizeof plant, "%.64s/motor", scratch.folder);
    (void)snprintf(path, sizeof path, "%s/%s", plant, TL_CONTROL_SOCKET);
    peer = (tl_control_peer){.socket = -1};
    client = -1;
    size = 0;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_control_listen(path, &listener, &error));
}

void tearDown(void) {
    tl_control_close(&peer);
    if (client >= 0) {
        (void)close(client);
    }
    if (listener >= 0) {
        (void)close(listener);
    }
    (void)unlink(path);
    (void)rmdir(plant);
}

static void meet(void) {
    TEST_ASSERT_FALSE(tl_control_has_connection(listener));
    TEST_ASSERT_FALSE(tl_control_accept(listener, &peer));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_control_connect(path, &client, &error));
    TEST_ASSERT_TRUE(tl_control_has_connection(listener));
    TEST_ASSERT_TRUE(tl_control_accept(listener, &peer));
}

static tl_control_request good_request(tl_control_verb verb) {
    tl_control_request request;
    memset(&request, 0, sizeof request);
    request.protocol = TL_CONTROL_PROTOCOL;
    request.verb = (uint32_t)verb;
    request.require_lock = -1.0;
    (void)snprintf(request.who, sizeof request.who, "Zoë");
    return request;
}

static tl_control_event receive(tl_control_request *request) {
    return tl_control_receive(&peer, request, taken, &size);
}

/* The request is refused, and the client receives the refusal. */
static void assert_refused(void) {
    tl_control_request request;
    tl_control_reply reply;
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_CLOSED, receive(&request));
    TEST_ASSERT_EQUAL_INT(-1, peer.socket);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_control_next(client, SOON, &reply, NULL, &error));
    TEST_ASSERT_EQUAL_UINT(TL_CONTROL_END, reply.kind);
    TEST_ASSERT_EQUAL_UINT(TL_CONTROL_BAD, reply.as.end.result);
    TEST_ASSERT_EQUAL_INT(TL_PLANT_DOWN, tl_control_next(client, SOON, &reply, NULL, &error));
    (void)close(client);
    client = -1;
}

/* ---- valid requests ---- */

static void test_a_candidate_arrives(void) {
    tl_control_request sent = good_request(TL_CONTROL_APPLY);
    tl_control_request request;
    meet();
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_NOTHING, receive(&request));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_control_ask(client, &sent, text, strlen(text), &error));
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_REQUEST, receive(&request));
    TEST_ASSERT_EQUAL_size_t(strlen(text), size);
    TEST_ASSERT_EQUAL_STRING(text, taken);
    TEST_ASSERT_EQUAL_STRING("Zoë", request.who);
}

static void test_the_largest_candidate_arrives(void) {
    tl_control_request sent = good_request(TL_CONTROL_APPLY);
    tl_control_request request;
    char *large = malloc(TL_CONTROL_MOST);
    TEST_ASSERT_NOT_NULL(large);
    memset(large, 'x', TL_CONTROL_MOST);
    meet();
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_control_ask(client, &sent, large, TL_CONTROL_MOST, &error));
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_REQUEST, receive(&request));
    TEST_ASSERT_EQUAL_size_t(TL_CONTROL_MOST, size);
    TEST_ASSERT_EQUAL_MEMORY(large, taken, TL_CONTROL_MOST);
    free(large);
}

static void test_replies_arrive_in_order(void) {
    tl_control_request request = good_request(TL_CONTROL_READ);
    tl_control_reply reply = tl_control_new_reply(TL_CONTROL_CONFIGURATION);
    reply.as.version.version = 7;
    reply.more = (uint32_t)strlen(text);
    tl_control_reply sent = reply;
    meet();
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_control_ask(client, &request, NULL, 0, &error));
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_REQUEST, receive(&request));
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, tl_control_next(client, 0, &reply, taken, &error));
    TEST_ASSERT_TRUE(tl_control_send(&peer, &sent, text));
    tl_control_finish(&peer, TL_CONTROL_DONE, 7, "", "there it is");
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_control_next(client, SOON, &reply, taken, &error));
    TEST_ASSERT_EQUAL_UINT(TL_CONTROL_CONFIGURATION, reply.kind);
    TEST_ASSERT_EQUAL_STRING(text, taken);
    TEST_ASSERT_EQUAL_UINT64(7, reply.as.version.version);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_control_next(client, SOON, &reply, taken, &error));
    TEST_ASSERT_EQUAL_UINT(TL_CONTROL_END, reply.kind);
    TEST_ASSERT_EQUAL_STRING("there it is", reply.as.end.text);
    TEST_ASSERT_EQUAL_INT(TL_PLANT_DOWN, tl_control_next(client, SOON, &reply, taken, &error));
}

/* ---- invalid requests ---- */

static void assert_garbage(const void *bytes, size_t length, const char *with, size_t with_length) {
    meet();
    TEST_ASSERT_TRUE(tl_control_packet_send(client, bytes, length, with, with_length));
    assert_refused();
}

static void test_other_sizes_are_no_requests(void) {
    static const size_t lengths[] = {1, sizeof(tl_control_request) - 1, sizeof(tl_control_request) + 1, 100000};
    char *bytes = calloc(1, 100000);
    TEST_ASSERT_NOT_NULL(bytes);
    for (size_t i = 0; i < sizeof lengths / sizeof lengths[0]; i++) {
        assert_garbage(bytes, lengths[i], NULL, 0);
    }
    free(bytes);
}

static void test_numbers_that_do_not_exist(void) {
    tl_control_request bad[9];
    for (size_t i = 0; i < 9; i++) {
        bad[i] = good_request(TL_CONTROL_SHOW);
    }
    bad[0].protocol = 99;
    bad[1].verb = TL_CONTROL_VERBS;
    bad[2].right = TL_RIGHT_BOX;
    bad[3].origin = TL_ORIGIN_START;
    bad[4].flags = TL_CONTROL_FLAGS + 1;
    bad[5].require_lock = (double)NAN;
    bad[6].require_lock = 100.5;
    memset(bad[7].hash, 'a', sizeof bad[7].hash);
    (void)snprintf(bad[8].if_match, sizeof bad[8].if_match, "abc");
    for (size_t i = 0; i < 9; i++) {
        assert_garbage(&bad[i], sizeof bad[i], NULL, 0);
    }
}

static void test_words_that_are_not_clean(void) {
    tl_control_request request = good_request(TL_CONTROL_SHOW);
    (void)snprintf(request.who, sizeof request.who, "a\x1b[2J");
    assert_garbage(&request, sizeof request, NULL, 0);
    request = good_request(TL_CONTROL_SHOW);
    (void)snprintf(request.why, sizeof request.why, "one line\nanother");
    assert_garbage(&request, sizeof request, NULL, 0);
    request = good_request(TL_CONTROL_SHOW);
    memset(request.why, 'w', sizeof request.why);
    assert_garbage(&request, sizeof request, NULL, 0);
}

static void test_a_candidate_must_be_the_one_that_is_named(void) {
    tl_control_request request = good_request(TL_CONTROL_APPLY);
    tl_sha256("other", 5, request.hash);
    assert_garbage(&request, sizeof request, text, strlen(text));
    assert_garbage(&request, sizeof request, NULL, 0);
    request = good_request(TL_CONTROL_SHOW);
    tl_sha256(text, strlen(text), request.hash);
    assert_garbage(&request, sizeof request, text, strlen(text));
}

static void test_one_request_for_each_connection(void) {
    tl_control_request request = good_request(TL_CONTROL_SHOW);
    meet();
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_control_ask(client, &request, NULL, 0, &error));
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_REQUEST, receive(&request));
    request = good_request(TL_CONTROL_SHOW);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_control_ask(client, &request, NULL, 0, &error));
    assert_refused();
}

/* ---- foreign descriptors ---- */

/* Sends a request with these descriptors. */
static void send_with(const int *descriptors, size_t count) {
    tl_control_request request = good_request(TL_CONTROL_APPLY);
    union {
        struct cmsghdr header;
        char bytes[CMSG_SPACE(16 * sizeof(int))];
    } room = {.header = {0}};
    tl_sha256(text, strlen(text), request.hash);
    struct iovec part = {.iov_base = &request, .iov_len = sizeof request};
    struct msghdr message = {.msg_iov = &part,
                             .msg_iovlen = 1,
                             .msg_control = room.bytes,
                             .msg_controllen = CMSG_SPACE(count * sizeof(int))};
    struct cmsghdr *header = CMSG_FIRSTHDR(&message);
    header->cmsg_level = SOL_SOCKET;
    header->cmsg_type = SCM_RIGHTS;
    header->cmsg_len = CMSG_LEN(count * sizeof(int));
    memcpy(CMSG_DATA(header), descriptors, count * sizeof(int));
    TEST_ASSERT_EQUAL_INT(sizeof request, sendmsg(client, &message, MSG_NOSIGNAL));
}

static void assert_descriptors_are_refused(const int *descriptors, size_t count) {
    meet();
    size_t before = open_descriptors();
    send_with(descriptors, count);
    assert_refused();
    TEST_ASSERT_EQUAL_size_t(before - 2, open_descriptors()); /* the two ends */
}

/* Such a file could be slow, change during the read, or end the reader by a signal. */
static void test_only_plain_memory_is_read(void) {
    int pipe_[2];
    int empty = memfd_create("empty", MFD_CLOEXEC);
    int large = memfd_create("large", MFD_CLOEXEC);
    int root = open("/", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    int process = open("/proc/self/status", O_RDONLY | O_CLOEXEC);
    TEST_ASSERT_EQUAL_INT(0, pipe2(pipe_, O_CLOEXEC));
    TEST_ASSERT_EQUAL_INT(0, ftruncate(large, TL_CONTROL_MOST + 1));
    const int strangers[] = {pipe_[0], empty, large, root, process, listener};
    for (size_t i = 0; i < sizeof strangers / sizeof strangers[0]; i++) {
        assert_descriptors_are_refused(&strangers[i], 1);
    }
    for (size_t i = 0; i < 5; i++) {
        (void)close(strangers[i]);
    }
    (void)close(pipe_[1]);
}

static void test_many_descriptors_are_closed(void) {
    int many[16];
    for (size_t i = 0; i < 16; i++) {
        many[i] = listener;
    }
    assert_descriptors_are_refused(many, 2);
    assert_descriptors_are_refused(many, 16);
}

/* ---- clients that do not receive ---- */

static void test_a_client_that_takes_nothing_is_given_up(void) {
    tl_control_reply reply;
    memset(&reply, 0, sizeof reply);
    int sent = 0;
    meet();
    while (sent < 100000 && tl_control_send(&peer, &reply, NULL)) {
        sent++;
    }
    TEST_ASSERT_LESS_THAN_INT(100000, sent);
    TEST_ASSERT_EQUAL_INT(-1, peer.socket);
    TEST_ASSERT_FALSE(tl_control_send(&peer, &reply, NULL));
}

static void test_a_client_that_is_gone(void) {
    tl_control_request request;
    meet();
    (void)close(client);
    client = -1;
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_CLOSED, receive(&request));
    TEST_ASSERT_EQUAL_INT(-1, peer.socket);
}

/* ---- invalid replies ---- */

static void test_replies_that_are_none(void) {
    tl_control_reply reply;
    memset(&reply, 0xff, sizeof reply);
    meet();
    TEST_ASSERT_TRUE(tl_control_send(&peer, &reply, NULL));
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_control_next(client, SOON, &reply, taken, &error));
    memset(&reply, 0xff, sizeof reply);
    reply.kind = TL_CONTROL_PROBLEM;
    TEST_ASSERT_TRUE(tl_control_send(&peer, &reply, NULL));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_control_next(client, SOON, &reply, taken, &error));
    TEST_ASSERT_EQUAL_size_t(TL_CONTROL_TEXT - 1, strlen(reply.as.problem.text));
    reply.kind = TL_CONTROL_CONFIGURATION;
    TEST_ASSERT_TRUE(tl_control_send(&peer, &reply, NULL));
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_control_next(client, SOON, &reply, taken, &error));
}

/* ---- the socket itself ---- */

static void test_a_dead_socket_is_replaced_and_a_living_one_is_not(void) {
    int second = -1;
    struct stat about;
    TEST_ASSERT_EQUAL_INT(0, stat(path, &about));
    TEST_ASSERT_EQUAL_UINT(0660, about.st_mode & 0777);
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, tl_control_listen(path, &second, &error));
    TEST_ASSERT_EQUAL_INT(-1, second);
    (void)close(listener);
    TEST_ASSERT_EQUAL_INT(TL_PLANT_DOWN, tl_control_connect(path, &client, &error));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_control_listen(path, &listener, &error));
    meet();
}

static void test_a_file_in_its_place_stays(void) {
    (void)close(listener);
    listener = -1;
    (void)unlink(path);
    int file = open(path, O_CREAT | O_WRONLY | O_CLOEXEC, 0600);
    TEST_ASSERT_GREATER_OR_EQUAL_INT(0, file);
    (void)close(file);
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, tl_control_listen(path, &listener, &error));
    TEST_ASSERT_EQUAL_INT(0, access(path, F_OK));
}

static void test_names_that_lead_nowhere(void) {
    char long_name[300];
    int none = -1;
    memset(long_name, 'x', sizeof long_name - 1);
    long_name[sizeof long_name - 1] = '\0';
    TEST_ASSERT_EQUAL_INT(TL_BAD_USAGE, tl_control_listen(long_name, &none, &error));
    TEST_ASSERT_EQUAL_INT(TL_PLANT_DOWN, tl_control_connect(long_name, &none, &error));
    TEST_ASSERT_EQUAL_INT(TL_PLANT_DOWN, tl_control_connect("/nowhere/at/all", &none, &error));
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, tl_control_listen("/nowhere/at/all", &none, &error));
}

static void test_words(void) {
    tl_change_right right = TL_RIGHT_BOX;
    for (unsigned i = 0; i < TL_RIGHT_BOX; i++) {
        TEST_ASSERT_TRUE(tl_change_right_of(tl_change_rights[i], &right));
        TEST_ASSERT_EQUAL_UINT(i, right);
    }
    TEST_ASSERT_FALSE(tl_change_right_of("root", &right));
    TEST_ASSERT_FALSE(tl_change_right_of(tl_change_rights[TL_RIGHT_BOX], &right));
    for (unsigned i = 0; i < TL_CONTROL_STEPS; i++) {
        TEST_ASSERT_NOT_NULL(tl_control_step_name((tl_control_step)i));
    }
    for (unsigned i = 0; i < TL_CONTROL_RESULTS; i++) {
        TEST_ASSERT_NOT_NULL(tl_control_result_name((tl_control_result)i));
    }
    for (unsigned i = 0; i < TL_ORIGINS; i++) {
        TEST_ASSERT_NOT_NULL(tl_change_origins[i]);
    }
}

int main(void) {
    tl_scratch_make(&scratch, "/tmp", "control");
    UNITY_BEGIN();
    RUN_TEST(test_a_candidate_arrives);
    RUN_TEST(test_the_largest_candidate_arrives);
    RUN_TEST(test_replies_arrive_in_order);
    RUN_TEST(test_other_sizes_are_no_requests);
    RUN_TEST(test_numbers_that_do_not_exist);
    RUN_TEST(test_words_that_are_not_clean);
    RUN_TEST(test_a_candidate_must_be_the_one_that_is_named);
    RUN_TEST(test_one_request_for_each_connection);
    RUN_TEST(test_only_plain_memory_is_read);
    RUN_TEST(test_many_descriptors_are_closed);
    RUN_TEST(test_a_client_that_takes_nothing_is_given_up);
    RUN_TEST(test_a_client_that_is_gone);
    RUN_TEST(test_replies_that_are_none);
    RUN_TEST(test_a_dead_socket_is_replaced_and_a_living_one_is_not);
    RUN_TEST(test_a_file_in_its_place_stays);
    RUN_TEST(test_names_that_lead_nowhere);
    RUN_TEST(test_words);
    return tl_scratch_finish(&scratch, UNITY_END());
}
