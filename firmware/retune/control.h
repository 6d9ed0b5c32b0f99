/* The control socket of a plant: its messages, their words, the server's end and the client's.
 *
 * Thread:  one for each end.
 */
#ifndef TL_FIRMWARE_RETUNE_CONTROL_H
#define TL_FIRMWARE_RETUNE_CONTROL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/base/change.h"
#include "firmware/base/identity.h"
#include "master/base/simtime.h"
#include "master/base/status.h"

/* ---- What is said over a plant's control socket: every request and every reply there is.
 *
 * Purpose: who changes the configuration of a running plant, or asks how it is, does so by this socket (Unix, SOCK_SEQPACKET) and by
 *          nothing else: `twinlock reload` on the box, and twinlock-serve for who is on the network.
 * Course:  one request for each connection, with a candidate's text in memory that it hands over by descriptor if it has one; then replies, the last of which is
 *          TL_CONTROL_END. Every message has exactly the size of its struct, in this machine's own byte order.
 * Trust:   the server believes nothing of a request but its right, since only the plant's user and group may enter the socket's folder. The client believes no reply: each has a checked
 *          kind, and ends its texts within their room.
 * Thread:  plain data.
 */

enum {
    TL_CONTROL_PROTOCOL = 2,      /* the number of this protocol: both sides have the same */
    TL_CONTROL_MOST = 256 * 1024, /* bytes of a configuration's text */
    TL_CONTROL_NAME = 64,         /* of who asks, of a plant; with the NUL, as all texts */
    TL_CONTROL_WHY = 256,         /* what somebody wrote about a change */
    TL_CONTROL_PATH = 256,        /* a JSON path */
    TL_CONTROL_TEXT = 1024,       /* a sentence for people */
    TL_CONTROL_TIME = 32          /* "2026-11-23T10:02:03.456Z"; "": not known */
};

/* What is asked for. */
typedef enum tl_control_verb {
    TL_CONTROL_SHOW,     /* how the plant is: one STATE */
    TL_CONTROL_READ,     /* a version's text: one CONFIGURATION */
    TL_CONTROL_VERSIONS, /* all that are kept, newest first, then what was refused last: a VERSION each */
    TL_CONTROL_TAKE,     /* a new configuration: CHANGE, PROBLEM and STEP, as they come */
    TL_CONTROL_CONFIRM,  /* the one on probation is kept */
    TL_CONTROL_RETURN,   /* another version is brought back: by `version`, or the one before the active one */
    TL_CONTROL_VERBS
} tl_control_verb;

/* How a change is to be made. */
typedef enum tl_control_flag {
    TL_CONTROL_ONLY_CHECK = 1, /* all steps up to the activation, and not that */
    TL_CONTROL_MAY_RESTART =
        2, /* what cannot change while the plant's twin runs is changed by an end and a new start, with a gap */
    TL_CONTROL_BY_PERSON = 4,     /* kept only if somebody confirms it */
    TL_CONTROL_WAIT = 8,          /* replies go on until it is kept or returned; else until it is active */
    TL_CONTROL_ONLY_PENDING = 16, /* of RETURN: what is under way or on probation; if nothing is, nothing is done */
    TL_CONTROL_EVEN_WORSE = 32,   /* also if an output is worse than that of the run's twin, beside which it has run */
    TL_CONTROL_FLAGS = 63
} tl_control_flag;

typedef struct tl_control_request {
    uint32_t protocol;
    uint32_t verb; /* tl_control_verb */
    uint32_t
        right; /* tl_change_right that the caller has, or claims, at most TL_RIGHT_COMMISSION; the peer's own user may have less */
    uint32_t origin;      /* tl_change_origin, at most TL_ORIGIN_LIMITED */
    uint32_t flags;       /* tl_control_flag, of TAKE and RETURN */
    uint32_t probation_s; /* 0: as usual */
    uint32_t shadow_s;    /* for which a new twin runs beside the old one over live samples; 0: as usual */
    uint32_t unused;
    double require_lock;           /* percent of the probation's steps that must be in lock; < 0: as usual */
    uint64_t version;              /* of READ and RETURN: its number; 0: the active one, or the one before it */
    char hash[TL_SHA256_TEXT];     /* of the candidate */
    char if_match[TL_SHA256_TEXT]; /* of what is expected to be active; "": whatever is */
    char who[TL_CONTROL_NAME];     /* asks */
    char why[TL_CONTROL_WHY];
} tl_control_request;

typedef enum tl_control_kind {
    TL_CONTROL_STATE,
    TL_CONTROL_VERSION,
    TL_CONTROL_CONFIGURATION, /* a version, and its text in memory */
    TL_CONTROL_CHANGE,        /* one difference to what is active */
    TL_CONTROL_PROBLEM,       /* one thing that is wrong with the candidate */
    TL_CONTROL_STEP,          /* a step of the activation begins, or says something */
    TL_CONTROL_END,
    TL_CONTROL_KINDS
} tl_control_kind;

