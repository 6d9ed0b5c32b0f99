/* Account of a twin: its names, units and counts as plain data.
 *
 * Purpose: recorder, report and summary need names, units and counts of a twin that may be in
 *          another process. That process may write anything into the account. So an account has no
 *          pointers, and its reader must call tl_account_is_sound() first.
 * Size:    fixed; about 33 KB.
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
    TL_ACCOUNT_TEXT = 128       /* bytes of a text, including the NUL; longer ones are cut */
};

/* Executions of one component; the plant is the last one. Fields as in tl_twin_ledger. */
typedef struct tl_account_component {
    char name[TL_ACCOUNT_TEXT];
    uint64_t plain;
    uint64_t predicted;
    uint64_t executions;
    uint64_t repeated;
    uint64_t uncached;
    uint32_t nodes_peak;
} tl_account_component;

typedef struct tl_account_match {
    char unit[TL_ACCOUNT_TEXT]; /* as the FMU declares it; "": none */
    tl_type type;
    tl_metrics metrics;
    tl_metrics readings; /* see tl_twin_readings() */
    tl_metrics released; /* see tl_twin_released() */
} tl_account_match;

typedef struct tl_account_adjust {
    char unit[TL_ACCOUNT_TEXT];
    tl_type type;
    double step, lower, upper, least, most; /* as in tl_twin_adjusted */
} tl_account_adjust;

/* As in tl_twin_bounds. */
typedef struct tl_account_signal {
    double least, most, scale;
    uint64_t items;
} tl_account_signal;

/* As in tl_twin_finding; `component` is "" if there is none. */
typedef struct tl_account_finding {
    char component[TL_ACCOUNT_TEXT];
    char variable[TL_ACCOUNT_TEXT]; /* "": the FMU failed */
    char unit[TL_ACCOUNT_TEXT];
    int64_t step;
    uint32_t after;
    uint32_t mended; /* tl_twin_repaired */
    uint32_t cause;  /* tl_restore_cause */
    double committed, again, tolerances;
} tl_account_finding;

typedef struct tl_account {
    uint32_t components;      /* at most TL_ACCOUNT_COMPONENTS */
    uint32_t matches;         /* at most TL_MAX_MATCH */
    uint32_t adjusts;         /* at most TL_MAX_ADJUST */
    uint32_t prediction;      /* T_P in use */
    tl_experiment experiment; /* as in tl_twin_facts; finite */
    uint32_t lead;            /* step i is computed at tick i + lead */
    uint8_t complete;         /* 1: `predicted` of the components is valid; 0: it is too high */
    uint8_t has_free_twin;    /* 1: the free-run check is on */
    uint64_t verified;        /* as in tl_twin_facts */
    uint64_t verified_executions;
    uint64_t differed;
    tl_free_twin_counts free_twin;
    uint32_t released_state; /* tl_released_state */
    uint32_t released_steps; /* R: steps of a release */
    tl_released_counts released;
    uint64_t replayed;          /* steps that rollback by replay executed again; no other count includes them */
    tl_account_finding finding; /* the newest finding */
    tl_twin_delay delay;
    char algorithm[TL_ACCOUNT_TEXT]; /* the solver in use; "": nothing is adjusted */
    char fallback[TL_ACCOUNT_TEXT];  /* the fallback solver; "": none */
    tl_account_component component[TL_ACCOUNT_COMPONENTS];
    tl_account_match match[TL_MAX_MATCH];
    tl_account_adjust adjust[TL_MAX_ADJUST];
    tl_account_signal signal[TL_MAX_SIGNALS];
} tl_account;

/* Fills the present account of a twin. Characters of names and units that cannot be displayed are
 * replaced by "?". */
void tl_account_take(const tl_twin *twin, tl_account *account);

/* Checks counts, the NUL and the characters of texts (text.h), enumerations, and that `experiment`
 * is finite. Does not check other numbers. */
bool tl_account_is_sound(const tl_account *account);

/* Executions of all components. */
uint64_t tl_account_executions(const tl_account *account);

#endif
