/* Sensitivity of the matched outputs to the adjusted variables: which variables are identifiable.
 *
 * Purpose: a variable to which no matched output reacts gets no correction. Two variables whose
 *          effects are parallel share one correction, and only their sum is known. The user must
 *          know both, whatever the solver is.
 * Method:  the slope: change of each residual per `step` of each unknown. A solver that stores the
 *          slope provides it. Otherwise its column for an unknown is the difference of two
 *          candidates of one search that differ only in this unknown. All solvers evaluate such
 *          candidates, so no evaluation is added. The effect of a variable is the sum of the
 *          columns of its unknowns.
 * Window:  a result counts after TL_SENSITIVITY_TESTS tests in a row. A test is a step in which the
 *          columns are known. Nothing here changes a result of the search.
 * Thread:  the twin's. Memory: the arena, at start-up.
 */
#ifndef TL_MASTER_SYNC_SENSITIVITY_H
#define TL_MASTER_SYNC_SENSITIVITY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/arena.h"
#include "master/sync/horizon.h"

enum { TL_SENSITIVITY_TESTS = 10 };

/* Fields are private. */
typedef struct tl_sensitivity {
    const tl_horizon *horizon;
    const double *step;             /* of each unknown */
    size_t rows;                    /* samples of the horizon times matched outputs */
    double *slope;                  /* [row · unknowns + unknown]: change of a residual per step */
    int64_t *probed;                /* step in which the column of an unknown was measured */
    bool is_new;                    /* a column was measured since the last test */
    double *effects;                /* [variable · rows + row] */
    uint32_t unseen[TL_MAX_ADJUST]; /* tests in a row in which no output reacted */
    uint32_t alike[TL_MAX_ADJUST];  /* tests in a row in which another variable had a parallel effect */
    int64_t since[TL_MAX_ADJUST];   /* step of the first of these */
    uint32_t group;                 /* bits: the variables that were parallel in the last test */
} tl_sensitivity;

/* `step`: of each unknown; it must outlive the object. Returns false if memory is out. */
bool tl_sensitivity_init(tl_sensitivity *sensitivity, tl_arena *arena, const tl_horizon *horizon, const double *step,
                         size_t rows);

/* Compares two candidates of the search of step i, with the residuals of their samples. Measures a
 * column if they differ in exactly one unknown. */
void tl_sensitivity_probe(tl_sensitivity *sensitivity, int64_t i, const double *u, const double *other,
                          const double *residuals, const double *other_residuals);

/* Tests the columns after the search of step i. `slope`: from the solver, in the layout of the
 * field `slope`; NULL: uses the columns measured in this step or shortly before. A variable is
 * unseen if its effect is below `floor`, in tolerances. */
void tl_sensitivity_test(tl_sensitivity *sensitivity, int64_t i, const double *slope, double floor);

/* Bits of the variables to which no output reacts. (An unseen unknown of objective.h is another
 * case.) */
uint32_t tl_sensitivity_unseen(const tl_sensitivity *sensitivity);

/* Bits of the variables of one group with parallel effects; 0: none. *since: step of the first test
 * in a row that found them. */
uint32_t tl_sensitivity_alike(const tl_sensitivity *sensitivity, int64_t *since);

/* Drops all columns and results. */
void tl_sensitivity_forget(tl_sensitivity *sensitivity);

#endif
