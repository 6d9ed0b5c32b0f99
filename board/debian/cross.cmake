# What the toolchains of boxes have in common: Debian's cross compiler, the sysroot that script/bootstrap --cross makes,
# and an emulator that runs what was built, if there is one. A toolchain sets before
#   TL_MACHINE   Debian's name of the machine      armhf
#   TL_TRIPLET   and GNU's                         arm-linux-gnueabihf
#   TL_EMULATOR  command before a program          qemu-arm-static -cpu cortex-a8
set(CMAKE_SYSTEM_NAME Linux)
set(CMAKE_C_COMPILER ${TL_TRIPLET}-gcc)
set(CMAKE_LIBRARY_ARCHITECTURE ${TL_TRIPLET})

cmake_path(SET CMAKE_SYSROOT NORMALIZE "${CMAKE_CURRENT_LIST_DIR}/../../.deps/sysroot/${TL_MACHINE}")
list(GET TL_EMULATOR 0 emulator)
find_program(emulator_path "${emulator}" NO_CACHE)
find_program(compiler_path "${CMAKE_C_COMPILER}" NO_CACHE)
if(NOT EXISTS "${CMAKE_SYSROOT}/.complete" OR NOT compiler_path)
    message(FATAL_ERROR "Missing compiler or libraries for ${TL_MACHINE}: run script/bootstrap --cross first "
        "(script/build does it for you).")
endif()

# The emulator looks into the sysroot for the files that a program opens, then at the machine's own.
if(emulator_path)
    set(CMAKE_CROSSCOMPILING_EMULATOR ${TL_EMULATOR} -L "${CMAKE_SYSROOT}")
endif()

# Libraries and headers are the box's, programs are this machine's.
set(CMAKE_FIND_ROOT_PATH_MODE_PROGRAM NEVER)
set(CMAKE_FIND_ROOT_PATH_MODE_LIBRARY ONLY)
set(CMAKE_FIND_ROOT_PATH_MODE_INCLUDE ONLY)
set(CMAKE_FIND_ROOT_PATH_MODE_PACKAGE ONLY)
set(ENV{PKG_CONFIG_SYSROOT_DIR} "${CMAKE_SYSROOT}")
set(ENV{PKG_CONFIG_LIBDIR} "${CMAKE_SYSROOT}/usr/lib/${TL_TRIPLET}/pkgconfig:${CMAKE_SYSROOT}/usr/share/pkgconfig")
