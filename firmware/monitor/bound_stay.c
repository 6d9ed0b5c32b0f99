/* How long an adjusted variable has been at a bound: see bound_stay.h. */
#include "firmware/monitor/bound_stay.h"

static const double MOST = 0.5;
static const double LITTLE = 0.25;

static void judge(tl_bound_stay *stay) {
    uint64_t steps = 0;
    uint64_t there = 0;
    for (int i = 0; i < TL_BOUND_BLOCKS; i++) {
        steps += stay->steps[i];
        there += stay->there[i];
    }
    stay->share = steps == 0 ? 0.0 : (double)there / (double)steps;
    if (!stay->is_told && stay->passed == TL_BOUND_BLOCKS && stay->share > MOST) {
        stay->is_told = true;
        stay->turn = TL_BOUND_REACHED;
    } else if (stay->is_told && stay->share < LITTLE) {
        stay->is_told = false;
        stay->turn = TL_BOUND_LEFT;
    }
}

/* Blocks without a step are empty. */
static void go_on(tl_bound_stay *stay, int64_t block) {
    int64_t count = block - stay->block;
    for (int64_t i = 1; i <= count && i <= TL_BOUND_BLOCKS; i++) {
        stay->steps[(stay->block + i) % TL_BOUND_BLOCKS] = 0;
        stay->there[(stay->block + i) % TL_BOUND_BLOCKS] = 0;
    }
    stay->passed = count < TL_BOUND_BLOCKS - (int64_t)stay->passed ? stay->passed + (uint32_t)count : TL_BOUND_BLOCKS;
    stay->block = block;
}

void tl_bound_stay_step(tl_bound_stay *stay, tl_time time, bool is_there) {
    int64_t block = time / TL_BOUND_BLOCK;
    stay->turn = TL_BOUND_AS_BEFORE;
    stay->block = stay->has_begun ? stay->block : block; /* the first one of a run that goes on may be any */
    stay->has_begun = true;
    if (block > stay->block) {
        judge(stay);
        go_on(stay, block);
    }
    stay->steps[stay->block % TL_BOUND_BLOCKS]++;
    stay->there[stay->block % TL_BOUND_BLOCKS] += is_there ? 1 : 0;
}
