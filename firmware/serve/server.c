/* The server's loop: see server.h. */
#include "firmware/serve/server.h"

#include <errno.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "firmware/base/clock.h"
#include "firmware/serve/server_parts.h"

/* The listener, all of libmicrohttpd, and of each visit its plant and, while it is suspended, itself. */
enum { FIXED = 2, DESCRIPTORS = FIXED + 2 * TL_GUESTS, AT_ONCE = 32, MESSAGES_A_SECOND = 5 };

/* ---- who comes ---- */

/* Its connection is closed within this call. */
static void put_out(tl_server *server, int place) {
    tl_visit *visit = &server->visits[place];
    (void)shutdown(visit->socket, SHUT_RDWR);
    server->guests.rows[place].deadline = TL_TIME_NEVER;
    if (visit->is_suspended) {
        tl_visit_audit(visit);
        tl_dialogue_close(&visit->dialogue);
        visit->dialogue.has_ended = true;
        visit->dialogue.status = TL_HTTP_TIMEOUT;
        tl_visit_resume(visit);
    }
    (void)MHD_run(server->daemon);
}

static int find_place(tl_server *server, const tl_address *address, tl_time now) {
    int gives_way = -1;
    int place = tl_guests_admit(&server->guests, address, now, &gives_way);
    if (place < 0 && gives_way >= 0) {
        put_out(server, gives_way);
        place = tl_guests_admit(&server->guests, address, now, &gives_way);
    }
    return place;
}

static void find_local(int socket, char text[TL_ADDRESS_TEXT]) {
    struct sockaddr_storage local;
    socklen_t size = sizeof local;
    memset(&local, 0, sizeof local);
    (void)getsockname(socket, (struct sockaddr *)&local, &size);
    tl_address_text((const struct sockaddr *)&local, text);
}

static void admit(tl_server *server, int socket, const struct sockaddr *from, socklen_t size) {
    tl_address address = tl_address_of(from);
    int place = find_place(server, &address, tl_clock_now(NULL));
    if (place < 0) {
        (void)close(socket);
        return;
    }
    tl_visit *visit = &server->visits[place];
    *visit = (tl_visit){.place = place, .socket = socket, .address = address, .dialogue = {.socket = -1}};
    tl_address_text(from, visit->from);
    find_local(socket, visit->local);
    server->arriving = place;
    if (MHD_add_connection(server->daemon, socket, from, size) != MHD_YES) {
        tl_guests_leave(&server->guests, place);
        return;
    }
    tl_visit_allow(server, visit, TL_VISIT_GREETING);
}

static void open_door(tl_server *server) {
    struct sockaddr_storage from;
    for (int i = 0; i < AT_ONCE; i++) {
        socklen_t size = sizeof from;
        int socket = accept4(server->settings.listener, (struct sockaddr *)&from, &size, SOCK_CLOEXEC | SOCK_NONBLOCK);
        if (socket < 0) {
            return;
        }
        admit(server, socket, (const struct sockaddr *)&from, size);
    }
}

/* ---- what is waited for ---- */

static size_t list_descriptors(const tl_server *server, struct pollfd list[DESCRIPTORS]) {
    size_t count = FIXED;
    list[0] = (struct pollfd){.fd = server->settings.listener, .events = POLLIN};
    list[1] = (struct pollfd){.fd = MHD_get_daemon_info(server->daemon, MHD_DAEMON_INFO_EPOLL_FD)->epoll_fd,
                              .events = POLLIN};
    for (int i = 0; i < TL_GUESTS; i++) {
        const tl_visit *visit = &server->visits[i];
        if (!server->guests.rows[i].is_there) {
            continue;
        }
        if (tl_dialogue_listens(&visit->dialogue)) {
            list[count++] = (struct pollfd){.fd = visit->dialogue.socket, .events = POLLIN};
        }
        if (visit->is_suspended) { /* libmicrohttpd does not look at it meanwhile */
            list[count++] = (struct pollfd){.fd = visit->socket, .events = POLLRDHUP};
        }
    }
    return count;
}

