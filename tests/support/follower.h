/* A follower: the smallest twin there is to be locked, with all that a cycle and a recorder want of it.
 *
 * Twin:   motor.y0 follows plant.speed by adjusting motor.u0 from 0; motor is a test FMU.
 * Use:    tl_follower_begin(), then what is other in FMU and plan, tl_follower_build(), then what is other in its configuration; tl_follower_end() also in
 *         tearDown().
 * Owner:  the caller places it (it is large: make it static), zero at first, and does not move it.
 * Errors: what does not go well fails the test.
 * Thread: one at a time.
 */
#ifndef TL_TESTS_SUPPORT_FOLLOWER_H
#define TL_TESTS_SUPPORT_FOLLOWER_H

#include "firmware/store/recorder.h"
#include "firmware/twin/assembly.h"
#include "tests/support/test_fmu.h"
#include "tests/support/test_plan.h"

typedef struct tl_follower {
    tl_test_log log; /* a violation of FMI is found by tl_follower_end() */
    tl_test_fmu fmu;
    tl_test_plan plan;
    tl_config_signal signal;
    tl_assembly assembly; /* of no file */
} tl_follower;

void tl_follower_begin(tl_follower *follower, tl_time step);

/* The same tolerance for every step; searches of 60 evaluations and a step at most. */
void tl_follower_build(tl_follower *follower, double tolerance);

/* How it is recorded: nothing is committed by time, and nothing is known of another configuration. Its texts are static, but for the path. */
tl_recorder_settings tl_follower_recording(const tl_follower *follower, const char *path);

/* Zeroed, or ended: nothing happens. */
void tl_follower_end(tl_follower *follower);

#endif
