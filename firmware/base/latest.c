/* A latest-value register: a sequence lock (seqlock) over words; see latest.h. */
#include "firmware/base/latest.h"

#include <assert.h>
#include <string.h>

void tl_latest_publish(tl_latest *latest, const void *data, size_t size) {
    assert(size <= sizeof latest->words);
    const unsigned char *bytes = data;
    uint64_t writing =
        __atomic_load_n(&latest->sequence, __ATOMIC_RELAXED) | 1U; /* odd already if a writer died here */
    __atomic_store_n(&latest->sequence, writing, __ATOMIC_SEQ_CST);
    for (size_t i = 0; i * sizeof(uint64_t) < size; i++) {
        uint64_t word = 0;
        size_t rest = size - i * sizeof word;
        memcpy(&word, bytes + i * sizeof word, rest < sizeof word ? rest : sizeof word);
        __atomic_store_n(&latest->words[i], word, __ATOMIC_SEQ_CST);
    }
    __atomic_store_n(&latest->sequence, writing + 1, __ATOMIC_SEQ_CST);
}

bool tl_latest_read(const tl_latest *latest, void *data, size_t size) {
    unsigned char *bytes = data;
    for (int attempt = 0; attempt < TL_LATEST_TRIES; attempt++) {
        uint64_t before = __atomic_load_n(&latest->sequence, __ATOMIC_SEQ_CST);
        for (size_t i = 0; i * sizeof(uint64_t) < size; i++) {
            uint64_t word = __atomic_load_n(&latest->words[i], __ATOMIC_SEQ_CST);
            size_t rest = size - i * sizeof word;
            memcpy(bytes + i * sizeof word, &word, rest < sizeof word ? rest : sizeof word);
        }
        if (before % 2 == 0 && before == __atomic_load_n(&latest->sequence, __ATOMIC_SEQ_CST)) {
            return true;
        }
    }
    return false;
}
