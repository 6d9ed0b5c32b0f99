/* A dialogue with a simulated plant: the state of the answer, and the limit of buffered bytes. */
#include "firmware/serve/dialogue.h"

#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/retune/control.h"
#include "tests/support/scratch.h"

static tl_scratch scratch;
static tl_dialogue dialogue;
static tl_control_peer peer;
static int listener;
static char room[TL_CONTROL_MOST + 1];

void setUp(void) {
    tl_error error;
    TEST_ASSERT_EQUAL_INT(0, mkdir(tl_scratch_path(&scratch, "motor"), 0700));
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        TL_OK, tl_control_listen(tl_scratch_path(&scratch, "motor/control"), &listener, &error), error.text);
    dialogue = (tl_dialogue){.socket = -1, .request = {.plant = "motor"}};
    peer = (tl_control_peer){.socket = -1};
}

void tearDown(void) {
    tl_dialogue_close(&dialogue);
    tl_control_close(&peer);
    (void)close(listener);
    (void)unlink(tl_scratch_path(&scratch, "motor/control"));
    (void)rmdir(tl_scratch_path(&scratch, "motor"));
}

/* Sends a request and lets the plant receive it. */
static void begin(tl_control_verb verb) {
    tl_control_request request;
    size_t size = 0;
    dialogue.request.control.verb = verb;
    dialogue.request.is_change = verb == TL_CONTROL_APPLY;
    if (verb == TL_CONTROL_APPLY) {
        dialogue.request.body = 2;
        TEST_ASSERT_TRUE(tl_dialogue_add_body(&dialogue, "{", 1));
        TEST_ASSERT_TRUE(tl_dialogue_add_body(&dialogue, "}", 1));
        TEST_ASSERT_FALSE(tl_dialogue_add_body(&dialogue, "x", 1));
    }
    tl_dialogue_begin(&dialogue, scratch.folder);
    TEST_ASSERT_TRUE(tl_control_accept(listener, &peer));
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_REQUEST, tl_control_receive(&peer, &request, room, &size));
    TEST_ASSERT_EQUAL_size_t(verb == TL_CONTROL_APPLY ? 2 : 0, size);
}

static void say(tl_control_kind kind, uint32_t step) {
    tl_control_reply reply;
    memset(&reply, 0, sizeof reply);
    reply.kind = kind;
    if (kind == TL_CONTROL_STEP) {
        reply.as.progress.step = step;
    }
    TEST_ASSERT_TRUE(tl_control_send(&peer, &reply, NULL));
}

static void follow(void) {
    tl_dialogue_follow(&dialogue, room);
}

static void a_change_is_decided_behind_its_validation(void) {
    begin(TL_CONTROL_APPLY);
    say(TL_CONTROL_STEP, TL_CONTROL_AUTHORISE);
    say(TL_CONTROL_STEP, TL_CONTROL_VALIDATE);
    say(TL_CONTROL_CHANGE, 0);
    follow();
    TEST_ASSERT_EQUAL_INT(0, dialogue.status);
    say(TL_CONTROL_STEP, TL_CONTROL_TRY);
    follow();
    TEST_ASSERT_EQUAL_INT(TL_HTTP_OK, dialogue.status);
    TEST_ASSERT_FALSE(dialogue.has_ended);
    tl_control_finish(&peer, TL_CONTROL_INVALID, 1, "", "too late for a status of its own");
    follow();
    TEST_ASSERT_EQUAL_INT(TL_HTTP_OK, dialogue.status);
    TEST_ASSERT_TRUE(dialogue.has_ended);
    TEST_ASSERT_EQUAL_STRING("invalid", dialogue.result);
}

static void a_refusal_has_all_its_problems(void) {
    begin(TL_CONTROL_APPLY);
    say(TL_CONTROL_PROBLEM, 0);
    say(TL_CONTROL_PROBLEM, 0);
    tl_control_finish(&peer, TL_CONTROL_INVALID, 1, "", "two");
    follow();
    TEST_ASSERT_EQUAL_INT(TL_HTTP_INVALID, dialogue.status);
    TEST_ASSERT_NOT_NULL(memmem(dialogue.text, dialogue.size, "\"problem\"", strlen("\"problem\"")));
}

static void a_plant_that_hangs_up_is_told(void) {
    begin(TL_CONTROL_SHOW);
    say(TL_CONTROL_STATE, 0);
    tl_control_close(&peer);
    follow();
    TEST_ASSERT_EQUAL_INT(TL_HTTP_UNAVAILABLE, dialogue.status);
    TEST_ASSERT_EQUAL_STRING("failed", dialogue.result);
}

/* A client that reads nothing: the server stops reading from the plant. Complete lines are kept. */
static void what_nobody_takes_is_bounded(void) {
    char piece[4096];
    size_t taken = 0;
    begin(TL_CONTROL_APPLY);
    say(TL_CONTROL_STEP, TL_CONTROL_TRY);
    for (int i = 0; i < 100000 && peer.socket >= 0; i++) {
        tl_control_reply reply;
        memset(&reply, 0, sizeof reply);
        reply.kind = TL_CONTROL_PROBLEM;
        memset(reply.as.problem.text, 'x', sizeof reply.as.problem.text - 1);
        (void)tl_control_send(&peer, &reply, NULL);
        follow();
    }
    TEST_ASSERT_EQUAL_INT_MESSAGE(-1, peer.socket, "the plant could say all it wanted");
    TEST_ASSERT_FALSE(tl_dialogue_can_receive(&dialogue));
    TEST_ASSERT_LESS_OR_EQUAL_size_t(TL_DIALOGUE_MOST, dialogue.size);
    for (size_t now = 1; now > 0; taken += now) {
        now = tl_dialogue_take(&dialogue, piece, sizeof piece);
    }
    TEST_ASSERT_GREATER_THAN(TL_CONTROL_MOST / 2, taken);
    TEST_ASSERT_TRUE(tl_dialogue_can_receive(&dialogue));
    follow();
    TEST_ASSERT_TRUE(dialogue.has_ended);
}

static void who_is_not_there(void) {
    dialogue.request.control.verb = TL_CONTROL_SHOW;
    memcpy(dialogue.request.plant, "pump", sizeof "pump");
    tl_dialogue_begin(&dialogue, scratch.folder);
    TEST_ASSERT_EQUAL_INT(TL_HTTP_NOT_FOUND, dialogue.status);
    TEST_ASSERT_TRUE(dialogue.has_ended);
}

static void plants_are_those_with_a_socket(void) {
    TEST_ASSERT_EQUAL_INT(0, mkdir(tl_scratch_path(&scratch, "belt"), 0700));
    tl_dialogue_list_plants(&dialogue, scratch.folder);
    TEST_ASSERT_EQUAL_INT(TL_HTTP_OK, dialogue.status);
    TEST_ASSERT_EQUAL_STRING_LEN("{\"plants\":[\"motor\"]}\n", dialogue.text, dialogue.size);
    TEST_ASSERT_EQUAL_INT(0, rmdir(tl_scratch_path(&scratch, "belt")));
}

int main(void) {
    UNITY_BEGIN();
    tl_scratch_make(&scratch, "/tmp", "tl_dialogue");
    RUN_TEST(a_change_is_decided_behind_its_validation);
    RUN_TEST(a_refusal_has_all_its_problems);
    RUN_TEST(a_plant_that_hangs_up_is_told);
    RUN_TEST(what_nobody_takes_is_bounded);
    RUN_TEST(who_is_not_there);
    RUN_TEST(plants_are_those_with_a_socket);
    return tl_scratch_finish(&scratch, UNITY_END());
}
