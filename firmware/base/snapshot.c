/* A snapshot: a sequence lock over words; see snapshot.h. */
#include "firmware/base/snapshot.h"

#include <assert.h>
#include <string.h>

void tl_snapshot_publish(tl_snapshot *snapshot, const void *data, size_t size) {
    assert(size <= sizeof snapshot->words);
    const unsigned char *bytes = data;
    uint64_t sequence = __atomic_load_n(&snapshot->sequence, __ATOMIC_RELAXED);
    __atomic_store_n(&snapshot->sequence, sequence + 1, __ATOMIC_SEQ_CST);
    for (size_t i = 0; i * sizeof(uint64_t) < size; i++) {
        uint64_t word = 0;
        size_t rest = size - i * sizeof word;
        memcpy(&word, bytes + i * sizeof word, rest < sizeof word ? rest : sizeof word);
        __atomic_store_n(&snapshot->words[i], word, __ATOMIC_SEQ_CST);
    }
    __atomic_store_n(&snapshot->sequence, sequence + 2, __ATOMIC_SEQ_CST);
}

bool tl_snapshot_read(const tl_snapshot *snapshot, void *data, size_t size) {
    unsigned char *bytes = data;
    for (int attempt = 0; attempt < TL_SNAPSHOT_TRIES; attempt++) {
        uint64_t before = __atomic_load_n(&snapshot->sequence, __ATOMIC_SEQ_CST);
        for (size_t i = 0; i * sizeof(uint64_t) < size; i++) {
            uint64_t word = __atomic_load_n(&snapshot->words[i], __ATOMIC_SEQ_CST);
            size_t rest = size - i * sizeof word;
            memcpy(bytes + i * sizeof word, &word, rest < sizeof word ? rest : sizeof word);
        }
        if (before % 2 == 0 && before == __atomic_load_n(&snapshot->sequence, __ATOMIC_SEQ_CST)) {
            return true;
        }
    }
    return false;
}
