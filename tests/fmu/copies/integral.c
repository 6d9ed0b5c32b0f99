/* Defines the number as a plain global. -DUNIQUE: as a unique symbol, like a static variable in an
 * inline C++ function. -DTLS=BYTES: as a thread-local variable in the static TLS block, with so
 * many further bytes. */
#include "tests/fmu/copies/integral.h"

#if defined(UNIQUE)
__asm__(".pushsection .bss\n"
        ".globl shared_by_all\n"
        ".type shared_by_all, %gnu_unique_object\n"
        ".size shared_by_all, 8\n"
        ".balign 8\n"
        "shared_by_all: .zero 8\n"
        ".popsection\n");
extern double shared_by_all;
#define INTEGRAL shared_by_all
#elif defined(TLS)
static __thread struct {
    double first;
    unsigned char rest[TLS];
} of_thread __attribute__((tls_model("initial-exec")));
#define INTEGRAL of_thread.first
#else
static double global;
#define INTEGRAL global
#endif

__attribute__((visibility("default"))) double *tl_integral(void) {
    return &INTEGRAL;
}
