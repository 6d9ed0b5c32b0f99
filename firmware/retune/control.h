/* Control socket of a plant: message formats, names of enumerations, server side and client side.
 *
 * Terms:   the box is the computer that runs the twin. A *candidate* is a new configuration that a
 *          client has sent (not candidate values of u).
 * Thread:  one for each side.
 */
#ifndef TL_FIRMWARE_RETUNE_CONTROL_H
#define TL_FIRMWARE_RETUNE_CONTROL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/base/change.h"
#include "firmware/base/identity.h"
#include "firmware/base/json.h"
#include "master/base/simtime.h"
#include "master/base/status.h"

/* ---- Messages of a plant's control socket: all requests and replies.
 *
 * Purpose: clients use this socket (Unix, SOCK_SEQPACKET) to change the configuration of a running
 *          plant and to query its state. Clients are `twinlock reload` on the box, and
 *          twinlock-serve for the network.
 * Course:  a client sends one request per connection. A candidate's text comes with the request, as
 *          the descriptor of a memory file (memfd). Then the server sends replies; the last one is
 *          TL_CONTROL_END. Every message has exactly the size of its struct, in this machine's byte
 *          order.
 * Trust:   the server validates everything in a request except whether the client has the claimed
 *          right, because only the plant's user and group can enter the socket's folder. The client
 *          checks each reply and terminates its texts.
 * Texts:   UTF-8, with a final NUL.
 */

enum {
    TL_CONTROL_PROTOCOL = 2,      /* version of this protocol; both sides must have the same one */
    TL_CONTROL_MOST = 256 * 1024, /* maximum number of bytes of a configuration's text */
    TL_CONTROL_NAME = 64,         /* bytes of the name of a user or a plant; this and all sizes below include the NUL */
    TL_CONTROL_WHY = 256,         /* a user's reason for a change, or a result */
    TL_CONTROL_PATH = 256,        /* a JSON path */
    TL_CONTROL_TEXT = 1024,       /* a message for the user */
    TL_CONTROL_TIME = 32          /* "2026-11-23T10:02:03.456Z"; "": unknown */
};

/* Kind of a request. ROLL_BACK with version 0 cancels the change in progress. If there is none, it
 * restores the version before the active one, also without a probation. */
typedef enum tl_control_verb {
    TL_CONTROL_SHOW,      /* state of the plant: sends one STATE reply */
    TL_CONTROL_READ,      /* text of a version: sends one CONFIGURATION reply */
    TL_CONTROL_VERSIONS,  /* sends a VERSION reply for each saved version, newest first, then for each refused change */
    TL_CONTROL_APPLY,     /* a candidate: sends CHANGE, PROBLEM and STEP replies */
    TL_CONTROL_CONFIRM,   /* ends the probation and keeps its version */
    TL_CONTROL_ROLL_BACK, /* activates `version` again; 0: see above */
    TL_CONTROL_VERBS
} tl_control_verb;

/* Options of a change. */
typedef enum tl_control_flag {
    TL_CONTROL_ONLY_CHECK = 1, /* executes only the steps before TL_CONTROL_ACTIVATE */
    TL_CONTROL_MAY_RESTART =
        2, /* restarts the run, with a gap in the record, if the change is not possible without a restart */
    TL_CONTROL_MUST_CONFIRM = 4, /* the version is kept only if a user confirms it */
    TL_CONTROL_WAIT = 8,         /* replies until the version is kept or rolled back; default: until it is active */
    TL_CONTROL_ONLY_PENDING =
        16, /* of ROLL_BACK: does nothing if no change is in progress and no version on probation */
    TL_CONTROL_ACCEPT_WORSE =
        32, /* activates a candidate also if the comparison with the run's twin is "worse" (comparison.h) */
    TL_CONTROL_FLAGS = 63 /* all flags */
} tl_control_flag;

typedef struct tl_control_request {
    uint32_t protocol; /* TL_CONTROL_PROTOCOL */
    uint32_t verb;     /* tl_control_verb */
    uint32_t
        right; /* tl_change_right that the client claims, ≤ TL_RIGHT_COMMISSION; not checked against the peer's user */
    uint32_t origin;      /* tl_change_origin, at most TL_ORIGIN_LIMITED */
    uint32_t flags;       /* tl_control_flag, combined; for APPLY and ROLL_BACK */
    uint32_t probation_s; /* duration, s; 0: 300. With the right retune at least 2 × tl_verdict.window */
    uint32_t shadow_s;    /* seconds of live samples during which a new twin runs as a shadow, at most 3600; 0: 60 */
    uint32_t unused;      /* padding */
    double require_lock;  /* percent of the steps in lock, in comparison and probation, at most 100; < 0: 95 */
    uint64_t
        version; /* READ and ROLL_BACK: number of a version; 0: for READ the active version, for ROLL_BACK see above */
    char hash[TL_SHA256_TEXT];     /* SHA-256 of the candidate; "": no candidate */
    char if_match[TL_SHA256_TEXT]; /* SHA-256 of the configuration that must be active; "": any */
    char who[TL_CONTROL_NAME];     /* name of the user */
    char why[TL_CONTROL_WHY];      /* the user's reason */
} tl_control_request;

