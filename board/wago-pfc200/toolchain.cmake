# WAGO PFC200 and whatever else runs Debian's armhf programs: an ARM Cortex-A8 with NEON, 32 bits, one core.
#
# time_t has 4 bytes there, as in all of Debian 12's armhf: -D_TIME_BITS=64 would break the binary interface of its
# libraries (libgpiod's timeouts). Our own time is int64 nanoseconds.
set(TL_MACHINE armhf)
set(TL_TRIPLET arm-linux-gnueabihf)
set(TL_EMULATOR qemu-arm-static -cpu cortex-a8) # refuses instructions that the box has not
set(CMAKE_SYSTEM_PROCESSOR armv7l)
set(CMAKE_C_FLAGS_INIT "-mcpu=cortex-a8 -mfpu=neon -mfloat-abi=hard")
include("${CMAKE_CURRENT_LIST_DIR}/../debian/cross.cmake")
