/* Shared memory and futexes: see forked_block.h. */
#include "firmware/forked/forked_block.h"

#include <limits.h>
#include <linux/futex.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

/* Looks before the kernel is asked to wake us: about as long as that takes. With one processor each look is in vain. */
enum { LOOKS = 2000, MS_PER_S = 1000, NS_PER_MS = 1000000 };

static size_t size_for(uint32_t slots) {
    return sizeof(tl_forked_block) + slots * sizeof(tl_forked_slot);
}

tl_forked_block *tl_forked_block_make(uint32_t slots) {
    /* cppcheck-suppress invalidFunctionArg ; an anonymous mapping has no file, which is -1 */
    tl_forked_block *made = mmap(NULL, size_for(slots), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (made == MAP_FAILED) {
        return NULL;
    }
    return made;
}

void tl_forked_block_free(tl_forked_block *block, uint32_t slots) {
    (void)munmap(block, size_for(slots));
}

/* What keeps time in 64 bits on machines of 32 is a call of its own; 100 ms fit into either. */
static void wait_in_kernel(const uint32_t *word, uint32_t old, unsigned patience_ms) {
    const struct {
        long seconds;
        long nanoseconds;
    } patience = {(long)(patience_ms / MS_PER_S), (long)(patience_ms % MS_PER_S) * NS_PER_MS};
    (void)syscall(SYS_futex, word, FUTEX_WAIT, old, patience_ms == 0 ? NULL : &patience, NULL, 0);
}

void tl_forked_wait(const uint32_t *word, uint32_t old, unsigned patience_ms) {
    static int looks = -1;
    if (looks < 0) {
        looks = sysconf(_SC_NPROCESSORS_ONLN) > 1 ? LOOKS : 0;
    }
    for (int i = 0; i < looks; i++) {
        if (__atomic_load_n(word, __ATOMIC_ACQUIRE) != old) {
            return;
        }
#if defined(__x86_64__) || defined(__i386__)
        __builtin_ia32_pause();
#endif
    }
    if (__atomic_load_n(word, __ATOMIC_ACQUIRE) == old) {
        wait_in_kernel(word, old, patience_ms);
    }
}

void tl_forked_wake(uint32_t *word) {
    (void)__atomic_add_fetch(word, 1, __ATOMIC_RELEASE);
    (void)syscall(SYS_futex, word, FUTEX_WAKE, INT_MAX, NULL, NULL, 0);
}
