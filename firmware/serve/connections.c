/* Connections: see connections.h. */
#include "firmware/serve/connections.h"

static const tl_time SAFE = TL_SECOND;

/* Number of connections of an address. */
static int count_of(const tl_connections *connections, const tl_address *address) {
    int count = 0;
    for (int i = 0; i < TL_CONNECTIONS; i++) {
        count += connections->rows[i].is_there && tl_address_is(&connections->rows[i].address, address) ? 1 : 0;
    }
    return count;
}

static int free_index(const tl_connections *connections) {
    for (int i = 0; i < TL_CONNECTIONS; i++) {
        if (!connections->rows[i].is_there) {
            return i;
        }
    }
    return -1;
}

/* Finds the oldest connection without a token, of the address with the most connections. `only`: of
 * this address; NULL: of any. */
static int find_evictable(const tl_connections *connections, const tl_address *only) {
    int found = -1;
    int most = 0;
    for (int i = 0; i < TL_CONNECTIONS; i++) {
        const tl_connection_entry *row = &connections->rows[i];
        if (!row->is_there || row->is_known || (only != NULL && !tl_address_is(&row->address, only))) {
            continue;
        }
        int count = count_of(connections, &row->address);
        if (found < 0 || count > most || (count == most && row->since < connections->rows[found].since)) {
            found = i;
            most = count;
        }
    }
    return found;
}

int tl_connections_admit(tl_connections *connections, const tl_address *address, tl_time now, int *evicted) {
    int own = count_of(connections, address);
    bool has_all = own >= TL_CONNECTIONS_OF_ADDRESS;
    int index = has_all ? -1 : free_index(connections);
    *evicted = -1;
    if (index >= 0) {
        connections->rows[index] =
            (tl_connection_entry){.is_there = true, .address = *address, .since = now, .deadline = TL_TIME_NEVER};
        return index;
    }
    int oldest = find_evictable(connections, has_all ? address : NULL);
    if (oldest >= 0) {
        const tl_connection_entry *row = &connections->rows[oldest];
        bool has_more = count_of(connections, &row->address) > own + 1;
        *evicted = (!has_all && has_more) || now - row->since >= SAFE ? oldest : -1;
    }
    return -1;
}

void tl_connections_leave(tl_connections *connections, int index) {
    connections->rows[index].is_there = false;
}

int tl_connections_overdue(const tl_connections *connections, int first, tl_time now) {
    for (int i = first; i < TL_CONNECTIONS; i++) {
        const tl_connection_entry *row = &connections->rows[i];
        if (row->is_there && row->deadline != TL_TIME_NEVER && row->deadline <= now) {
            return i;
        }
    }
    return -1;
}

tl_time tl_connections_next(const tl_connections *connections) {
    tl_time least = TL_TIME_NEVER;
    for (int i = 0; i < TL_CONNECTIONS; i++) {
        const tl_connection_entry *row = &connections->rows[i];
        bool has_one = row->is_there && row->deadline != TL_TIME_NEVER;
        if (has_one && (least == TL_TIME_NEVER || row->deadline < least)) {
            least = row->deadline;
        }
    }
    return least;
}