/* Kind of a reply. */
typedef enum tl_control_kind {
    TL_CONTROL_STATE,
    TL_CONTROL_VERSION,
    TL_CONTROL_CONFIGURATION, /* a version, with its text in a memory file */
    TL_CONTROL_CHANGE,        /* one difference between the candidate and the active configuration */
    TL_CONTROL_PROBLEM,       /* one error in the candidate */
    TL_CONTROL_STEP,          /* a step of the activation begins, or reports its progress */
    TL_CONTROL_END,           /* the result of the request */
    TL_CONTROL_KINDS
} tl_control_kind;

/* The steps of a change, in their order. */
typedef enum tl_control_step {
    TL_CONTROL_IDLE,      /* no change is in progress */
    TL_CONTROL_AUTHORISE, /* checks that the client may change anything, and `if_match` */
    TL_CONTROL_VALIDATE,  /* parses the candidate, finds the changes and checks the right that they need */
    TL_CONTROL_TRY,       /* tests the candidate's FMUs */
    TL_CONTROL_PREDICT,   /* forecasts the time and memory that its twin needs */
    TL_CONTROL_SHADOW,    /* runs the new twin as a shadow: over recorded samples, then over live ones */
    TL_CONTROL_COMPARE,   /* compares the shadow with the run's twin */
    TL_CONTROL_ACTIVATE,  /* makes the candidate the active version, on disk and in the run */
    TL_CONTROL_PROBATION, /* the version is active, and is kept or rolled back later (probation.h) */
    TL_CONTROL_KEPT,      /* the probation has ended, and the version stays active */
    TL_CONTROL_RETURNED,  /* rolled back to the version before */
    TL_CONTROL_STEPS
} tl_control_step;

/* Result of a request. */
typedef enum tl_control_result {
    TL_CONTROL_DONE,      /* success; a change is active, or kept if the client waited for that */
    TL_CONTROL_SAME,      /* the candidate is already active: nothing was done */
    TL_CONTROL_BAD,       /* the request is invalid */
    TL_CONTROL_FORBIDDEN, /* the client lacks the right */
    TL_CONTROL_CHANGED,   /* the active configuration is not `if_match` */
    TL_CONTROL_INVALID,   /* the candidate failed validation, trial or comparison; PROBLEMs list errors in it */
    TL_CONTROL_RESTART,   /* the change needs TL_CONTROL_MAY_RESTART */
    TL_CONTROL_BUSY,      /* another change is in progress */
    TL_CONTROL_ABSENT,    /* there is no such version, no version on probation, or nothing to roll back */
    TL_CONTROL_FAILED,    /* the change failed, and nothing has changed */
    TL_CONTROL_UNDONE,    /* the change was active, and was rolled back */
    TL_CONTROL_CANCELLED, /* a client cancelled the change before it was active */
    TL_CONTROL_RESULTS
} tl_control_result;

/* State of a plant. */
typedef struct tl_control_state {
    char plant[TL_CONTROL_NAME];
    char hash[TL_SHA256_TEXT]; /* of the active configuration */
    uint64_t version;          /* its number */
    uint32_t step;             /* tl_control_step of the change in progress, TL_CONTROL_PROBATION, or TL_CONTROL_IDLE */
    uint32_t left_s;           /* seconds that remain of the probation; 0: no probation */
    char lock[16];             /* lock state: "locked", …; "hold": safe hold; "": no twin runs */
    double step_s;             /* T_S, s */
    /* counts of the twin (run_status.h) */
    uint64_t ticks, steps, skipped, deadline_misses;
    double in_lock; /* percent of the evaluated steps that were locked or corrected */
    char line[512]; /* the status line */
} tl_control_state;

