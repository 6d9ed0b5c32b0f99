/* Networks at random that can be synchronised: chains, branches, loops, components that matter to nothing.
 *
 * Purpose: campaigns over many graphs. 2 to 12 components; Real, Integer and Boolean connections, with conversions of units and
 *          without; signals of the plant, also where they are adjusted; 1 to 3 variables to adjust (numbers, one in
 *          four a tunable parameter; in every fifth network flags), 1 to 3 matched outputs, some of them without weight.
 * Exact:   whatever reaches a component can be told from its outputs, so that the ledger must be exact. Else there are also
 *          flags on ways of their own, behind which a difference ends as soon as the flag is the same again.
 * Thread:  one at a time.
 */
#ifndef TL_TESTS_SUPPORT_RANDOM_NETWORK_H
#define TL_TESTS_SUPPORT_RANDOM_NETWORK_H

#include "tests/support/random_numbers.h"
#include "tests/support/test_network.h"

/* A network and its plan: built, but for T_P, shape, solver and what is saved. What the network was before is ended; it
 * may be all zero. */
void tl_test_random_network(tl_test_network *network, tl_test_plan *plan, tl_test_log *log, tl_test_random *random,
                            bool exact);

/* A value for a variable of the network that is adjusted: often one that is the same as another. */
double tl_test_random_value(const tl_test_network *network, tl_test_random *random);

#endif
