/* Connections: see connections.h. */
#include "firmware/serve/connections.h"

static const tl_time SAFE = TL_SECOND;

/* Number of connections of an address. */
static int count_of(const tl_connections *guests, const tl_address *address) {
    int count = 0;
    for (int i = 0; i < TL_CONNECTIONS; i++) {
        count += guests->rows[i].is_there && tl_address_is(&guests->rows[i].address, address) ? 1 : 0;
    }
    return count;
}

static int free_place(const tl_connections *guests) {
    for (int i = 0; i < TL_CONNECTIONS; i++) {
        if (!guests->rows[i].is_there) {
            return i;
        }
    }
    return -1;
}

/* Finds the oldest connection without a token, of the address with the most connections. `only`: of
 * this address; NULL: of any. */
static int find_stranger(const tl_connections *guests, const tl_address *only) {
    int found = -1;
    int most = 0;
    for (int i = 0; i < TL_CONNECTIONS; i++) {
        const tl_connection_entry *row = &guests->rows[i];
        if (!row->is_there || row->is_known || (only != NULL && !tl_address_is(&row->address, only))) {
            continue;
        }
        int count = count_of(guests, &row->address);
        if (found < 0 || count > most || (count == most && row->since < guests->rows[found].since)) {
            found = i;
            most = count;
        }
    }
    return found;
}

int tl_connections_admit(tl_connections *guests, const tl_address *address, tl_time now, int *gives_way) {
    int own = count_of(guests, address);
    bool has_all = own >= TL_CONNECTIONS_OF_ADDRESS;
    int place = has_all ? -1 : free_place(guests);
    *gives_way = -1;
    if (place >= 0) {
        guests->rows[place] =
            (tl_connection_entry){.is_there = true, .address = *address, .since = now, .deadline = TL_TIME_NEVER};
        return place;
    }
    int stranger = find_stranger(guests, has_all ? address : NULL);
    if (stranger >= 0) {
        const tl_connection_entry *row = &guests->rows[stranger];
        bool has_more = count_of(guests, &row->address) > own + 1;
        *gives_way = (!has_all && has_more) || now - row->since >= SAFE ? stranger : -1;
    }
    return -1;
}

void tl_connections_leave(tl_connections *guests, int place) {
    guests->rows[place].is_there = false;
}

int tl_connections_overdue(const tl_connections *guests, int place, tl_time now) {
    for (int i = place; i < TL_CONNECTIONS; i++) {
        const tl_connection_entry *row = &guests->rows[i];
        if (row->is_there && row->deadline != TL_TIME_NEVER && row->deadline <= now) {
            return i;
        }
    }
    return -1;
}

tl_time tl_connections_next(const tl_connections *guests) {
    tl_time least = TL_TIME_NEVER;
    for (int i = 0; i < TL_CONNECTIONS; i++) {
        const tl_connection_entry *row = &guests->rows[i];
        bool has_one = row->is_there && row->deadline != TL_TIME_NEVER;
        if (has_one && (least == TL_TIME_NEVER || row->deadline < least)) {
            least = row->deadline;
        }
    }
    return least;
}