/* A saved version, or a refused change. */
typedef struct tl_control_version {
    uint64_t version;   /* its number, from 1; 0: a change that was refused or cancelled */
    uint64_t parent;    /* version that was active before; 0: none */
    uint32_t is_active; /* 0 or 1 */
    char hash[TL_SHA256_TEXT];
    char kind[16];   /* "in place", "new twin", "restart"; "": a refused change */
    char origin[16]; /* "start", "reload", "limited", … */
    char right[16];  /* right that the change needed, for example "commission"; "": a refused change */
    char who[TL_CONTROL_NAME];
    char why[TL_CONTROL_WHY];
    char at[TL_CONTROL_TIME];    /* when it was added or refused, UTC */
    char result[TL_CONTROL_WHY]; /* "kept", "returned: in lock in 71 % of …", "refused: …" */
} tl_control_version;

/* One difference between the active configuration and the candidate. Long values are truncated. */
typedef struct tl_control_change {
    char path[TL_CONTROL_PATH];
    char before[64]; /* "": the key was absent */
    char after[64];  /* "": the key is absent */
    char kind[16];   /* as in tl_control_version */
    char right[16];  /* right that this difference needs */
} tl_control_change;

typedef struct tl_control_problem {
    uint32_t line; /* from 1; 0: unknown */
    char path[TL_CONTROL_PATH];
    char text[TL_CONTROL_TEXT]; /* the value found, the value expected, an example */
} tl_control_problem;

typedef struct tl_control_progress {
    uint32_t step;   /* tl_control_step */
    uint32_t left_s; /* seconds that remain of the probation; 0: no probation */
    char text[TL_CONTROL_TEXT];
} tl_control_progress;

typedef struct tl_control_end {
    uint32_t result;            /* tl_control_result */
    uint64_t version;           /* version that is active now; 0: none, or the request was invalid */
    char hash[TL_SHA256_TEXT];  /* of its text */
    char text[TL_CONTROL_TEXT]; /* for the user */
} tl_control_end;

typedef struct tl_control_reply {
    uint32_t kind; /* tl_control_kind */
    uint32_t more; /* of the last CHANGE or PROBLEM: number of those not sent; of CONFIGURATION: bytes of the text */
    union {
        tl_control_state state;
        tl_control_version version; /* of a VERSION or a CONFIGURATION */
        tl_control_change change;
        tl_control_problem problem;
        tl_control_progress progress;
        tl_control_end end;
    } as;
} tl_control_reply;

/* ---- Names of enumerations, as in messages, JSON and versions.
 *
 * Thread:  pure.
 */

/* Returns "idle", "authorise", "validate", …. */
const char *tl_control_step_name(tl_control_step step);

/* Returns "done", "same", "bad request", "forbidden", …. */
const char *tl_control_result_name(tl_control_result result);

/* Exit code for TL_CONTROL_FORBIDDEN (EX_NOPERM); all others are those of a tl_status. */
enum { TL_CONTROL_NOT_PERMITTED = 77 };

/* Returns the exit code of a client program, such as `twinlock reload`, for this result. */
int tl_control_exit_code(tl_control_result result);

/* Adds the members of *state from `lock` on to an open JSON object. */
void tl_control_add_figures(tl_json_writer *json, const tl_control_state *state);

/* Logs a problem of `subject` as an error: "SUBJECT: line 7: PATH: value found, value expected". */
void tl_control_log_problem(const char *subject, const tl_control_problem *problem);

/* ---- Make a reply. The functions set all its bytes, because all bytes of a reply are sent. */

tl_control_reply tl_control_new_reply(tl_control_kind kind);

/* Makes a TL_CONTROL_END. A text that does not fit is truncated. */
tl_control_reply tl_control_new_end(tl_control_result result, uint64_t version, const char *hash, const char *text);

/* ---- Packet of a control socket: a message of an exact size, with or without the descriptor of a
 * memory file.
 *
 * Purpose: internal to control.c; both sides use it.
 * Trust:   a received packet may have any size and any descriptor. Each received descriptor is
 *          closed. A text is copied only from a memory file (memfd, tmpfs), because reading that
 *          neither blocks nor fails.
 * Thread:  one for each socket.
 */

/* Sends `size` bytes as one packet. Unless `text` is NULL, adds a memory file with `length` bytes
 * of it. Returns false and sets errno if sending fails. */
bool tl_control_packet_send(int socket, const void *bytes, size_t size, const char *text, size_t length);

/* ---- Server side of a control socket.
 *
 * Purpose: listens, and accepts connections with one request each.
 * Trust:   a request is accepted only if its size, its numbers and its texts are valid. A candidate
 *          is copied from a memory file, because a file on disk could be slow. Its hash must be
 *          that of the request.
 * Waiting: none. The server closes the connection of a client that does not read its replies.
 * Thread:  one; the listening socket may be passed to another process.
 */