/* ms, at most `most` */
static int patience_of(const tl_server *server, tl_time most) {
    MHD_UNSIGNED_LONG_LONG wanted = 0;
    tl_time least = most;
    tl_time next = tl_guests_next(&server->guests);
    tl_time left = next == TL_TIME_NEVER ? most : next - tl_clock_now(NULL);
    least = left < least ? left : least;
    if (MHD_get_timeout(server->daemon, &wanted) == MHD_YES && wanted < (MHD_UNSIGNED_LONG_LONG)(most / 1000000)) {
        least = (tl_time)wanted * 1000000 < least ? (tl_time)wanted * 1000000 : least;
    }
    return least > 0 ? (int)((least + 999999) / 1000000) : 0;
}

/* ---- visits ---- */

static bool has_left(const tl_visit *visit) {
    struct pollfd one = {.fd = visit->socket, .events = POLLRDHUP};
    return poll(&one, 1, 0) > 0 && (one.revents & (POLLRDHUP | POLLHUP | POLLERR)) != 0;
}

static void follow(tl_server *server, tl_visit *visit) {
    tl_dialogue *dialogue = &visit->dialogue;
    tl_dialogue_follow(dialogue, server->room);
    if (!visit->is_suspended) {
        return;
    }
    bool can_begin = dialogue->status != 0 && (dialogue->size > 0 || dialogue->has_ended);
    if (can_begin) {
        tl_visit_allow(server, visit, TL_VISIT_TAKING);
        tl_visit_resume(visit);
    } else if (dialogue->status != 0) { /* all that there is has been taken: the plant has its time */
        tl_visit_allow(server, visit, TL_TIME_NEVER);
    }
    if (visit->is_suspended && has_left(visit)) {
        put_out(server, visit->place);
    }
}

static void follow_all(tl_server *server) {
    for (int i = 0; i < TL_GUESTS; i++) {
        if (server->guests.rows[i].is_there) {
            follow(server, &server->visits[i]);
        }
    }
}

/* A plant that does not answer is told of; a guest who does not go on is put out. */
static void end_overdue(tl_server *server) {
    tl_time now = tl_clock_now(NULL);
    for (int i = 0; (i = tl_guests_overdue(&server->guests, i, now)) >= 0; i++) {
        tl_visit *visit = &server->visits[i];
        if (visit->is_suspended && visit->dialogue.status == 0) {
            tl_dialogue_refuse(&visit->dialogue, TL_HTTP_TIMEOUT, TL_CONTROL_FAILED,
                               "the plant's twin has not answered in time; what was asked for may be done yet");
            tl_visit_allow(server, visit, TL_VISIT_TAKING);
            tl_visit_resume(visit);
        } else {
            put_out(server, i);
        }
    }
}

void tl_server_turn(tl_server *server, tl_time most) {
    struct pollfd list[DESCRIPTORS];
    size_t count = list_descriptors(server, list);
    if (poll(list, count, patience_of(server, most)) < 0 && errno != EINTR) {
        tl_log_limited(&server->says, TL_LOG_ERROR, "nothing can be waited for: %s", strerror(errno));
    }
    open_door(server);
    follow_all(server);
    end_overdue(server);
    (void)MHD_run(server->daemon);
}

/* ---- beginning and end ---- */

tl_status tl_server_open(const tl_server_settings *settings, tl_server **server, tl_error *error) {
    *server = calloc(1, sizeof **server);
    if (*server == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "out of memory");
    }
    (*server)->settings = *settings;
    (*server)->says = (tl_log_limiter)TL_LOG_LIMITER(MESSAGES_A_SECOND);
    tl_status status = tl_http_service_start(*server, error);
    if (status != TL_OK) {
        free(*server);
        *server = NULL;
    }
    return status;
}

void tl_server_close(tl_server *server) {
    if (server == NULL) {
        return;
    }
    for (int i = 0; i < TL_GUESTS; i++) {
        if (server->guests.rows[i].is_there) {
            put_out(server, i);
        }
    }
    MHD_stop_daemon(server->daemon);
    tl_log_limiter_end(&server->says);
    free(server);
}
