/* Makes random networks that can be synchronised: chains, branches, loops, and components without
 * effect on a matched output.
 *
 * Purpose: campaigns over many graphs. A network has 2 to 12 components, and Real, Integer and
 *          Boolean connections, some with a conversion of units. It has signals of the plant; an
 *          input that such a signal drives may also be adjusted. It has 1 to 3 adjusted variables:
 *          in one of five networks Booleans, else numbers, of which one in four is a tunable
 *          parameter. It has 1 to 3 matched outputs, some with weight 0.
 * Exact:   if `exact`, each difference of a component's inputs shows in its outputs, so the ledger
 *          must be exact. Otherwise a Boolean may be the only connection between two components.
 *          A difference does not pass it while the Boolean has the same value.
 * Thread:  one at a time.
 */
#ifndef TL_TESTS_SUPPORT_RANDOM_NETWORK_H
#define TL_TESTS_SUPPORT_RANDOM_NETWORK_H

#include "tests/support/random_numbers.h"
#include "tests/support/test_network.h"

/* Makes a network and its plan. The plan is complete except T_P, shape, solver and `saving`. Ends
 * the previous network; a zeroed one is allowed. */
void tl_test_random_network(tl_test_network *network, tl_test_plan *plan, tl_test_log *log, tl_test_random *random,
                            bool exact);

/* Returns a random value for an adjusted variable of the network: a Boolean, or a number that is
 * often 0, −0 or 1. */
double tl_test_random_value(const tl_test_network *network, tl_test_random *random);

#endif