enum { TL_CONTROL_CLIENTS = 16 }; /* most connections at a time; others wait in the socket's queue */

/* Binds `path` and listens; the caller closes *listener. If the last folder of the path is missing,
 * makes it with mode 0770. Replaces the socket of a process that has ended, but never one in use.
 * The socket has mode 0660. Every user who can enter the folder may send requests, and the claimed
 * right is trusted. Errors: TL_TRY_AGAIN; TL_BAD_USAGE if the path is too long. */
tl_status tl_control_listen(const char *path, int *listener, tl_error *error);

/* Returns true if a connection waits to be accepted. */
bool tl_control_has_connection(int listener);

/* A connection. `socket` is −1 if there is none. */
typedef struct tl_control_peer {
    int socket;
    bool has_asked; /* its request was received */
} tl_control_peer;

typedef enum tl_control_event {
    TL_CONTROL_NOTHING, /* nothing has arrived yet */
    TL_CONTROL_REQUEST, /* the request has arrived, with the candidate of an APPLY */
    TL_CONTROL_GARBAGE, /* an invalid packet; only inside of control.c, callers get TL_CONTROL_CLOSED */
    TL_CONTROL_CLOSED   /* closed by the peer, or because of an invalid packet or unread replies */
} tl_control_event;

/* Accepts the next connection. Returns false if there is none. */
bool tl_control_accept(int listener, tl_control_peer *peer);

/* Receives the request without blocking. `text` has TL_CONTROL_MOST + 1 bytes: it receives the
 * candidate, *size bytes and a final NUL. Every APPLY has a candidate; other requests have none
 * (*size 0). Answers an invalid or second request with TL_CONTROL_BAD and closes the connection. */
tl_control_event tl_control_receive(tl_control_peer *peer, tl_control_request *request, char *text, size_t *size);

/* Sends all bytes of a reply, so make it with tl_control_new_reply(). `text`: `more` bytes of a
 * TL_CONTROL_CONFIGURATION; NULL for all other kinds. If sending fails, closes the connection.
 * Returns false if the connection is closed or was closed before. */
bool tl_control_send(tl_control_peer *peer, const tl_control_reply *reply, const char *text);

/* Sends TL_CONTROL_END and closes the connection. A peer without a connection is allowed. */
void tl_control_finish(tl_control_peer *peer, tl_control_result result, uint64_t version, const char *hash,
                       const char *text);

/* Closes the connection without a reply. A peer without a connection is allowed. */
void tl_control_close(tl_control_peer *peer);

/* ---- Client side of a control socket.
 *
 * Purpose: connects, sends one request and receives its replies.
 * Waiting: at most the time that the caller passes.
 * Errors:  TL_PLANT_DOWN if no server answers or the connection is closed; TL_BAD_DATA for an
 *          invalid reply; TL_TRY_AGAIN if time or resources run out.
 * Thread:  one for each socket.
 */

/* Default paths of control sockets: TL_CONTROL_FOLDER/NAME/TL_CONTROL_SOCKET for the run NAME. */
#define TL_CONTROL_FOLDER "/run/twinlock"
#define TL_CONTROL_SOCKET "control"

/* Connects. The socket is nonblocking and close-on-exec; the caller closes it. Errors:
 * TL_PLANT_DOWN; TL_TRY_AGAIN if too many clients are connected. */
tl_status tl_control_connect(const char *path, int *socket, tl_error *error);

/* Sends a copy of the request with `protocol` and `hash` set. `text`: the candidate of an APPLY,
 * `size` bytes; NULL for all other requests. Errors: TL_TRY_AGAIN. */
tl_status tl_control_ask(int socket, const tl_control_request *request, const char *text, size_t size, tl_error *error);

/* Receives the next reply within `time` (ns, at most 1000 s; 0: only one that has arrived). With a
 * TL_CONTROL_CONFIGURATION, `text` receives `more` bytes and a final NUL. `text` has
 * TL_CONTROL_MOST + 1 bytes; NULL: no such reply is accepted. All texts of a reply are terminated.
 * Errors: TL_TRY_AGAIN if no reply came in time; TL_PLANT_DOWN if the server closed the connection
 * before TL_CONTROL_END; TL_BAD_DATA if the reply is invalid. */
tl_status tl_control_next(int socket, tl_time time, tl_control_reply *reply, char *text, tl_error *error);

#endif
