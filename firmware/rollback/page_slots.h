/* Pieces of memory of one size, each of which may have several owners.
 *
 * Purpose: what versions of memory share (fmu_pages.h) is kept once, and is free again when its last owner has let it go.
 * Memory:  grows by 256 slots at a time, when one is taken or before (tl_page_slots_stock()), and is not touched before; given back by tl_page_slots_close() only.
 * Thread:  one at a time.
 */
#ifndef TL_FIRMWARE_ROLLBACK_PAGE_SLOTS_H
#define TL_FIRMWARE_ROLLBACK_PAGE_SLOTS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define TL_NO_SLOT UINT32_MAX

/* Fields are private. */
typedef struct tl_page_slots {
    size_t size;            /* bytes of each, a multiple of 16 */
    uint32_t made;          /* slots that there are, */
    uint32_t taken;         /* of which the first so many were taken once, */
    uint32_t unused;        /* and nobody owns so many of these: */
    uint32_t first_unused;  /* each has the next one in its first bytes */
    unsigned char **pieces; /* each: how many owners its slots have, then the slots */
} tl_page_slots;

void tl_page_slots_open(tl_page_slots *self, size_t size);

/* All are gone; it is as just opened. */
void tl_page_slots_close(tl_page_slots *self);

/* So many can be taken without asking for memory. False: there is none. */
bool tl_page_slots_stock(tl_page_slots *self, uint32_t count);

/* A slot with one owner, its bytes being anything; TL_NO_SLOT: there is no memory. */
uint32_t tl_page_slots_take(tl_page_slots *self);

unsigned char *tl_page_slots_at(const tl_page_slots *self, uint32_t slot);

/* One owner more. */
void tl_page_slots_share(tl_page_slots *self, uint32_t slot);

/* One owner less. True: that was the last; the slot's bytes, but for the first four, are as they were until one is taken. */
bool tl_page_slots_drop(tl_page_slots *self, uint32_t slot);

bool tl_page_slots_has_one_owner(const tl_page_slots *self, uint32_t slot);

#endif
