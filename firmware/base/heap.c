/* How much memory is allocated: see heap.h. */
#include "firmware/base/heap.h"

#include <malloc.h>

size_t tl_heap_used(void) {
    struct mallinfo2 heap = mallinfo2();
    return heap.uordblks + heap.hblkhd;
}
