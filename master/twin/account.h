/* The account of a twin: what is known of it, as plain data.
 *
 * Purpose: whoever tells of a run (recorder, report, summary) needs names, units and counts, not the twin. The twin may live in another
 *          process, whose memory is an enemy's; so there are no pointers in here, texts end within their arrays, and
 *          tl_account_is_sound() says whether an account is one.
 * Size:    fixed; some 10 KB.
 * Thread:  plain data.
 */
#ifndef TL_MASTER_TWIN_ACCOUNT_H
#define TL_MASTER_TWIN_ACCOUNT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/signal.h"
#include "master/twin/twin.h"

enum {
    TL_ACCOUNT_COMPONENTS = 64, /* FMUs and the plant; further ones are left out */
    TL_ACCOUNT_TEXT = 128       /* bytes of a name or a unit, cut */
};

/* What one component was executed for; the plant is the last one. As in tl_twin_ledger. */
typedef struct tl_account_component {
    char name[TL_ACCOUNT_TEXT];
    uint64_t plain;
    uint64_t predicted;
    uint64_t executions;
    uint64_t caught_up;
    uint64_t unstored;
    uint32_t nodes_peak;
} tl_account_component;

typedef struct tl_account_match {
    char unit[TL_ACCOUNT_TEXT]; /* as the FMU declares it; "": it does not */
    tl_type type;
    tl_metrics metrics;
    tl_metrics readings; /* as tl_twin_readings() */
} tl_account_match;

typedef struct tl_account_adjust {
    char unit[TL_ACCOUNT_TEXT];
    tl_type type;
    double step, lower, upper, least, most; /* as in tl_twin_adjusted */
} tl_account_adjust;

/* As in tl_twin_finding. */
typedef struct tl_account_finding {
    char component[TL_ACCOUNT_TEXT];
    char variable[TL_ACCOUNT_TEXT]; /* "": the FMU failed */
    char unit[TL_ACCOUNT_TEXT];
    int64_t step;
    uint32_t after;
    uint32_t mended; /* tl_twin_mended */
    uint32_t cause;  /* tl_restore_cause */
    double committed, again, tolerances;
} tl_account_finding;

typedef struct tl_account {
    uint32_t components;   /* at most TL_ACCOUNT_COMPONENTS */
    uint32_t matches;      /* at most TL_MAX_MATCH */
    uint32_t adjusts;      /* at most TL_MAX_ADJUST */
    uint32_t prediction;   /* T_P in force */
    uint32_t lead;         /* step i is computed at tick i + lead */
    uint8_t complete;      /* 1: the ledger is; 0: what it predicts is too high */
    uint8_t has_free_twin; /* 1: one was led beside */
    uint64_t verified;     /* as in tl_twin_facts, */
    uint64_t verified_executions;
    uint64_t differed;
    tl_free_twin_counts free_twin;
    uint64_t replayed;          /* steps by which FMUs were led back by replay, which no other count has */
    tl_account_finding finding; /* the newest of these */
    tl_twin_delay delay;
    char algorithm[TL_ACCOUNT_TEXT]; /* the solver in force; "": nothing is adjusted */
    char fallback[TL_ACCOUNT_TEXT];
    tl_account_component component[TL_ACCOUNT_COMPONENTS];
    tl_account_match match[TL_MAX_MATCH];
    tl_account_adjust adjust[TL_MAX_ADJUST];
} tl_account;

/* The account of this twin as it stands. What cannot be shown of names and units is "?" in it. */
void tl_account_take(const tl_twin *twin, tl_account *account);

/* Counts within their arrays; texts that end and can be shown (text.h); types and states that exist. Numbers are not judged. */
bool tl_account_is_sound(const tl_account *account);

/* Executions of all components. */
uint64_t tl_account_executions(const tl_account *account);

#endif
