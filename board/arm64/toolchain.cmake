# Any 64-bit ARM box with Debian 12: the least that ARMv8-A has.
set(TL_MACHINE arm64)
set(TL_TRIPLET aarch64-linux-gnu)
set(TL_EMULATOR qemu-aarch64-static -cpu cortex-a53)
set(CMAKE_SYSTEM_PROCESSOR aarch64)
include("${CMAKE_CURRENT_LIST_DIR}/../debian/cross.cmake")
