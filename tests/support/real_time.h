/* Real time, for tests with threads, devices and processes that run at the same time.
 *
 * Thread: any.
 */
#ifndef TL_TESTS_SUPPORT_REAL_TIME_H
#define TL_TESTS_SUPPORT_REAL_TIME_H

#include "master/base/simtime.h"

/* CLOCK_MONOTONIC, ns. */
tl_time tl_test_now(void);

void tl_test_pause_ms(long ms);

#endif