/* The steps of a change, in their order. */
typedef enum tl_control_step {
    TL_CONTROL_IDLE, /* none is under way */
    TL_CONTROL_AUTHORISE,
    TL_CONTROL_VALIDATE,
    TL_CONTROL_TRY,     /* its FMUs */
    TL_CONTROL_PREDICT, /* what it will cost */
    TL_CONTROL_SHADOW,  /* the new twin beside the old one: over recorded samples, then over live ones */
    TL_CONTROL_COMPARE, /* the two */
    TL_CONTROL_ACTIVATE,
    TL_CONTROL_PROBATION,
    TL_CONTROL_KEPT,
    TL_CONTROL_RETURNED, /* to the version before */
    TL_CONTROL_STEPS
} tl_control_step;

/* How a request ended. */
typedef enum tl_control_result {
    TL_CONTROL_DONE,      /* what was asked for is done; of a change: it is active, or kept if that was waited for */
    TL_CONTROL_SAME,      /* the candidate is what is active: nothing was done */
    TL_CONTROL_BAD,       /* no such request */
    TL_CONTROL_FORBIDDEN, /* who asks may not do that */
    TL_CONTROL_CHANGED,   /* what is active is not `if_match` */
    TL_CONTROL_INVALID,   /* the candidate is no good: PROBLEMs say why */
    TL_CONTROL_RESTART,   /* it needs TL_CONTROL_MAY_RESTART */
    TL_CONTROL_BUSY,      /* another change is under way */
    TL_CONTROL_ABSENT,    /* no such version; nothing is on probation */
    TL_CONTROL_FAILED,    /* it could not be done, and all is as it was */
    TL_CONTROL_UNDONE,    /* it was active, and has been returned from */
    TL_CONTROL_CANCELLED, /* somebody did not want it any more, before it was active */
    TL_CONTROL_RESULTS
} tl_control_result;

/* How a plant is. */
typedef struct tl_control_state {
    char plant[TL_CONTROL_NAME];
    char hash[TL_SHA256_TEXT]; /* of the active configuration */
    uint64_t version;          /* its number */
    uint32_t step;             /* tl_control_step of the change that is under way */
    uint32_t left_s;           /* of its probation */
    char lock[16];             /* "locked", …; "hold": safe hold; "": nothing runs */
    double step_s;             /* T_S */
    uint64_t ticks, steps, skipped, deadline_misses;
    double in_lock; /* percent of the run's steps */
    char line[512]; /* the status line */
} tl_control_state;

typedef struct tl_control_version {
    uint64_t version; /* its number, from 1 on; 0: of a candidate that was refused or cancelled, and never was one */
    uint64_t parent;  /* 0: none */
    uint32_t is_active;
    char hash[TL_SHA256_TEXT];
    char kind[16];   /* "in place", "new twin", "restart" */
    char origin[16]; /* "start", "reload", "limited", … */
    char right[16];  /* it was taken with */
    char who[TL_CONTROL_NAME];
    char why[TL_CONTROL_WHY];
    char at[TL_CONTROL_TIME];
    char result[TL_CONTROL_WHY]; /* "kept", "returned: in lock for 71 % of …" */
} tl_control_version;

typedef struct tl_control_change {
    char path[TL_CONTROL_PATH];
    char before[64]; /* "": it was not there */
    char after[64];  /* "": it is no more */
    char kind[16];
    char right[16]; /* that it needs */
} tl_control_change;

typedef struct tl_control_problem {
    uint32_t line; /* from 1; 0: none */
    char path[TL_CONTROL_PATH];
    char text[TL_CONTROL_TEXT]; /* what was found, what was expected, an example */
} tl_control_problem;

typedef struct tl_control_progress {
    uint32_t step; /* tl_control_step */
    uint32_t left_s;
    char text[TL_CONTROL_TEXT];
} tl_control_progress;

typedef struct tl_control_end {
    uint32_t result; /* tl_control_result */
    uint64_t version;
    char hash[TL_SHA256_TEXT]; /* of what is active now */
    char text[TL_CONTROL_TEXT];
} tl_control_end;

typedef struct tl_control_reply {
    uint32_t kind; /* tl_control_kind */
    uint32_t
        more; /* of CHANGE and PROBLEM: so many are there that were not told; of CONFIGURATION: bytes of the text */
    union {
        tl_control_state state;
        tl_control_version version; /* also of a CONFIGURATION */
        tl_control_change change;
        tl_control_problem problem;
        tl_control_progress progress;
        tl_control_end end;
    } as;
} tl_control_reply;

/* ---- The words for what is said over a control socket, as people, JSON and versions have them.
 *
 * Thread: pure.
 */

/* "authorise", "validate", …; "idle". */
const char *tl_control_step_name(tl_control_step step);

/* "done", "same", "bad request", "forbidden", …. */
const char *tl_control_result_name(tl_control_result result);

/* Beside the exit codes of a tl_status. */
enum { TL_CONTROL_NOT_PERMITTED = 77 };

/* The exit code of a program that has sent a request, such as `twinlock reload`. */
int tl_control_exit_code(tl_control_result result);

