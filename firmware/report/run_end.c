/* The end of a run as its twin tells it: see run_end.h. */
#include "firmware/report/run_end.h"

/* Its names are pointers, which are filled in by who prints it. */
static bool has_no_pointers(const tl_run_figures *figures) {
    return figures->ledger_count == 0;
}

bool tl_run_end_is_sound(const tl_summary *summary, const tl_account *account, const tl_config *config) {
    bool fits = account->components == config->component_count + 1 && account->matches == config->match_count &&
                account->adjusts == config->adjust_count;
    bool goes_on = (unsigned)summary->resumption.from <= (unsigned)TL_RESUMED_INPUTS;
    bool judged = (unsigned)summary->lock.state < (unsigned)TL_LOCK_STATES;
    return fits && judged && goes_on && has_no_pointers(&summary->figures) && tl_account_is_sound(account);
}
