/* A twin that takes over with other sources: where each signal is looked up, before and after. */
#include <math.h>
#include <string.h>

#include <unity.h>

#include "firmware/plant/mail_change.h"

enum { SIGNALS = 3, DEPTH = 256 };
enum { SAME, NEW, MOVED };

/* Two mails: the run's, and its own. */
typedef struct mail {
    tl_mailbox_slot slots[SIGNALS][DEPTH];
    uint64_t counts[SIGNALS];
    tl_mailbox mailboxes[SIGNALS];
} mail;

static mail of_run, own;
static tl_plant_input input;
static tl_mail_change change;
static tl_sample sample;

static void open_mail(mail *made) {
    memset(made, 0, sizeof *made);
    for (size_t i = 0; i < SIGNALS; i++) {
        made->mailboxes[i] = (tl_mailbox){.slots = made->slots[i], .count = &made->counts[i], .depth = DEPTH};
    }
}

void setUp(void) {
    const tl_same_signals same = {
        .count = SIGNALS, .of = {[SAME] = 0, [NEW] = TL_NO_SUCH_SIGNAL, [MOVED] = 1}, .unseen = 1};
    open_mail(&of_run);
    open_mail(&own);
    memset(&input, 0, sizeof input);
    input.count = SIGNALS;
    for (size_t i = 0; i < SIGNALS; i++) {
        input.mailboxes[i] = own.mailboxes[i];
        input.limits[i] = (tl_plant_limits){.minimum = -HUGE_VAL, .maximum = HUGE_VAL, .type = TL_REAL};
    }
    tl_mail_change_open(&change, &input, &same, of_run.mailboxes);
}

void tearDown(void) {}

static void post(mail *to, size_t signal, double value, tl_time stamp, tl_quality quality) {
    const tl_reading reading = {.value = value, .stamp = stamp, .quality = quality};
    tl_mailbox_post(&to->mailboxes[signal], &reading);
}

static void take(tl_time instant) {
    tl_mail_change_look(&change, instant);
    tl_plant_input_take(&input, 0, instant, &sample);
}

static void expect(size_t signal, double value, tl_quality quality) {
    TEST_ASSERT_EQUAL_DOUBLE(value, sample.values[signal]);
    TEST_ASSERT_EQUAL_INT(quality, sample.quality[signal]);
}

/* It sees what the run reads as well, and of the rest that there is nothing. */
static void test_beside(void) {
    post(&of_run, 0, 1.5, 1000, TL_GOOD);
    post(&of_run, 1, 2.5, 1000, TL_GOOD);
    post(&of_run, 2, 9.0, 1000, TL_GOOD);
    take(2000);
    expect(SAME, 1.5, TL_GOOD);
    expect(NEW, 0, TL_NO_LINK);
    expect(MOVED, 2.5, TL_GOOD);
}

/* Not before it is the run's, whatever lies in its own mail. */
static void test_not_before_the_flip(void) {
    post(&of_run, 0, 1.5, 1000, TL_GOOD);
    post(&own, SAME, 7.5, 1000, TL_GOOD);
    take(2 * TL_MAIL_CHANGE_LONGEST);
    expect(SAME, 1.5, TL_GOOD);
    TEST_ASSERT_FALSE(tl_mail_change_is_over(&change));
}

/* Each once it is read. */
static void test_one_after_the_other(void) {
    post(&of_run, 0, 1.5, 1000, TL_GOOD);
    post(&of_run, 1, 2.5, 1000, TL_GOOD);
    tl_mail_change_begin(&change, 2000);
    take(2000);
    expect(SAME, 1.5, TL_GOOD);
    post(&own, MOVED, 3.5, 2500, TL_GOOD);
    post(&own, NEW, 4.5, 2500, TL_GOOD);
    take(2400); /* a look at an instant before it was read */
    expect(MOVED, 2.5, TL_GOOD);
    take(3000);
    expect(SAME, 1.5, TL_GOOD);
    expect(NEW, 4.5, TL_GOOD);
    expect(MOVED, 3.5, TL_GOOD);
    TEST_ASSERT_FALSE(tl_mail_change_is_over(&change));
    post(&own, SAME, 5.5, 3000, TL_GOOD);
    take(4000);
    expect(SAME, 5.5, TL_GOOD);
    TEST_ASSERT_TRUE(tl_mail_change_is_over(&change));
    post(&of_run, 0, 6.5, 5000, TL_GOOD);
    take(6000);
    expect(SAME, 5.5, TL_GOOD);
}

/* Where a look is back in time, the reading has to be as old. */
static void test_a_look_back(void) {
    input.looks[SAME].back = 500;
    post(&of_run, 0, 1.5, 1000, TL_GOOD);
    post(&own, SAME, 5.5, 2000, TL_GOOD);
    tl_mail_change_begin(&change, 2100);
    take(2400);
    expect(SAME, 1.5, TL_GOOD);
    take(2500);
    expect(SAME, 5.5, TL_GOOD);
}

/* A device that does not answer the new io: what the old one has read last is not believed for long. */
static void test_never_read(void) {
    post(&of_run, 0, 1.5, 1000, TL_GOOD);
    post(&own, SAME, 0, 2500, TL_NO_LINK);
    tl_mail_change_begin(&change, 2000);
    take(3000);
    expect(SAME, 1.5, TL_GOOD);
    take(2000 + TL_MAIL_CHANGE_LONGEST - 1);
    expect(SAME, 1.5, TL_GOOD);
    take(2000 + TL_MAIL_CHANGE_LONGEST);
    expect(SAME, 0, TL_NO_LINK);
    expect(MOVED, 0, TL_NO_LINK);
    TEST_ASSERT_TRUE(tl_mail_change_is_over(&change));
}

static void test_none(void) {
    tl_mail_change none = {.input = NULL};
    TEST_ASSERT_TRUE(tl_mail_change_is_over(&none));
    tl_mail_change_begin(&none, 1000);
    tl_mail_change_look(&none, 2 * TL_MAIL_CHANGE_LONGEST);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_beside);
    RUN_TEST(test_not_before_the_flip);
    RUN_TEST(test_one_after_the_other);
    RUN_TEST(test_a_look_back);
    RUN_TEST(test_never_read);
    RUN_TEST(test_none);
    return UNITY_END();
}