/* Logs a problem of `subject` as an error: "SUBJECT: line 7: PATH: what was found, what was expected". */
void tl_control_log_problem(const char *subject, const tl_control_problem *problem);

/* ---- Replies, all bytes of which are set: they go out whole. */

tl_control_reply tl_control_new_reply(tl_control_kind kind);

/* A text that does not fit is cut. */
tl_control_reply tl_control_new_end(tl_control_result result, uint64_t version, const char *hash, const char *text);

/* ---- A packet of a control socket: a message of an exact size, and memory that may come with it.
 *
 * Purpose: private to the room: what both ends do alike.
 * Trust:   whatever arrives may be of any size and may bring any descriptor. None of them stays open; of one that is handed over as text the bytes
 *          are copied if it is plain memory (memfd, tmpfs), where reading neither waits nor fails.
 * Thread:  one for each socket.
 */

/* Sends `size` bytes as one packet, with `length` bytes of text in memory unless `text` is NULL. False, and errno: it could not be. */
bool tl_control_packet_send(int socket, const void *bytes, size_t size, const char *text, size_t length);

/* ---- The answering end of a control socket.
 *
 * Purpose: the socket itself, and connections of which each asks once.
 * Trust:   what is asked has exactly its size, numbers that exist, texts that end. A candidate is copied out of
 *          memory (no file that could be slow, or change), and has the hash that the request names.
 * Waiting: never. A client that does not take its replies is given up.
 * Thread:  one; the listening socket may be handed to another process.
 */

enum { TL_CONTROL_CLIENTS = 16 }; /* at a time; others wait in the socket's queue */

/* Binds `path` and listens, in a folder that is made if it is missing. What is left of a dead socket is replaced, a living one is not. Mode 0660, and the
 * folder's 0770: who may ask is who may enter there, and he is believed the rights that he claims.
 * Errors: TL_TRY_AGAIN. */
tl_status tl_control_listen(const char *path, int *listener, tl_error *error);

/* True: somebody waits to be accepted. */
bool tl_control_is_knocked_at(int listener);

/* A connection. A zeroed one with socket −1 is none. */
typedef struct tl_control_peer {
    int socket;
    bool has_asked;
} tl_control_peer;

typedef enum tl_control_news {
    TL_CONTROL_NOTHING,
    TL_CONTROL_ASKED,   /* the request is there, and the candidate of a TAKE */
    TL_CONTROL_GARBAGE, /* something else; a peer that sends it is GONE */
    TL_CONTROL_GONE /* it is closed: by the other end, or since what it said was none, or nobody took what we said */
} tl_control_news;

/* The next one that waits; false: nobody does. */
bool tl_control_accept(int listener, tl_control_peer *peer);

/* Looks for its request. *size > 0: it came with so many bytes, which are in `text`, of TL_CONTROL_MOST + 1 bytes, with a NUL behind them: of a TAKE always,
 * of others never. A bad request is answered with TL_CONTROL_BAD. */
tl_control_news tl_control_receive(tl_control_peer *peer, tl_control_request *request, char *text, size_t *size);

/* Says something; all its bytes go out, so they are zeroed at first. `text`, of `more` bytes, is that of a TL_CONTROL_CONFIGURATION; NULL of all others.
 * False: the peer is gone, and closed. */
bool tl_control_send(tl_control_peer *peer, const tl_control_reply *reply, const char *text);

/* Says the last thing, and closes. None is allowed. */
void tl_control_finish(tl_control_peer *peer, tl_control_result result, uint64_t version, const char *hash,
                       const char *text);
void tl_control_close(tl_control_peer *peer);

/* ---- The asking end of a control socket.
 *
 * Purpose: a connection, one request, its replies.
 * Waiting: never for longer than it is told.
 * Errors:  TL_PLANT_DOWN if nobody is there; TL_BAD_DATA for a reply that is none; TL_TRY_AGAIN for time and resources.
 * Thread:  one, one client at a time.
 */

/* Where the plants of a box have their sockets: TL_CONTROL_FOLDER/NAME/control. */
#define TL_CONTROL_FOLDER "/run/twinlock"
#define TL_CONTROL_SOCKET "control"

/* A connected socket, which does not block and is closed on exec; the caller's to close. */
tl_status tl_control_connect(const char *path, int *socket, tl_error *error);

/* `protocol` and `hash` are filled in; `text` is what TAKE hands over, NULL of all others. */
tl_status tl_control_ask(int socket, const tl_control_request *request, const char *text, size_t size, tl_error *error);

/* The next reply, within `time` (ns; 0: if it is there). `text`, of TL_CONTROL_MOST + 1 bytes, is filled by a TL_CONTROL_CONFIGURATION: `more` bytes, and a NUL
 * behind them. All texts of a reply end. TL_TRY_AGAIN: none came in time. TL_PLANT_DOWN: the other end is gone before TL_CONTROL_END. */
tl_status tl_control_next(int socket, tl_time time, tl_control_reply *reply, char *text, tl_error *error);

#endif
