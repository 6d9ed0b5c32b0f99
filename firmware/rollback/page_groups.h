/* Groups of pages, which versions of memory share (fmu_pages.h), and which share their pages.
 *
 * Purpose: a version is a list of groups, and a group a list of pages: who differs in one page has that page and its group for itself, and all else is others', too.
 * Written: who writes to a group or a page that has several owners gets one of its own first.
 * Memory:  asked for when something is put, or before (tl_page_groups_stock()); given back by tl_page_groups_close() only.
 * Thread:  one at a time.
 */
#ifndef TL_FIRMWARE_ROLLBACK_PAGE_GROUPS_H
#define TL_FIRMWARE_ROLLBACK_PAGE_GROUPS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/rollback/fmu_written.h"
#include "firmware/rollback/page_slots.h"

enum { TL_PAGE_GROUP = 64 }; /* pages in one */

/* Fields are private. */
typedef struct tl_page_groups {
    tl_page_slots contents; /* of pages */
    tl_page_slots groups;
    uint32_t zeros; /* a page of zeros; TL_NO_SLOT: not yet */
} tl_page_groups;

void tl_page_groups_open(tl_page_groups *self);

/* All are gone; it is as just opened. */
void tl_page_groups_close(tl_page_groups *self);

/* Groups that so many pages need. */
size_t tl_page_groups_of(size_t pages);

/* One that has no pages yet, with one owner. TL_NO_SLOT: no memory. */
uint32_t tl_page_groups_make(tl_page_groups *self);

/* One owner more; one less. */
void tl_page_groups_share(tl_page_groups *self, uint32_t group);
void tl_page_groups_drop(tl_page_groups *self, uint32_t group);

/* The bytes of a page; NULL: it has none yet. Two groups that share a page have it at the same place. */
const unsigned char *tl_page_groups_look(const tl_page_groups *self, uint32_t group, size_t page);

/* Other bytes for a page, in a group that is its caller's alone then: another one, if it had several owners. False: no memory, and nothing has changed that anybody can see. */
bool tl_page_groups_put(tl_page_groups *self, uint32_t *group, size_t page, const unsigned char *bytes);

/* Memory for versions to come: beside the first so many pages, so many more that differ, each at worst in a group of its own. False: there is none. */
bool tl_page_groups_stock(tl_page_groups *self, size_t first, size_t differing);

#endif
