/* Sets one value of an emulated Modbus device; the other values do not change. */
#ifndef TL_TESTS_SUPPORT_DEVICE_VALUE_H
#define TL_TESTS_SUPPORT_DEVICE_VALUE_H

#include <unity.h>

#include "firmware/cli/plant_server.h"

/* Call it in one thread at a time. A channel that the device does not have is ignored. */
static inline void tl_test_set_value(tl_plant_server *device, size_t channel, double value) {
    enum { MOST = 4096 }; /* channels of a device */
    static double values[MOST];
    static bool present[MOST];
    TEST_ASSERT_LESS_THAN_size_t(MOST, channel);
    values[channel] = value;
    present[channel] = true;
    tl_plant_server_set_all(device, values, present);
    present[channel] = false;
}

#endif
