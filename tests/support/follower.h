/* Follower: the smallest twin that can be locked, with the assembly that a cycle and a recorder
 * need.
 *
 * Twin:   motor.y0 follows plant.speed; motor.u0 is adjusted, from 0. motor is a test FMU.
 * Use:    tl_follower_begin(); the test changes FMU and plan; tl_follower_build(); the test changes
 *         the configuration. Call tl_follower_end() at the end and in tearDown().
 * Owner:  the caller provides the memory, zeroed at first, and must not move it; it is large, so
 *         make it static.
 * Errors: any error fails the test.
 * Thread: one at a time.
 */
#ifndef TL_TESTS_SUPPORT_FOLLOWER_H
#define TL_TESTS_SUPPORT_FOLLOWER_H

#include "firmware/store/recorder.h"
#include "firmware/twin/assembly.h"
#include "tests/support/test_fmu.h"
#include "tests/support/test_plan.h"

typedef struct tl_follower {
    tl_test_log log; /* if it has a violation of FMI, tl_follower_end() fails the test */
    tl_test_fmu fmu;
    tl_test_plan plan;
    tl_config_signal signal;
    tl_assembly assembly; /* not read from a file */
} tl_follower;

void tl_follower_begin(tl_follower *follower, tl_time step);

/* Builds the twin. A search has at most 60 evaluations and the time of one step. */
void tl_follower_build(tl_follower *follower, double tolerance);

/* Returns settings for a recorder, without a commit interval and without other configurations. All
 * texts except `path` are static. */
tl_recorder_settings tl_follower_recording(const tl_follower *follower, const char *path);

/* Does nothing if the follower is zeroed or has ended. */
void tl_follower_end(tl_follower *follower);

#endif
